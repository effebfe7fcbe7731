"""The command: what it writes, that it repeats to the byte, and what it says to bad input."""

import errno
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
import warnings
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from experiments.campaign.processes import WorkerDiedError
from experiments.campaign.store import CampaignError, DamagedResult
from experiments.campaign.version import code_version
from experiments.command.cli import app
from laisn.failure import LaisnError
from sim.film import graphics
from sim.film.render import RendererDiedError
from sim.fleet import FleetError
from sim.log import reader

SHORT = ["--set", "duration_s=20", "--no-video"]
WITHOUT_FILM = {"flight.mcap", "report.html", "summary.json", "timing.json", "scenario.toml", "foxglove.json"}


def laisn(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "experiments.command.cli", *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty report, where nothing is asked of it: to draw one takes half a second."""
    draw = "experiments.pages.flight_report.flight_report"
    monkeypatch.setattr(draw, lambda flight, errors, summary, path, *_: path.write_text(""))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flown")
    result = laisn("fly", "T5", *SHORT, "--out", "first", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "results in first" in result.stdout
    return folder


def test_fly_writes_all_its_evidence(flown: Path) -> None:
    assert {path.name for path in (flown / "first").iterdir()} == WITHOUT_FILM
    summary = json.loads((flown / "first" / "summary.json").read_text())
    assert {"scenario", "seed", "outcome", "variant", "versions", "followers"} <= set(summary)
    for figure in ("e_p_max_m", "e_p_mean_m", "e_p_std_m", "e_b_max_deg", "e_b_mean_deg", "e_b_std_deg"):
        assert summary[figure] >= 0
    assert summary["flown_s"] == 20
    timing = json.loads((flown / "first" / "timing.json").read_text())
    assert {"simulate_s", "navigate_s", "log_s", "report_s", "real_time_factor"} <= set(timing)


@pytest.mark.usefixtures("without_report")
def test_the_written_scenario_reflies_the_mission_to_the_byte(flown: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first time it was flown by another process."""
    monkeypatch.chdir(flown)
    result = CliRunner().invoke(app, ["fly", "first/scenario.toml", "--no-video", "--out", "second"])
    assert result.exit_code == 0, result.stderr
    for name in ("summary.json", "scenario.toml", "flight.mcap"):
        assert (flown / "first" / name).read_bytes() == (flown / "second" / name).read_bytes()


@pytest.mark.usefixtures("without_report")
def test_another_run_has_other_noise_and_the_same_motion(flown: Path) -> None:
    result = CliRunner().invoke(app, ["fly", "T5", *SHORT, "--run", "7", "--out", str(flown / "run7")])
    assert result.exit_code == 0, result.stderr
    first, other = (reader.read(flown / name / "flight.mcap") for name in ("first", "run7"))
    assert (first.trajectory.position == other.trajectory.position).all()
    assert (first.measurements[0].speed != other.measurements[0].speed).any()


def test_replay_gives_the_logged_estimates_again(flown: Path) -> None:
    log, again = (str(flown / name) for name in ("first/flight.mcap", "again.mcap"))
    result = CliRunner().invoke(app, ["replay", log, "--variant", "laisn-2", "--out", again])
    assert result.exit_code == 0, result.stderr
    first, again = (reader.read(flown / name) for name in ("first/flight.mcap", "again.mcap"))
    assert (first.estimates[0].state == again.estimates[0].state).all()


def test_a_replay_smooths_after_the_fact(flown: Path) -> None:
    """Until the last message the estimates are others; after it there is nothing to smooth with."""
    log, files = str(flown / "first/flight.mcap"), [flown / "filtered.mcap", flown / "smoothed.mcap"]
    tight = ["replay", log, "--variant", "tight", "--out"]
    outputs = []
    for file, smooth in zip(files, ([], ["--smooth", "60"]), strict=True):
        result = CliRunner().invoke(app, [*tight, str(file), *smooth])
        assert result.exit_code == 0, result.stderr
        outputs.append(result.stdout)
    title = "smoothed with messages of up to 60 s later"
    assert title not in outputs[0]
    filtered, smoothed = (reader.read(file).estimates[0] for file in files)
    truth = reader.read(files[0]).hydrophone(0)[:, :2]
    table = outputs[1][outputs[1].index(title) :]
    for estimates in (filtered, smoothed):
        rms = np.sqrt(np.mean(np.sum((estimates.state[:, :2] - truth) ** 2, axis=1)))
        assert f"{rms:.3f} m" in table
    differs = (filtered.state != smoothed.state).any(axis=1)
    last = filtered.fix_step[-1]
    assert differs[: last - 1].all()
    assert not differs[last - 1 :].any()


def test_only_the_tightly_coupled_navigator_is_smoothed(flown: Path) -> None:
    result = CliRunner().invoke(app, ["replay", str(flown / "first/flight.mcap"), "--smooth", "60"])
    assert result.exit_code != 0
    assert "add --variant tight" in result.stderr


@pytest.mark.usefixtures("without_report")
def test_a_vehicle_that_sinks_through_the_floor_is_told(tmp_path: Path) -> None:
    sunk = ["--set", "leader.excess_buoyancy_n=-100", "--set", "leader.cg_offset_x_m=0.2"]
    shallow = ["--set", "ocean.floor_depth_m=12", *sunk]
    result = CliRunner().invoke(app, ["fly", "T5", *SHORT, *shallow, "--out", str(tmp_path / "sunk")])
    assert result.exit_code == 0, result.stderr
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
        (["reproduce", "--seed", "-1"], "Invalid value for"),
        (["reproduce", "--runs", "1000000000000"], "Invalid value for"),
        (["reproduce", "--workers", "0"], "Invalid value for"),
    ],
)
def test_bad_input_gets_one_screen_and_exit_code_2(arguments: list[str], expected: str) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert expected in result.output
    assert "Traceback" not in result.output
    assert len(result.output.splitlines()) <= 24


