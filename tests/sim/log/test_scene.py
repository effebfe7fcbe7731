"""What the log draws: hulls, ellipses and rays where geometry puts them, and a layout for Foxglove
that names existing channels.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from foxglove import messages as fg

import laisn_sim
import models
from laisn.arrays import Floats
from sim.attitude import FLATTENING, SEMI_MAJOR_AXIS, geodetic
from sim.film import film_data as film
from sim.flight import FlightRecord
from sim.log.contents import Contents
from sim.log.scene import (
    ESTIMATE_HUE,
    FOLLOWER_HUE,
    LEADER_HUE,
    draw_vehicles,
    layout,
    trail_step,
)
from sim.log.schema import message_class_of
from tests.synthetic import make_flight, messages, short_flight, write_log


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return short_flight()


@pytest.fixture(scope="module")
def written(flight: FlightRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_log(flight, tmp_path_factory.mktemp("log"))


@pytest.mark.parametrize("name", ["leader", "follower"])
def test_the_hull_in_the_scene_fills_the_model(name: str, written: Path) -> None:
    """Extent along the hull and across it, against MuJoCo's own bounding boxes of the geoms."""
    model = mujoco.MjModel.from_xml_path(str(models.path(name)))
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    boxes = [
        (model.geom_aabb[g, :3] + corners * model.geom_aabb[g, 3:])
        @ data.geom_xmat[g].reshape(3, 3).T
        + data.geom_xpos[g]
        for g in range(model.ngeom)
    ]
    points_in_model = np.concatenate(boxes)

    def corners_of(part: Any) -> Any:
        position, orientation, rotation = part.pose.position, part.pose.orientation, np.empty(9)
        mujoco.mju_quat2Mat(
            rotation, np.array([orientation.w, orientation.x, orientation.y, orientation.z])
        )
        if hasattr(part, "size"):
            points = corners * [part.size.x, part.size.y, part.size.z] / 2
        else:
            points = np.array([[v.x, v.y, v.z] for v in part.points])
        return [position.x, position.y, position.z] + points @ rotation.reshape(3, 3).T

    (update,) = messages(written, "/scene/hulls")
    (shape,) = (e for e in update.entities if e.id == f"{name}/hull")
    assert shape.frame_locked
    assert shape.frame_id == name
    parts = [*shape.cylinders, *shape.spheres, *shape.cubes, *shape.triangles]
    points_in_scene = np.concatenate([corners_of(part) for part in parts])
    np.testing.assert_allclose(points_in_scene.min(axis=0), points_in_model.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(points_in_scene.max(axis=0), points_in_model.max(axis=0), atol=1e-6)


def test_fins_of_the_scene_turn_with_their_deflections(
    flight: FlightRecord, tmp_path: Path
) -> None:
    """Rudders of a REMUS 100 turn about the vertical axis and stern planes about the lateral
    one.
    """
    scenario = laisn_sim.load("T5", {"leader.model": "remus100", "duration_s": 30})
    states = flight.trajectory.effector_states.copy()
    states[:, 0], states[10:, 0] = 0.0, [12.0, 0.1, 0.2, -0.1, -0.2]
    trajectory = replace(flight.trajectory, effector_states=states)
    flight_with_fins = replace(flight, scenario=scenario, trajectory=trajectory)
    first, *others, last = messages(write_log(flight_with_fins, tmp_path), "/scene/hulls")
    assert len(others) == 29, "one update a second"

    def quaternions(update: Any) -> list[Floats]:
        (shape,) = (e for e in update.entities if e.id == "leader/hull")
        parts = [part.pose.orientation for part in shape.cubes]
        return [np.array([q.w, q.x, q.y, q.z]) for q in parts]

    model = models.path("remus100").read_text()
    boxes = re.findall(r'<geom name="(\w+)" class="fin"', model)
    assert boxes == ["rudder_top", "rudder_bottom", "stern_plane_port", "stern_plane_starboard"]
    # a positive rudder pushes the stern to port and a positive plane lifts it
    expected = [(3, 0.1), (3, 0.2), (2, 0.1), (2, 0.2)]
    for before, after, (axis, angle) in zip(
        quaternions(first), quaternions(last), expected, strict=True
    ):
        inverse, turned = np.empty(4), np.zeros(4)
        mujoco.mju_negQuat(inverse, before)
        mujoco.mju_mulQuat(turned, after, inverse)
        expected_rotation = np.zeros(4)
        expected_rotation[[0, axis]] = np.cos(angle / 2), np.sin(angle / 2)
        np.testing.assert_allclose(turned, expected_rotation, atol=1e-9)


def test_the_scene_is_complete_at_every_second(flight: FlightRecord, written: Path) -> None:
    update = messages(written, "/scene/vehicles")[20]
    entities = {e.id: e for e in update.entities}
    assert set(entities) == {"leader/trail", "follower/trail", "follower/estimate"}
    assert len(entities["leader/trail"].lines[0].points) == 21
    last = entities["leader/trail"].lines[0].points[-1]
    assert (last.x, last.y, last.z) == tuple(flight.trajectory.position[200, 0])
    # the ellipse that holds 95 % of a normal distribution has half axes √(χ²₀.₉₅ of 2 degrees,
    # 5.991) σ
    ellipse = entities["follower/estimate"].spheres[0]
    variance = np.linalg.eigvalsh(flight.estimates[0].covariance[199, :2, :2])
    np.testing.assert_allclose(
        [ellipse.size.x, ellipse.size.y], 2 * np.sqrt(5.991464547 * variance[::-1]), rtol=1e-9
    )
    half_turn = np.arctan2(ellipse.pose.orientation.z, ellipse.pose.orientation.w)
    major = np.array([np.cos(2 * half_turn), np.sin(2 * half_turn)])
    np.testing.assert_allclose(
        flight.estimates[0].covariance[199, :2, :2] @ major, variance[1] * major, atol=1e-12
    )


def test_a_ping_is_drawn_from_the_transmitters_to_the_hydrophone(
    flight: FlightRecord, written: Path
) -> None:
    trajectory, measured = flight.trajectory, flight.measurements[0]
    ping = messages(written, "/scene/acoustics")[9].entities[0]
    hydrophone, rear = (
        trajectory.site_position[100, trajectory.site(s)]
        for s in ("follower/hydrophone", "leader/tx_rear")
    )
    points = [(p.x, p.y, p.z) for p in ping.lines[0].points]
    assert points[:2] == [tuple(rear), tuple(hydrophone)]
    assert len(points) == 6
    disc = ping.cylinders[0]
    assert (disc.pose.position.x, disc.pose.position.y, disc.pose.position.z) == (
        rear[0],
        rear[1],
        hydrophone[2],
    )
    # Pythagoras: slant range, horizontal range and difference in height
    assert (disc.size.x / 2) ** 2 + (rear[2] - hydrophone[2]) ** 2 == pytest.approx(
        measured.ranges[9, 0] ** 2
    )
    assert len(messages(written, "/scene/acoustics")[12].entities[0].lines[0].points) == 4, (
        "one range was lost"
    )


def test_the_map_agrees_with_the_ellipsoid() -> None:
    """Against the exact transformation: the tangent plane at the origin, in earth-centred
    coordinates.
    """

    def earth_centred(latitude: Any, longitude: Any, height: Any) -> Any:
        squared_eccentricity = FLATTENING * (2 - FLATTENING)
        radius_of_curvature = SEMI_MAJOR_AXIS / np.sqrt(
            1 - squared_eccentricity * np.sin(latitude) ** 2
        )
        return np.stack(
            [
                (radius_of_curvature + height) * np.cos(latitude) * np.cos(longitude),
                (radius_of_curvature + height) * np.cos(latitude) * np.sin(longitude),
                (radius_of_curvature * (1 - squared_eccentricity) + height) * np.sin(latitude),
            ]
        )

    origin = np.deg2rad([60.0, 18.55])
    positions = np.array([[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [-700, 700, 0]], dtype=float)
    latitude, longitude, height = geodetic(positions, 60.0, 18.55).T
    from_origin = (
        earth_centred(np.deg2rad(latitude), np.deg2rad(longitude), height)
        - earth_centred(origin[0], origin[1], 0.0)[:, None]
    )
    sin_latitude, cos_latitude, sin_longitude, cos_longitude = (
        np.sin(origin[0]),
        np.cos(origin[0]),
        np.sin(origin[1]),
        np.cos(origin[1]),
    )
    east, north = (
        -sin_longitude * from_origin[0] + cos_longitude * from_origin[1],
        -sin_latitude * cos_longitude * from_origin[0]
        - sin_latitude * sin_longitude * from_origin[1]
        + cos_latitude * from_origin[2],
    )
    np.testing.assert_allclose(np.column_stack([east, north]), positions[:, :2], atol=0.2)


@pytest.mark.parametrize("followers", [1, 3])
def test_layout_names_channels_and_fields_of_the_flights_own_vehicles(
    followers: int, tmp_path: Path
) -> None:
    flight = make_flight(5.0, followers)
    names = flight.trajectory.names
    contents = Contents(write_log(flight, tmp_path))
    whole_layout = json.loads(layout(names))

    def panels_in(node: Any) -> list[Any]:
        return (
            [node]
            if node["type"] == "panel"
            else [panel for item in node["items"] for panel in panels_in(item["content"])]
        )

    panels = panels_in(whole_layout["content"])
    configs = {panel["panelType"]: panel["config"] for panel in panels}
    assert configs["ThreeDee"]["followTf"] == "leader"
    topics = {
        topic
        for panel in panels
        for topic in [*panel["config"].get("topics", {}), *panel["config"].get("topicColors", {})]
    }
    assert topics | {configs["Log"]["topicToRender"]} <= set(contents.topics)
    assert {f"/{name}/estimate" for name in names[1:]} <= topics
    assert configs["Image"]["imageMode"]["imageTopic"] == "/camera"
    panels_without_camera = panels_in(json.loads(layout(names, camera=False))["content"])
    assert [panel for panel in panels if panel["panelType"] != "Image"] == panels_without_camera
    paths = [
        path["value"].removesuffix(".@rad2deg")
        for panel in panels
        for path in panel["config"].get("paths", [])
    ]
    # E_P, E_B and three ranges of each follower, and the pitch of each vehicle
    assert len(paths) == len(set(paths)) == 5 * followers + followers + 1
    for topic, _, name in (path.partition(".") for path in paths):
        assert name in contents.topics[topic].message_class.DESCRIPTOR.fields_by_name


def test_the_layout_has_the_colours_of_the_film() -> None:
    for hex_colour, (r, g, b) in (
        (LEADER_HUE, film.LEADER),
        (FOLLOWER_HUE, film.TRUTH),
        (ESTIMATE_HUE, film.ESTIMATE),
    ):
        np.testing.assert_allclose(
            [int(hex_colour[i : i + 2], 16) for i in (1, 3, 5)], 255 * np.array([r, g, b]), atol=1
        )


def test_trails_of_many_vehicles_have_the_same_fewer_points_in_any_excerpt() -> None:
    """25 trails of 100 s share 500 points: one every 5 s, and the present position. Those of an
    excerpt from 147 s on have the same points.
    """
    flight = make_flight(300.0, 12)
    instants = flight.trajectory.time.size
    first_instant = 1470
    first_step = first_instant // flight.stride
    estimates = []
    for whole_estimates in flight.estimates:
        is_after = whole_estimates.fix_step > first_step
        of_fixes = {
            name: getattr(whole_estimates, name)[is_after]
            for name in (
                "fix_position",
                "fix_sigma",
                "fix_kind",
                "innovation",
                "innovation_covariance",
            )
        }
        states = {
            "state": whole_estimates.state[first_step:],
            "covariance": whole_estimates.covariance[first_step:],
        }
        fix_step = whole_estimates.fix_step[is_after] - first_step
        estimates.append(replace(whole_estimates, **states, fix_step=fix_step, **of_fixes))
    later = replace(
        flight,
        trajectory=flight.trajectory.part(first_instant, instants - 1),
        measurements=tuple(
            measured.part(first_step, measured.speed.size) for measured in flight.measurements
        ),
        estimates=tuple(estimates),
    )
    draw = draw_vehicles(flight, np.arange(0, instants, 10))
    draw_later = draw_vehicles(later, np.arange(0, later.trajectory.time.size, 10))
    for second in range(110, 153):
        update = draw(10**9, 147 + second).encode()
        assert update == draw_later(10**9, second).encode()
    trails = (
        message_class_of(fg.SceneUpdate.get_schema()).FromString(draw(10**9, 283).encode()).entities
    )
    points = trails[0].lines[0].points
    # at 185, 190 … 280 s, and now
    assert len(points) == 21
    np.testing.assert_allclose(
        [points[0].x, points[-1].x], flight.trajectory.position[[1850, 2830], 0, 0]
    )
    assert trail_step(3) == 1
    assert trail_step(401) == 10
