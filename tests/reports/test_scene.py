"""The mission in 3D: its data, read back by a decoder of its own, and the page in a browser."""

import base64
import dataclasses
import hashlib
import json
import re
import shlex
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.flight.results import camera_of
from laisn.arrays import Floats
from laisn.estimates import FixKind
from reports import scene as package
from reports.flight_report import scene_of_flight
from reports.page import Page, PageSection, Replay, render
from reports.replay_page import Replayed
from reports.scene.codec import Packer
from reports.scene.measured import Measured, scene_of_measured
from reports.scene.mission import CROWD, Scene, held, rate_of, turns
from sim import attitude
from sim.film.film_data import FilmData
from sim.flight import FlightRecord
from tests import browser
from tests.reports.test_replay_page import replayed_vehicle
from tests.synthetic import make_flight, moved

SCENE = Path(package.__file__).parent
HALF_MILLIMETRE = 0.0005 + 1e-9


def inflated(text: str) -> bytes:
    return zlib.decompress(base64.b64decode(text), -15)


def read_array(data: bytes, layout: dict[str, Any]) -> Floats:
    """An array as `Packer` documents it: varints of zigzag differences, column by column."""
    offset = int(layout["at"])
    columns = []
    for _ in range(int(layout["columns"])):
        integers = []
        for _ in range(int(layout["rows"])):
            code = shift = 0
            while True:
                byte = data[offset]
                offset += 1
                code |= (byte & 0x7F) << shift
                shift += 7
                if byte < 0x80:
                    break
            integers.append(-((code + 1) // 2) if code % 2 else code // 2)
        column = np.array(integers, dtype=np.int64)
        for _ in range(int(layout["order"])):
            column = np.cumsum(column)
        columns.append(column * layout["unit"])
    return np.array(columns, dtype=np.float64).T


def arrays_of(scene: Scene) -> dict[str, Floats]:
    data = inflated(scene.data)
    return {name: read_array(data, layout) for name, layout in scene.meta["arrays"].items()}


@given(
    values=st.lists(st.lists(st.integers(-(2**44), 2**44), min_size=3, max_size=3), min_size=1),
    order=st.integers(0, 2),
)
def test_what_is_packed_is_read_back(values: list[list[int]], order: int) -> None:
    packer = Packer()
    packer.add("first", [1.0, 2.0], order=1)
    packer.add("second", values, 1.0, order)
    data = inflated(packer.text())
    table = packer.table()
    assert read_array(data, table["first"]).T.tolist() == [[1.0, 2.0]]
    assert read_array(data, table["second"]).tolist() == values


def test_numbers_are_rounded_to_their_unit() -> None:
    packer = Packer()
    values = np.random.default_rng(2).normal(scale=100.0, size=(50, 4))
    packer.add("values", values, 0.01)
    read = read_array(inflated(packer.text()), packer.table()["values"])
    assert np.abs(read - values).max() <= 0.005 + 1e-9


def test_an_array_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="'gaps' of a scene is not finite"):
        Packer().add("gaps", [0.0, np.nan])


def test_the_scene_holds_poses_estimates_and_sites() -> None:
    flight = make_flight(20.0)
    scene = scene_of_flight(flight)
    meta, array = scene.meta, arrays_of(scene)
    truth = flight.trajectory
    time = meta["start"] + np.arange(len(array["position"])) / meta["hz"]
    assert meta["hz"] == pytest.approx(5.0)
    assert time[-1] == pytest.approx(truth.time[-1])
    position, quaternion = truth.at(time)
    assert np.abs(array["position"].reshape(position.shape) - position).max() <= HALF_MILLIMETRE
    # an attitude is that of the quaternion with the other sign too
    packed = array["quaternion"].reshape(quaternion.shape)
    ahead = np.array([1.0, 0.0, 0.0])
    difference = attitude.rotate(packed, ahead) - attitude.rotate(quaternion, ahead)
    assert np.abs(difference).max() < 1e-3
    assert np.einsum("nvi,nvi->nv", packed[1:], packed[:-1]).min() > 0
    steps = truth.time[flight.step_index()]
    state = flight.estimates[0].state
    east = np.interp(time, steps, state[:, 0])
    assert np.abs(array["estimate"][1:, 0] - east[1:]).max() <= HALF_MILLIMETRE
    assert meta["known"] == [pytest.approx(steps[0])]
    assert [vehicle["role"] for vehicle in meta["vehicles"]] == [
        "leader",
        "follower",
    ]
    assert meta["vehicles"][0]["transmitters"][0] == [-1.0, 0.0, 0.0]
    assert meta["vehicles"][1]["hydrophone"] == [0.0, 0.0, 0.1]


def test_messages_keep_their_time_range_and_kind() -> None:
    flight = make_flight(20.0)
    measured, estimates = flight.measurements[0], flight.estimates[0]
    array = arrays_of(scene_of_flight(flight))
    sent = flight.trajectory.time[0] + measured.time[measured.message_step - 1]
    assert np.abs(array["time0"][:, 0] - sent).max() <= 0.005 + 1e-9
    lost = np.isnan(measured.ranges)
    assert lost.any()
    assert (array["range0"][lost] == 0).all()
    assert np.abs(array["range0"] - measured.ranges)[~lost].max() <= 0.005 + 1e-9
    kinds = dict(zip(estimates.fix_step.tolist(), estimates.fix_kind.tolist(), strict=True))
    expected = [kinds.get(step, -1) for step in measured.message_step.tolist()]
    assert array["kind0"][:, 0].tolist() == expected


def test_lost_and_rejected_messages_stand_on_the_time_line() -> None:
    flight = make_flight(20.0)
    (estimates,) = flight.estimates
    kinds = np.full(estimates.fix_kind.size, FixKind.TWO_POINTS)
    kinds[[2, 5]] = [FixKind.GATED, FixKind.LOST]
    changed = dataclasses.replace(
        flight, estimates=(dataclasses.replace(estimates, fix_kind=kinds.astype(np.int64)),)
    )
    times = flight.trajectory.time[0] + estimates.fix_step[[2, 5]] * flight.measurements[0].dt
    assert scene_of_flight(changed).meta["messagesRefused"] == [
        [pytest.approx(times[0], abs=0.06), "gate", 0],
        [pytest.approx(times[1], abs=0.06), "loss", 0],
    ]


def test_a_turn_begins_where_the_leader_leaves_its_course() -> None:
    """North for 60 s, then a quarter of a circle to the east within 15 s."""
    flight = make_flight(120.0)
    truth = flight.trajectory
    heading = np.interp(truth.time, [0.0, 60.0, 75.0], [0.0, 0.0, np.pi / 2])
    level = np.zeros_like(heading)
    quaternion = truth.quaternion.copy()
    quaternion[:, 0] = attitude.from_euler(heading, level, level)
    turned = dataclasses.replace(flight, trajectory=moved(truth, quaternion=quaternion))
    assert turns(turned) == [(pytest.approx(60.0, abs=3.0), pytest.approx(90.0, abs=0.5))]


def test_a_measured_log_shows_the_leader_as_broadcast_and_the_surveyed_path() -> None:
    """The leader is 30 m north of the path, which runs east at 1 m/s; the estimate is 3 m off."""
    replayed = replayed_vehicle()
    scene = scene_of_measured("log", [measured_of(replayed)])
    array = arrays_of(scene)
    time = scene.meta["start"] + np.arange(len(array["position"])) / scene.meta["hz"]
    leader, follower = np.moveaxis(array["position"].reshape(-1, 2, 3), 1, 0)
    between_messages = (time >= 10.0) & (time <= 40.0)  # from the first to the last message
    expected = np.column_stack([time, np.full_like(time, 30.0), np.full_like(time, -5.0)])
    assert np.abs(leader - expected)[between_messages].max() <= HALF_MILLIMETRE
    expected[:, 1] = 0.0
    assert np.abs(follower - expected)[between_messages].max() <= HALF_MILLIMETRE
    assert (
        np.abs(array["estimate"] - [[0.0, 3.0]] - expected[:, :2] * [1, 0])[between_messages].max()
        < 0.001
    )
    assert scene.meta["truth"]
    assert scene.meta["beacons"] == []
    assert scene.meta["vehicles"][0]["transmitters"] == [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    assert scene.meta["used"] == 2
    assert array["major"].max() == pytest.approx(2.0, abs=0.001)
    assert array["minor"].max() == pytest.approx(0.5, abs=0.001)
    # without a surveyed path hulls are where they are estimated
    without_path = scene_of_measured("log", [measured_of(replayed_vehicle(path=None))])
    assert not without_path.meta["truth"]
    north = arrays_of(without_path)["position"].reshape(-1, 2, 3)[between_messages, 1, 1]
    assert north == pytest.approx(np.full(north.size, 3.0), abs=HALF_MILLIMETRE)


def test_a_leader_is_shown_by_the_first_vehicle_that_heard_of_it() -> None:
    """A vehicle without messages stands before the one that has them all."""
    heard = replayed_vehicle()
    silent = replayed_vehicle(
        measurements=dataclasses.replace(
            heard.measurements,
            message_step=np.empty(0, dtype=np.int64),
            message=np.empty((0, heard.measurements.message.shape[1])),
            ranges=np.empty((0, 3)),
        ),
        estimates=dataclasses.replace(
            heard.estimates,
            fix_step=np.empty(0, dtype=np.int64),
            fix_position=np.empty((0, 2)),
            fix_sigma=np.empty(0),
            fix_kind=np.empty(0, dtype=np.int64),
            innovation=np.empty((0, 2)),
            innovation_covariance=np.empty((0, 2, 2)),
        ),
    )
    both = scene_of_measured("log", [measured_of(silent), measured_of(heard)])
    alone = scene_of_measured("log", [measured_of(heard)])
    np.testing.assert_array_equal(
        arrays_of(both)["position"].reshape(-1, 3, 3)[:, 0],
        arrays_of(alone)["position"].reshape(-1, 2, 3)[:, 0],
    )
    leader_speed = [
        arrays_of(scene)["speed"].reshape(-1, n)[:, 0] for scene, n in ((both, 3), (alone, 2))
    ]
    np.testing.assert_array_equal(*leader_speed)


def test_fixed_transmitters_take_the_place_of_a_leader() -> None:
    replayed = replayed_vehicle()
    transmitters = np.full((4, 3, 3), np.nan)
    transmitters[:, 0], transmitters[2:, 1] = [1.0, 2.0, 3.0], [10.0, 20.0, 30.0]
    measurements = dataclasses.replace(replayed.measurements, transmitters=transmitters)
    scene = scene_of_measured("log", [measured_of(replayed_vehicle(measurements=measurements))])
    assert scene.meta["beacons"] == [[1.0, 2.0, -3.0], [10.0, 20.0, -30.0]]
    assert [one["role"] for one in scene.meta["vehicles"]] == ["follower"]
    assert arrays_of(scene)["source0"].tolist() == [[1, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 0]]


def measured_of(replayed: Replayed) -> Measured:
    return Measured(
        name=replayed.name,
        measurements=replayed.measurements,
        estimates=replayed.estimates,
        time=replayed.time,
        baseline=replayed.baseline,
        path=replayed.path,
    )


def test_a_gap_holds_the_last_value() -> None:
    values = np.array([[np.nan, 0.0], [1.0, 2.0], [np.inf, 3.0], [4.0, 5.0]])
    assert held(values).tolist() == [[1.0, 2.0], [1.0, 2.0], [1.0, 2.0], [4.0, 5.0]]
    assert held(np.full((2, 2), np.nan)).tolist() == [[0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(
    ("duration", "vehicles", "hz"), [(1000.0, 2, 5.0), (1000.0, 11, 5.0), (1000.0, 51, 2.0)]
)
def test_pages_of_many_vehicles_have_fewer_rows(duration: float, vehicles: int, hz: float) -> None:
    assert rate_of(duration, vehicles) == hz
    assert rate_of(1e9, 51) > 0


def test_a_crowd_is_rounded_more_coarsely() -> None:
    scene = scene_of_flight(make_flight(5.0, CROWD + 1))
    assert scene.meta["arrays"]["estimate"]["unit"] == 0.01


def test_the_script_is_built_from_its_sources() -> None:
    """Otherwise: `make bundle`."""
    digest = hashlib.sha256()
    for path in sorted((SCENE / "src").iterdir(), key=lambda path: path.name):
        digest.update(path.read_bytes())
    script = (SCENE / "replay.js").read_text(encoding="utf-8")
    assert f"sha256 {digest.hexdigest()}" in script[:300]
    assert "MIT License" in (SCENE / "three.LICENSE").read_text(encoding="utf-8")


def test_the_script_names_no_address_that_a_browser_would_ask_for() -> None:
    script = (SCENE / "replay.js").read_text(encoding="utf-8")
    assert set(re.findall(r"https?://[^\s\"'`]+", script)) <= {"http://www.w3.org/1999/xhtml"}


def page_of(scene: Scene) -> Page:
    return Page(title="T", summary="s", facts=[], sections=[], replay=Replay(scene=scene))


def test_the_page_has_the_scene_once_with_its_licence() -> None:
    scene = scene_of_flight(make_flight(5.0))
    html = render(page_of(scene))
    assert html.count('id="scene-view"') == 1
    assert "Permission is hereby granted" in html
    (text,) = re.findall(r'<script type="application/json" id="scene-meta">(.*?)</script>', html)
    assert json.loads(text)["vehicles"][0]["name"] == "leader"
    page_with_two = dataclasses.replace(
        page_of(scene), sections=[PageSection(title="again", blocks=[Replay(scene=scene)])]
    )
    with pytest.raises(ValueError, match="2 missions in 3D"):
        render(page_with_two)


# ---------------------------------------------------------------------------------------- browser

in_browser = pytest.mark.skipif(browser.executable() is None, reason="no Chromium is installed")
SHARE_OF_CHANGED_PIXELS = """(() => {
  const view = replay.view;
  view.draw(performance.now(), { turned: 0, speed: 1, sea: 0, busy: true });
  const gl = view.renderer.getContext();
  const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const now = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, now);
  const before = window.pixels;
  window.pixels = now;
  if (!before || before.length !== now.length) return null;
  let changed = 0;
  for (let i = 0; i < now.length; i += 4) {
    if (Math.abs(now[i] - before[i]) + Math.abs(now[i + 1] - before[i + 1]) > 24) changed++;
  }
  return changed / (w * h);
})()"""
"""The share of pixels of the scene that differ from those of the last call."""
LEADER_EAST = "replay.view.poses[0].position.x"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "report.html"
    flight = make_flight(60.0)
    write_report(flight, path)
    return path


def write_report(flight: FlightRecord, path: Path) -> None:
    from experiments.flight.results import Flight

    Flight(**vars(flight)).report(path)


@pytest.fixture(scope="module")
def tab(report: Path) -> Iterator[browser.Page]:
    with browser.chromium() as page:
        page.open(report, "#t=10&q=0")
        yield page


@pytest.mark.system
@in_browser
def test_the_page_asks_for_nothing_but_itself(tab: browser.Page, report: Path) -> None:
    asked = {url.partition("#")[0] for url in tab.requests}
    assert asked <= {f"file://{report}", "about:blank"}
    assert tab.problems == []


@in_browser
def test_a_click_on_play_moves_the_hulls(tab: browser.Page) -> None:
    tab.run(SHARE_OF_CHANGED_PIXELS)
    assert tab.run(SHARE_OF_CHANGED_PIXELS) < 1e-3  # at rest
    before = tab.run(LEADER_EAST)
    left, top, width, height = tab.box("#scene-play")
    tab.click(left + width / 2, top + height / 2)
    tab.wait("replay.state.time > 15")
    assert tab.run("document.getElementById('scene-play').getAttribute('aria-label')") == "Pause"
    tab.click(left + width / 2, top + height / 2)
    tab.wait("!replay.state.playing")
    assert tab.run(LEADER_EAST) > before + 2.0
    assert tab.run(SHARE_OF_CHANGED_PIXELS) > 0.005


@in_browser
def test_the_slider_sets_the_time(tab: browser.Page) -> None:
    left, top, width, height = tab.box("#scene-time")
    tab.click(left + 0.5 * width, top + height / 2)
    tab.wait("Math.abs(replay.state.time - 30) < 1")
    tab.wait("document.getElementById('scene-clock').textContent.startsWith('0:')")
    expected = make_flight(60.0).trajectory.at(np.array([tab.run("replay.state.time")]))[0][0, 0]
    tab.run(SHARE_OF_CHANGED_PIXELS)
    assert tab.run(LEADER_EAST) == pytest.approx(expected[0], abs=0.02)


@in_browser
def test_a_click_in_a_curve_moves_the_scene_and_the_scene_its_cursor(tab: browser.Page) -> None:
    over_time = "[...drawings.values()].find((drawing) => drawing.overTime)"
    tab.run("document.querySelector('.plot').scrollIntoView({ block: 'center' })")
    tab.wait(f"{over_time} !== undefined")
    tab.run(f"{over_time}.box.id = 'curve'; {over_time}.box.scrollIntoView({{ block: 'center' }})")
    left, top, _, height = tab.box("#curve")
    tab.click(left + tab.run(f"{over_time}.x.at(40)"), top + 0.3 * height)
    tab.wait("Math.abs(replay.state.time - 40) < 0.2")
    tab.run("replay.setTime(20)")
    cursor_x = f"new DOMMatrix(getComputedStyle({over_time}.cursor).transform).e"
    tab.command("Input.dispatchMouseEvent", type="mouseMoved", x=2, y=2)
    tab.wait(f"Math.abs({cursor_x} - {over_time}.x.at(20)) < 1")
    tab.run("window.scrollTo(0, 0)")


@pytest.mark.system
@in_browser
def test_a_link_opens_its_camera_and_time(tab: browser.Page, report: Path) -> None:
    tab.open(report, "#t=33&follow=0&camera=top&q=0")
    assert tab.run("replay.state.time") == 33
    assert tab.run("replay.view.follow") == 0
    assert tab.run("replay.link()").startswith("#t=33.0&follow=0&camera=top&at=")
    tab.open(report, "#t=10&q=0")


@pytest.mark.system
@in_browser
def test_a_camera_is_copied_as_options_of_render(tab: browser.Page) -> None:
    flight = make_flight(60.0)
    state = FilmData(flight, 30.0, 0).at(tab.run("replay.setTime(20) || replay.state.time"))
    tab.run(SHARE_OF_CHANGED_PIXELS)  # draws
    for follow in (1, -1):
        tab.run(f"replay.follow({follow})")
        tab.wait("!replay.view.cameras.busy")
        tab.run(SHARE_OF_CHANGED_PIXELS)
        options = shlex.split(tab.run("replay.options()"))
        assert options[1:] == ["--still", "20.0"]
        camera = camera_of(options[0].removeprefix("--view="), flight.trajectory.names)
        expected = tab.run("replay.view.camera.position.toArray()")
        assert camera.shot(state).view.position == pytest.approx(expected, abs=0.02)
    tab.run("replay.follow(1)")


@in_browser
def test_without_webgl_the_map_takes_the_place_of_the_scene(report: Path) -> None:
    with browser.chromium(flags=browser.WITHOUT_WEBGL) as page:
        page.open(report)
        assert "the map shows the mission" in page.run(
            "document.getElementById('scene-fallback').textContent"
        )
        _, _, width, height = page.box("#scene-map")
        assert width > 800
        assert height > 300
        page.run("document.getElementById('scene-play').click()")
        page.wait("replay.state.time > replay.mission.start + 1")
        assert page.problems == []
