"""Cells: what they share, what their keys hold, and whose noise they have."""

import gc
import weakref
from dataclasses import replace
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
    """A kinematic scenario with a turning leader and two followers."""
    fields = {"leader": Leader(route=None, waypoints=TURNING), "name": "turning", **changes}
    followers = (Follower(name="one", route="T3", depth_m=14.0), Follower(name="two", route="T5"))
    return Scenario(motion="kinematic", duration_s=DURATION, followers=followers, **fields)


@pytest.fixture(scope="module")
def flown() -> Trajectory:
    return montecarlo.simulate_mission(mission())


def rows_of(flown: Trajectory, *plans: CellPlan) -> list[Any]:
    """The rows of cells of one trajectory, computed together."""
    return [row for _, row, _ in compute(flown, plans)]


def test_a_mission_is_freed_with_its_last_reference() -> None:
    """Its arrays take megabytes, and the garbage collector, which counts objects, would let many
    of them pile up.
    """
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


def test_cells_that_differ_in_the_inclinometer_alone_do_not_share_measurements(
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
    ([exact_row], [sensing_row]) = rows_of(flown, exact), rows_of(flown, sensing)
    assert exact_row["e_p_mean_m"] != sensing_row["e_p_mean_m"]
    assert rows_of(flown, exact, sensing) == [exact_row, sensing_row]
    assert rows_of(flown, sensing, exact) == [sensing_row, exact_row]


one_of = st.sampled_from
LEADERS = st.builds(
    lambda baseline, offset, broadcast: Leader(
        route=None,
        waypoints=TURNING,
        baseline_m=baseline,
        middle_offset_m=offset,
        broadcast_attitude=broadcast,
    ),
    one_of([1.0, 2.0]),
    one_of([0.1, 0.2]),
    st.booleans(),
)
SENSORS = st.builds(
    Sensors,
    heading_bias_deg=one_of([0.0, 5.0]),
    depth_sigma_m=one_of([0.0, 0.1]),
    leader_attitude_sigma_deg=one_of([0.0, 1.0]),
    leader_attitude_senses_acceleration=st.booleans(),
    leader_gyro_time_constant_s=one_of([0.0, 4.0]),
)
ACOUSTICS = st.builds(
    Acoustics,
    range_scale_mean_m=one_of([0.1, 0.3]),
    travel_time=st.booleans(),
    ping_slot_s=one_of([0.0, 0.05]),
    sound_speed_bias_m_s=one_of([0.0, 10.0]),
    sound_speed_profile=one_of([(), ((0.0, 1480.0), (20.0, 1510.0))]),
    clock_offset_s=one_of([0.0, 1e-4]),
    clock_drift_ppm=one_of([0.0, 50.0]),
    bottom_echo_probability=one_of([0.0, 0.3]),
    surface_echo_probability=one_of([0.0, 0.3]),
    loss_probability=one_of([0.0, 0.2]),
    max_range_m=one_of([0.0, 25.0]),
)
TIMINGS = st.builds(
    Timing,
    filter_step_s=one_of([0.1, 0.2]),
    message_interval_s=one_of([1.0, 2.0]),
    physics_step_s=one_of([0.02]),
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
    TIMINGS,
    one_of(["laisn-2", "laisn-3-1", "laisn-best"]),
    st.booleans(),
    one_of([0, 1]),
)


@given(plans=st.lists(PLANS, min_size=2, max_size=4), data=st.data())
@settings(max_examples=40)
def test_a_cell_depends_on_no_other_and_on_no_order(
    plans: list[CellPlan], data: st.DataObject
) -> None:
    cell_settings = montecarlo.CellSettings.of(mission())
    trajectory, _ = montecarlo.mission_of(mission()).motion_and_measurements(cell_settings, 0)
    alone = {plan.key: rows_of(trajectory, plan) for plan in plans}
    order = data.draw(st.permutations(plans))
    assert rows_of(trajectory, *order) == [row for plan in order for row in alone[plan.key]]


def leaves(section: BaseModel) -> list[tuple[str, ...]]:
    """Names of all settings within a section that are no sections themselves."""
    names: list[tuple[str, ...]] = []
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, BaseModel):
            names += [(name, *rest) for rest in leaves(value)]
        else:
            names.append((name,))
    return names


def changed(scenario: Scenario, leaf: tuple[str, ...]) -> Scenario:
    """A valid scenario that differs in one setting."""
    table = scenario.model_dump()
    section = table
    for name in leaf[:-1]:
        section = section[name]
    old_value = section[leaf[-1]]
    tuples = [
        ((0.0, 1480.0), (20.0, 1510.0)),
        ((0.0, 9.0),),
        (0.02, 0.02, 0.02),
        ((0.0, 0.0, 0.0), (50.0, 50.0, 9.0)),
    ]
    tuples.append(((0.0, 0.3, 90.0), (10.0, 0.5, 120.0)))  # a current over time
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
    candidates = {
        bool: [not old_value],
        int: [3, 2, 320, 240, 24],
        float: [0.2, 2.5, 0.05, 3.0, 1.25, 40.0, 1490.0, 1020.0],
        tuple: tuples,
        str: [*words, "kinematic", "L", "ilos", "surface", "end", "refracted", "profile", "direct"],
        type(None): ["T4", 0.3, hull("follower"), "thrust", "free"],
    }[type(old_value)]
    for candidate in candidates:
        section[leaf[-1]] = candidate
        try:
            changed_scenario = Scenario.model_validate(table)
        except ValidationError:
            continue
        if changed_scenario != scenario:
            return changed_scenario
    raise AssertionError(f"no other value of {leaf} is known")


