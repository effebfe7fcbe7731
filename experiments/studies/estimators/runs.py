"""Runs of one mission by LAISN-2, the tightly coupled navigator and a plain EKF, and the bound, on the same noise."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.special import chdtri

from experiments.campaign.bound import geometry_of, least_rms, noise_of
from experiments.campaign.missions import mission_of, motion_of
from experiments.campaign.store import Record
from experiments.flight.library import load, table_of
from experiments.studies.estimators.cases import SEAS, Case, with_errors
from laisn import lanes, metrics
from laisn.arrays import Floats
from laisn.bound import TrueNoise
from laisn.lane_rows import LANES
from laisn.messages import Measurements
from laisn.rivals.kalman import RangeFilter
from laisn.settings import NavigationSettings
from laisn.tight.leader import CURRENT_SIGMA
from laisn.tight.mission import run_mission
from laisn.tight.model import model_of
from laisn.tight.settings import Assume, TightSettings
from sim.flight import settings_as
from sim.scenario.file import assigned, validate
from sim.scenario.routes import LEADER_DEPTH, Route, library_route
from sim.scenario.settings import Scenario
from sim.sensing.errors import SensorErrors, errors_of
from sim.sensing.observation import MissionTruth, measure

MIDDLE_OFFSET = 0.1
"""H_T of missions, unless it is what is varied [m]."""
WEAVE, WEAVE_PERIOD = float(np.deg2rad(5.0)), 40.0
"""Angle of the legs with the route [rad], and period [s], of a leader that weaves."""
LAG = 60.0
"""How much later the messages are that smoothing uses [s]."""
SETTLED_S = 60.0
"""Errors after the leader's first turn count from this time after it on [s]."""
_EXACT_CLOCK = Case(name="exact clock")
_UNKNOWN_CLOCK = Case(name="unknown clock", assume=Assume(clock=True), errors=("clock",))


def weaving(route: Route) -> tuple[tuple[float, float, float], ...]:
    """Waypoints (time, east, north) of legs that alternate by `WEAVE` about those of a route, its corners kept."""
    half = 0.5 * WEAVE_PERIOD
    points = []
    for k, (begin, end) in enumerate(pairwise(route.time.tolist())):
        here, way = route.waypoint[k], route.waypoint[k + 1] - route.waypoint[k]
        speed = float(np.hypot(*way)) / (end - begin)
        starboard = np.array([way[1], -way[0]]) / float(np.hypot(*way))
        points.append((begin, *here.tolist()))
        for i, time in enumerate(np.arange(begin + half, end - half, half).tolist()):
            aside = (-1.0) ** i * 0.5 * speed * half * np.tan(WEAVE)
            points.append((time, *(here + (time - begin) / (end - begin) * way + aside * starboard).tolist()))
    return (*points, (float(route.time[-1]), *route.waypoint[-1].tolist()))


@cache
def scenario_of(
    route: str, interval: float, leader_heading_deg: float = 0.0, middle_offset: float = MIDDLE_OFFSET,
    weave: bool = False,
) -> Scenario:  # fmt: skip
    """The paper's point motion on a route, with three transmitters and the paper's sensors.

    Args:
        route: T2 … T9.
        interval: of messages [s].
        leader_heading_deg: mean error of the leader's compass.
        middle_offset: H_T [m].
        weave: the leader weaves about its route.
    """
    keys = {
        "motion": "kinematic",
        "followers.0.depth_m": LEADER_DEPTH,
        "navigation.variant": "laisn-3-2",
        "timing.message_interval_s": interval,
        "leader.middle_offset_m": middle_offset,
        "sensors.leader_heading_bias_deg": leader_heading_deg,
        # the spread that fits the paper's Tables 8 and 9
        "sensors.leader_heading_sigma_deg": 0.4 * leader_heading_deg,
    }
    made = validate(assigned(table_of(route), keys), route)
    if not weave:
        return made
    leader = made.leader.model_copy(update={"route": None, "waypoints": weaving(library_route("L"))})
    return made.model_copy(update={"leader": leader})


