"""The results folder of a flight: files of two flights never lie beside each other, and no whole
flight is lost.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from experiments.campaign.store import Store
from experiments.flight.folder import (
    FILES,
    FILM,
    LOG,
    REPORT,
    SCENARIO,
    SUMMARY,
    UNFINISHED,
    one_flight,
    require_safe,
)
from laisn.errors import LaisnError
from reports.version import ROOT
from sim.log.contents import partial_path


def contents(folder: Path) -> dict[str, str]:
    """The text of all files of a folder, by their paths within it."""
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def write(folder: Path, text: str, names: tuple[str, ...] = FILES) -> None:
    for name in names:
        (folder / name).write_text(text)


def fly(
    folder: Path,
    text: str,
    names: tuple[str, ...] = FILES,
    error: type[BaseException] | None = None,
) -> None:
    """Write the files of a flight, all with the same text, and raise the error, if any."""
    with one_flight(folder) as work:
        write(work, text, names)
        if error is not None:
            raise error


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Holds a whole earlier flight and a file of the user's."""
    path = tmp_path / "T5"
    fly(path, "earlier")
    (path / "notes.txt").write_text("mine")
    return path


def test_a_whole_flight_takes_the_place_of_the_earlier_one(folder: Path) -> None:
    without_film = tuple(name for name in FILES if name != FILM)
    with one_flight(folder) as work:
        write(work, "new", without_film)
        assert contents(folder)[FILM] == "earlier"
    assert contents(folder) == dict.fromkeys(without_film, "new") | {"notes.txt": "mine"}


def test_a_folder_holds_one_kind_of_result(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(LaisnError, match=r"T5: holds a flight \(summary.json\)"):
        Store(folder)
    Store(tmp_path / "study")
    with pytest.raises(LaisnError, match=r"study: holds a study \(campaign.json\)"):
        require_safe(tmp_path / "study")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, ValueError])
def test_a_flight_that_fails_leaves_the_earlier_one_and_nothing_else(
    folder: Path, error: type[BaseException]
) -> None:
    before = contents(folder)
    with pytest.raises(error) as raised:
        fly(folder, "new", (REPORT,), error)
    assert contents(folder) == before
    assert sorted(path.name for path in folder.iterdir()) == sorted(before)
    assert raised.value.__notes__ == [
        f"nothing of this flight is kept; the earlier flight in {folder} is unchanged"
    ]


@pytest.mark.parametrize("log", [LOG, partial_path(Path(LOG)).name])
def test_an_incomplete_log_is_kept_and_reported(folder: Path, log: str) -> None:
    before = contents(folder)
    with pytest.raises(KeyboardInterrupt) as raised:
        fly(folder, "new", (log,), KeyboardInterrupt)
    work = folder / UNFINISHED
    assert contents(folder) == before | {f"{work.name}/{log}": "new"}
    assert raised.value.__notes__ == [
        f"the unfinished flight is in {work}; the earlier flight in {folder} is unchanged"
    ]
    fly(folder, "whole")
    assert contents(folder) == dict.fromkeys(FILES, "whole") | {"notes.txt": "mine"}


def test_a_failed_first_flight_mentions_no_earlier_one(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt) as raised:
        fly(tmp_path / "T5", "new", (), KeyboardInterrupt)
    assert raised.value.__notes__ == ["nothing of this flight is kept"]
    assert not (tmp_path / "T5").exists()


@pytest.mark.parametrize("after_move", [False, True], ids=["before the move", "after the move"])
@pytest.mark.parametrize("move", range(len(FILES)))
def test_an_interrupt_between_any_two_moves_loses_no_file_of_the_new_flight(
    folder: Path, monkeypatch: pytest.MonkeyPatch, move: int, after_move: bool
) -> None:
    """The summary is moved last, so that a folder with a summary has all files of that flight; the
    next flight may be written into the folder after any of these interrupts.
    """
    replace, count = os.replace, 0

    def interrupted(source: Path, target: Path) -> None:
        nonlocal count
        count += 1
        if after_move or count != move + 1:
            replace(source, target)
        if count == move + 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            fly(folder, "new")
    files = contents(folder)
    assert files.pop("notes.txt") == "mine"
    assert set(files.values()) == {"new"}
    assert sorted(Path(name).name for name in files) == sorted(FILES)
    assert (SUMMARY in files) == (move + after_move == len(FILES))
    require_safe(folder)


