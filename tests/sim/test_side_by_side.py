"""Missions that are simulated side by side: each moves as it does alone, to the bit."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from experiments.campaign import campaign
from experiments.flight.library import load_scenario
from experiments.study.file import study_of
from experiments.study.plan import engines_of, plan_of
from experiments.study.run import StudyResults, fly_studies
from laisn.arrays import Ints
from sim import side_by_side
from sim.scenario.parts import MotionSettings
from sim.side_by_side import groups_for_lanes, simulate_side_by_side
from sim.simulation import Mission, mission_for_lanes, simulate_open_loop
from sim.trajectory import Trajectory
from tests.sim.water.field_data import metres_field, scenario_file
from tests.sim.water.test_casts import table

RECORDED = ("pose", "twist", "effector_states", "water_velocity")


def motion_of(*settings: str, engine: str = "direct") -> MotionSettings:
    """Motion of 20 s on route T5 with these changes."""
    keys = (f"timing.engine={engine}", "duration_s=20", *settings)
    return MotionSettings.of(load_scenario("T5", keys))


def require_equal(actual: Trajectory | None, expected: Trajectory) -> None:
    assert actual is not None
    for name in RECORDED:
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), err_msg=name)


def varied_missions(model: str = "follower") -> list[MotionSettings]:
    """Missions that differ in numbers of every kind."""
    return [
        motion_of(
            f"followers.0.model={model}",
            f"followers.0.drag_scale={1.0 + 0.1 * i}",
            f"followers.0.thrust_scale={1.0 - 0.05 * i}",
            f"leader.added_mass_scale={1.0 + 0.05 * i}",
            f"leader.excess_buoyancy_n={i}",
            f"followers.0.depth_m={8 + i}",
            f"ocean.current_speed_m_s={0.05 * i}",
            f"ocean.current_direction_deg={40 * i}",
            f"ocean.current_shear_per_s={0.002 * i}",
        )
        for i in range(3)
    ]


@pytest.mark.system
@pytest.mark.parametrize("model", ["follower", "remus100", "lauv", "bluerov2_heavy"])
def test_missions_move_as_each_does_alone(model: str) -> None:
    motions = varied_missions(model)
    alone = [simulate_open_loop(motion) for motion in motions]
    assert len({trajectory.pose[-1].tobytes() for trajectory in alone}) == 3
    for actual, expected in zip(simulate_side_by_side(motions), alone, strict=True):
        require_equal(actual, expected)


def in_waves(
    kind: str, depths: Sequence[float], *, least_spreading_deg: int = 0, step_deg: int = 0
) -> list[MotionSettings]:
    """Missions whose seas differ in all settings; pairs have the same seed."""
    waves = (f"ocean.waves.kind={kind}", "ocean.waves.components=20")
    return [
        motion_of(
            *waves,
            f"seed={1 + i // 2}",
            f"ocean.waves.height_m={0.4 + 0.1 * i}",
            f"ocean.waves.period_s={4 + i}",
            f"ocean.waves.spreading_deg={least_spreading_deg + step_deg * i}",
            f"ocean.waves.direction_deg={50 * i}",
            f"ocean.floor_depth_m={20 + 5 * i}",
            f"ocean.current_speed_m_s={0.1 * i}",
            "ocean.current_shear_per_s=0.01",
            f"followers.0.depth_m={depth}",
        )
        for i, depth in enumerate(depths)
    ]


@pytest.mark.system
@pytest.mark.parametrize(
    ("kind", "least_spreading_deg", "step_deg"),
    [("regular", 0, 0), ("jonswap", 0, 0), ("jonswap", 5, 10), ("jonswap", 0, 10)],
)
def test_missions_in_waves_move_as_each_does_alone(
    kind: str, least_spreading_deg: int, step_deg: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of them leaves the water, through the surface of its own waves. Seas that spread do
    not lie beside one that does not.
    """
    motions = in_waves(
        kind, [9.0, 9.0, 5.0, 0.2], least_spreading_deg=least_spreading_deg, step_deg=step_deg
    )
    alone = [simulate_open_loop(motion) for motion in motions]
    assert len({trajectory.water_velocity[-1].tobytes() for trajectory in alone}) == 4
    simulated_alone: list[MotionSettings] = []

    def recording_simulate(motion: MotionSettings) -> Trajectory:
        simulated_alone.append(motion)
        return simulate_open_loop(motion)

    monkeypatch.setattr(side_by_side, "simulate_open_loop", recording_simulate)
    for actual, expected in zip(simulate_side_by_side(motions), alone, strict=True):
        require_equal(actual, expected)
    some_spread = least_spreading_deg == 0 and step_deg > 0
    assert simulated_alone == (motions if some_spread else [])