def test_a_flight_replaces_nothing_of_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "own"
    own.mkdir()
    text = "# my notes\nduration_s = 2\n[[followers]]\nroute = 'T5'\n"
    (own / "scenario.toml").write_text(text)
    for out, told in (
        ("own", "scenario.toml"),
        ("", "is empty"),
        (" ", "is empty"),
        ("own/scenario.toml", "is a file"),
    ):
        result = CliRunner().invoke(app, ["fly", "own/scenario.toml", "--no-video", "--out", out])
        assert result.exit_code == 2
        assert told in result.output
    assert files(tmp_path) == {"own/scenario.toml": text.encode()}


@pytest.mark.usefixtures("without_report")
@pytest.mark.parametrize(("file", "folder"), [("...toml", "scenario.."), ("..toml", "scenario."), ("a b.toml", "a-b")])
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
    ("out", "told"), [("first/flight.mcap", "is the log that is read"), ("a.toml", "end in .mcap")]
)
def test_a_replay_replaces_no_log(flown: Path, monkeypatch: pytest.MonkeyPatch, out: str, told: str) -> None:
    monkeypatch.chdir(flown)
    before = files(flown)
    result = CliRunner().invoke(app, ["replay", "first/flight.mcap", "--out", out])
    assert result.exit_code == 2
    assert told in " ".join(result.output.split())
    assert files(flown) == before


