"""Navigators of a swarm, all followers in one call, against navigators of one follower each."""

from dataclasses import replace

import numpy as np
import pytest

from laisn.arrays import Bools, Floats, Records, records
from laisn.failure import LaisnError
from laisn.lanes import new_lanes
from laisn.messages import OwnMotion, Ranges, Reception
from laisn.navigator import Navigator
from laisn.settings import NavigationSettings, TightSettings
from laisn.swarm import ESTIMATE, MESSAGE, READING, SeparateNavigators
from laisn.tight import navigator as mission
from laisn.tight.model import refresh_output
from laisn.tight.navigator import TightNavigator
from tests.laisn.test_tight_oracle import ALL_OF_2, Voyage
from tests.laisn.tight_mission import details
from tests.synthetic import record

FOLLOWERS, DT = 3, 0.5
Step = tuple[list[OwnMotion], list[Reception | None]]


def shared_voyage() -> tuple[list[Step], Floats]:
    """Readings of followers that receive messages of one leader, each with errors of its own; and
    their starts.

    Some messages are not in yet with one of them when they are with the others.
    """
    rng = np.random.default_rng(8)
    steps, start = Voyage(seed=2, messages=8, turns=0.05, offset=(-15.0, 9.0)).readings()
    mine: list[Step] = []
    for own, reception, _ in steps:
        owns = [OwnMotion(*(np.array(own) + 0.02 * rng.normal(size=3))) for _ in range(FOLLOWERS)]
        arrived: list[Reception | None] = [None] * FOLLOWERS
        if reception is not None:
            ranges = np.array(reception.ranges) + 0.02 * rng.normal(size=(FOLLOWERS, 3))
            ranges[rng.random(ranges.shape) < 0.1] = np.nan
            arrived = [
                Reception(reception.message, Ranges(*row)) if rng.random() < 0.8 else None
                for row in ranges.tolist()
            ]
        mine.append((owns, arrived))
    starts = np.column_stack(
        [start + 0.3 * rng.normal(size=(FOLLOWERS, 2)), rng.normal(size=(FOLLOWERS, 2))]
    )
    return mine, starts


def tables(step: Step) -> tuple[Records, Bools, Records, Floats]:
    """Readings, reception flags, messages and ranges, as compiled swarms take them."""
    owns, arrived = step
    received = np.array([h is not None for h in arrived])
    messages, ranges = records(MESSAGE, FOLLOWERS), np.full((FOLLOWERS, 3), 7.0)
    messages.fill(np.nan)
    for i, reception in enumerate(arrived):
        if reception is not None:
            messages[i], ranges[i] = tuple(reception.message), reception.ranges
    readings = records(READING, FOLLOWERS)
    readings.speed, readings.heading, readings.depth = np.array(owns).T
    return readings, received, messages, ranges


@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-1"])
def test_a_swarm_of_lanes_is_so_many_navigators(variant: str) -> None:
    settings = NavigationSettings(variant=variant, dt=DT, use_attitude=True, hydrophone_height=0.2)  # type: ignore[arg-type]
    steps, starts = shared_voyage()
    together, alone = new_lanes(settings, starts), [Navigator(settings, row) for row in starts]
    out = records(ESTIMATE, FOLLOWERS)
    for k, step in enumerate(steps, start=1):
        assert together.navigate(k, *tables(step), out) == 0
        for i, navigator in enumerate(alone):
            navigator.step(step[0][i], step[1][i])
            found = [*out[i].position, *out[i].velocity]
            np.testing.assert_allclose(found, navigator.state, rtol=0, atol=1e-9)
    # LAISN estimates nothing else
    assert not any(
        out[name].any() for name in out.dtype.names if name not in ("position", "velocity")
    )


def test_there_is_a_lane_for_each_of_sixty_four_followers_and_no_more() -> None:
    starts = np.arange(4.0 * 64).reshape(64, 4)
    block = new_lanes(NavigationSettings(), starts).block
    np.testing.assert_array_equal(block[: 4 * 64].reshape(4, 64).T, starts)
    with pytest.raises(LaisnError, match="65 followers cannot navigate together, at most 64"):
        new_lanes(NavigationSettings(), np.zeros((65, 4)))


