"""`laisn view`: the page of a log, opened where there is a screen."""

import webbrowser
from pathlib import Path

import pytest
from typer.testing import CliRunner

from laisn_sim.cli import viewing
from laisn_sim.cli.main import app
from sim.log import writer
from tests.synthetic import make_flight


def test_the_page_of_a_log_opens_with_its_mission_in_3d(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setenv("DISPLAY", ":7")
    log = tmp_path / "a.mcap"
    writer.write(make_flight(10.0), log)
    page = tmp_path / "page.html"
    result = CliRunner().invoke(app, ["view", str(log), "--out", str(page)])
    assert result.exit_code == 0, result.output
    assert 'id="scene-view"' in page.read_text(encoding="utf-8")
    assert opened == [page.resolve().as_uri()]
    CliRunner().invoke(app, ["view", str(log), "--out", str(page), "--no-open"])
    assert len(opened) == 1


def test_without_a_screen_nothing_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    viewing.open_page(tmp_path / "page.html")
    assert opened == []


def test_a_log_of_measurements_alone_is_refused_and_replay_is_named(tmp_path: Path) -> None:
    log = tmp_path / "plaza.mcap"
    source = Path(__file__).parents[2] / "data" / "plaza" / "Plaza2.mat"
    options = ["log", "import", str(source), "--out", str(log), "--beacons", "1,6"]
    assert CliRunner().invoke(app, options).exit_code == 0
    result = CliRunner().invoke(app, ["view", str(log)])
    assert result.exit_code == 2
    assert f"laisn replay {log}" in "".join(result.stderr.split("\n"))
