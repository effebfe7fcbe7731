"""Navigators of a swarm, all followers in one call, against navigators of one follower each."""

from dataclasses import fields, replace

import numpy as np
import pytest

from laisn.arrays import Bools, Floats, Records, records
from laisn.errors import LaisnError
from laisn.estimates import Estimates, TightEstimates
from laisn.lanes import new_lanes
from laisn.messages import Measurements, OwnMotion, Ranges, Reception
from laisn.navigator import Navigator
from laisn.settings import LAISN_VARIANTS, NavigationSettings, TightSettings
from laisn.swarm import ESTIMATE, MESSAGE, READING, SeparateNavigators, SwarmRecord
from laisn.tight import navigator as tight
from laisn.tight.model import refresh_output
from laisn.tight.navigator import TightNavigator
from tests.laisn.tight.mission import details
from tests.laisn.tight.test_navigator_oracle import ALL_OF_2, Voyage
from tests.synthetic import record

FOLLOWERS, DT = 3, 0.5
Step = tuple[list[OwnMotion], list[Reception | None]]


def shared_voyage() -> tuple[list[Step], Floats]:
    """Readings of followers that receive messages of one leader, each with errors of its own; and
    their starts.

    Some messages are not in yet with one of them when they are with the others.
    """
    rng = np.random.default_rng(8)
    steps, start = Voyage(seed=2, messages=8, turn_sigma=0.05, offset=(-15.0, 9.0)).readings()
    voyage: list[Step] = []
    for own, reception, _ in steps:
        own_motions = [
            OwnMotion(*(np.array(own[:3]) + 0.02 * rng.normal(size=3))) for _ in range(FOLLOWERS)
        ]
        receptions: list[Reception | None] = [None] * FOLLOWERS
        if reception is not None:
            ranges = np.array(reception.ranges) + 0.02 * rng.normal(size=(FOLLOWERS, 3))
            ranges[rng.random(ranges.shape) < 0.1] = np.nan
            receptions = [
                Reception(reception.message, Ranges(*row)) if rng.random() < 0.8 else None
                for row in ranges.tolist()
            ]
        voyage.append((own_motions, receptions))
    starts = np.column_stack(
        [start + 0.3 * rng.normal(size=(FOLLOWERS, 2)), rng.normal(size=(FOLLOWERS, 2))]
    )
    return voyage, starts


def tables(step: Step) -> tuple[Records, Bools, Records, Floats]:
    """Readings, reception flags, messages and ranges, as compiled swarms take them."""
    own_motions, receptions = step
    received = np.array([h is not None for h in receptions])
    messages, ranges = records(MESSAGE, FOLLOWERS), np.full((FOLLOWERS, 3), 7.0)
    messages.fill(np.nan)
    for i, reception in enumerate(receptions):
        if reception is not None:
            messages[i], ranges[i] = tuple(reception.message), reception.ranges
    readings = records(READING, FOLLOWERS)
    readings.speed, readings.heading, readings.depth = np.array([own[:3] for own in own_motions]).T
    return readings, received, messages, ranges


def new_record(steps: list[Step], kind: type[Estimates] = Estimates) -> SwarmRecord:
    """Room for all that navigators conclude in a voyage."""
    return SwarmRecord.empty(FOLLOWERS, len(steps), len(steps), kind, whole=True)


def measurements_of(steps: list[Step], follower: int) -> Measurements:
    """The same voyage as one follower measures it."""
    own_motions = np.array([own_motions[follower][:3] for own_motions, _ in steps])
    receptions = [(k, r[follower]) for k, (_, r) in enumerate(steps, start=1) if r[follower]]
    return Measurements(
        dt=DT,
        speed=own_motions[:, 0],
        heading=own_motions[:, 1],
        depth=own_motions[:, 2],
        message_step=np.array([k for k, _ in receptions]),
        message=np.array([reception.message for _, reception in receptions if reception]),
        ranges=np.array([reception.ranges for _, reception in receptions if reception]),
    )


def require_equal(actual: Estimates, expected: Estimates, tolerance: float) -> None:
    """All arrays agree, where they hold numbers."""
    assert type(actual) is type(expected)
    for field in fields(expected):
        expected_values = getattr(expected, field.name)
        np.testing.assert_allclose(
            getattr(actual, field.name), expected_values, rtol=0, atol=tolerance, err_msg=field.name
        )


