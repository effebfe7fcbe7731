"""A mission that is shown while it is flown: who may see it, what pages get, what pauses it."""

import json
import math
import socket
import threading
import webbrowser
from collections.abc import Iterator
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner
from websockets.sync.client import connect
from websockets.typing import Subprotocol

import laisn_sim
from laisn.errors import LaisnError
from laisn_sim.cli import fly as flying
from laisn_sim.cli.main import app
from laisn_sim.live import LiveView
from reports.flight_report import scene_of_flight
from sim.scenario.parts import MissionPlan
from tests import browser
from tests.reports.test_scene import arrays_of, inflated, read_array
from tests.synthetic import make_flight

LISTEN_STATE = "0A"  # state of a socket in /proc/net/tcp
FOXGLOVE = Subprotocol("foxglove.sdk.v1")
SHORT = {"duration_s": 30.0}


@pytest.fixture
def view() -> Iterator[LiveView]:
    view = LiveView(math.inf)
    flight = make_flight(10.0)
    view.begin(MissionPlan.of(flight.scenario))
    view.show(flight)
    yield view
    view.close()


def port_of(view: LiveView) -> int:
    return int(view.address.rstrip("/").rpartition(":")[2])


def status_of(view: LiveView, method: str, path: str, body: str = "", **headers: str) -> int:
    """The status that a request gets."""
    connection = HTTPConnection("127.0.0.1", port_of(view), timeout=20)
    connection.request(method, path, body or None, headers)
    return connection.getresponse().status


def listening_addresses(port: int) -> list[str]:
    """Addresses in hexadecimal that a port is listened to on."""
    sockets = []
    for table in ("tcp", "tcp6"):
        path = Path("/proc/net") / table
        if path.exists():
            sockets += [line.split() for line in path.read_text().splitlines()[1:]]
    address_and_port = [fields[1].split(":") for fields in sockets if fields[3] == LISTEN_STATE]
    return [address for address, number in address_and_port if int(number, 16) == port]


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="no table of sockets")
def test_only_this_machine_is_listened_to(view: LiveView) -> None:
    loopback = f"{int.from_bytes(socket.inet_aton('127.0.0.1'), 'little'):08X}"
    assert listening_addresses(port_of(view)) == [loopback]


def test_pages_of_other_sites_are_refused(view: LiveView) -> None:
    port = port_of(view)
    assert status_of(view, "GET", "/") == 200
    assert status_of(view, "GET", "/", Host=f"localhost:{port}") == 200
    assert status_of(view, "GET", "/", Host="localhost:8000") == 200  # through a tunnel
    assert status_of(view, "GET", "/", Host="attacker.example") == 403
    pause = json.dumps({"paused": True})
    for origin in ("http://attacker.example", "http://localhost:3000", "null"):
        assert status_of(view, "POST", "/control", pause, Origin=origin) == 403
    assert not view.paused
    assert status_of(view, "POST", "/control", pause, Origin=f"http://127.0.0.1:{port}") == 204
    assert view.paused


@pytest.mark.parametrize(
    "body",
    [
        '{"speed": -1}',
        '{"paused": 3}',
        "[",
        "7",
        '{"speed": "a"}',
        '{"speed": true}',
        '{"speed": false}',
        '{"paused": true, "speed": -1}',
    ],
)
def test_an_invalid_control_request_is_refused(view: LiveView, body: str) -> None:
    view.control(None, 10.0)
    assert status_of(view, "POST", "/control", body) == 400
    assert view.speed == 10.0
    assert not view.paused


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, "fast", True])
def test_an_invalid_speed_is_refused(speed: Any) -> None:
    with pytest.raises(LaisnError, match="expected a speed above 0"):
        LiveView(speed)


def test_a_mission_begins_when_its_page_is_opened() -> None:
    """A browser asks for the page before there is a mission to show; one that is refused opens
    none.
    """
    view = LiveView(math.inf)
    try:
        assert status_of(view, "GET", "/", Host="attacker.example") == 403
        assert status_of(view, "GET", "/favicon.ico") == 204
        assert not view.wait_for_page(0.01)
        assert status_of(view, "GET", "/") == 200
        assert view.wait_for_page(10.0)
    finally:
        view.close()


def test_a_mission_waits_while_it_is_paused(view: LiveView) -> None:
    view.control(True, None)
    waiting = threading.Thread(target=view.wait, args=(1.0,), daemon=True)
    waiting.start()
    waiting.join(0.3)
    assert waiting.is_alive()
    view.control(False, None)
    waiting.join(20)
    assert not waiting.is_alive()