def failing(error: Exception, monkeypatch: pytest.MonkeyPatch) -> Result:
    """What the command does when a study raises an error."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("experiments.reproduction.study.reproduce", fail)
    monkeypatch.delenv("LAISN_DEBUG", raising=False)
    return CliRunner().invoke(app, ["reproduce"])


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (WorkerDiedError("a worker process died"), "laisn: a worker process died"),
        (CampaignError("the sources changed while it ran"), "laisn: the sources changed while it ran"),
        (FleetError("the state of T2 is lost", 0.0, None), "laisn: the state of T2 is lost"),
        (LaisnError("unknown stage 9"), "laisn: unknown stage 9"),
        (LaisnError("one\ntwo \x1b[2J"), "laisn: one\ntwo \\x1b[2J"),
        (OSError(errno.ENOSPC, "No space left on device", "out/a"), "laisn: out/a: No space left on device"),
    ],
)
def test_what_a_user_can_mend_is_one_message_and_exit_code_2(
    error: Exception, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = failing(error, monkeypatch)
    assert (result.exit_code, result.output.strip()) == (2, told)


@pytest.mark.parametrize(
    "error",
    [
        ValueError("operands could not be broadcast together"),
        RuntimeError("from elsewhere"),
        OSError("no number of the system's"),
        KeyError("x"),
        RecursionError(),
    ],
)
def test_a_fault_of_the_program_is_one_line_that_says_where_its_traceback_is(
    error: Exception, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    error.add_note("nothing of this flight is kept")
    result = failing(error, monkeypatch)
    assert result.exit_code == 1
    [report] = tmp_path.iterdir()
    line, note = result.output.splitlines()
    assert line.startswith(f"laisn: this is a bug in the program ({type(error).__name__}")
    assert line.endswith(f"the traceback is in {report}")
    assert note == "nothing of this flight is kept"
    assert stat.S_IMODE(report.stat().st_mode) == 0o600
    written = report.read_text()
    assert "Traceback (most recent call last)" in written
    assert f"in fail\n    raise error\n{type(error).__name__}" in written
    assert written.startswith(f"laisn {code_version()}, Python ")


def test_a_fault_whose_traceback_finds_no_place_is_told_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/dev/null")
    result = failing(RuntimeError("from elsewhere"), monkeypatch)
    assert result.exit_code == 1
    assert "the traceback could not be written (Not a directory); LAISN_DEBUG=1 shows it" in result.output


def test_debugging_shows_every_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("experiments.reproduction.study.reproduce", lambda *_, **__: 1 // 0)
    monkeypatch.setenv("LAISN_DEBUG", "1")
    assert isinstance(CliRunner().invoke(app, ["reproduce"]).exception, ZeroDivisionError)


def test_no_message_is_longer_than_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    long = failing(LaisnError("\n".join(f"fault {i}" for i in range(1000))), monkeypatch).output.splitlines()
    assert long[:2] == ["laisn: fault 0", "fault 1"]
    assert long[-1] == f"  … and {1000 - (len(long) - 1)} more"
    assert len(long) <= 24
    wide = failing(LaisnError("x" * 10**6), monkeypatch).output
    assert len(wide) <= 24 * 80


def test_a_damaged_result_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def warn(*_: object, **__: object) -> Path:
        warnings.warn("cells/a.parquet cannot be read and is computed again: it is empty", DamagedResult, stacklevel=2)
        return tmp_path

    monkeypatch.setattr("experiments.reproduction.study.reproduce", warn)
    result = CliRunner().invoke(app, ["reproduce"])
    assert result.exit_code == 0
    assert result.stderr == "laisn: cells/a.parquet cannot be read and is computed again: it is empty\n"
    assert result.stdout == f"report in {tmp_path}\n"


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def interrupted(folder: Path, begun: str, *options: str) -> str:
    """Press Ctrl-C in a flight of T5 into a folder as soon as a file is there; what is told then."""
    command = [sys.executable, "-m", "experiments.command.cli", "fly", "T5", *options, "--out", str(folder)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not list(folder.glob(begun)) and child.poll() is None:
        time.sleep(0.002)
    child.send_signal(signal.SIGINT)
    said, told = child.communicate(timeout=60)
    assert child.returncode == 130, said + told
    assert told.startswith("laisn: interrupted; ")
    assert len(told.splitlines()) == 1
    return told


def test_ctrl_c_in_the_simulation_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    assert "nothing of this flight is kept" in interrupted(folder, "unfinished-*", "--no-video")
    assert list(folder.iterdir()) == []


def test_ctrl_c_in_the_log_leaves_the_earlier_flight(flown: Path, tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    shutil.copytree(flown / "first", folder)
    told = interrupted(folder, "unfinished-*/flight.mcap.partial", "--no-video")
    assert f"the earlier flight in {folder} is as it was" in told
    left = files(folder)
    assert {name: left.pop(name) for name in files(flown / "first")} == files(flown / "first")
    assert all(name.startswith("unfinished-") for name in left)


@pytest.mark.skipif(graphics.working() is None, reason=graphics.MISSING)
def test_ctrl_c_in_the_film_leaves_the_earlier_flight_and_the_new_log(flown: Path, tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    shutil.copytree(flown / "first", folder)
    told = interrupted(folder, "unfinished-*/flight.mcap", "--set", "duration_s=200")
    [log] = folder.glob("unfinished-*/*")
    assert f"what there is of this flight is in {log.parent}; the earlier flight in {folder} is as it was" in told
    left = files(folder)
    assert reader.read(log).trajectory.time[-1] == 200
    assert left.pop(log.relative_to(folder).as_posix())
    assert left == files(flown / "first")


def press_ctrl_c(*_: object, **__: object) -> None:
    signal.raise_signal(signal.SIGINT)


def press_ctrl_c_after_the_log(flight: object, errors: object, summary: object, path: Path, *_: object) -> None:
    """A report, drawn in a process of its own, that would take a minute."""
    while not path.with_name("flight.mcap").exists():
        time.sleep(0.01)
    os.kill(os.getppid(), signal.SIGINT)
    time.sleep(60)


@pytest.mark.usefixtures("without_report")
@pytest.mark.parametrize(
    ("where", "kept"),
    [
        ("sim.log.writer.os.fsync", {"flight.mcap.partial"}),  # the log is written but has no name yet
        ("sim.film.render.render", {"flight.mcap"}),
        ("experiments.pages.flight_report.flight_report", {"flight.mcap"}),
        ("experiments.command.fly.dumps", {"flight.mcap", "report.html"}),
        ("experiments.flight.folder._exchange", WITHOUT_FILM),
    ],
)
def test_ctrl_c_in_any_phase_keeps_the_earlier_flight(
    flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, kept: set[str]
) -> None:
    folder = tmp_path / "stopped"
    shutil.copytree(flown / "first", folder)
    (folder / "flight.mp4").write_bytes(b"film")
    before = files(folder)
    film = "--video" if where == "sim.film.render.render" else "--no-video"
    with monkeypatch.context() as patch:
        patch.setattr(where, press_ctrl_c_after_the_log if where.endswith("report") else press_ctrl_c)
        result = CliRunner().invoke(app, ["fly", "T5", "--set", "duration_s=100", film, "--out", str(folder)])
    assert result.exit_code == 130
    after = files(folder)
    assert {name: after.pop(name) for name in before} == before
    assert {Path(name).name for name in after} >= kept


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
    for what in ("Python", "MuJoCo", "egl", "osmesa", "flight", "film"):
        assert what in result.output


HIDDEN = """
import importlib.machinery, sys
from experiments.command.cli import main
from sim.film import graphics