@pytest.mark.parametrize("variant", [*LAISN_VARIANTS])
def test_lanes_record_what_navigators_of_one_follower_conclude(variant: str) -> None:
    settings = NavigationSettings(variant=variant, dt=DT, use_attitude=True, hydrophone_height=0.2)  # type: ignore[arg-type]
    steps, starts = shared_voyage()
    swarm = new_lanes(settings, starts)
    recorded = new_record(steps)
    for k, step in enumerate(steps, start=1):
        swarm.navigate(k, *tables(step), records(ESTIMATE, FOLLOWERS), recorded)
    kinds = set[int]()
    for i in range(FOLLOWERS):
        expected = Navigator(settings, starts[i]).run(measurements_of(steps, i))
        require_equal(recorded.estimates(i, range(len(steps)), Estimates), expected, 1e-8)
        kinds |= {*expected.fix_kind.tolist()}
    assert len(kinds) > 1


@pytest.mark.parametrize(
    "settings", [ALL_OF_2, TightSettings(known_start=False)], ids=["all of 2", "start of 3"]
)
def test_a_tight_swarm_records_what_a_navigator_concludes_to_the_bit(
    settings: TightSettings,
) -> None:
    settings = replace(settings, dt=DT)
    steps, starts = shared_voyage()
    swarm = tight.new_tight_swarm(settings, starts)
    recorded = new_record(steps, TightEstimates)
    for k, step in enumerate(steps, start=1):
        swarm.navigate(k, *tables(step), records(ESTIMATE, FOLLOWERS), recorded)
    for i in range(FOLLOWERS):
        expected = TightNavigator(settings, starts[i]).run(measurements_of(steps, i))
        require_equal(recorded.estimates(i, range(len(steps)), TightEstimates), expected, 0.0)
        assert expected.fix_step.size > 3