@pytest.mark.system
def test_the_parts_of_a_page_are_the_scene_of_the_flight(monkeypatch: pytest.MonkeyPatch) -> None:
    # a picture at every step, however fast the machine is
    monkeypatch.setattr(LiveView, "is_due", True)
    with laisn_sim.Simulation("T5", SHORT, live=math.inf) as simulation:
        while not simulation.done:
            simulation.step(5.0)
        assert simulation.live is not None
        page = simulation.live.page.decode()
        messages = [json.loads(text) for text in simulation.live.messages]
        flight = simulation.flight()
    expected_scene = scene_of_flight(flight)
    data = page.partition('id="scene-data">')[2].partition("<")[0]
    meta = json.loads(page.partition('id="scene-meta">')[2].partition("</script>")[0])
    parts = [(meta["arrays"], inflated(data))]
    parts += [(m["arrays"], inflated(m["data"])) for m in messages if "arrays" in m]
    assert len(parts) >= 3
    for name, expected in arrays_of(expected_scene).items():
        received = [read_array(content, table[name]) for table, content in parts if name in table]
        np.testing.assert_array_equal(np.concatenate(received), expected, err_msg=name)
    assert meta["planned"] == 30.0
    assert messages[-1]["events"] == expected_scene.meta["events"]
    assert "flown to its end" in messages[-1]["over"]


SPEED_BOX = "document.getElementById('scene-speed')"
SPEED = f"{SPEED_BOX}.value"


@pytest.mark.system
@pytest.mark.skipif(browser.executable() is None, reason="no Chromium is installed")
def test_a_page_shows_moving_hulls_and_pauses_the_mission() -> None:
    east = "replay.view.poses[0].position.x"
    simulation = laisn_sim.Simulation("T5", {"duration_s": 600.0}, live=18.0)
    view = simulation.live
    assert view is not None

    def fly() -> None:
        while not simulation.done and not view.is_over:
            simulation.step(1.0)

    flying_thread = threading.Thread(target=fly, daemon=True)
    flying_thread.start()
    with browser.chromium(width=800) as page:
        with view.changed:
            assert view.changed.wait_for(lambda: bool(view.page), 60)
        page.visit(view.address, "#q=0")
        page.wait("replay.state.playing && replay.state.frames > 2")
        assert page.run(SPEED) == "18"
        before = page.run(east)
        page.wait(f"{east} > {before} + 5")
        page.run("document.getElementById('scene-play').click()")
        page.wait("!replay.state.playing")
        paused = simulation.time
        flying_thread.join(1.0)
        assert simulation.time <= paused + view.span + 1.0
        at_rest = simulation.time
        flying_thread.join(0.5)
        assert simulation.time == at_rest
        truth = float(simulation.truth["leader"].position[0])
        page.wait(f"Math.abs({east} - {truth}) < 6")  # of the last picture, 4 s at most before
        page.run("document.getElementById('scene-play').click()")
        page.wait(f"{east} > {truth} + 10")
        assert page.requests
        assert all(url.startswith((view.address, "about:")) for url in page.requests)
        assert page.problems == []
        view.close()
        page.wait("replay.live.over")
        # a replay has no "fastest", and goes on at the speed of the mission
        assert page.run(SPEED) == "18"
        assert page.run(f"!{SPEED_BOX}.querySelector('[value=\"0\"]')")
    flying_thread.join(20)


def test_a_page_is_told_of_pauses_and_of_another_mission(view: LiveView) -> None:
    connection = HTTPConnection("127.0.0.1", port_of(view), timeout=20)
    connection.request("GET", "/events")
    reply = connection.getresponse()
    assert reply.headers["Content-Type"].startswith("text/event-stream")

    def next_event() -> dict[str, Any]:
        while not (line := reply.readline()).startswith(b"data: "):
            assert line, "the stream ended"
        return dict(json.loads(line.removeprefix(b"data: ")))

    assert next_event() == {"paused": False, "speed": 0.0}  # as fast as possible
    view.control(True, 5.0)
    assert next_event() == {"paused": True, "speed": 5.0}
    view.begin(MissionPlan.of(make_flight(10.0).scenario))
    assert next_event() == {"anew": True}
    assert not reply.read().strip()


def test_a_view_feeds_foxglove_beside_its_page() -> None:
    flight = make_flight(5.0)
    view = LiveView(math.inf, foxglove_port=0)
    assert view.foxglove is not None
    view.begin(MissionPlan.of(flight.scenario))
    with connect(view.foxglove.address, subprotocols=[FOXGLOVE], max_size=None) as socket:
        view.show(flight)
        topics = set[str]()
        while "/leader/pose" not in topics:
            message = json.loads(socket.recv(timeout=20))
            topics |= {channel["topic"] for channel in message.get("channels", ())}
    assert b"scene-view" in view.page
    view.close()


def test_kinematic_motion_cannot_be_shown_live(tmp_path: Path) -> None:
    arguments = ["fly", "T5", "--live", "--set", "motion=kinematic", "--out", str(tmp_path / "o")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code != 0
    assert '--live: expected motion = "physics"' in result.output
    assert not (tmp_path / "o").exists()


@pytest.mark.system
def test_a_live_flight_has_the_summary_of_a_flight_that_is_not_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(flying, "_PATIENCE_S", 0.1)
    monkeypatch.setattr("laisn_sim.live.USUAL_SPEED", math.inf)
    summaries = []
    for name, options in (("live", ["--live"]), ("plain", [])):
        arguments = ["fly", "T5", "--set", "duration_s=30", "--no-video", *options]
        result = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / name)])
        assert result.exit_code == 0, result.output
        summaries.append(json.loads((tmp_path / name / "summary.json").read_text()))
    assert summaries[0] == summaries[1]
    (address,) = opened
    assert address.startswith("http://127.0.0.1:")
