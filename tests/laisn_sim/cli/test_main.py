"""The command: what it writes, that it repeats to the byte, and what it looks into."""

import json
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from reports.bound import flight_bound
from sim.log import reader
from tests.laisn_sim.cli.flights import SHORT, WITHOUT_FILM, files


@pytest.mark.system
def test_fly_writes_all_its_evidence(flown_folder: Path) -> None:
    assert {path.name for path in (flown_folder / "first").iterdir()} == WITHOUT_FILM
    summary = json.loads((flown_folder / "first" / "summary.json").read_text())
    assert {"scenario", "seed", "outcome", "variant", "versions", "followers"} <= set(summary)
    for key in (
        "e_p_max_m",
        "e_p_mean_m",
        "e_p_std_m",
        "e_b_max_deg",
        "e_b_mean_deg",
        "e_b_std_deg",
    ):
        assert summary[key] >= 0
    assert summary["flown_s"] == 20
    timing = json.loads((flown_folder / "first" / "timing.json").read_text())
    phases = ("prepare", "simulate", "navigate", "log", "report")
    assert set(timing) == {
        *(f"{phase}{clock}" for phase in phases for clock in ("_s", "_processor_s")),
        "real_time_factor",
        "real_time_factor_processor",
    }
    assert timing["real_time_factor"] == pytest.approx(20 / timing["simulate_s"])
    by_processor = timing["real_time_factor_processor"]
    assert by_processor == pytest.approx(20 / timing["simulate_processor_s"])