graphics.BACKENDS = ()  # to try what renders is another test's matter
modules, packages = sys.argv[1].split(), sys.argv[2].split()

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

find = importlib.machinery.PathFinder.find_distributions
importlib.machinery.PathFinder.find_distributions = lambda *given: (d for d in find(*given) if d.name not in packages)
sys.meta_path.insert(0, Hidden())
sys.argv = ["laisn", "doctor"]
main()
"""


@pytest.mark.parametrize(
    ("modules", "packages", "told", "remedy"),
    [
        (
            "numba mujoco",
            "numba mujoco",
            {"numba": "is not installed", "mujoco": "is not installed"},
            r"pip install mujoco==[\d.]+ 'numba>=[\d.]+'$",
        ),
        (
            "av OpenGL",
            "",
            {
                "av": "cannot be imported: No module named 'av'",
                "pyopengl": "cannot be imported: No module named 'OpenGL'",
            },
            r"pip install --force-reinstall 'av>=[\d.]+' 'pyopengl>=[\d.]+'$",
        ),
        ("", "laisn-sim", {"laisn-sim": "is not installed"}, r"pip install -e \.$"),
    ],
)
def test_doctor_names_packages_that_are_missing_and_the_remedy(
    modules: str, packages: str, told: dict[str, str], remedy: str
) -> None:
    command = [sys.executable, "-c", HIDDEN, modules, packages]
    environment = os.environ | {"COLUMNS": "200"}
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (result.returncode, result.stderr) == (1, "")
    lines = [line.rstrip() for line in result.stdout.splitlines()]
    faults = dict(line.split(maxsplit=2)[1:] for line in lines if line.startswith("no"))
    assert {name: fault for name, fault in faults.items() if name not in ("flight", "film")} == told
    assert [line for line in lines if re.search(remedy, line)]


@pytest.mark.parametrize("wanted", ["osmesa", "no-such-thing"])
def test_a_graphics_library_that_is_asked_for_and_missing_breaks_no_flight(wanted: str, tmp_path: Path) -> None:
    code = "import sys; sys.argv = ['laisn', 'check', 'T5']; from experiments.command.cli import main; main()"
    environment = os.environ | {"MUJOCO_GL": wanted}
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert "T5: fine" in result.stdout


def test_the_ranges_of_a_log_are_taken_apart(flown: Path, tmp_path: Path) -> None:
    log, table = flown / "first" / "flight.mcap", tmp_path / "shares.csv"
    result = CliRunner().invoke(app, ["anatomy", str(log), "--out", str(table)])
    assert result.exit_code == 0
    assert "lever arm" in result.output
    heads, *rows = (line.split(",") for line in table.read_text().splitlines())
    heard = reader.read(log).measurements[0].ranges
    assert len(rows) == int(np.isfinite(heard).sum())
    used = [float(row[heads.index("used_range_m")]) for row in rows if row[heads.index("transmitter")] == "rear"]
    assert 0 < min(heard[:, 0] - used) < max(heard[:, 0] - used) < 1.0  # Δz is 2 m, so that slant ranges are longer


@pytest.mark.parametrize(
    ("options", "told"),
    [(["--set", "seed=3"], "--set changes a scenario"), (["--out", "a.xlsx"], "should end in .csv or .parquet")],
)
def test_what_cannot_be_taken_apart_is_named(flown: Path, options: list[str], told: str) -> None:
    result = CliRunner().invoke(app, ["anatomy", str(flown / "first" / "flight.mcap"), *options])
    assert result.exit_code == 2
    assert told in " ".join(result.output.split())


@pytest.mark.usefixtures("without_report")
def test_without_graphics_a_flight_says_in_one_line_what_its_film_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graphics, "working", lambda: None)
    result = CliRunner().invoke(app, ["fly", "T5", "--set", "duration_s=20", "--out", str(tmp_path)])
    assert result.exit_code == 0
    [line] = [line for line in result.output.splitlines() if "film" in line]
    assert line == f"no film: no graphics library works here (laisn doctor says why); {graphics.INSTALL}"
    assert not (tmp_path / "flight.mp4").exists()


@pytest.mark.usefixtures("without_report")
def test_a_renderer_that_dies_costs_the_film_alone_and_gives_exit_code_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(*_: object, **__: object) -> None:
        raise RendererDiedError("a process that renders frames ended with code 1\nZeroDivisionError: of the child")

    monkeypatch.setattr("sim.film.render.render", die)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    result = CliRunner().invoke(app, ["fly", "T5", "--set", "duration_s=20", "--out", str(tmp_path / "o")])
    assert result.exit_code == 1
    assert "no film: a bug in the program" in result.stdout.splitlines()
    assert f"results in {tmp_path / 'o'}" in result.stdout.splitlines()
    [fault] = tmp_path.glob("laisn-failure-*.txt")
    assert len(result.stderr.splitlines()) == 1
    assert "ended with code 1" in result.stderr
    assert f"the traceback is in {fault}" in result.stderr
    assert "Traceback" not in result.output
    assert "ZeroDivisionError: of the child" in fault.read_text()
    assert {path.name for path in (tmp_path / "o").iterdir()} == WITHOUT_FILM


def test_the_pitch_study_says_at_once_that_there_will_be_no_film(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(graphics, "working", lambda: None)
    monkeypatch.setattr("experiments.asymmetry.study.run", lambda folder, **_: folder / "report.html")
    asked = CliRunner().invoke(app, ["asymmetry", "--film", "--quick", "--out", str(tmp_path)])
    assert asked.stderr == f"no film: {graphics.MISSING}\n"
    assert CliRunner().invoke(app, ["asymmetry", "--quick", "--out", str(tmp_path)]).stderr == ""


@pytest.mark.usefixtures("without_report")
def test_a_film_goes_with_the_flight_that_it_shows(flown: Path, tmp_path: Path) -> None:
    shutil.copytree(flown / "first", tmp_path / "T5")
    (tmp_path / "T5" / "flight.mp4").write_bytes(b"film")
    (tmp_path / "T5" / "notes.txt").write_text("mine")
    result = CliRunner().invoke(app, ["fly", "T5", *SHORT, "--out", str(tmp_path / "T5")])
    assert result.exit_code == 0
    assert "the film of the earlier flight went with it" in result.output
    names = {path.name for path in (tmp_path / "T5").iterdir()}
    assert names == {*WITHOUT_FILM, "notes.txt"}


def test_the_command_tells_its_version() -> None:
    result = CliRunner().invoke(app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"laisn-sim {version('laisn-sim')}\n")


def test_the_command_installs_completion_of_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    # whatever started the tests: in the background there may be no shell above them
    monkeypatch.setattr("shellingham.detect_shell", lambda: ("bash", "/bin/bash"))
    result = CliRunner().invoke(app, ["--show-completion"], prog_name="laisn")
    assert result.exit_code == 0
    assert "complete -o default -F _laisn_completion laisn" in result.output
    words = {"_LAISN_COMPLETE": "complete_bash", "COMP_WORDS": "laisn scen", "COMP_CWORD": "1"}
    assert CliRunner().invoke(app, [], env=words, prog_name="laisn").output.split() == ["scenarios"]


def test_the_command_works_where_other_packages_have_our_names(tmp_path: Path) -> None:
    for name in ("models", "sim", "experiments"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('the wrong package')")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    code = "import sys; sys.argv = ['laisn', 'check', 'T5']; from laisn_sim import main; main()"
    # -P: as for a console script, whose folder stands first instead of the working directory
    command = [sys.executable, "-P", "-c", code]
    result = subprocess.run(
        command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert (result.returncode, result.stderr) == (0, "")
    assert "T5: fine" in result.stdout


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['laisn', '--help']\n"
        "from experiments.command.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'numba', 'mujoco', 'matplotlib', 'scipy', 'av', 'pyarrow'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or 0)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
