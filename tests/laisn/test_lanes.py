"""One algorithm, two engines: the compiled lanes agree with the readable navigator to 1e-9 m, for
any input.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from laisn import POSITION
from laisn.arrays import Floats, Ints
from laisn.estimates import FixKind
from laisn.lanes import LANES
from laisn.messages import Measurements
from laisn.navigator import Navigator
from laisn.settings import LAISN_VARIANTS, GateRule, NavigationSettings, SideRule, Variant
from tests.effort import examples
from tests.laisn import in_lanes

STEPS = 24
VELOCITY = slice(2, 4)
POSITION_AGREEMENT = 1e-9
"""Largest difference of positions [m]; relative to the displacement in a step where broken ranges
make that longer than a metre.
"""
VELOCITY_AGREEMENT = 1e-7
"""Largest difference of velocities [m/s]; relative to the speed where that is above 1 m/s.

With exact fixes each second, of a velocity variance of (60 m/s)² some (0.2 m/s)² is left: both
engines are then 3e-8 m/s from the same filter in extended precision.
"""


@dataclass(frozen=True, kw_only=True)
class Case:
    """Difficulties of a mission. Continuous quantities are drawn from `seed`, so that ties, which
    rounding would decide, have probability 0.
    """

    seed: int
    steps_per_message: int
    bearing_deg: float
    """Bearing of the follower, from the leader's bow."""
    distance: float
    bearing_sigma: float
    """Standard deviation of the bearing [rad]: a small one keeps the follower on the axis."""
    range_sigma: float
    """Standard deviation of range errors [m]: a large one makes circles miss each other."""
    lost_ranges: float
    """Share of ranges that are missing."""
    lost_messages: float
    attitude: bool
    """The leader broadcasts pitch and roll."""
    dt: float = 0.1


def missions(case: Case, count: int) -> tuple[list[Measurements], Floats]:
    """Missions with messages at the same steps, and their start: a follower near a bearing of a
    leader that wanders.
    """
    rng = np.random.default_rng(case.seed)
    possible_steps = np.arange(case.steps_per_message, STEPS + 1, case.steps_per_message)
    message_step = possible_steps[rng.random(possible_steps.size) >= case.lost_messages]
    n_messages = message_step.size
    result = []
    heading = rng.uniform(-np.pi, np.pi)
    for _ in range(count):
        theta = heading + np.cumsum(rng.normal(0, 0.2, n_messages))
        leader = np.cumsum(rng.normal(0, 0.5, (n_messages, 2)), axis=0)
        depth, own_depth = 8 + rng.normal(0, 1, n_messages), 10 + rng.normal(0, 1, STEPS)
        bearing = (
            theta + np.deg2rad(case.bearing_deg) + rng.normal(0, 1, n_messages) * case.bearing_sigma
        )
        follower = leader + case.distance * np.stack([np.sin(bearing), np.cos(bearing)], axis=1)
        forward = np.stack([np.sin(theta), np.cos(theta)], axis=1)
        port = np.stack([-np.cos(theta), np.sin(theta)], axis=1)
        transmitters = [leader - forward, leader + forward, leader + 0.1 * port]
        depth_difference = own_depth[message_step - 1] - depth
        ranges = np.stack(
            [
                np.sqrt(np.sum((follower - p) ** 2, axis=1) + depth_difference**2)
                for p in transmitters
            ],
            axis=1,
        )
        ranges = np.abs(ranges + rng.normal(0, 1, ranges.shape) * case.range_sigma)
        ranges[rng.random(ranges.shape) < case.lost_ranges] = np.nan
        tilt = (
            rng.normal(0, 0.2, (n_messages, 2))
            if case.attitude
            else np.full((n_messages, 2), np.nan)
        )
        speed = np.abs(rng.normal(1, 0.3, n_messages))
        message = np.column_stack(
            [
                message_step * case.dt,
                leader,
                theta,
                speed,
                depth,
                tilt,
                np.full((n_messages, 2), np.nan),
            ]
        )
        result.append(
            Measurements(
                dt=case.dt,
                speed=np.abs(rng.normal(1, 0.3, STEPS)) + 0.01,
                heading=rng.normal(heading, 0.3, STEPS) + 2 * np.pi * rng.integers(-1, 2, STEPS),
                depth=own_depth,
                message_step=message_step,
                message=message,
                ranges=ranges,
            )
        )
    angle = heading + np.deg2rad(case.bearing_deg)
    start = np.array(
        [case.distance * np.sin(angle), case.distance * np.cos(angle), 0.3, -0.2]
    ) + rng.normal(0, 0.1, 4)
    return result, start


