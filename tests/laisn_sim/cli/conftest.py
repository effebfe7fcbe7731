"""A flight that tests of the command read, and an empty report for tests that do not read it."""

from pathlib import Path

import pytest

from tests.laisn_sim.cli.flights import SHORT, laisn


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty report, for tests that do not check it: to draw one takes half a second."""
    draw = "reports.flight_report.flight_report"
    monkeypatch.setattr(draw, lambda flight, errors, summary, path, *_: path.write_text(""))


@pytest.fixture(scope="session")
def flown_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with 20 s of T5, flown without film, in its subfolder `first`."""
    folder = tmp_path_factory.mktemp("flown")
    result = laisn("fly", "T5", *SHORT, "--out", "first", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "results in first" in result.stdout
    return folder
