"""Cells: what they share, what their keys hold, and whose noise they have."""

import gc
import weakref
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from experiments.campaign import montecarlo
from experiments.campaign.montecarlo import CampaignMission, Cell, CellSettings, histories
from experiments.campaign.plans import CellPlan, compute
from laisn.errors import LaisnError
from laisn.navigator import Navigator
from laisn_sim import hull
from sim.flight import navigate
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import (
    Acoustics,
    Follower,
    Leader,
    Navigation,
    OceanTable,
    Scenario,
    Sensors,
    Timing,
    WavesTable,
)
from sim.simulation import simulate_motion
from sim.trajectory import Trajectory

# the leader turns from the start, so that its inclinometer has accelerations to sense
TURNING = tuple(
    (t, 20.0 * float(np.sin(t / 20.0)), 20.0 - 20.0 * float(np.cos(t / 20.0)))
    for t in range(0, 40, 2)
)


DURATION = 12.0


def mission(**changes: Any) -> Scenario:
    given = {"leader": Leader(route=None, waypoints=TURNING), "name": "turning", **changes}
    followers = (Follower(name="one", route="T3", depth_m=14.0), Follower(name="two", route="T5"))
    return Scenario(motion="kinematic", duration_s=DURATION, followers=followers, **given)


@pytest.fixture(scope="module")
def flown() -> Trajectory:
    return montecarlo.simulate_mission(mission())


def computed(flown: Trajectory, *plans: CellPlan) -> list[Any]:
    return [row for _, row, _ in compute(flown, plans)]


def test_a_mission_goes_with_its_last_reference() -> None:
    """Its arrays take megabytes, and the collector of garbage counts objects."""
    gc.collect()
    gc.disable()
    try:
        flown = montecarlo.simulate_mission(mission())
        reference = weakref.ref(flown)
        compute(flown, [CellPlan(scenario=mission(), follower=0, runs=1)])
        del flown
        assert reference() is None
    finally:
        gc.enable()


def test_cells_that_differ_in_the_inclinometer_alone_do_not_share_what_they_see(
    flown: Trajectory,
) -> None:
    leader = Leader(route=None, waypoints=TURNING, broadcast_attitude=True)
    exact, sensing = (
        CellPlan(
            scenario=mission(
                leader=leader,
                navigation=Navigation(use_attitude=True),
                sensors=Sensors(leader_attitude_senses_acceleration=senses),
            ),
            runs=3,
        )
        for senses in (False, True)
    )
    ([one], [other]) = computed(flown, exact), computed(flown, sensing)
    assert one["e_p_mean_m"] != other["e_p_mean_m"]
    assert computed(flown, exact, sensing) == [one, other]
    assert computed(flown, sensing, exact) == [other, one]


some = st.sampled_from
LEADERS = st.builds(
    lambda baseline, offset, broadcast: Leader(
        route=None,
        waypoints=TURNING,
        baseline_m=baseline,
        middle_offset_m=offset,
        broadcast_attitude=broadcast,
    ),
    some([1.0, 2.0]),
    some([0.1, 0.2]),
    st.booleans(),
)
SENSORS = st.builds(
    Sensors,
    heading_bias_deg=some([0.0, 5.0]),
    depth_sigma_m=some([0.0, 0.1]),
    leader_attitude_sigma_deg=some([0.0, 1.0]),
    leader_attitude_senses_acceleration=st.booleans(),
    leader_gyro_time_constant_s=some([0.0, 4.0]),
)
ACOUSTICS = st.builds(
    Acoustics,
    range_scale_mean_m=some([0.1, 0.3]),
    travel_time=st.booleans(),
    ping_slot_s=some([0.0, 0.05]),
    sound_speed_bias_m_s=some([0.0, 10.0]),
    sound_speed_profile=some([(), ((0.0, 1480.0), (20.0, 1510.0))]),
    clock_offset_s=some([0.0, 1e-4]),
    clock_drift_ppm=some([0.0, 50.0]),
    bottom_echo_probability=some([0.0, 0.3]),
    surface_echo_probability=some([0.0, 0.3]),
    loss_probability=some([0.0, 0.2]),
    max_range_m=some([0.0, 25.0]),
)
TIMES = st.builds(
    Timing,
    filter_step_s=some([0.1, 0.2]),
    message_interval_s=some([1.0, 2.0]),
    physics_step_s=some([0.02]),
)
PLANS = st.builds(
    lambda leader, sensors, acoustics, timing, variant, use, follower: CellPlan(
        scenario=mission(
            leader=leader,
            sensors=sensors,
            acoustics=acoustics,
            timing=timing,
            navigation=Navigation(variant=variant, use_attitude=use and leader.broadcast_attitude),
        ),
        runs=2,
        follower=follower,
    ),
    LEADERS,
    SENSORS,
    ACOUSTICS,
    TIMES,
    some(["laisn-2", "laisn-3-1", "laisn-best"]),
    st.booleans(),
    some([0, 1]),
)


@given(plans=st.lists(PLANS, min_size=2, max_size=4), data=st.data())
@settings(max_examples=40)
def test_a_cell_depends_on_no_other_and_on_no_order(
    plans: list[CellPlan], data: st.DataObject
) -> None:
    cell = montecarlo.CellSettings.of(mission())
    trajectory, _ = montecarlo.mission_of(mission()).motion_and_measurements(cell, 0)
    alone = {plan.key: computed(trajectory, plan) for plan in plans}
    order = data.draw(st.permutations(plans))
    assert computed(trajectory, *order) == [row for plan in order for row in alone[plan.key]]


