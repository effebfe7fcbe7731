"""The command: what it writes, that it repeats to the byte, and what it says to bad input."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from experiments.cli import app
from experiments.failures import CampaignError
from experiments.processes import WorkerDiedError
from sim import log_reader
from sim.fleet import FleetError

SHORT = ["--set", "duration_s=20", "--no-video"]


def laisn(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "experiments.cli", *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    result = laisn("fly", "T5", *SHORT, "--out", "first", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "results in first" in result.stdout
    return folder


def test_fly_writes_all_its_evidence(flown: Path) -> None:
    names = {path.name for path in (flown / "first").iterdir()}
    assert names == {"flight.mcap", "report.html", "summary.json", "timing.json", "scenario.toml"}
    summary = json.loads((flown / "first" / "summary.json").read_text())
    assert {"scenario", "seed", "outcome", "variant", "versions", "followers"} <= set(summary)
    for figure in ("e_p_max_m", "e_p_mean_m", "e_p_std_m", "e_b_max_deg", "e_b_mean_deg", "e_b_std_deg"):
        assert summary[figure] >= 0
    assert summary["flown_s"] == 20
    timing = json.loads((flown / "first" / "timing.json").read_text())
    assert {"simulate_s", "navigate_s", "log_s", "report_s", "real_time_factor"} <= set(timing)


def test_the_written_scenario_reflies_the_mission_to_the_byte(flown: Path) -> None:
    result = laisn("fly", "first/scenario.toml", "--no-video", "--out", "second", cwd=flown)
    assert result.returncode == 0, result.stderr
    for name in ("summary.json", "scenario.toml", "flight.mcap"):
        assert (flown / "first" / name).read_bytes() == (flown / "second" / name).read_bytes()


def test_another_run_has_other_noise_and_the_same_motion(flown: Path) -> None:
    result = laisn("fly", "T5", *SHORT, "--run", "7", "--out", "run7", cwd=flown)
    assert result.returncode == 0, result.stderr
    first, other = (log_reader.read(flown / name / "flight.mcap") for name in ("first", "run7"))
    assert (first.trajectory.position == other.trajectory.position).all()
    assert (first.measurements[0].speed != other.measurements[0].speed).any()


def test_replay_gives_the_logged_estimates_again(flown: Path) -> None:
    result = laisn("replay", "first/flight.mcap", "--variant", "laisn-2", "--out", "again.mcap", cwd=flown)
    assert result.returncode == 0, result.stderr
    first, again = (log_reader.read(flown / name) for name in ("first/flight.mcap", "again.mcap"))
    assert (first.estimates[0].state == again.estimates[0].state).all()


def test_a_vehicle_that_sinks_through_the_floor_is_told(tmp_path: Path) -> None:
    sunk = ["--set", "leader.excess_buoyancy_n=-100", "--set", "leader.cg_offset_x_m=0.2"]
    result = laisn("fly", "T5", *SHORT, "--set", "ocean.floor_depth_m=12", *sunk, "--out", "sunk", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "leader goes below the sea floor" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["fly", "T1"], "unknown scenario 'T1'; available: T2, T3"),
        (["fly", "T5", "--set", "sensors.speed_bais_m_s=1"], "did you mean 'speed_bias_m_s'?"),
        (["fly", "T5", "--set", "timing.message_interval_s=0.25"], "no multiple of filter_step_s"),
        (["fly", "T5", "--no-video", "--out", "/dev/null/x"], "/dev/null/x: Not a directory"),
        (["check", "nothing.toml"], "nothing.toml: cannot be read: No such file"),
        (["render", "T5", "--set", "duration_s=20", "--camera", "drone"], "unknown camera 'drone'"),
        (["render", "T5", "--set", "duration_s=20", "--size", "12"], "expected WIDTHxHEIGHT"),
        (["render", "T5", "--set", "duration_s=20", "--size", "641x480"], "width_px"),
        (["render", "T5", "--set", "duration_s=20", "--speed-up", "-3"], "speed_up"),
        (["render", "T5", "--set", "duration_s=20", "--still", "99", "--out", "x.png"], "outside the mission"),
        (["render", "T5", "--set", "duration_s=20", "--follower", "3"], "there are followers 0 … 0"),
        (["render", "missing.mcap"], "missing.mcap"),
        (["log", "info", __file__], "no MCAP file"),
        (["log", "recover", __file__], "test_cli.py"),
        (["replay", __file__], "no MCAP file"),
    ],
)
def test_bad_input_gets_one_screen_and_exit_code_2(arguments: list[str], expected: str) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert expected in result.output
    assert "Traceback" not in result.output
    assert len(result.output.splitlines()) <= 24


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (WorkerDiedError("a worker process died"), 1, "laisn: a worker process died"),
        (CampaignError("the sources changed while it ran"), 1, "laisn: the sources changed while it ran"),
        (FleetError("the state of T2 is lost", 0.0, None), 1, "laisn: the state of T2 is lost"),
        (ValueError("unknown stage 9"), 2, "laisn: unknown stage 9"),
    ],
)
def test_a_failure_of_our_own_is_one_message_and_exit_code_1(
    error: Exception, code: int, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("experiments.reproduce.reproduce", fail)
    monkeypatch.delenv("LAISN_DEBUG", raising=False)
    result = CliRunner().invoke(app, ["reproduce"])
    assert (result.exit_code, result.output.strip()) == (code, told)


def test_an_exception_that_nobody_foresaw_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("from elsewhere")

    monkeypatch.setattr("experiments.reproduce.reproduce", fail)
    result = CliRunner().invoke(app, ["reproduce"])
    assert isinstance(result.exception, RuntimeError)


def test_ctrl_c_leaves_no_half_written_file(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "experiments.cli", "fly", "T5", "--no-video", "--out", "stopped"]
    child = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    folder = tmp_path / "stopped"
    while not folder.exists() and child.poll() is None:
        time.sleep(0.02)
    os.kill(child.pid, signal.SIGINT)
    _, told = child.communicate(timeout=60)
    assert child.returncode == 130
    assert "interrupted" in told
    assert {path.suffix for path in folder.iterdir()} <= {".partial"}


def test_a_scenario_is_printed_as_a_start_for_ones_own(tmp_path: Path) -> None:
    printed = CliRunner().invoke(app, ["scenarios", "T7"]).output
    (tmp_path / "own.toml").write_text(printed)
    checked = CliRunner().invoke(app, ["check", str(tmp_path / "own.toml")])
    assert checked.exit_code == 0
    assert "fine" in checked.output
    assert "T9" in CliRunner().invoke(app, ["scenarios"]).output


def test_doctor_names_what_it_tried() -> None:
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    for what in ("Python", "MuJoCo", "egl", "osmesa", "H.264"):
        assert what in result.output


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['laisn', '--help']\n"
        "from experiments.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'mujoco', 'matplotlib', 'scipy', 'av', 'pyarrow'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or 0)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