def mission(
    route: str, interval: float, leader_heading_deg: float = 0.0, middle_offset: float = MIDDLE_OFFSET,
    weave: bool = False,
) -> tuple[MissionTruth, SensorErrors]:  # fmt: skip
    """What the sensors of `scenario_of` measure, and their errors; the same arguments."""
    made = scenario_of(route, interval, leader_heading_deg, middle_offset, weave)
    return mission_of(motion_of(made)).seen(made, 0)[1], errors_of(made)


def noise_known(assume: Assume) -> TrueNoise:
    """The paper's noise where all biases are known but those that are estimated, and drift is slow."""
    settings = TightSettings(assume=assume)
    model = model_of(settings)
    return TrueNoise(
        speed_walk=math.sqrt(model.log_walk[0]) if assume.drift else 0.0,
        heading_walk=math.sqrt(model.compass_walk[0]) if assume.drift else 0.0,
        leader_heading_bias=0.0 if assume.exact_leader else settings.leader_heading_bias_sigma,
        current=settings.current_sigma if assume.current else 0.0,
        current_walk=math.sqrt(model.current_walk) if assume.current else 0.0,
        clock_offset=settings.clock_offset_sigma if assume.clock else 0.0,
        clock_drift=settings.clock_drift_sigma if assume.clock else 0.0,
        clock_walk=math.sqrt(model.clock_walk) if assume.clock else 0.0,
        range_offset=settings.offset_sigma if assume.offsets else 0.0,
        leader_way_sigma=CURRENT_SIGMA if assume.current or not assume.exact_leader else 0.0,
    )


@cache
def bound(scenario: Scenario, transmitters: int, assume: Assume, lag: float = 0.0) -> Floats:
    """Least RMS of E_P after each step [m], averaged over all biases, with messages of up to a lag later [s]."""
    trajectory, _ = mission_of(motion_of(scenario)).seen(scenario, 0)
    geometry = geometry_of(trajectory, scenario, transmitters=transmitters)
    return least_rms(geometry, noise_known(assume), lag)