def leaves(section: BaseModel) -> list[tuple[str, ...]]:
    """Names of all settings within a section that are no sections themselves."""
    actual: list[tuple[str, ...]] = []
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, BaseModel):
            actual += [(name, *rest) for rest in leaves(value)]
        else:
            actual.append((name,))
    return actual


def changed(scenario: Scenario, leaf: tuple[str, ...]) -> Scenario:
    """A valid scenario that differs in one setting."""
    table = scenario.model_dump()
    place = table
    for name in leaf[:-1]:
        place = place[name]
    was = place[leaf[-1]]
    points = [
        ((0.0, 1480.0), (20.0, 1510.0)),
        ((0.0, 9.0),),
        (0.02, 0.02, 0.02),
        ((0.0, 0.0, 0.0), (50.0, 50.0, 9.0)),
    ]
    points.append(((0.0, 0.3, 90.0), (10.0, 0.5, 120.0)))  # a current over time
    words = [
        "regular",
        "thrust",
        "physics",
        "laisn-3-2",
        "v-measured",
        "predicted",
        "2027-01-01T00:00:00+00:00",
        "top",
        "neutral",
    ]
    others = {
        bool: [not was],
        int: [3, 2, 320, 240, 24],
        float: [0.2, 2.5, 0.05, 3.0, 1.25, 40.0, 1490.0, 1020.0],
        tuple: points,
        str: [*words, "kinematic", "L", "ilos", "surface", "end", "refracted", "profile", "direct"],
        type(None): ["T4", 0.3, hull("follower"), "thrust"],
    }[type(was)]
    for other in others:
        place[leaf[-1]] = other
        try:
            made = Scenario.model_validate(table)
        except ValidationError:
            continue
        if made != scenario:
            return made
    raise AssertionError(f"no other value of {leaf} is known")


@pytest.mark.system
def test_what_the_keys_leave_out_changes_nothing() -> None:
    """Setting by setting: a flight that is shared is the one that would be flown, a row that is
    shared the same row.
    """
    sea = OceanTable(waves=WavesTable(kind="jonswap", height_m=0.5, period_s=6.0))
    still = mission(
        ocean=sea, leader=Leader(route=None, waypoints=TURNING, broadcast_attitude=True)
    )
    for base in (still, still.model_copy(update={"motion": "physics", "duration_s": 1.0})):
        plan = CellPlan(scenario=base, runs=2)
        shared, of_cells = [], []
        moved = montecarlo.simulate_mission(base)
        row = computed(moved, plan)
        for leaf in leaves(base):
            # a list of tables, what makes such a list, what needs followers on stations, of which a
            # cell has none, a route, which waypoints replace, settings of a navigator and of the
            # user's own sensors, what needs files, and links, which tests of their own share
            if leaf in {
                ("followers",),
                ("formation", "shape"),
                ("formation", "proximity"),
                ("leader", "broadcast_waypoints"),
                ("leader", "broadcast_position"),
                ("leader", "controller"),
                ("leader", "guidance_position"),
                ("leader", "hydrophone_m"),
                ("leader", "navigation"),
                ("leader", "route"),
                ("leader", "sensors", "custom"),
                ("navigation", "further_links"),
                ("navigation", "custom"),
                ("ocean", "origin"),
                ("ocean", "current"),
                ("ocean", "density"),
                ("ocean", "floor"),
                ("ocean", "sound_speed"),
                ("links",),
                ("navigation", "link"),
                ("sensors", "custom"),
            }:
                continue
            other = changed(base, leaf)
            if MotionSettings.of(other) == MotionSettings.of(base):
                shared.append(leaf)
                served, direct = (
                    montecarlo.with_transmitter_sites(moved, CellSettings.of(other).transmitters),
                    simulate_motion(other),
                )
                for name in ("position", "velocity", "quaternion", "site_offset"):
                    np.testing.assert_array_equal(
                        getattr(served, name), getattr(direct, name), err_msg=str(leaf)
                    )
            if CellPlan(scenario=other, runs=2).key == plan.key:
                of_cells.append(leaf[0])
                assert computed(simulate_motion(other), CellPlan(scenario=other, runs=2)) == row, (
                    leaf
                )
        assert {("name",), ("run",), ("leader", "baseline_m"), ("acoustics", "travel_time")} <= set(
            shared
        )
        assert set(of_cells) == {
            "name",
            "run",
            "epoch",
            "origin_latitude_deg",
            "origin_longitude_deg",
            "video",
        }


def test_run_k_of_a_scenario_s_cell_is_the_flight_with_that_run() -> None:
    given = mission(
        seed=7, sensors=Sensors(depth_sigma_m=0.1), acoustics=Acoustics(loss_probability=0.2)
    )
    states = histories(Cell.of(given, follower=1, runs=4))
    for run in range(4):
        flight = navigate(given.model_copy(update={"run": run}), simulate_motion(given), Navigator)
        assert np.abs(states[:, :, run] - flight.estimates[1].state).max() < 1e-9
    some_runs = histories(
        Cell.of(given.model_copy(update={"run": 9}), follower=1, runs=range(2, 4))
    )
    np.testing.assert_array_equal(some_runs, states[:, :, 2:])


def test_a_cell_of_what_is_not_there_is_refused(flown: Trajectory) -> None:
    given = mission()
    for follower in (-1, 2):
        with pytest.raises(LaisnError, match=f"follower is {follower}, the scenario has 2"):
            Cell.of(given, follower)
    taken = CampaignMission(MotionSettings.of(given), flown)
    assert Cell.of(given.model_copy(update={"name": "other"}), mission=taken).runs == range(60)
    with pytest.raises(
        LaisnError, match="the scenario moves otherwise than the mission that was simulated"
    ):
        Cell.of(given.model_copy(update={"duration_s": 6.0}), mission=taken)
