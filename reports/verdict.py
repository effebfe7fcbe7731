"""What matters most of a flight, in a sentence: who was lost, when, and the likeliest cause that
the record shows.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from laisn.arrays import Bools, Floats
from laisn.metrics import mirror_locked_steps, nees
from sim.cautions import Navigated, assumption_cautions
from sim.flight import FlightRecord, Termination, position_and_bearing_errors
from sim.scenario.links import LEADER_LINK
from sim.tracking import JOINED_M, LOST_M, contacts

_BEFORE_S = 120.0  # causes are sought in this time before a loss
# least silence that is a cause: the longer of these [message intervals] and [s]
_SILENCE_MESSAGES = 5.0
_SILENCE_S = 10.0
_TURN_DEG = 45.0  # least turn of the leader that is named
# an error of the estimate below this share of the distance off the route or station is no cause
_RIGHT_SHARE = 0.3
_LOCKED_SHARE = 0.5  # least share of the time within `_LOCKED_S` of a loss that is a cause
_LOCKED_S = 20.0
_OVERCONFIDENT_NEES = 20.0  # mean NEES above this: the filter is surer than right (2: consistent)
_NO_CAUSE = "the record shows no single cause"
_MAX_NAMED_FOLLOWERS = 4  # most followers that the sentence names


@dataclass(frozen=True, kw_only=True)
class Loss:
    """A follower that was lost, and why."""

    follower: str
    time_s: float  # when it first was
    what: str  # in what respect: "more than 10 m off its station", and so on
    cause: str
    silence_s: float  # longest time without a message shortly before [s]


@dataclass(frozen=True, kw_only=True)
class Verdict:
    sentence: str
    lost: tuple[Loss, ...]

    def table(self) -> dict[str, Any]:
        """As `summary.json` holds it."""
        return {"sentence": self.sentence, "lost": [asdict(loss) for loss in self.lost]}


@dataclass(frozen=True, kw_only=True)
class Silence:
    """The longest time without a message in a stretch of the mission."""

    begin_s: float
    end_s: float
    turn_deg: float  # between the leader's extreme headings during it

    @property
    def length_s(self) -> float:
        return self.end_s - self.begin_s


def longest_silence(flight: FlightRecord, follower: int, begin_s: float, end_s: float) -> Silence:
    """The longest time without a received message of a follower that ends after `begin_s`, until
    `end_s` at most.
    """
    measurements = flight.measurements[follower]
    truth = flight.trajectory
    start = float(truth.time[0])
    received = start + measurements.time[measurements.message_step - 1]
    # with a range; the fields of a message alone give no position
    heard_times = received[np.isfinite(measurements.ranges).any(axis=1)]
    times = np.concatenate([[start], heard_times[heard_times <= end_s], [end_s]])
    spans = np.where(times[1:] > begin_s, np.diff(times), 0.0)
    longest = int(np.argmax(spans))
    begin, end = float(times[longest]), float(times[longest + 1])
    is_silent = (truth.time >= begin) & (truth.time <= end)
    headings = np.unwrap(truth.heading[is_silent, 0])
    turn = math.degrees(float(np.ptp(headings))) if headings.size else 0.0
    return Silence(begin_s=begin, end_s=end, turn_deg=turn)


def _silence_text(silence: Silence) -> str:
    turn = (
        f", in which the leader turned by {silence.turn_deg:.0f}°"
        if silence.turn_deg > _TURN_DEG
        else ""
    )
    return (
        f"no message for {silence.length_s:.0f} s ({silence.begin_s:.0f} s to "
        f"{silence.end_s:.0f} s){turn}"
    )


def _is_locked(flight: FlightRecord, follower: int, time: Floats, loss_s: float) -> bool:
    """Whether the estimate was at the mirror image for most of the time around a loss, of one that
    navigates on the leader's messages; `time` of the filter steps, shape (n,), [s].
    """
    if flight.scenario.navigation_of(follower).link != LEADER_LINK:
        return False
    steps = flight.step_index()
    truth = flight.trajectory
    locked = mirror_locked_steps(
        flight.estimates[follower].state[:, :2],
        flight.hydrophone(follower)[:, :2],
        truth.position[steps, 0, :2],
        truth.heading[steps, 0],
    )
    near_loss = np.abs(time - loss_s) <= _LOCKED_S
    return bool(locked[near_loss].mean() > _LOCKED_SHARE)


def _first_true(condition: Bools) -> int | None:
    return int(np.argmax(condition)) if condition.any() else None


def _loss(
    flight: FlightRecord, follower: int, errors: Floats, track_error: Floats
) -> tuple[float, str] | None:
    """When a follower was first lost [s], and in what respect; None if it was not.

    `errors` of its estimate at filter steps, `track_error` off its route or station at all
    instants of the trajectory [m].

    On a station, or steering by its estimate, its place counts; on a route the estimate.
    """
    plan = flight.scenario.followers[follower]
    time = flight.trajectory.time
    # a controller of the user's own has its own idea of where to go
    by_estimate = plan.guided_by_estimate and not plan.controller
    if plan.station is not None or by_estimate:
        joined_step = _first_true(track_error < JOINED_M) if plan.station is not None else 0
        target = "station" if plan.station is not None else "route"
        if joined_step is None:
            return float(time[-1]), f"never reached its {target}"
        left_step = _first_true(track_error[joined_step:] > LOST_M)
        if left_step is not None:
            return float(time[joined_step + left_step]), f"more than {LOST_M:g} m off its {target}"
    lost_step = _first_true(errors > LOST_M)
    if lost_step is None:
        return None
    return float(time[flight.step_index()][lost_step]), f"its estimate more than {LOST_M:g} m off"


def _cause(
    flight: FlightRecord, follower: int, loss_s: float, errors: Floats, track_error: Floats
) -> str:
    """The likeliest cause of a loss that the record shows; arguments as of `_loss`."""
    steps = flight.step_index()
    time = flight.trajectory.time[steps]
    step = min(int(np.searchsorted(time, loss_s)), time.size - 1)
    error = float(errors[step])
    plan = flight.scenario.followers[follower]
    distance_off = float(track_error[min(int(steps[step]), track_error.size - 1)])
    if plan.guided_by_estimate and error < _RIGHT_SHARE * distance_off:
        speed = float(flight.trajectory.forward_speed[steps[step], follower + 1])
        return (
            f"not its estimate, which was {error:.1f} m off, but its motion, at {speed:.2g} m/s "
            "through the water"
        )
    silence = longest_silence(flight, follower, loss_s - _BEFORE_S, loss_s)
    interval = flight.scenario.timing.message_interval_s
    if silence.length_s > max(_SILENCE_S, _SILENCE_MESSAGES * interval):
        return _silence_text(silence)
    if _is_locked(flight, follower, time, loss_s):
        return "the estimate was locked on the mirror image of the truth in the leader's axis"
    if cautions := assumption_cautions(Navigated.of(flight.scenario, [follower])):
        return "an assumption that does not hold: " + "; ".join(cautions[:2])
    squares = nees(flight.estimates[follower], flight.hydrophone(follower)[:, :2])[: step + 1]
    finite = squares[np.isfinite(squares)]
    if finite.size and finite.mean() > _OVERCONFIDENT_NEES:
        return (
            f"the filter was surer than right (mean NEES {finite.mean():.3g} before, 2 if "
            "consistent): its assumed errors are too small for the true ones"
        )
    return _NO_CAUSE


def losses(flight: FlightRecord, track_errors: Floats) -> tuple[Loss, ...]:
    """Lost followers in order of time; `track_errors` are distances from routes and stations, shape
    (n, f), [m].
    """
    lost = list[Loss]()
    for i, ((errors, _), name) in enumerate(
        zip(position_and_bearing_errors(flight), flight.trajectory.names[1:], strict=True)
    ):
        finite_errors = np.nan_to_num(errors, nan=0.0)
        loss = _loss(flight, i, finite_errors, track_errors[:, i])
        if loss is None:
            continue
        time_s, respect = loss
        silence = longest_silence(flight, i, time_s - _BEFORE_S, time_s)
        lost.append(
            Loss(
                follower=name,
                time_s=time_s,
                what=respect,
                cause=_cause(flight, i, time_s, finite_errors, track_errors[:, i]),
                silence_s=silence.length_s,
            )
        )
    return tuple(sorted(lost, key=lambda loss: loss.time_s))


def _because(subject: str, cause: str) -> str:
    return cause if cause == _NO_CAUSE else f"{subject}: {cause}"


def _lost_text(lost: Sequence[Loss], followers: int) -> str:
    texts = [f"{loss.follower} at {loss.time_s:.0f} s" for loss in lost[:_MAX_NAMED_FOLLOWERS]]
    if len(lost) > _MAX_NAMED_FOLLOWERS:
        texts.append(f"{len(lost) - _MAX_NAMED_FOLLOWERS} more")
    first = lost[0]
    number = f"{len(lost)} of {followers} followers" if followers > 1 else first.follower
    verb = "was" if len(lost) == 1 else "were"
    if followers == 1:
        cause = _because("likeliest cause", first.cause)
        return f"{number} was lost at {first.time_s:.0f} s ({first.what}); {cause}."
    subject = f"likeliest cause of the first ({first.what})"
    return f"{number} {verb} lost: {', '.join(texts)}; {_because(subject, first.cause)}."


def _without_text(names: Sequence[str]) -> str:
    named = ", ".join(names[:_MAX_NAMED_FOLLOWERS])
    more = len(names) - _MAX_NAMED_FOLLOWERS
    return (
        f"No estimate in the whole mission: {named}{f' and {more} more' if more > 0 else ''}; "
        "without a known start a navigator begins with a message that has at least two ranges."
    )


def _errors_text(flight: FlightRecord) -> str:
    """Mean and largest errors of a flight in which none was lost."""
    time = flight.trajectory.time[flight.step_index()]
    names = flight.trajectory.names[1:]
    errors = [position for position, _ in position_and_bearing_errors(flight)]
    finite_masks = [np.isfinite(position) for position in errors]
    if not all(
        finite[e.steps_without_estimate :].all()
        for finite, e in zip(finite_masks, flight.estimates, strict=True)
    ):
        return "An estimate is not finite."
    means = [float(p[k].mean()) for p, k in zip(errors, finite_masks, strict=True)]
    largest = [float(np.nanmax(position)) for position in errors]
    worst = int(np.argmax(largest))
    time_s = float(time[int(np.nanargmax(errors[worst]))])
    if len(names) == 1:
        return (
            f"The mean position error is {means[0]:.2f} m; the largest is {largest[0]:.2f} m, at "
            f"{time_s:.0f} s."
        )
    low, high = int(np.argmin(means)), int(np.argmax(means))
    return (
        f"The mean position errors of {len(names)} followers lie between {means[low]:.2f} m "
        f"({names[low]}) and {means[high]:.2f} m ({names[high]}); the largest error is "
        f"{largest[worst]:.2f} m ({names[worst]}, at {time_s:.0f} s)."
    )


def verdict(flight: FlightRecord, track_errors: Floats) -> Verdict:
    """What matters most of a flight; `track_errors` as of `losses`."""
    lost = losses(flight, track_errors)
    parts = list[str]()
    if flight.outcome is not Termination.COMPLETED:
        text = flight.outcome.value
        parts.append(f"{text[0].upper()}{text[1:]}, at {flight.trajectory.time[-1]:g} s.")
    if lost:
        parts.append(_lost_text(lost, len(flight.measurements)))
    touching = contacts(flight.trajectory)
    if touching and flight.outcome is not Termination.CONTACT:
        time_s, pair = touching[0]
        parts.append(f"{' and '.join(pair)} touched at {time_s:.0f} s.")
    without = flight.without_estimate
    if without:
        parts.append(_without_text(without))
    if not parts:
        parts.append(_errors_text(flight))
    return Verdict(sentence=" ".join(parts), lost=lost)
