"""A mission that is shown while it is flown: a page on this machine alone, which can pause it.

The page is that of a report's scene. It comes from a server on 127.0.0.1, which sends what happens
as server-sent events; what the page asks for (pause, speed) comes back by POST. Requests that name
another host, or come from the page of another site, are refused.
"""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from laisn.arrays import Bools
from laisn.errors import LaisnError
from reports.page import Page, Replay, render
from reports.scene.stream import SceneStream, ending, text_of
from sim.flight import FlightRecord, Termination
from sim.log.stream import FoxgloveStream
from sim.log.writer import Event
from sim.scenario.parts import MissionPlan

HOST = "127.0.0.1"
USUAL_SPEED = 10.0  # seconds of the mission in a second of the viewer's
_SHOWN_EVERY_S = 0.2  # of the viewer's time
_HEARTBEAT_S = 2.0  # longest time between two messages to a page, which shows that it is still open
_GOODBYE_S = 3.0  # longest wait at the end for pages to receive the rest
_LONGEST_REQUEST = 1000  # bytes of a request that controls
_WAITING = """<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="1">
<title>Waiting</title><p style="font: 1.1rem system-ui; margin: 3rem">The mission has not begun yet.
"""


def speed_of(value: object) -> float:
    """A speed in seconds of the mission in a second of the viewer's, inf: as fast as possible;
    LaisnError if the value is no such speed.
    """
    # True is a number of Python's
    if isinstance(value, bool) or not isinstance(value, int | float):
        number = math.nan
    else:
        number = float(value)
    if not number > 0.0:
        raise LaisnError(f"live: expected a speed above 0, seconds a second (given: {value!r})")
    return number


