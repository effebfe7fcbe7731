"""A flight that tests of the command look at, and an empty report for flights of which nothing
is asked.
"""

from pathlib import Path

import pytest

from tests.laisn_sim.cli.flights import SHORT, laisn


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty report, for tests that do not check it: to draw one takes half a second."""
    draw = "reports.flight_report.flight_report"
    monkeypatch.setattr(draw, lambda flight, errors, summary, path, *_: path.write_text(""))


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    result = laisn("fly", "T5", *SHORT, "--out", "first", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "results in first" in result.stdout
    return folder