def rms(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def nees(error: Floats, spread: Floats) -> Floats:
    """eᵀ P⁻¹ e of errors, shape (n, 2), with covariances xx, xy, yy, shape (n, 3)."""
    (x, y), (xx, xy, yy) = error.T, spread.T
    return np.asarray((x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy))


def share_inside(total: Floats, runs: int) -> float:
    """Share of steps at which the sum of eᵀ P⁻¹ e over the runs is within its 95 % interval.

    It is χ² of 2R degrees of freedom if the covariance is right (Bar-Shalom, Section 5.4.2).
    """
    low, high = (float(chdtri(2 * runs, tail)) for tail in (0.975, 0.025))
    return float(np.mean((total >= low) & (total <= high)))


def _mirror_locked(found: Floats, truth: MissionTruth, steps: int) -> bool:
    """Whether an estimate was at the mirror image of the truth for so many steps."""
    return metrics.was_mirror_locked(found, truth.hydrophone, truth.leader_position, truth.leader_heading, steps)


def _laisn(measured: Sequence[Measurements], truth: MissionTruth, settings: NavigationSettings) -> Iterator[Floats]:
    """Positions of LAISN-2 in one run after another, shape (n, 2)."""
    for first in range(0, len(measured), LANES):
        state = lanes.run(measured[first : first + LANES], truth.start, settings).state
        yield from (state[:, :2, i] for i in range(state.shape[2]))


def fly_both(
    truth: MissionTruth, measured: Sequence[Measurements], settings: TightSettings, message_steps: int,
    laisn: NavigationSettings | None = None,
) -> Record:  # fmt: skip
    """Figures of R runs by LAISN-2 and the tightly coupled navigator, of each run where not said otherwise.

    Returns:
        `…_means`: mean E_P [m]; `…_squares`: mean E_P² [m²]; `largest`: E_P of the tightly coupled navigator [m];
        `normalised`: mean eᵀ P⁻¹ e, 2 if P is right; `inside`: as of `share_inside`, of all runs; `residuals`: mean
        squared residual of a range in units of S, 1 if S is right; `…_lost`: 1 if the estimate was at the mirror image
        for a message interval, else 0.
    """
    rows, total = [], np.zeros(truth.speed.size)
    others = _laisn(measured, truth, laisn or NavigationSettings())
    for given, other in zip(measured, others, strict=True):
        states, spread, outcome = run_mission(settings, given, truth.start)
        error = metrics.position_errors(states[:, :2], truth.hydrophone)
        laisn_error = metrics.position_errors(other, truth.hydrophone)
        normalised, used = nees(states[:, :2] - truth.hydrophone, spread), np.isfinite(outcome.squared)
        total += normalised
        rows.append(
            {
                "laisn_means": laisn_error.mean(),
                "laisn_squares": np.mean(laisn_error**2),
                "tight_means": error.mean(),
                "tight_squares": np.mean(error**2),
                "largest": error.max(),
                "normalised": normalised.mean(),
                "residuals": outcome.squared[used].sum() / max(outcome.used[used].sum(), 1.0),
                "laisn_lost": float(_mirror_locked(other, truth, message_steps)),
                "tight_lost": float(_mirror_locked(states[:, :2], truth, message_steps)),
            }
        )
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return columns | {"inside": share_inside(total, len(rows))}


def compare(
    case: Case, route: str, interval: float, *, runs: int, seed: int, settings: TightSettings | None = None,
    middle_offset: float = MIDDLE_OFFSET, weave: bool = False, smoothing: bool = False,
) -> Record:  # fmt: skip
    """Fly the runs of one mission by both navigators.

    Args:
        case: what is assumed, and the errors.
        route: T2 … T9.
        interval: of messages [s].
        runs: how many.
        seed: of all noise.
        settings: of the tightly coupled navigator, but for the changes of the case; None: its defaults.
        middle_offset: H_T [m].
        weave: the leader weaves about its route.
        smoothing: compute also what smoothing with `LAG` leaves of the bound, given what the case assumes.

    Returns:
        As of `fly_both`, and the RMS of the bound [m], None where the case has none.
    """
    truth, errors = mission(route, interval, case.leader_heading_deg, middle_offset, weave)
    sensors = settings or TightSettings(middle_offset=middle_offset)
    given = replace(sensors, assume=case.assume, transmitters=case.transmitters)
    measured = [with_errors(measure(truth, errors, seed=seed, run=run), case, seed, run) for run in range(runs)]
    found = fly_both(truth, measured, given, round(interval / truth.dt))
    bounded = scenario_of(route, interval, 0.0, middle_offset, weave), case.transmitters, case.assume
    found |= {"route": route, "interval": interval, "bound_rms": rms(bound(*bounded)) if case.has_bound else None}
    return found | ({"smoothing": rms(bound(*bounded, LAG)) / rms(bound(*bounded))} if smoothing else {})


def at_sea(sea: str, route: str, *, runs: int, seed: int) -> Record:
    """Fly the runs of a physical mission of `SEAS` by both navigators; the bound is that of its noise."""
    asked = load(route, ["navigation.variant=tight", f"seed={seed}", *SEAS[sea]["set"]])
    trajectory, truth = mission_of(motion_of(asked)).seen(asked, 0)
    errors = errors_of(asked)
    measured = [measure(truth, errors, seed=seed, run=run) for run in range(runs)]
    laisn = asked.model_copy(update={"navigation": asked.navigation.model_copy(update={"variant": "laisn-2"})})
    own = settings_as(NavigationSettings, laisn, trajectory, 0)
    found = fly_both(truth, measured, settings_as(TightSettings, asked, trajectory, 0), asked.message_every, own)
    least = least_rms(geometry_of(trajectory, asked), noise_of(asked))
    return found | {"route": route, "interval": asked.timing.message_interval_s, "bound_rms": rms(least)}


def plain_filter(case: Case, route: str, interval: float, *, runs: int, seed: int) -> Record:
    """Fly the runs of one mission by a plain extended Kalman filter, with the noise that `compare` gives them.

    Args:
        case: without errors, and with the assumptions that are the defaults of `Assume`.
        route: T2 … T9.
        interval: of messages [s].
        runs: how many.
        seed: of all noise.

    Returns:
        Of each run `means`, `normalised` and `lost` as in `fly_both`.
    """
    truth, errors = mission(route, interval)
    settings = TightSettings(middle_offset=MIDDLE_OFFSET, assume=case.assume, transmitters=case.transmitters)
    measured = [measure(truth, errors, seed=seed, run=run) for run in range(runs)]
    steps, found = round(interval / truth.dt), [RangeFilter(settings, truth.start).run(given) for given in measured]
    estimates = [(one.state[:, :2], one.covariance[:, (0, 0, 1), (0, 1, 1)]) for one in found]
    return {
        "route": route,
        "means": np.array([metrics.position_errors(p, truth.hydrophone).mean() for p, _ in estimates]),
        "normalised": np.array([nees(p - truth.hydrophone, spread).mean() for p, spread in estimates]),
        "lost": np.array([float(_mirror_locked(p, truth, steps)) for p, _ in estimates]),
    }


def mirror_locks(route: str, interval: float, transmitters: int, runs: range, seed: int) -> Record:
    """How many `runs` of LAISN-2 and of the tightly coupled navigator are locked on the mirror image."""
    truth, errors = mission(route, interval)
    settings, steps = TightSettings(transmitters=transmitters), round(interval / truth.dt)
    laisn = tight = 0
    for first in range(0, len(runs), LANES):
        measured = [measure(truth, errors, seed=seed, run=run) for run in runs[first : first + LANES]]
        for given, other in zip(measured, _laisn(measured, truth, NavigationSettings()), strict=True):
            found = run_mission(settings, given, truth.start, covariance=False).state
            laisn += _mirror_locked(other, truth, steps)
            tight += _mirror_locked(found, truth, steps)
    return {"runs": len(runs), "laisn": laisn, "tight": tight}


def clock_cost(route: str, interval: float, transmitters: int, *, runs: int, seed: int) -> Record:
    """The same runs of one mission with exact clocks, and with one that is off and estimated.

    On a straight leg a clock's drift, the log's bias and, far astern, the distance change all ranges alike. After a
    turn they can be separated.

    Returns:
        `exact` and `unknown`: mean E_P before the leader's first turn and from a minute after it on, shape (R, 2), [m];
        `bound`: RMS of the bound in these parts with an unknown clock over that with exact ones.
    """
    truth, errors = mission(route, interval)
    turn = float(library_route("L").time[1])
    parts = slice(0, round(turn / truth.dt)), slice(round((turn + SETTLED_S) / truth.dt), truth.speed.size)
    means = []
    for case in (_EXACT_CLOCK, _UNKNOWN_CLOCK):
        settings = TightSettings(middle_offset=MIDDLE_OFFSET, assume=case.assume, transmitters=transmitters)
        for run in range(runs):
            measured = with_errors(measure(truth, errors, seed=seed, run=run), case, seed, run)
            found = run_mission(settings, measured, truth.start, covariance=False).state
            error = metrics.position_errors(found, truth.hydrophone)
            means.append([error[part].mean() for part in parts])
    exact, unknown = np.array(means).reshape(2, runs, 2)
    bounds = [bound(scenario_of(route, interval), transmitters, c.assume) for c in (_EXACT_CLOCK, _UNKNOWN_CLOCK)]
    ratios = np.array([rms(bounds[1][part]) / rms(bounds[0][part]) for part in parts])
    return {"route": route, "exact": exact, "unknown": unknown, "bound": ratios}
