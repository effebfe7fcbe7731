"""Ctrl-C in each phase of a flight: what is kept, and what stays as it was."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from laisn_sim.cli.main import app
from sim.film import graphics
from sim.log import reader
from tests.laisn_sim.cli.flights import WITHOUT_FILM, files, without_notice

pytestmark = pytest.mark.system


def message_of_interrupted_flight(folder: Path, awaited_file: str, *options: str) -> str:
    """What a flight of T5 into a folder prints if Ctrl-C is pressed as soon as a file is there."""
    command = [
        sys.executable,
        "-m",
        "laisn_sim.cli.main",
        "fly",
        "T5",
        *options,
        "--out",
        str(folder),
    ]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not list(folder.glob(awaited_file)) and child.poll() is None:
        time.sleep(0.002)
    child.send_signal(signal.SIGINT)
    printed, reported = child.communicate(timeout=60)
    # a shell reports 130 for both: CPython ends by the signal if the interrupt met an `exec`, as in
    # imports
    assert child.returncode in (130, -signal.SIGINT), printed + reported
    # where this test is the first to compile something, a notice is printed before
    reported = without_notice(reported)
    assert reported.startswith("laisn: interrupted; ")
    assert len(reported.splitlines()) == 1
    return reported


def test_ctrl_c_in_the_simulation_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    assert "nothing of this flight is kept" in message_of_interrupted_flight(
        folder, "unfinished", "--no-video"
    )
    assert not folder.exists()


def test_ctrl_c_in_the_log_leaves_the_earlier_flight(flown_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "stopped"
    shutil.copytree(flown_folder / "first", folder)
    reported = message_of_interrupted_flight(folder, "unfinished/flight.mcap.partial", "--no-video")
    assert f"the earlier flight in {folder} is unchanged" in reported
    remaining = files(folder)
    assert {name: remaining.pop(name) for name in files(flown_folder / "first")} == files(
        flown_folder / "first"
    )
    assert all(name.startswith("unfinished/") for name in remaining)


@pytest.mark.skipif(graphics.working() is None, reason=graphics.MISSING)
def test_ctrl_c_in_the_film_leaves_the_earlier_flight_and_the_new_log(
    flown_folder: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "stopped"
    shutil.copytree(flown_folder / "first", folder)
    reported = message_of_interrupted_flight(
        folder, "unfinished/flight.mcap", "--set", "duration_s=200"
    )
    [log] = folder.glob("unfinished/*")
    assert (
        f"the unfinished flight is in {log.parent}; the earlier flight in {folder} is unchanged"
        in reported
    )
    remaining = files(folder)
    assert reader.read(log).trajectory.time[-1] == 200
    assert remaining.pop(log.relative_to(folder).as_posix())
    assert remaining == files(flown_folder / "first")


def press_ctrl_c(*_: object, **__: object) -> None:
    signal.raise_signal(signal.SIGINT)


def press_ctrl_c_after_the_log(
    flight: object, errors: object, summary: object, path: Path, *_: object
) -> None:
    """A report, drawn in a process of its own, that would take a minute."""
    while not path.with_name("flight.mcap").exists():
        time.sleep(0.01)
    os.kill(os.getppid(), signal.SIGINT)
    time.sleep(60)


@pytest.mark.usefixtures("without_report")
@pytest.mark.parametrize(
    ("interrupted_function", "kept_files"),
    [
        # the last piece of the log is written first
        ("sim.log.writer.os.fsync", {"flight.mcap"}),
        ("sim.film.render.render", {"flight.mcap"}),
        ("reports.flight_report.flight_report", {"flight.mcap"}),
        ("sim.log.scene.layout", {"flight.mcap", "report.html"}),
        ("experiments.flight.folder._exchange", WITHOUT_FILM),
    ],
)
def test_ctrl_c_in_any_phase_keeps_the_earlier_flight(
    flown_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    interrupted_function: str,
    kept_files: set[str],
) -> None:
    folder = tmp_path / "stopped"
    shutil.copytree(flown_folder / "first", folder)
    (folder / "flight.mp4").write_bytes(b"film")
    before = files(folder)
    film = "--video" if interrupted_function == "sim.film.render.render" else "--no-video"
    with monkeypatch.context() as patch:
        patch.setattr(
            interrupted_function,
            press_ctrl_c_after_the_log if interrupted_function.endswith("report") else press_ctrl_c,
        )
        result = CliRunner().invoke(
            app, ["fly", "T5", "--set", "duration_s=100", film, "--out", str(folder)]
        )
    assert result.exit_code == 130
    after = files(folder)
    assert {name: after.pop(name) for name in before} == before
    assert {Path(name).name for name in after} >= kept_files