def test_files_of_two_flights_never_coexist(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A crash may come between any two moves."""
    replace, texts_after_moves = os.replace, []

    def watched(source: Path, target: Path) -> None:
        replace(source, target)
        texts_after_moves.append(
            {(folder / name).read_text() for name in FILES if (folder / name).exists()}
        )

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", watched)
        fly(folder, "new")
    assert len(texts_after_moves) == len(FILES)
    assert all(len(texts) <= 1 for texts in texts_after_moves)


def test_what_a_killed_flight_left_is_removed_by_the_next(folder: Path) -> None:
    (folder / UNFINISHED / "earlier").mkdir(parents=True)
    (folder / UNFINISHED / LOG).write_text("killed")
    fly(folder, "new")
    assert contents(folder) == dict.fromkeys(FILES, "new") | {"notes.txt": "mine"}


# writes a flight whose first file is there, until it is killed or told to end
FLIGHT = """
import sys
from pathlib import Path
from reports.version import ROOT
from experiments.flight.folder import FILES, one_flight
with one_flight(Path(sys.argv[1])) as work:
    (work / FILES[0]).write_text("other")
    print("ready", flush=True)
    sys.stdin.readline()
"""


@pytest.mark.system
def test_a_second_flight_into_a_folder_is_refused_until_the_process_of_the_first_has_ended(
    tmp_path: Path,
) -> None:
    other_process = subprocess.Popen(
        [sys.executable, "-c", FLIGHT, str(tmp_path)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert other_process.stdout is not None
    with other_process:
        assert other_process.stdout.readline() == "ready\n"
        with pytest.raises(LaisnError, match="another process writes a flight into this folder"):
            fly(tmp_path, "new")
        assert contents(tmp_path) == {f"{UNFINISHED}/{FILES[0]}": "other"}
        other_process.kill()
    fly(tmp_path, "new")
    assert contents(tmp_path) == dict.fromkeys(FILES, "new")


def test_a_folder_that_is_new_empty_or_holds_a_flight_is_safe(folder: Path, tmp_path: Path) -> None:
    require_safe(tmp_path / "new" / "deep")
    (tmp_path / "empty").mkdir()
    require_safe(tmp_path / "empty")
    require_safe(folder)
    (folder / LOG).unlink()  # of a flight, the log is often moved away
    require_safe(folder)


def test_what_a_kill_left_between_two_moves_is_safe(folder: Path) -> None:
    (folder / SUMMARY).unlink()
    (folder / UNFINISHED).mkdir()
    require_safe(folder)


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_no_flight_wrote_is_not_replaced(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(
        LaisnError, match=rf"holds {name}, but no flight .* choose another folder with --out"
    ):
        require_safe(tmp_path)


@pytest.mark.parametrize("name", FILES)
def test_a_folder_or_a_link_with_the_name_of_a_result_is_not_replaced(
    folder: Path, tmp_path: Path, name: str
) -> None:
    (folder / name).rename(tmp_path / "target")
    (folder / name).mkdir()
    with pytest.raises(
        LaisnError,
        match=rf"{name}: expected a regular file, .* or choose another folder with --out",
    ):
        require_safe(folder)
    (folder / name).rmdir()
    for target in ("target", "missing"):
        (folder / name).symlink_to(tmp_path / target)
        with pytest.raises(LaisnError, match=rf"{name}: expected a regular file"):
            require_safe(folder)
        (folder / name).unlink()


def test_a_scenario_is_not_replaced_by_a_changed_copy_from_its_own_flight(
    folder: Path, tmp_path: Path
) -> None:
    link = tmp_path / "link.toml"
    link.hardlink_to(folder / SCENARIO)
    for source in (folder / SCENARIO, folder / ".." / folder.name / SCENARIO, link):
        require_safe(folder, source, lambda: "earlier")
        with pytest.raises(LaisnError, match="is the scenario of this flight"):
            require_safe(folder, source, lambda: "a copy with every default written out")


def test_results_need_a_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(LaisnError, match="is a file, results need a folder"):
        require_safe(tmp_path / "file")