@pytest.mark.system
def test_what_the_keys_leave_out_changes_nothing() -> None:
    """Setting by setting: where a changed setting has the same motion, the shared motion is the
    one that would be flown; where the key of the cell is the same, so is its row.
    """
    sea = OceanTable(waves=WavesTable(kind="jonswap", height_m=0.5, period_s=6.0))
    turning = mission(
        ocean=sea, leader=Leader(route=None, waypoints=TURNING, broadcast_attitude=True)
    )
    for base in (turning, turning.model_copy(update={"motion": "physics", "duration_s": 1.0})):
        plan = CellPlan(scenario=base, runs=2)
        sharing_motion, sharing_key = [], []
        base_motion = montecarlo.simulate_mission(base)
        row = rows_of(base_motion, plan)
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
                sharing_motion.append(leaf)
                shared_motion, flown_motion = (
                    montecarlo.with_transmitter_sites(
                        base_motion, CellSettings.of(other).transmitters
                    ),
                    simulate_motion(other),
                )
                for name in ("position", "velocity", "quaternion", "site_offset"):
                    np.testing.assert_array_equal(
                        getattr(shared_motion, name), getattr(flown_motion, name), err_msg=str(leaf)
                    )
            if CellPlan(scenario=other, runs=2).key == plan.key:
                sharing_key.append(leaf[0])
                assert rows_of(simulate_motion(other), CellPlan(scenario=other, runs=2)) == row, (
                    leaf
                )
        assert {("name",), ("run",), ("leader", "baseline_m"), ("acoustics", "travel_time")} <= set(
            sharing_motion
        )
        assert set(sharing_key) == {
            "name",
            "run",
            "epoch",
            "origin_latitude_deg",
            "origin_longitude_deg",
            "video",
        }


def test_run_k_of_a_scenario_s_cell_is_the_flight_with_that_run() -> None:
    scenario = mission(
        seed=7, sensors=Sensors(depth_sigma_m=0.1), acoustics=Acoustics(loss_probability=0.2)
    )
    states = histories(Cell.of(scenario, follower=1, runs=4))
    for run in range(4):
        flight = navigate(
            scenario.model_copy(update={"run": run}), simulate_motion(scenario), Navigator
        )
        assert np.abs(states[:, :, run] - flight.estimates[1].state).max() < 1e-9
    some_runs = histories(
        Cell.of(scenario.model_copy(update={"run": 9}), follower=1, runs=range(2, 4))
    )
    np.testing.assert_array_equal(some_runs, states[:, :, 2:])


def test_a_cell_without_its_follower_or_with_another_mission_is_refused(flown: Trajectory) -> None:
    scenario = mission()
    for follower in (-1, 2):
        with pytest.raises(LaisnError, match=f"follower is {follower}, the scenario has 2"):
            Cell.of(scenario, follower)
    campaign_mission = CampaignMission(MotionSettings.of(scenario), flown)
    assert Cell.of(
        scenario.model_copy(update={"name": "other"}), mission=campaign_mission
    ).runs == range(60)
    with pytest.raises(
        LaisnError, match="the scenario moves otherwise than the mission that was simulated"
    ):
        Cell.of(scenario.model_copy(update={"duration_s": 6.0}), mission=campaign_mission)


_MEASURED_ON: list[Trajectory] = []


def _facts_and_their_motion(_: MotionSettings, trajectory: Trajectory) -> list[dict[str, Any]]:
    """A pitch of the leader for one follower; notes the motion of which it was asked."""
    _MEASURED_ON.append(trajectory)
    return [{"leader_pitch_rms_deg": 1.0}]


def test_facts_of_all_cells_are_of_the_missions_own_motion() -> None:
    """Not of the motion at the steps of messages, of which the bound of the cell before was."""
    cell = CellPlan(
        scenario=mission(navigation=Navigation(variant="tight")),
        runs=1,
        measured={"navigation.expected_pitch_deg": "leader_pitch_rms_deg"},
        facts=_facts_and_their_motion,
    )
    trajectory = simulate_motion(cell.scenario)
    rows = [row for _, row, _ in compute(trajectory, [cell, replace(cell, first_run=1)])]
    assert all(row["bound_rms_m"] > 0.0 for row in rows)
    assert [motion is trajectory for motion in _MEASURED_ON] == [True, True]
