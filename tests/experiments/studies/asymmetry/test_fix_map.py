"""The pitch study: the map against closed forms and against the sites of the physical leader."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import models
from experiments.studies.asymmetry import fix_map
from laisn.geometry import angle_between
from laisn.settings import LAISN_VARIANTS, NavigationSettings
from sim import attitude
from sim.trajectory import tilted
from tests.effort import examples
from tests.synthetic import make_scenario, make_trajectory

ANYWHERE = NavigationSettings(side_rule="predicted")
"""The side of the leader is that of the prediction, so that the follower may be on either."""


@cache
def leader_model() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(models.path("leader")))
    return model, mujoco.MjData(model)


def physical_ranges(
    pitch: float, depth_offset: float, horizontal_range: float, bearing: float
) -> np.ndarray:
    """Ranges from the sites that MuJoCo gives for a pitched leader at the origin heading north,
    [m].
    """
    model, data = leader_model()
    data.qpos[:] = [0, 0, 0, *attitude.from_euler(0.0, pitch)]
    mujoco.mj_kinematics(model, data)
    follower = np.array(
        [horizontal_range * np.sin(bearing), horizontal_range * np.cos(bearing), -depth_offset]
    )
    sites = [data.site(name).xpos for name in ("tx_rear", "tx_front", "tx_middle")]
    return np.linalg.norm(np.array(sites) - follower, axis=1)


@given(
    pitch=st.floats(-0.5, 0.5),
    offset=st.floats(-15, 15),
    horizontal_range=st.floats(3, 100),
    bearing=st.floats(0, 2 * np.pi),
)
@examples(30)
def test_ranges_are_those_of_the_physical_leader(pitch, offset, horizontal_range, bearing):
    transmitters = ANYWHERE.baseline, ANYWHERE.middle_offset
    received = fix_map.slant_ranges(
        np.array([[pitch, offset, horizontal_range, bearing]]), transmitters
    )
    assert_allclose(
        received[0], physical_ranges(pitch, offset, horizontal_range, bearing), rtol=1e-9
    )


@pytest.mark.parametrize("horizontal_range", [10.0, 20.0, 60.0, 100.0])
def test_abeam_error_is_0_87_m_at_5_degrees_and_10_m_for_any_range(horizontal_range):
    pitch, offset = np.deg2rad(5.0), 10.0
    point = np.array([[pitch, offset, horizontal_range, np.pi / 2]])
    for variant in LAISN_VARIANTS:
        error = fix_map.sweep(point, replace(ANYWHERE, variant=variant))
        # 10 m · sin 5°
        assert_allclose(np.hypot(*error[0]), 0.87, rtol=0.02)
    slant = np.hypot(horizontal_range, offset)
    range_errors = physical_ranges(*point[0]) - physical_ranges(
        0.0, offset, horizontal_range, np.pi / 2
    )
    assert_allclose(
        range_errors[:2], np.array([-1, 1]) * offset * 1.0 * np.sin(pitch) / slant, rtol=0.02
    )


@given(
    pitch=st.floats(-0.35, 0.35),
    offset=st.floats(-15, 15),
    horizontal_range=st.floats(5, 100),
    bearing=st.floats(0.2, 2.9),
)
@examples(60)
def test_pitch_turns_the_fix_about_the_leader(pitch, offset, horizontal_range, bearing):
    closed_form = fix_map.closed_form_error(pitch, offset, horizontal_range, bearing)
    cosine = np.cos(bearing) * np.cos(pitch) - offset / horizontal_range * np.sin(pitch)
    if abs(cosine) > 0.999:
        return  # two intersections that are closer than T, or none
    error = fix_map.sweep(np.array([[pitch, offset, horizontal_range, bearing]]), ANYWHERE)
    assert_allclose(np.hypot(*error[0]), closed_form, atol=1e-4)
    fix = horizontal_range * np.array([np.sin(bearing), np.cos(bearing)]) + error[0]
    assert_allclose(np.hypot(*fix), horizontal_range, atol=1e-4)
    assert_allclose(angle_between(np.arctan2(*fix), 0.0), np.arccos(cosine), atol=1e-4)


def test_small_pitch_adds_the_lever_arm_over_the_sine_of_the_bearing():
    bearing = np.deg2rad([30.0, 90.0, 150.0, 230.0])
    exact = fix_map.closed_form_error(1e-6, 7.0, 40.0, bearing)
    assert_allclose(exact, 7.0 * 1e-6 / np.abs(np.sin(bearing)), rtol=1e-4)


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_a_follower_with_the_attitude_has_no_error(variant):
    with_attitude = replace(ANYWHERE, variant=variant, use_attitude=True)
    grid = np.array(
        [
            [pitch, depth_offset, horizontal_range, bearing]
            for pitch in (-0.2, 0.1)
            for depth_offset in (0.0, 10.0)
            for horizontal_range in (8.0, 50.0)
            for bearing in (0.7, 2.0)
        ]
    )
    error = fix_map.sweep(grid, with_attitude)
    assert_allclose(error, 0.0, atol=1e-5)


def test_map_holds_every_point_once():
    grid = {
        "pitch_deg": (0.0, 5.0),
        "depth_offset_m": (0.0, 10.0),
        "range_m": (20.0,),
        "bearing_deg": (0.0, 90.0, 180.0),
    }
    table = fix_map.measure_map(grid, ANYWHERE)
    points = [
        dict(zip(table, point, strict=True)) for point in np.column_stack(list(table.values()))
    ]
    assert len(points) == 12
    pitched_abeam = [
        point for point in points if point["pitch_deg"] > 4 and point["bearing_deg"] == 90
    ]
    deep_point = next(point for point in pitched_abeam if point["depth_offset_m"] == 10)
    assert deep_point["error_laisn-2_m"] == pytest.approx(
        deep_point["error_closed_form_m"], abs=1e-6
    )
    slant = np.hypot(20.0, 10.0)
    assert deep_point["range_error_front_m"] == pytest.approx(
        10 * np.sin(np.deg2rad(5)) / slant, rel=0.02
    )
    assert deep_point["range_error_rear_m"] == pytest.approx(
        -10 * np.sin(np.deg2rad(5)) / slant, rel=0.02
    )
    for point in points:
        pitch, offset, bearing = (
            np.deg2rad(point["pitch_deg"]),
            point["depth_offset_m"],
            np.deg2rad(point["bearing_deg"]),
        )
        # a fix keeps its range, so that it moves along a chord, ahead as well as aside
        error = fix_map.sweep(
            np.array([[pitch, offset, point["range_m"], bearing]]),
            replace(ANYWHERE, variant="laisn-2"),
        )
        assert point["error_laisn-2_m"] == pytest.approx(np.linalg.norm(error), abs=1e-5)


def test_tilting_moves_nothing_but_the_leaders_attitude():
    trajectory = make_trajectory(make_scenario(10.0))
    pitched = tilted(trajectory, 0.1, -0.2)
    assert_allclose(pitched.pitch[:, 0], 0.1, atol=1e-12)
    assert_allclose(pitched.roll[:, 0], -0.2, atol=1e-12)
    assert_allclose(angle_between(pitched.heading[5, 0], trajectory.heading[5, 0]), 0.0, atol=1e-12)
    assert_allclose(pitched.position, trajectory.position)
    assert_allclose(pitched.quaternion[:, 1], trajectory.quaternion[:, 1])
    restored = tilted(tilted(trajectory, 0.0), trajectory.pitch[:, 0], trajectory.roll[:, 0])
    assert_allclose(restored.site_position, trajectory.site_position, atol=1e-9)
