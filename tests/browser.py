"""Headless Chromium over its DevTools protocol: opens pages from disk, with all hosts blocked."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

from websockets.sync.client import ClientConnection, connect

EXECUTABLES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
# flags: WebGL drawn by the processor, and none
SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WITHOUT_WEBGL = ("--disable-gpu", "--disable-3d-apis")
_PATIENCE_S = 60.0


def executable() -> str | None:
    """Path of a Chromium; None: there is none."""
    return next((path for name in EXECUTABLES if (path := shutil.which(name))), None)


class Page:
    """A tab. `requests` are the addresses that it asked for, `problems` what its console holds."""

    def __init__(self, socket: ClientConnection) -> None:
        self.requests: list[str] = []
        self.problems: list[str] = []
        self._socket = socket
        self._number = 0
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.command(f"{domain}.enable")

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            reply = json.loads(self._socket.recv(timeout=_PATIENCE_S))
            if reply.get("id") == self._number:
                assert "error" not in reply, reply
                return dict(reply["result"])
            self._note(reply)

    def _note(self, event: dict[str, Any]) -> None:
        method = event.get("method")
        if method == "Network.requestWillBeSent":
            self.requests.append(event["params"]["request"]["url"])
        elif method in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded"):
            self.problems.append(json.dumps(event["params"])[:600])

    def size(self, width: int, height: int) -> None:
        """Set the size of the window [px]."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.command("Emulation.setDeviceMetricsOverride", **metrics)

    def open(self, path: Path, fragment: str = "") -> None:
        """Open a page and wait until its scene has drawn a picture, if it has one."""
        self.visit(f"file://{path.resolve()}", fragment)

    def visit(self, address: str, fragment: str = "") -> None:
        """Open an address as `open` does a file."""
        self.command("Page.navigate", url="about:blank")
        self.command("Page.navigate", url=f"{address}{fragment}")
        self.wait("document.readyState === 'complete' && location.protocol !== 'about:'")
        if self.run("document.getElementById('scene-meta') !== null"):
            self.wait("document.documentElement.dataset.scene === 'ready'")
            self.wait("document.documentElement.dataset.first !== undefined")

    def run(self, script: str) -> Any:
        """The value of an expression; AssertionError with what it threw."""
        result = self.command(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, condition: str) -> None:
        """Wait until an expression is true; AssertionError after a minute."""
        deadline = time.monotonic() + _PATIENCE_S
        while not self.run(condition):
            assert time.monotonic() < deadline, f"never true: {condition}"
            time.sleep(0.05)

    def click(self, x: float, y: float) -> None:
        """Press and release the pointer at a place of the window [px]."""
        for kind in ("mousePressed", "mouseReleased"):
            button = {"button": "left", "clickCount": 1}
            self.command("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element in the window [px]."""
        script = (
            f"(() => {{ const r = document.querySelector({selector!r}).getBoundingClientRect();"
            "return [r.x, r.y, r.width, r.height]; })()"
        )
        left, top, width, height = self.run(script)
        return left, top, width, height

    def picture(self, path: Path) -> None:
        """A screenshot, as PNG."""
        shot = self.command("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(shot["data"]))


@contextmanager
def chromium(
    width: int = 1400, height: int = 900, flags: Sequence[str] = SOFTWARE
) -> Iterator[Page]:
    """A page of a new Chromium without network."""
    path = executable()
    assert path is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        arguments = [
            *("--headless=new", "--no-sandbox", "--hide-scrollbars", *flags),
            f"--user-data-dir={profile}",
            "--remote-debugging-port=0",
            f"--window-size={width},{height}",
            "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
            "about:blank",
        ]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = subprocess.Popen([path, *arguments], **quiet)
        try:
            port = _port(Path(profile) / "DevToolsActivePort")
            with urlopen(f"http://127.0.0.1:{port}/json") as reply:
                tabs = json.load(reply)
            address = next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")
            with connect(address, max_size=None, ping_interval=None) as socket:
                page = Page(socket)
                page.size(width, height)
                yield page
        finally:
            process.terminate()
            process.wait(20)


def _port(path: Path) -> int:
    """The port that Chromium listens on, which it writes into its profile."""
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline:
        if path.exists() and (lines := path.read_text().splitlines()):
            return int(lines[0])
        time.sleep(0.05)
    raise AssertionError("Chromium did not start")
