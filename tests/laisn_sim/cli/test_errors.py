"""Messages of the command for invalid input, user errors and bugs."""

import errno
import stat
import tempfile
import warnings
from contextlib import nullcontext
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner, Result

from experiments.campaign.store import CampaignError, DamagedResult
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.vehicle.plant import PlantError


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
        (
            ["render", "T5", "--set", "duration_s=20", "--size", f"{'9' * 5000}x480"],
            "expected WIDTHxHEIGHT",
        ),
        (["render", "T5", "--set", "duration_s=20", "--speed-up", "-3"], "speed_up"),
        (
            ["render", "T5", "--set", "duration_s=20", "--still", "99", "--out", "x.png"],
            "outside the mission",
        ),
        (
            ["render", "T5", "--set", "duration_s=20", "--follower", "3"],
            "follower 3: expected 0 … 0",
        ),
        (["render", "T5", "--out", "film.avi"], "expected a file name that ends in .mp4"),
        (["render", "T5", "--view", "1,2"], "(given: 1,2)"),
        (["render", "T5", "--background", "transparent"], "a film cannot be transparent"),
        (["render", "missing.mcap"], "missing.mcap"),
        (["log", "info", __file__], "no MCAP file"),
        (["log", "recover", __file__], "test_errors.py"),
        (["log", "export", __file__, "--format", "ros2"], "parquet or csv; write --ros2"),
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


def reproduce_failing_with(error: Exception, monkeypatch: pytest.MonkeyPatch) -> Result:
    """Result of `laisn reproduce` where the study raises an error."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("experiments.study.study.run", fail)
    monkeypatch.delenv("LAISN_DEBUG", raising=False)
    return CliRunner().invoke(app, ["reproduce"])


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (CampaignError("a worker process died"), "laisn: a worker process died"),
        (
            CampaignError("the sources changed while it ran"),
            "laisn: the sources changed while it ran",
        ),
        (PlantError("the state of T2 is lost"), "laisn: the state of T2 is lost"),
        (LaisnError("unknown stage 9"), "laisn: unknown stage 9"),
        (LaisnError("one\ntwo \x1b[2J"), "laisn: one\ntwo \\x1b[2J"),
        (
            OSError(errno.ENOSPC, "No space left on device", "out/a"),
            "laisn: out/a: No space left on device; make room there, or choose another folder",
        ),
    ],
)
def test_user_errors_print_one_message_and_exit_with_code_2(
    error: Exception, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = reproduce_failing_with(error, monkeypatch)
    assert (result.exit_code, result.output.strip()) == (2, message)


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
def test_internal_errors_print_one_line_with_the_traceback_path(
    error: Exception, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    error.add_note("nothing of this flight is kept")
    result = reproduce_failing_with(error, monkeypatch)
    assert result.exit_code == 1
    [traceback_file] = tmp_path.iterdir()
    line, note = result.output.splitlines()
    assert line.startswith(f"laisn: this is a bug in the program ({type(error).__name__}")
    assert line.endswith(f"the traceback is in {traceback_file}")
    assert note == "nothing of this flight is kept"
    assert stat.S_IMODE(traceback_file.stat().st_mode) == 0o600
    traceback = traceback_file.read_text()
    assert "Traceback (most recent call last)" in traceback
    assert f"in fail\n    raise error\n{type(error).__name__}" in traceback
    assert traceback.startswith(f"laisn-sim {version('laisn-sim')}, Python ")


def test_internal_errors_are_reported_without_a_writable_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/dev/null")
    result = reproduce_failing_with(RuntimeError("from elsewhere"), monkeypatch)
    assert result.exit_code == 1
    assert (
        "the traceback could not be written (Not a directory); LAISN_DEBUG=1 shows it"
        in result.output
    )


def test_debugging_shows_every_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("experiments.study.study.run", lambda *_, **__: 1 // 0)
    monkeypatch.setenv("LAISN_DEBUG", "1")
    assert isinstance(CliRunner().invoke(app, ["reproduce"]).exception, ZeroDivisionError)


def test_no_message_is_longer_than_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = reproduce_failing_with(
        LaisnError("\n".join(f"fault {i}" for i in range(1000))), monkeypatch
    ).output.splitlines()
    assert lines[:2] == ["laisn: fault 0", "fault 1"]
    assert lines[-1] == f"  … and {1000 - (len(lines) - 1)} more"
    assert len(lines) <= 24
    one_line = reproduce_failing_with(LaisnError("x" * 10**6), monkeypatch).output
    assert len(one_line) <= 24 * 80


@pytest.mark.parametrize("debug", [False, True])
def test_warnings_of_libraries_are_shown_to_developers_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, debug: bool
) -> None:
    def warn(*_: object, **__: object) -> SimpleNamespace:
        warnings.warn(
            "A worker stopped while some jobs were given to the executor.",
            UserWarning,
            stacklevel=1,
        )
        return SimpleNamespace(report=lambda: tmp_path, answers=list)

    monkeypatch.setattr("experiments.study.study.run", warn)
    monkeypatch.setenv("LAISN_DEBUG", "1" if debug else "")
    with pytest.warns(UserWarning, match="A worker stopped") if debug else nullcontext():
        result = CliRunner().invoke(app, ["reproduce"])
    assert result.exit_code == 0
    assert result.stderr == ""


def test_a_damaged_result_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def warn(*_: object, **__: object) -> SimpleNamespace:
        warnings.warn(
            "store/a.zip cannot be read and is computed again: it is empty",
            DamagedResult,
            stacklevel=2,
        )
        return SimpleNamespace(report=lambda: tmp_path, answers=list)

    monkeypatch.setattr("experiments.study.study.run", warn)
    result = CliRunner().invoke(app, ["reproduce"])
    assert result.exit_code == 0
    assert result.stderr == "laisn: store/a.zip cannot be read and is computed again: it is empty\n"
    assert result.stdout == f"report in {tmp_path}\n"
