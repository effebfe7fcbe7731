"""Warnings that a flight prints: all of few, and of very many of one kind the first ones."""

import json
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from laisn_sim.cli.fly import show_warnings
from laisn_sim.cli.main import app
from sim.log.writer import Event

NAMES = ("leader", *(f"follower-{i}" for i in range(1, 201)))


def printed_lines(events: list[Event]) -> list[str]:
    text = StringIO()
    show_warnings(Console(file=text, width=200), events, NAMES)
    return text.getvalue().splitlines()


def proximity_warning(k: int) -> Event:
    text = (
        f"stations of follower-{k + 1} and follower-{k}, {3 + k / 100:.1f} m apart, are nearer "
        "than 3 sigma of their relative position error"
    )
    return Event(float(k), "warning", text, f"follower-{k + 1}")


@pytest.mark.parametrize("count", [1, 10])
def test_few_warnings_are_printed_whole(count: int) -> None:
    lines = printed_lines([proximity_warning(k) for k in range(1, count + 1)])
    assert len(lines) == count
    assert lines[0].startswith("warning: at 1 s stations of follower-2 and follower-1, 3.0 m apart")


def test_many_of_a_kind_are_counted_and_hide_no_other_kind() -> None:
    """Warnings of 87 pairs of stations, which differ in names and numbers alone, and one of another
    kind among them.
    """
    events = [proximity_warning(k) for k in range(1, 88)]
    events.insert(60, Event(60.5, "warning", "follower-3 goes below the sea floor", "follower-3"))
    lines = printed_lines(events)
    # ten of the pairs, the other kind, and the count of the 77 that are left out
    assert len(lines) == 12
    assert sum("apart" in line and " at " in line for line in lines) == 10
    assert "warning: at 60.5 s follower-3 goes below the sea floor" in lines
    rest = "stations of … and …, … m apart, are nearer than … sigma"
    assert lines[-1].startswith(f"warning: 77 more like these are in flight.mcap: {rest}")


@pytest.mark.system
def test_a_follower_that_never_has_an_estimate_leaves_a_whole_flight(tmp_path: Path) -> None:
    """With an unknown start, out of reach of all messages."""
    out = tmp_path / "flown"
    changes = (
        "duration_s=20",
        "navigation.variant=tight",
        "navigation.assume.known_start=false",
        "acoustics.max_range_m=0.001",
    )
    options = [option for change in changes for option in ("--set", change)]
    result = CliRunner().invoke(app, ["fly", "T5", *options, "--no-video", "--out", str(out)])
    assert result.exit_code == 0, result.output
    text = "No estimate in the whole mission: follower; without a known start"
    assert text in " ".join(result.output.split())
    assert "follower: no estimate in the whole mission." in (out / "report.html").read_text("utf-8")
    row = json.loads((out / "summary.json").read_text("utf-8"))["followers"]["follower"]
    assert row["e_p_mean_m"] is None
    assert row["track_error_rms_m"] > 0.0