def in_a_field(folder: Path) -> Callable[..., MotionSettings]:
    """Makes missions of numbers, and perhaps with further settings, in the sway of a gyre, in water
    whose density grows with depth; they differ in their hulls.
    """
    metres_field(folder / "gyre.nc", 100.0, 20.0)
    table(folder / "cast.csv", "depth,density", [0.0, 10.0, 30.0], [1004.0, 1005.0, 1011.0])
    toml = scenario_file(
        folder / "gyre.nc", origin='[ocean.density]\nfile = "cast.csv"\ntrim_depth_m = 12\n'
    )

    def mission(i: int, *further: str) -> MotionSettings:
        settings = (
            "timing.engine=direct",
            f"leader.drag_scale={1 + 0.1 * i}",
            "leader.waypoints=[[0, 400, 300], [20, 412, 316]]",
            f"followers.0.depth_m={9 + i}",
        )
        return MotionSettings.of(load_scenario(str(toml), (*settings, *further)))

    return mission


@pytest.mark.long
def test_missions_in_a_field_move_as_each_does_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = in_a_field(tmp_path)
    motions = [mission(i) for i in range(3)]
    alone = [simulate_open_loop(motion) for motion in motions]
    # the leader is far from the middle of the gyre
    assert np.abs(np.diff(alone[0].water_velocity, axis=1)).max() > 0.05
    # none is flown alone
    monkeypatch.delattr(side_by_side, "simulate_open_loop")
    for actual, expected in zip(simulate_side_by_side(motions), alone, strict=True):
        require_equal(actual, expected)


@pytest.mark.long
def test_missions_in_different_parts_of_a_field_move_alone(tmp_path: Path) -> None:
    mission = in_a_field(tmp_path)
    far = [f"leader.waypoints=[[0, {200 * i}, 0], [20, {200 * i}, 20]]" for i in range(3)]
    motions = [mission(i, waypoints) for i, waypoints in enumerate(far)]
    assert groups_for_lanes(motions) == [[0, 1, 2]]
    assert not side_by_side.fly_group([mission_for_lanes(motion) for motion in motions])
    require_each_as_alone(motions)


@pytest.mark.system
@pytest.mark.parametrize("model", ["follower", "remus100"])
def test_missions_on_different_routes_steer_as_each_does_alone(model: str) -> None:
    """One straight on, one with a stop, one with turns that saturate its effectors."""
    routes = (
        "[[0, 0, 0], [60, 80, 0]]",
        "[[0, 0, 0], [20, 20, 0], [60, 20, 0]]",
        "[[0, 0, 0], [15, 30, 0], [35, 36, 30], [60, 0, 30]]",
    )
    settings = ("duration_s=40", f"followers.0.model={model}", "followers.0.route=null")
    motions = [
        motion_of(
            *settings, f"followers.0.waypoints={route}", f"followers.0.excess_buoyancy_n={3 * i}"
        )
        for i, route in enumerate(routes)
    ]
    alone = [simulate_open_loop(motion) for motion in motions]
    straight, _, turning = (
        np.abs(trajectory.effector_states[:, 1]).max(axis=0) for trajectory in alone
    )
    assert np.any(turning > 3.0 * straight)
    for actual, expected in zip(simulate_side_by_side(motions), alone, strict=True):
        require_equal(actual, expected)