def test_without_whole_records_states_alone_are_recorded() -> None:
    settings = replace(ALL_OF_2, dt=DT)
    steps, starts = shared_voyage()
    states = []
    for whole in (True, False):
        swarm = tight.new_tight_swarm(settings, starts)
        recorded = SwarmRecord.empty(FOLLOWERS, len(steps), len(steps), TightEstimates, whole=whole)
        for k, step in enumerate(steps, start=1):
            swarm.navigate(k, *tables(step), records(ESTIMATE, FOLLOWERS), recorded)
        assert recorded.fix_count.any() == whole
        states.append(recorded.state)
    np.testing.assert_allclose(states[0], states[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-1"])
def test_a_swarm_of_lanes_agrees_with_navigators_of_one_follower(variant: str) -> None:
    settings = NavigationSettings(variant=variant, dt=DT, use_attitude=True, hydrophone_height=0.2)  # type: ignore[arg-type]
    steps, starts = shared_voyage()
    swarm, navigators = new_lanes(settings, starts), [Navigator(settings, row) for row in starts]
    out = records(ESTIMATE, FOLLOWERS)
    recorded = new_record(steps)
    for k, step in enumerate(steps, start=1):
        assert swarm.navigate(k, *tables(step), out, recorded) == 0
        for i, navigator in enumerate(navigators):
            navigator.step(step[0][i], step[1][i])
            actual = [*out[i].position, *out[i].velocity]
            np.testing.assert_allclose(actual, navigator.state, rtol=0, atol=1e-9)
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
def test_a_tightly_coupled_swarm_is_navigators_of_one_follower_to_the_bit(
    settings: TightSettings,
) -> None:
    """`position_sigma` is the largest standard deviation of the position at the last message,
    `offset_to_likelier` that from the mean to the likelier of two positions, where twice their
    standard deviations do not overlap; the rest are means over the mixture.
    """
    settings = replace(settings, dt=DT)
    steps, starts = shared_voyage()
    swarm, navigators = (
        tight.new_tight_swarm(settings, starts),
        [TightNavigator(settings, row) for row in starts],
    )
    out, leaning_count, other_count = records(ESTIMATE, FOLLOWERS), 0, 0
    recorded = new_record(steps, TightEstimates)
    for k, step in enumerate(steps, start=1):
        assert swarm.navigate(k, *tables(step), out, recorded) == 0
        for i, navigator in enumerate(navigators):
            updates = navigator.step(step[0][i], step[1][i])
            assert out[i].position.tobytes() == navigator.state[:2].tobytes()
            if np.isfinite(navigator.state).all():
                np.testing.assert_allclose(out[i].velocity, navigator.state[2:], rtol=0, atol=1e-12)
            for update in map(details, updates):
                x = update.full_state
                current = x[6:8] if settings.assume.current else np.zeros(2)
                actual = [out[i].log_bias, out[i].compass_bias, *out[i].current]
                np.testing.assert_allclose(actual, [x[2], x[3], *current], rtol=0, atol=1e-12)
                offsets = update.hypothesis - x[:2]
                second_moments = (
                    update.hypothesis_covariance + offsets[:, :, None] * offsets[:, None, :]
                )
                largest = np.linalg.eigvalsh(np.einsum("h,hij->ij", update.weight, second_moments))[
                    -1
                ]
                assert out[i].position_sigma == pytest.approx(np.sqrt(largest), rel=1e-9)
                if settings.assume.drift:
                    continue
                expected = np.zeros(2)
                if update.weight.size > 1:
                    between = update.hypothesis[0] - update.hypothesis[1]
                    direction = between / np.hypot(*between)
                    sigmas = np.sqrt(
                        [direction @ update.hypothesis_covariance[h] @ direction for h in range(2)]
                    )
                    expected = offsets[0] * (np.hypot(*between) >= 2.0 * sigmas.sum())
                np.testing.assert_allclose(out[i].offset_to_likelier, expected, rtol=0, atol=1e-9)
                leaning_count, other_count = (
                    leaning_count + expected.any(),
                    other_count + (not expected.any()),
                )
    assert settings.assume.drift or min(leaning_count, other_count) > 5


@pytest.mark.parametrize(("half_distance", "is_distinct"), [(1.99, False), (2.01, True)])
def test_two_positions_are_distinct_where_twice_their_deviations_do_not_overlap(
    half_distance: float, is_distinct: bool
) -> None:
    """At ±d east, with weights 0.4 and 0.6 and deviations of 1 m: the mean is 0.2 d east, and the
    likelier position 0.8 d farther.
    """
    (beliefs, model, *_) = tight.new_tight_swarm(TightSettings(transmitters=2), np.zeros((1, 4)))
    belief, out = beliefs[0], record(ESTIMATE)
    belief.n_hypotheses, belief.weight[:2] = 2, (0.4, 0.6)
    belief.state[:2] = 0.0
    belief.state[:2, 0] = -half_distance, half_distance
    belief.covariance[:2] = np.diag([1.0, 9.0, *np.ones(15)])
    refresh_output(belief, model)
    tight._write_outputs(belief, model, out)
    assert out.offset_to_likelier == pytest.approx((0.8 * half_distance * is_distinct, 0.0))


def test_a_covariance_that_is_not_positive_definite_is_reported() -> None:
    steps, starts = shared_voyage()
    swarm = tight.new_tight_swarm(replace(ALL_OF_2, dt=DT), starts)
    swarm.beliefs[1].covariance[:] = -np.eye(17)
    recorded = new_record(steps, TightEstimates)
    answers = [
        swarm.navigate(k, *tables(step), records(ESTIMATE, FOLLOWERS), recorded)
        for k, step in enumerate(steps[:3])
    ]
    assert answers == [0, 0, 2]


def test_navigators_that_python_calls_one_by_one_agree_with_lanes() -> None:
    """The same as lanes, which the readable navigators agree with to rounding."""
    settings = NavigationSettings(dt=DT, use_attitude=True)
    steps, starts = shared_voyage()
    lanes, separate = (
        new_lanes(settings, starts),
        SeparateNavigators(Navigator, settings, starts),
    )
    expected, actual = records(ESTIMATE, FOLLOWERS), records(ESTIMATE, FOLLOWERS)
    recorded = new_record(steps)
    for k, step in enumerate(steps, start=1):
        assert (
            lanes.navigate(k, *tables(step), expected, new_record(steps))
            == separate.navigate(k, *tables(step), actual, recorded)
            == 0
        )
        np.testing.assert_allclose(actual.position, expected.position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(actual.velocity, expected.velocity, rtol=0, atol=1e-9)
    for i in range(FOLLOWERS):
        expected_fixes = Navigator(settings, starts[i]).run(measurements_of(steps, i))
        require_equal(separate.estimates(recorded, i, range(len(steps))), expected_fixes, 0.0)