class LiveView:
    """A mission on a page: what is shown, and when the mission may go on.

    One thread flies and calls `show` and `wait`; those of the server read what was shown.
    """

    def __init__(self, speed: float | None = None, *, foxglove_port: int | None = None) -> None:
        """Serve on a free port; `speed` as of `speed_of`, None: `USUAL_SPEED`.

        With a port, the channels of the log are served to Foxglove, too. LaisnError if the speed is
        not valid, or the port is taken.
        """
        self.foxglove = None if foxglove_port is None else FoxgloveStream(foxglove_port)
        self.speed = speed_of(USUAL_SPEED if speed is None else speed)
        self.paused = False
        self.changed = threading.Condition()  # guards what follows; notified of each change
        self.page = b""  # HTML, with the mission until its first picture; empty: not begun
        self.messages: list[str] = []  # JSON, since the page's beginning
        self.open_pages = 0  # that follow the mission
        self.was_opened = False  # whether the page was asked for, also before there is a mission
        self.is_over = False
        self.generation = 0  # number of missions that have begun
        self._stream: SceneStream | None = None
        # one moment on the monotonic clock and in the mission [s], from which `wait` keeps the
        # speed; None: it begins with the next call
        self._paced: tuple[float, float] | None = None
        self._shown_at = -math.inf  # when the last picture was sent, on the monotonic clock [s]
        self._server = _Server(self)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """Of the page."""
        return f"http://{HOST}:{self._server.server_port}/"

    def begin(self, plan: MissionPlan) -> None:
        """A mission sets out; pages of an earlier one are loaded anew."""
        with self.changed:
            self.generation += 1
            self.page = b""
            self.messages = []
            self.is_over = False
            self._stream = SceneStream(plan)
            self._paced = None
            self._shown_at = -math.inf
            self.changed.notify_all()
        if self.foxglove:
            self.foxglove.begin()

    @property
    def span(self) -> float:
        """How much of the mission passes between two pictures [s]."""
        return self.speed * _SHOWN_EVERY_S

    @property
    def is_due(self) -> bool:
        """Whether it is time for the next picture."""
        return time.monotonic() - self._shown_at >= 0.5 * _SHOWN_EVERY_S

    def show(self, flight: FlightRecord) -> None:
        """Send what has happened since the last call."""
        self._shown_at = time.monotonic()
        if self.foxglove:
            self.foxglove.show(flight, is_over=flight.outcome is not Termination.INTERRUPTED)
        stream = self._stream
        if stream is None:
            raise ValueError("no mission has begun")
        if self.page:
            self._send(stream.next_part(flight))
            return
        replay = Replay(scene=stream.beginning(flight), live=True)
        name = flight.scenario.name
        summary = (
            f"Live from this machine, seed {flight.scenario.seed}, run {flight.scenario.run}. "
            "Pause and speed are those of the mission itself; the slider goes back in time."
        )
        facts = [("Scenario", name), ("Navigator", flight.scenario.variants)]
        page = Page(title=name, summary=summary, facts=facts, sections=[], replay=replay)
        with self.changed:
            self.page = render(page).encode()
            self.changed.notify_all()

    def _send(self, message: str) -> None:
        with self.changed:
            self.messages.append(message)
            self.changed.notify_all()

    def wait(self, mission_time: float) -> None:
        """Return when the mission may go on from a time [s]: not while it is paused, and not
        earlier than its speed allows.
        """
        with self.changed:
            while True:
                if self.paused:
                    self._paced = None
                    self.changed.wait(_HEARTBEAT_S)
                    continue
                clock = time.monotonic()
                if self._paced is None or math.isinf(self.speed):
                    self._paced = (clock, mission_time)
                    return
                start_clock, start_mission = self._paced
                left = start_clock + (mission_time - start_mission) / self.speed - clock
                if left <= 0.0:
                    # a machine that is too slow for the speed does not make up for it later
                    if left < -1.0:
                        self._paced = (clock, mission_time)
                    return
                self.changed.wait(left)

    def control(self, paused: bool | None, speed: float | None) -> None:
        """What a page, or a program, asks for; None: as it is. LaisnError, and nothing is changed,
        if the speed is not valid.
        """
        new_speed = None if speed is None else speed_of(speed)
        with self.changed:
            if paused is not None:
                self.paused = paused
            if new_speed is not None:
                self.speed = new_speed
            self._paced = None
            self.messages.append(self._state())
            self.changed.notify_all()

    def _state(self) -> str:
        speed = 0.0 if math.isinf(self.speed) else self.speed  # JSON has no infinity
        return text_of({"paused": self.paused, "speed": speed})

    def state(self) -> str:
        """Pause and speed, as a page reads them."""
        with self.changed:
            return self._state()

    def note_opened(self) -> None:
        """A page has been sent."""
        with self.changed:
            self.was_opened = True
            self.changed.notify_all()

    def wait_for_page(self, patience_s: float) -> bool:
        """Wait for the first page that is opened; whether there is one."""
        with self.changed:
            return self.changed.wait_for(lambda: self.was_opened, patience_s)

    def finish(
        self, flight: FlightRecord, events: Sequence[Event], mirror_locked: Sequence[Bools]
    ) -> None:
        """Show the rest, and that the mission is over; wait until open pages have received it, for
        at most `_GOODBYE_S`.
        """
        if self.is_over:
            return
        self.show(flight)
        self._send(ending(flight, events, mirror_locked))
        with self.changed:
            self.is_over = True
            self.changed.notify_all()
            self.changed.wait_for(lambda: self.open_pages == 0, _GOODBYE_S)

    def close(self) -> None:
        """Serve no more."""
        with self.changed:
            self.is_over = True
            self.changed.notify_all()
        if self.foxglove:
            self.foxglove.close()
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    """The server of a view, on the loopback interface."""

    daemon_threads = True

    def __init__(self, view: LiveView) -> None:
        super().__init__((HOST, 0), _Handler)
        self.view = view

    def handle_error(self, *_: Any) -> None:
        """Print no traceback: a page was closed while it was answered."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def log_message(self, *_: Any) -> None:
        """Print no line for each request."""

    def _refuse(self, status: HTTPStatus) -> None:
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def _is_allowed(self) -> bool:
        """Whether a request is of this machine's own page: a name server may give another site the
        address 127.0.0.1.
        """
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin")
        # a tunnel may come in by another port
        name = host.rpartition(":")[0] or host
        return name in (HOST, "localhost") and origin in (None, f"http://{host}")

    def _send(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def do_GET(self) -> None:
        """Send the page, or what happens."""
        view = self.server.view
        if not self._is_allowed():
            self._refuse(HTTPStatus.FORBIDDEN)
        elif self.path == "/":
            self._send(view.page or _WAITING.encode(), "text/html")
            view.note_opened()
        elif self.path == "/events":
            self._stream(view)
        elif self.path == "/favicon.ico":
            self._refuse(HTTPStatus.NO_CONTENT)
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Pause, go on, or change the speed."""
        if not self._is_allowed():
            self._refuse(HTTPStatus.FORBIDDEN)
            return
        try:
            length = int(self.headers.get("Content-Length", ""))
            if self.path != "/control" or not 0 < length <= _LONGEST_REQUEST:
                raise ValueError(self.path)
            request = json.loads(self.rfile.read(length))
            paused = request.get("paused")
            speed = request.get("speed")
            if not isinstance(paused, bool | None):
                raise ValueError("paused")
            # JSON has no infinity; False equals 0, too
            is_unlimited = speed == 0 and not isinstance(speed, bool)
            self.server.view.control(paused, math.inf if is_unlimited else speed)
        except (ValueError, AttributeError):
            self._refuse(HTTPStatus.BAD_REQUEST)
            return
        self._refuse(HTTPStatus.NO_CONTENT)

    def _stream(self, view: LiveView) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        with view.changed:
            view.open_pages += 1
            generation = view.generation
            view.changed.notify_all()
        try:
            self._event(view.state())
            self._follow(view, generation)
        except OSError:
            pass  # the page was closed
        finally:
            with view.changed:
                view.open_pages -= 1
                view.changed.notify_all()

    def _follow(self, view: LiveView, generation: int) -> None:
        message_count = 0

        def has_more() -> bool:
            return (
                len(view.messages) > message_count or view.is_over or view.generation != generation
            )

        while True:
            with view.changed:
                view.changed.wait_for(has_more, _HEARTBEAT_S)
                is_new = view.generation != generation
                messages = view.messages[message_count:]
                is_over = view.is_over
            if is_new:
                self._event(text_of({"anew": True}))
                return
            for message in messages:
                self._event(message)
            message_count += len(messages)
            if is_over:
                return
            self.wfile.write(b": still here\n\n")
            self.wfile.flush()

    def _event(self, message: str) -> None:
        self.wfile.write(f"data: {message}\n\n".encode())
        self.wfile.flush()


def live_view(live: bool | float | LiveView) -> LiveView:
    """The view that a simulation is given, or a new one: of the usual speed for True, of this
    speed for a number; LaisnError if it is not valid.
    """
    if isinstance(live, LiveView):
        return live
    return LiveView(None if live is True else live)