@pytest.mark.system
def test_a_hull_that_leaves_the_water_moves_as_it_does_alone() -> None:
    """Beside one that stays immersed: added mass is that of the immersed part."""
    motions = [motion_of(f"followers.0.depth_m={depth}") for depth in (0.05, 0.1, 9.0)]
    for actual, motion in zip(simulate_side_by_side(motions), motions, strict=True):
        require_equal(actual, simulate_open_loop(motion))


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[list[int]]:
    """Numbers of the vehicles that each group since then has flown; none is known before."""
    groups = list[list[int]]()
    fly_vehicles = side_by_side._fly_vehicles

    def fly_and_record(missions: Sequence[Mission], vehicles: Ints) -> bool:
        groups.append(vehicles.tolist())
        return fly_vehicles(missions, vehicles)

    monkeypatch.setattr(side_by_side, "_fly_vehicles", fly_and_record)
    side_by_side._known_motions.clear()
    return groups


def varied_followers(first: int, *settings: str) -> list[MotionSettings]:
    """Three missions in JONSWAP waves and a current, whose followers differ."""
    sea = ("ocean.waves.kind=jonswap", "ocean.waves.components=20", "ocean.current_speed_m_s=0.2")
    return [
        motion_of(*sea, f"followers.0.drag_scale={1.0 + 0.01 * i}", *settings)
        for i in range(first, first + 3)
    ]


def require_each_as_alone(motions: Sequence[MotionSettings]) -> None:
    for actual, motion in zip(simulate_side_by_side(motions), motions, strict=True):
        require_equal(actual, simulate_open_loop(motion))


@pytest.mark.system
def test_a_leader_of_all_missions_is_flown_once(flown: list[list[int]]) -> None:
    require_each_as_alone(varied_followers(0))
    require_each_as_alone(varied_followers(3))
    # on another route of the follower, whose table of references is another
    require_each_as_alone(varied_followers(0, "followers.0.depth_m=7"))
    assert flown == [[0, 1], [1], [1]]


@pytest.mark.system
def test_missions_without_any_difference_in_motion_are_flown_once(flown: list[list[int]]) -> None:
    calm = [motion_of(f"seed={i}") for i in range(6)]
    require_each_as_alone(calm[:3])
    require_each_as_alone(calm[3:])
    assert flown == [[0, 1], []]


@pytest.mark.system
@pytest.mark.parametrize(
    "change",
    [
        "leader.drag_scale=1.01",
        "leader.lift_scale=1.01",
        "leader.thrust_scale=0.99",
        "leader.added_mass_scale=1.01",
        "leader.excess_buoyancy_n=1",
        "leader.cg_offset_x_m=0.001",
        "leader.depth_m=11",
        "leader.start_speed_m_s=0.9",
        "leader.waypoints=[[0, 0, 0], [40, 30, 60]]",
        "leader.depth_control=thrust",
        "leader.model=lauv",
        "seed=7",
        "ocean.waves.height_m=0.4",
        "ocean.floor_depth_m=35",
        "ocean.current_speed_m_s=0.21",
        "ocean.current_shear_per_s=0.001",
        "ocean.density_kg_m3=1010",
        "timing.physics_step_s=0.025",
        "duration_s=21",
    ],
)
def test_whatever_changes_a_leaders_motion_makes_it_fly(
    change: str, flown: list[list[int]]
) -> None:
    require_each_as_alone(varied_followers(0))
    require_each_as_alone(varied_followers(0, change))
    assert flown[0] == [0, 1]
    assert 0 in flown[1]


@pytest.mark.system
def test_a_leader_that_differs_in_one_mission_is_flown_in_all(flown: list[list[int]]) -> None:
    motions = [*varied_followers(0), *varied_followers(3, "leader.drag_scale=1.1")[:1]]
    require_each_as_alone(motions)
    require_each_as_alone(motions)
    assert flown == [[0, 1], [0, 1]]