@pytest.mark.system
@pytest.mark.usefixtures("without_report")
def test_the_written_scenario_reflies_the_mission_to_the_byte(
    flown_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first flight was that of another process."""
    monkeypatch.chdir(flown_folder)
    result = CliRunner().invoke(
        app, ["fly", "first/scenario.toml", "--no-video", "--out", "second"]
    )
    assert result.exit_code == 0, result.stderr
    for name in ("summary.json", "scenario.toml", "flight.mcap"):
        assert (flown_folder / "first" / name).read_bytes() == (
            flown_folder / "second" / name
        ).read_bytes()


@pytest.mark.usefixtures("without_report")
def test_another_run_has_other_noise_and_the_same_motion(flown_folder: Path) -> None:
    result = CliRunner().invoke(
        app, ["fly", "T5", *SHORT, "--run", "7", "--out", str(flown_folder / "run7")]
    )
    assert result.exit_code == 0, result.stderr
    first, other = (reader.read(flown_folder / name / "flight.mcap") for name in ("first", "run7"))
    assert (first.trajectory.position == other.trajectory.position).all()
    assert (first.measurements[0].speed != other.measurements[0].speed).any()


def test_replay_gives_the_logged_estimates_again(flown_folder: Path) -> None:
    log, replay = (str(flown_folder / name) for name in ("first/flight.mcap", "again.mcap"))
    result = CliRunner().invoke(app, ["replay", log, "--variant", "laisn-2", "--out", replay])
    assert result.exit_code == 0, result.stderr
    first, again = (
        reader.read(flown_folder / name) for name in ("first/flight.mcap", "again.mcap")
    )
    assert (first.estimates[0].state == again.estimates[0].state).all()


def test_a_replay_smooths_after_the_fact(flown_folder: Path) -> None:
    """Until the last message the estimates are others; after it there is nothing to smooth with."""
    log, replays = (
        str(flown_folder / "first/flight.mcap"),
        [flown_folder / "filtered.mcap", flown_folder / "smoothed.mcap"],
    )
    command = ["replay", log, "--variant", "tight", "--out"]
    outputs = []
    for replay, smooth in zip(replays, ([], ["--smooth", "60"]), strict=True):
        result = CliRunner().invoke(app, [*command, str(replay), *smooth])
        assert result.exit_code == 0, result.stderr
        outputs.append(result.stdout)
    title = "smoothed with messages of up to 60 s later"
    assert title not in outputs[0]
    filtered, smoothed = (reader.read(replay).estimates[0] for replay in replays)
    truth = reader.read(replays[0]).hydrophone(0)[:, :2]
    table = outputs[1][outputs[1].index(title) :]
    for estimates, lag in ((filtered, 0.0), (smoothed, 60.0)):
        rms = np.sqrt(np.mean(np.sum((estimates.state[:, :2] - truth) ** 2, axis=1)))
        bound = np.sqrt(np.mean(flight_bound(reader.read(replays[0]), 0, lag) ** 2))
        assert f"{rms:.3f}" in table
        assert f"{bound:.3f}" in table
    differs = (filtered.state != smoothed.state).any(axis=1)
    last = filtered.fix_step[-1]
    assert differs[: last - 1].all()
    assert not differs[last - 1 :].any()


def test_only_the_tightly_coupled_navigator_is_smoothed(flown_folder: Path) -> None:
    result = CliRunner().invoke(
        app, ["replay", str(flown_folder / "first/flight.mcap"), "--smooth", "60"]
    )
    assert result.exit_code != 0
    assert "add --variant tight" in result.stderr


@pytest.mark.usefixtures("without_report")
def test_a_vehicle_that_sinks_through_the_floor_is_reported(tmp_path: Path) -> None:
    sunk = ["--set", "leader.excess_buoyancy_n=-100", "--set", "leader.cg_offset_x_m=0.2"]
    shallow = ["--set", "ocean.floor_depth_m=12", "--set", "ocean.current_speed_m_s=0.1", *sunk]
    result = CliRunner().invoke(
        app, ["fly", "T5", *SHORT, *shallow, "--out", str(tmp_path / "sunk")]
    )
    # the report is written, and the exit status tells that the mission was not flown to its end
    assert result.exit_code == 3, result.stderr
    assert "leader goes below the sea floor" in result.stdout
    assert "NEES: 2 on average for a consistent filter" in result.stdout
    assert STILL_WATER in result.stdout


STILL_WATER = "warning: there is a current; navigator 'laisn-2' assumes still water\n"


def test_a_check_prints_what_a_navigator_does_not_assume() -> None:
    result = CliRunner().invoke(app, ["check", "T5", "--set", "ocean.current_speed_m_s=0.1"])
    assert (result.exit_code, result.stdout.startswith(STILL_WATER)) == (0, True)
    assert "warning" not in CliRunner().invoke(app, ["check", "T5"]).stdout


def test_a_flight_replaces_nothing_of_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "own"
    own.mkdir()
    text = "# my notes\nduration_s = 2\n[[followers]]\nroute = 'T5'\n"
    (own / "scenario.toml").write_text(text)
    for out, expected in (
        ("own", "scenario.toml"),
        ("", "is empty"),
        (" ", "is empty"),
        ("own/scenario.toml", "is a file"),
    ):
        result = CliRunner().invoke(app, ["fly", "own/scenario.toml", "--no-video", "--out", out])
        assert result.exit_code == 2
        assert expected in result.output
    assert files(tmp_path) == {"own/scenario.toml": text.encode()}


@pytest.mark.usefixtures("without_report")
@pytest.mark.parametrize(
    ("file", "folder"), [("...toml", "scenario.."), ("..toml", "scenario."), ("a b.toml", "a-b")]
)
def test_a_scenario_of_any_name_gets_a_folder_within_out(
    file: str, folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "below").mkdir()
    monkeypatch.chdir(tmp_path / "below")
    Path(file).write_text("duration_s = 2\n[[followers]]\nroute = 'T5'\n")
    result = CliRunner().invoke(app, ["fly", file, "--no-video"])
    assert result.exit_code == 0, result.output
    assert {p.name for p in tmp_path.iterdir()} == {"below"}
    assert {p.name for p in Path().iterdir()} == {file, "out"}
    assert [p.name for p in Path("out").iterdir()] == [folder]


@pytest.mark.parametrize(
    ("out", "expected"), [("first/flight.mcap", "than the input"), ("a.toml", "ends in .mcap")]
)
def test_a_replay_replaces_no_log(
    flown_folder: Path, monkeypatch: pytest.MonkeyPatch, out: str, expected: str
) -> None:
    monkeypatch.chdir(flown_folder)
    before = files(flown_folder)
    result = CliRunner().invoke(app, ["replay", "first/flight.mcap", "--out", out])
    assert result.exit_code == 2
    assert expected in " ".join(result.output.split())
    assert files(flown_folder) == before


def test_a_printed_scenario_is_a_valid_scenario_file(tmp_path: Path) -> None:
    printed = CliRunner().invoke(app, ["scenarios", "T7"]).output
    (tmp_path / "own.toml").write_text(printed)
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "own.toml")])
    assert checked.exit_code == 0
    assert "valid" in checked.output
    assert "T9" in CliRunner().invoke(app, ["scenarios"]).output


@pytest.mark.parametrize(
    "words",
    [
        ["log", "info"],
        ["range-budget"],
        ["log", "export", "--format", "csv"],
        ["replay", "--variant", "tight"],
    ],
)
def test_the_folder_of_a_flight_stands_for_its_log(
    flown_folder: Path, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = flown_folder / "first"
    results = [
        CliRunner().invoke(app, [*words, str(folder / name)]) for name in ("", "flight.mcap")
    ]
    assert [result.exit_code for result in results] == [0, 0]
    outputs = [result.output.replace(" (replaces an earlier file)", "") for result in results]
    assert outputs[0] == outputs[1] != ""


@pytest.mark.parametrize("words", [["log", "info"], ["range-budget"], ["view"], ["replay"]])
def test_a_folder_without_a_log_is_named(words: list[str], tmp_path: Path) -> None:
    result = CliRunner().invoke(app, [*words, str(tmp_path)])
    assert result.exit_code == 2
    assert "folder without flight.mcap" in re.sub(r"[\s│]+", " ", result.output)


def test_a_range_budget_has_a_row_for_each_received_range_of_a_log(
    flown_folder: Path, tmp_path: Path
) -> None:
    log, table = flown_folder / "first" / "flight.mcap", tmp_path / "shares.csv"
    result = CliRunner().invoke(app, ["range-budget", str(log), "--out", str(table)])
    assert result.exit_code == 0
    assert "lever arm" in result.output
    header, *rows = (line.split(",") for line in table.read_text().splitlines())
    received = reader.read(log).measurements[0].ranges
    assert len(rows) == int(np.isfinite(received).sum())
    used_rear_ranges = [
        float(row[header.index("used_range_m")])
        for row in rows
        if row[header.index("transmitter")] == "rear"
    ]
    assert (
        0 < min(received[:, 0] - used_rear_ranges) < max(received[:, 0] - used_rear_ranges) < 1.0
    )  # Δz is 2 m, so that slant ranges are longer


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--set", "seed=3"], "--set changes a scenario"),
        (["--out", "a.xlsx"], "ends in .csv or .parquet"),
    ],
)
def test_inputs_without_a_range_budget_are_reported(
    flown_folder: Path, options: list[str], expected: str
) -> None:
    result = CliRunner().invoke(
        app, ["range-budget", str(flown_folder / "first" / "flight.mcap"), *options]
    )
    assert result.exit_code == 2
    assert expected in " ".join(result.output.split())


def test_the_command_prints_its_version() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"laisn-sim {version('laisn-sim')}\n")


def test_the_command_installs_completion_of_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    # for any parent of the tests: in the background there may be no shell above them
    monkeypatch.setattr("shellingham.detect_shell", lambda: ("bash", "/bin/bash"))
    result = CliRunner().invoke(app, ["--show-completion"], prog_name="laisn")
    assert result.exit_code == 0
    assert "complete -o default -F _laisn_completion laisn" in result.output
    words = {"_LAISN_COMPLETE": "complete_bash", "COMP_WORDS": "laisn scen", "COMP_CWORD": "1"}
    assert CliRunner().invoke(app, [], env=words, prog_name="laisn").output.split() == ["scenarios"]


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['laisn', '--help']\n"
        "from laisn_sim.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'mujoco', 'matplotlib', 'scipy', 'av', 'pyarrow'} & "
        "set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or 0)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
