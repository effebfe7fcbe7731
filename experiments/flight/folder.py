"""The results folder of a flight: it holds one flight at a time, whole."""

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from laisn.failure import LaisnError
from laisn.whole_files import held, new_folder, remove_abandoned
from sim.log.file import partial_path

LOG, FILM, REPORT = "flight.mcap", "flight.mp4", "report.html"
SUMMARY, SCENARIO, TIMING, LAYOUT = "summary.json", "scenario.toml", "timing.json", "foxglove.json"
FILES = (LOG, FILM, REPORT, SUMMARY, SCENARIO, TIMING, LAYOUT)
"""What a flight may leave in its folder; other files there are the user's."""

_UNFINISHED = "unfinished-"


_ELSEWHERE = "choose another folder with --out"


def _require_ours(folder: Path, source: Path | None, again: Callable[[], str]) -> None:
    there = [folder / name for name in FILES if os.path.lexists(folder / name)]
    for path in there:
        if path.is_symlink() or not path.is_file():
            what = "a folder" if path.is_dir() and not path.is_symlink() else "no plain file"
            raise LaisnError(f"{path}: is {what}, and a flight writes a file of that name; move it, or {_ELSEWHERE}")
        if source is not None and source.exists() and path.samefile(source) and path.read_bytes() != again().encode():
            raise LaisnError(
                f"{path}: is the scenario to be flown, and the flight would replace it with a copy of its own; "
                f"rename it, or {_ELSEWHERE}"
            )
    # what a kill leaves of a flight is ours too
    flown = ((folder / SUMMARY).exists() and (folder / SCENARIO).exists()) or any(folder.glob(f"{_UNFINISHED}*"))
    if there and not flown:
        names = ", ".join(path.name for path in there)
        raise LaisnError(
            f"{folder}: holds {names}, but no flight ({SUMMARY} and {SCENARIO}) that has written this; a new flight "
            f"would replace it: move it, or {_ELSEWHERE}"
        )


def require_safe(folder: Path, source: Path | None = None, again: Callable[[], str] = str) -> None:
    """Refuse a folder in which a flight would replace what no flight has written.

    Args:
        folder: for the results of a flight; it need not be there.
        source: scenario file that is flown, if there is one.
        again: gives the text of the scenario that the flight will write; a source that holds just this may be replaced.

    Raises:
        LaisnError: says what would be lost, and what to do instead.
    """
    if not folder.is_dir():
        if folder.exists() or folder.is_symlink():
            raise LaisnError(f"{folder}: is a file, results need a folder; {_ELSEWHERE}")
        return
    # while another flight exchanges its files, some are missing
    with held(folder):
        _require_ours(folder, source, again)


def _exchange(folder: Path, work: Path) -> None:
    """Put the files of `work` in the place of the earlier flight's; if that cannot be done, all is as it was before."""
    earlier = work / "earlier"
    earlier.mkdir()
    new = [name for name in FILES if (work / name).exists()]
    try:
        for name in FILES:
            if (folder / name).exists():
                os.replace(folder / name, earlier / name)
        for name in new:
            os.replace(work / name, folder / name)
    except BaseException:
        # by what lies where: an interrupt may come between a move and any note of it
        for name in new:
            if not (work / name).exists():
                os.replace(folder / name, work / name)
        for path in earlier.iterdir():
            os.replace(path, folder / path.name)
        earlier.rmdir()
        raise


def _fate(folder: Path, work: Path | None) -> str:
    """Tidy up after a flight that failed, and say what there is of it: its log, whole or not, or nothing."""
    kept = work is not None and ((work / LOG).exists() or partial_path(work / LOG).exists())
    if work is not None and not kept:
        shutil.rmtree(work, ignore_errors=True)
    told = f"what there is of this flight is in {work}" if kept else "nothing of this flight is kept"
    earlier = any((folder / name).exists() for name in FILES)
    return f"{told}; the earlier flight in {folder} is as it was" if earlier else told


@contextmanager
def one_flight(folder: Path) -> Iterator[Path]:
    """A folder to write a flight into; when the block ends, its files take the place of an earlier flight's together.

    Until then the earlier flight stays as it was, and files of two flights never lie beside each other: those of the
    earlier one leave before the first of the new one comes, a film too if the new one has none. If the block fails or
    is interrupted, the exception carries a note that says what is kept: the log in `FOLDER/unfinished-PROCESS`, if one
    was begun, or nothing. The next flight that is whole removes what flights before it left unfinished.

    Args:
        folder: for the results; made if it is not there.

    Yields:
        An empty folder within it.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    work = None
    try:
        with new_folder(folder / f"{_UNFINISHED}{os.getpid()}") as work:
            yield work
            # of several flights that end at once, the last one stays
            with held(folder):
                _exchange(folder, work)
            shutil.rmtree(work, ignore_errors=True)
    except BaseException as error:
        error.add_note(_fate(folder, work))
        raise
    remove_abandoned(folder.glob(f"{_UNFINISHED}*"))