def assert_engines_agree(case: Case, navigation: NavigationSettings, count: int = 2) -> Ints:
    """Kinds of all fixes of all missions."""
    measurements, start = missions(case, count)
    navigation = replace(navigation, dt=case.dt)
    together = in_lanes.run(measurements, start, navigation)
    kinds = []
    for i, mission in enumerate(measurements):
        alone = Navigator(navigation, start).run(mission)
        difference = np.abs(together.state[:, :, i] - alone.state).max(axis=0)
        fastest = np.abs(alone.state[:, VELOCITY]).max()
        assert difference[POSITION].max() < POSITION_AGREEMENT * max(1.0, fastest * case.dt)
        assert difference[VELOCITY].max() < VELOCITY_AGREEMENT * max(1.0, fastest)
        # The lanes have a kind for each pair; the navigator lists a pair only if it was received.
        kinds_of_pairs = together.fix_kind[:, :, i]
        listed = [
            k[k != FixKind.LOST] if np.any(k != FixKind.LOST) else k[:1] for k in kinds_of_pairs
        ]
        assert (
            np.concatenate([*listed, np.empty(0, dtype=np.int64)]).tolist()
            == alone.fix_kind.tolist()
        )
        kinds.append(alone.fix_kind)
    return np.concatenate(kinds)


cases = st.builds(
    Case,
    seed=st.integers(0, 2**32 - 1),
    steps_per_message=st.integers(1, 8),
    bearing_deg=st.sampled_from([0.0, 45.0, 90.0, 180.0, 225.0]),
    distance=st.sampled_from([0.5, 3.0, 20.0, 100.0]),
    bearing_sigma=st.sampled_from([0.0, 0.02, 0.5]),
    # Without any error a follower on the axis sees circles that touch, and rounding decides whether
    # they meet.
    range_sigma=st.sampled_from([0.001, 0.05, 2.0]),
    lost_ranges=st.sampled_from([0.0, 0.2, 0.7, 1.0]),
    lost_messages=st.sampled_from([0.0, 0.3, 1.0]),
    attitude=st.booleans(),
    dt=st.sampled_from([0.1, 1.0]),
)

navigations = st.builds(
    NavigationSettings,
    variant=st.sampled_from(LAISN_VARIANTS),
    gate=st.sampled_from(["off", "v-max", "v-measured"]),
    side_rule=st.sampled_from(["behind", "predicted"]),
    use_attitude=st.booleans(),
    threshold=st.sampled_from([0.01, 0.1, 10.0]),
    beta=st.sampled_from([0.0, 0.1, 100.0]),
    sigma_floor=st.sampled_from([0.0, 0.05]),
    expected_pitch=st.sampled_from([0.0, 0.1]),
    hydrophone_height=st.sampled_from([0.0, 0.3]),
    alpha=st.sampled_from([0.0, 8.0]),
    sigma_a0=st.sampled_from([0.5, 60.0]),
    position_sigma0=st.sampled_from([0.0, 1.0]),
    velocity_sigma0=st.sampled_from([0.0, 0.5]),
)


@pytest.mark.system
@given(case=cases, navigation=navigations)
@settings(examples(150), suppress_health_check=[HealthCheck.too_slow])
def test_engines_agree_on_anything(case: Case, navigation: NavigationSettings) -> None:
    assert_engines_agree(case, navigation)