def test_a_mission_that_ends_early_does_not_end_others() -> None:
    """It ends at the floor; the others continue."""
    normal = motion_of("ocean.floor_depth_m=12")
    heavy = motion_of(
        "ocean.floor_depth_m=12", "leader.excess_buoyancy_n=-100", "leader.depth_m=11"
    )
    first, grounded, second = simulate_side_by_side([normal, heavy, normal])
    assert grounded is None
    require_equal(first, simulate_open_loop(normal))
    require_equal(second, simulate_open_loop(normal))


def test_missions_with_arrays_of_one_shape_form_groups() -> None:
    in_still_water = [motion_of(f"followers.0.drag_scale={1 + 0.01 * i}") for i in range(9)]
    longer = [motion_of("duration_s=30") for _ in range(3)]
    others: Sequence[MotionSettings] = [
        motion_of(engine="mujoco"),
        motion_of("ocean.waves.kind=regular"),
        motion_of("ocean.waves.kind=jonswap"),
        motion_of("ocean.waves.kind=jonswap", "ocean.waves.components=50"),
        motion_of("motion=kinematic"),
        motion_of("followers.0.model=remus100"),
    ]
    groups = groups_for_lanes([*in_still_water, *longer, *others])
    # a group has eight missions at most, so that the ninth remains alone
    assert groups == [[*range(8)], [9, 10, 11]]
    # waves that all run one way are added up otherwise
    in_waves_of_one_kind = [
        motion_of(
            "ocean.waves.kind=jonswap",
            f"seed={i}",
            f"ocean.waves.height_m={0.2 + 0.1 * i}",
            f"ocean.waves.spreading_deg={5 * i * (i % 2)}",
        )
        for i in range(6)
    ]
    assert groups_for_lanes(in_waves_of_one_kind) == [[0, 2, 4], [1, 3, 5]]
    assert groups_for_lanes(in_still_water, most=3) == [[0, 1, 2], [3, 4, 5], [6, 7, 8]]


def results_of_study(folder: object, **keys: object) -> StudyResults:
    """Results of a study of five drawn motions."""
    study = study_of(
        "T5",
        {
            "runs": 2,
            "realizations": 5,
            "draw": {"followers.0.drag_scale": {"uniform": [0.8, 1.2]}},
            "set": {"duration_s": 20.0},
            "engine": "direct",
            **keys,
        },
    )
    (results,) = fly_studies([plan_of(study)], folder, workers=1, quiet=True)  # type: ignore[arg-type]
    return results


@pytest.mark.system
def test_a_study_gives_the_same_in_lanes_and_alone(
    tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    group_sizes: list[int] = []
    simulate = side_by_side.simulate_side_by_side

    def recording_simulate(motions: Sequence[MotionSettings]) -> list[Trajectory | None]:
        group_sizes.append(len(motions))
        return simulate(motions)

    monkeypatch.setattr(campaign.montecarlo, "simulate_side_by_side", recording_simulate)
    in_lanes = results_of_study(tmp_path / "lanes")  # type: ignore[operator]
    assert group_sizes == [5]
    # a motion all of whose results are stored is not stored itself; a page that needs it flies it
    # again
    store = in_lanes.store
    assert not any(store.has(entry.motion_key) for entry in in_lanes.plan.entries)
    assert results_of_study(tmp_path / "lanes").rows == in_lanes.rows  # type: ignore[operator]
    assert group_sizes == [5]
    assert engines_of(in_lanes.plan) == ["direct"]
    monkeypatch.setattr(side_by_side, "MAX_ALONE", 8)
    alone = results_of_study(tmp_path / "alone")  # type: ignore[operator]
    assert group_sizes == [5]
    assert in_lanes.rows == alone.rows

    by_mujoco = results_of_study(tmp_path / "mujoco", engine="mujoco")  # type: ignore[operator]
    assert engines_of(by_mujoco.plan) == ["mujoco"]
    errors, expected = (
        np.array([row["e_p_mean_m"] for row in results.rows]) for results in (alone, by_mujoco)
    )
    assert not np.array_equal(errors, expected)
    np.testing.assert_allclose(errors, expected, rtol=0, atol=1e-9)
