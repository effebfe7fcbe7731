"""The results folder of a flight: it holds the files of one complete flight at a time."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from experiments.result_files import FLIGHT_FILE, STUDY_FILE
from laisn.errors import LaisnError
from sim.log.bag_folder import require_replaceable
from sim.log.contents import partial_path
from sim.system import locked

LOG = "flight.mcap"
FILM = "flight.mp4"
REPORT = "report.html"
SUMMARY = FLIGHT_FILE
SCENARIO = "scenario.toml"
TIMING = "timing.json"
LAYOUT = "foxglove.json"
BAG = "ros2"  # a folder, of one bag
# files of a flight; others in its folder are the user's
FILES = (LOG, FILM, REPORT, SUMMARY, SCENARIO, TIMING, LAYOUT)

UNFINISHED = "unfinished"
_ELSEWHERE = "choose another folder with --out"


def log_in(source: Path) -> Path:
    """The log that a path names: of the results folder of a flight, that in it. LaisnError if it is
    a folder without one.
    """
    if not source.is_dir():
        return source
    log = source / LOG
    if not log.exists() and not partial_path(log).exists():
        raise LaisnError(
            f"{source}: is a folder without {LOG}; expected a log, or a flight's folder"
        )
    return log


def title_of(file: Path) -> str:
    """What a log or a page is called in the names of what is made of it: a file that is named as in
    the results folder of each flight or study after that folder, another one by its own name
    without its ending.
    """
    folder = file.parent.resolve().name
    return folder if folder and file.name in (LOG, REPORT) else file.stem


def require_safe(
    folder: Path, source: Path | None = None, flown_text: Callable[[], str] = str
) -> None:
    """Refuse a folder in which a flight would replace other files than those of a flight;
    LaisnError names them.

    `source` is the scenario file of the flight, if there is one. It may be replaced if it has the
    text that the flight would write, `flown_text`.
    """
    if not folder.is_dir():
        if folder.exists() or folder.is_symlink():
            raise LaisnError(f"{folder}: is a file, results need a folder; {_ELSEWHERE}")
        return
    if (folder / STUDY_FILE).exists():
        raise LaisnError(f"{folder}: holds a study ({STUDY_FILE}); {_ELSEWHERE}")
    require_replaceable(folder / BAG)
    present = [folder / name for name in FILES if os.path.lexists(folder / name)]
    for path in present:
        if _is_other_source(path, source, flown_text):
            problem = "is the scenario of this flight"
        elif path.is_symlink() or not path.is_file():
            problem = "expected a regular file"
        else:
            continue
        raise LaisnError(
            f"{path}: {problem}, which the flight would replace; move it, or {_ELSEWHERE}"
        )
    if present and not _holds_flight(folder):
        names = ", ".join(path.name for path in present)
        raise LaisnError(
            f"{folder}: holds {names}, but no flight ({SUMMARY} and {SCENARIO}); a new flight "
            f"would replace these files: move them, or {_ELSEWHERE}"
        )


def _is_other_source(path: Path, source: Path | None, flown_text: Callable[[], str]) -> bool:
    """Whether a file is the scenario file `source`, with another text than `flown_text`."""
    if source is None or not path.is_file() or not source.exists():
        return False
    return path.samefile(source) and path.read_bytes() != flown_text().encode()


def _holds_flight(folder: Path) -> bool:
    # a flight that was killed while it replaced files has left its folder
    if (folder / UNFINISHED).exists():
        return True
    return (folder / SUMMARY).exists() and (folder / SCENARIO).exists()


def _exchange(folder: Path, work: Path) -> None:
    """Replace the files of the earlier flight by those in `work`: its summary goes first, the
    new one comes last.
    """
    for name in (SUMMARY, *FILES):
        (folder / name).unlink(missing_ok=True)
    if (folder / BAG).is_dir():
        shutil.rmtree(folder / BAG)
    if (work / BAG).exists():
        os.replace(work / BAG, folder / BAG)
    for name in sorted(FILES, key=SUMMARY.__eq__):
        if (work / name).exists():
            os.replace(work / name, folder / name)


def _outcome(folder: Path, work: Path) -> str:
    """Remove the files of a failed flight unless there is a log, and report what is kept."""
    has_log = (work / LOG).exists() or partial_path(work / LOG).exists()
    if not has_log:
        shutil.rmtree(work, ignore_errors=True)
    text = f"the unfinished flight is in {work}" if has_log else "nothing of this flight is kept"
    return (
        f"{text}; the earlier flight in {folder} is unchanged"
        if (folder / SUMMARY).exists()
        else text
    )


@contextmanager
def one_flight(folder: Path) -> Iterator[Path]:
    """A new folder to write a flight into; when the block ends, its files replace those of an
    earlier flight together.

    The folder never has files of two flights. If the block fails or is interrupted, the earlier
    flight is unchanged, and a note of the exception reports what is kept: the log in
    `FOLDER/unfinished`, until the next flight, or nothing. LaisnError if another process writes a
    flight there, OSError if the folder cannot be written.
    """
    work = folder / UNFINISHED
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        try:
            stack.enter_context(locked(folder, wait=False))
        except BlockingIOError:
            raise LaisnError(
                f"{folder}: another process writes a flight into this folder; {_ELSEWHERE}"
            ) from None
        shutil.rmtree(work, ignore_errors=True)
        try:
            work.mkdir()
            yield work
        except BaseException as error:
            error.add_note(_outcome(folder, work))
            if new:
                with suppress(OSError):
                    folder.rmdir()
            raise
        _exchange(folder, work)
        shutil.rmtree(work, ignore_errors=True)