ABEAM = Case(
    seed=3,
    steps_per_message=2,
    bearing_deg=120.0,
    distance=20.0,
    bearing_sigma=0.02,
    range_sigma=0.01,
    lost_ranges=0.0,
    lost_messages=0.0,
    attitude=True,
)


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
@pytest.mark.parametrize("gate", ["off", "v-max", "v-measured"])
@pytest.mark.parametrize("side_rule", ["behind", "predicted"])
def test_engines_agree_on_every_rule(variant: Variant, gate: GateRule, side_rule: SideRule) -> None:
    navigation = NavigationSettings(
        variant=variant, gate=gate, side_rule=side_rule, use_attitude=gate == "off"
    )
    assert_engines_agree(ABEAM, navigation)
    assert_engines_agree(
        replace(ABEAM, bearing_deg=0.0, bearing_sigma=0.0, range_sigma=1.0, lost_ranges=0.1),
        navigation,
    )


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_engines_agree_where_updates_are_singular_gated_or_lost(variant: Variant) -> None:
    astern = replace(ABEAM, bearing_deg=180.0, bearing_sigma=0.0, range_sigma=0.01)
    snapping = NavigationSettings(variant=variant, threshold=1000.0, gate="off")
    kinds = assert_engines_agree(astern, snapping, count=4)
    # Every pair is snapped onto the axis: three updates with σp = 0 in a row, the second and third
    # singular.
    assert np.mean(kinds == FixKind.SINGULAR) == (2 / 3 if variant == "laisn-3-1" else 0)
    assert FixKind.GATED in assert_engines_agree(
        replace(ABEAM, range_sigma=2.0), NavigationSettings(variant=variant)
    )
    assert FixKind.LOST in assert_engines_agree(
        replace(ABEAM, lost_ranges=0.9), NavigationSettings(variant=variant)
    )


def test_circles_that_touch_give_one_point() -> None:
    # 3 m behind the rear transmitter on the axis: with these numbers h² = 9 − 3² is zero without
    # rounding.
    mission = Measurements(
        dt=0.1,
        speed=np.ones(1),
        heading=np.zeros(1),
        depth=np.zeros(1),
        message_step=np.array([1]),
        message=np.array([[0.1, 0.0, 0.0, 0.0, 1.0, 0.0, *np.full(4, np.nan)]]),
        ranges=np.array([[3.0, 5.0, 4.0]]),
    )
    for variant in ("laisn-2", "laisn-best", "laisn-main"):
        navigation = NavigationSettings(variant=variant, gate="off")
        estimates = in_lanes.run([mission], np.array([0.0, -4.0, 0.0, 1.0]), navigation)
        assert estimates.fix_kind.tolist() == [[[FixKind.TANGENT]]]
        assert estimates.state[0, :2, 0] == pytest.approx([0.0, -4.0], abs=1e-12)


def test_transmitters_above_each_other_leave_the_hulls_heading_for_an_axis() -> None:
    """A leader that stands upright, far enough away for its transmitters' offsets to be lost in
    rounding.
    """
    heading, leader = 0.6, np.array([1000.0, -2000.0])
    mission = Measurements(
        dt=0.1,
        speed=np.ones(1),
        heading=np.zeros(1),
        depth=np.array([8.0]),
        message_step=np.array([1]),
        message=np.array([[0.1, *leader, heading, 1.0, 8.0, np.pi / 2, 0.0, np.nan, np.nan]]),
        # 20 m away, and 1 m above or below
        ranges=np.full((1, 3), np.sqrt(401.0)),
    )
    behind = leader - 20.0 * np.array([np.sin(heading), np.cos(heading)])
    # the start is far away: the fix is certain, so that it replaces it
    start, navigation = np.zeros(4), NavigationSettings(gate="off", use_attitude=True)
    together = in_lanes.run([mission], start, navigation)
    alone = Navigator(navigation, start).run(mission)
    np.testing.assert_allclose(together.state[0, :2, 0], behind, rtol=0, atol=1e-9)
    np.testing.assert_allclose(alone.state[0, :2], behind, rtol=0, atol=1e-9)
    assert together.fix_kind.ravel().tolist() == alone.fix_kind.tolist() == [FixKind.ASTERN]


def test_lanes_do_not_influence_each_other() -> None:
    # More missions than a block has lanes, and the same ones alone.
    measurements, start = missions(ABEAM, LANES + 3)
    navigation = NavigationSettings(variant="laisn-3-2")
    together = in_lanes.run(measurements, start, navigation)
    assert together.state.shape == (STEPS, 4, LANES + 3)
    for i in (0, LANES - 1, LANES, LANES + 2):
        alone = in_lanes.run([measurements[i]], start, navigation)
        assert alone.state[..., 0].tobytes() == together.state[..., i].tobytes()