@pytest.mark.parametrize(
    "settings", [ALL_OF_2, TightSettings(known_start=False)], ids=["all of 2", "start of 3"]
)
def test_a_tightly_coupled_swarm_is_so_many_navigators_to_the_bit(settings: TightSettings) -> None:
    """Spread is the largest standard deviation of the place at the last message; lean is the way to
    the likelier of two places, where twice their spreads do not meet; the rest are means over the
    mixture.
    """
    settings = replace(settings, dt=DT)
    steps, starts = shared_voyage()
    together, alone = (
        mission.new_tight_swarm(settings, starts),
        [TightNavigator(settings, row) for row in starts],
    )
    out, leant, upright = records(ESTIMATE, FOLLOWERS), 0, 0
    for k, step in enumerate(steps, start=1):
        assert together.navigate(k, *tables(step), out) == 0
        for i, navigator in enumerate(alone):
            updates = navigator.step(step[0][i], step[1][i])
            assert out[i].position.tobytes() == navigator.state[:2].tobytes()
            if np.isfinite(navigator.state).all():
                np.testing.assert_allclose(out[i].velocity, navigator.state[2:], rtol=0, atol=1e-12)
            for update in map(details, updates):
                x = update.full_state
                current = x[6:8] if settings.assume.current else np.zeros(2)
                found = [out[i].log_bias, out[i].compass_bias, *out[i].current]
                np.testing.assert_allclose(found, [x[2], x[3], *current], rtol=0, atol=1e-12)
                off = update.hypothesis - x[:2]
                spread = update.hypothesis_covariance + off[:, :, None] * off[:, None, :]
                largest = np.linalg.eigvalsh(np.einsum("h,hij->ij", update.weight, spread))[-1]
                assert out[i].spread == pytest.approx(np.sqrt(largest), rel=1e-9)
                if settings.assume.drift:
                    continue
                lean = np.zeros(2)
                if update.weight.size > 1:
                    apart = update.hypothesis[0] - update.hypothesis[1]
                    along = apart / np.hypot(*apart)
                    spreads = np.sqrt(
                        [along @ update.hypothesis_covariance[h] @ along for h in range(2)]
                    )
                    lean = off[0] * (np.hypot(*apart) >= 2.0 * spreads.sum())
                np.testing.assert_allclose(out[i].to_likelier, lean, rtol=0, atol=1e-9)
                leant, upright = leant + lean.any(), upright + (not lean.any())
    assert settings.assume.drift or min(leant, upright) > 5


@pytest.mark.parametrize(("half", "leans"), [(1.99, False), (2.01, True)])
def test_two_places_are_two_where_twice_their_spreads_do_not_meet(half: float, leans: bool) -> None:
    """At ±half m east, weights 0.4 and 0.6, spreads 1 m: the mean is 0.2 half east, the likelier
    0.8 half farther.
    """
    (beliefs, model, *_) = mission.new_tight_swarm(TightSettings(transmitters=2), np.zeros((1, 4)))
    belief, out = beliefs[0], record(ESTIMATE)
    belief.alive, belief.weight[:2] = 2, (0.4, 0.6)
    belief.state[:2] = 0.0
    belief.state[:2, 0] = -half, half
    belief.covariance[:2] = np.diag([1.0, 9.0, *np.ones(10)])
    refresh_output(belief, model)
    mission._write_outputs(belief, model, out)
    assert out.to_likelier == pytest.approx((0.8 * half * leans, 0.0))


def test_a_covariance_that_is_not_positive_definite_is_reported() -> None:
    steps, starts = shared_voyage()
    together = mission.new_tight_swarm(replace(ALL_OF_2, dt=DT), starts)
    together.beliefs[1].covariance[:] = -np.eye(12)
    answers = [
        together.navigate(k, *tables(step), records(ESTIMATE, FOLLOWERS))
        for k, step in enumerate(steps[:3])
    ]
    assert answers == [0, 0, 2]


def test_navigators_that_python_calls_one_by_one_get_the_measurements_of_their_own() -> None:
    """The same as lanes, which the readable navigators agree with to rounding."""
    settings = NavigationSettings(dt=DT, use_attitude=True)
    steps, starts = shared_voyage()
    together, separate = (
        new_lanes(settings, starts),
        SeparateNavigators(Navigator, settings, starts),
    )
    expected, found = records(ESTIMATE, FOLLOWERS), records(ESTIMATE, FOLLOWERS)
    for k, step in enumerate(steps, start=1):
        assert (
            together.navigate(k, *tables(step), expected)
            == separate.navigate(k, *tables(step), found)
            == 0
        )
        np.testing.assert_allclose(found.position, expected.position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.velocity, expected.velocity, rtol=0, atol=1e-9)
