"""Files that commands write: where they go, what they may replace, and how that is told.

A file goes where `--out` says, otherwise under its documented name. It never replaces the input or
a folder; it may replace an earlier file of its name, and the line that names it says so.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from laisn.errors import LaisnError

REPLACED = "replaces an earlier file"


@dataclass(frozen=True, kw_only=True)
class OutputFile:
    """A file that a command is going to write; as text its name, and whether it replaces one."""

    path: Path
    replaces: bool

    def __str__(self) -> str:
        return f"{self.path} ({REPLACED})" if self.replaces else str(self.path)


def output_file(
    path: Path, suffixes: Iterable[str], sources: Iterable[Path] = (), option: str = "--out"
) -> OutputFile:
    """The file at a path, in a folder that is made; LaisnError, before anything is computed, if
    it has another suffix, is a folder or one of the sources, or its folder cannot be made.
    """
    endings = tuple(suffixes)
    if path.suffix not in endings:
        raise LaisnError(
            f"{option}: expected a file name that ends in {' or '.join(endings)} (given: {path})"
        )
    if path.is_dir():
        raise LaisnError(f"{option}: expected the name of a file (given the folder: {path})")
    exists = path.exists()
    for source in sources:
        if exists and source.exists() and path.samefile(source):
            raise LaisnError(f"{option}: expected another file than the input (given: {path})")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LaisnError(
            f"{option}: the folder {path.parent} cannot be made: {error.strerror} (given: {path})"
        ) from None
    return OutputFile(path=path, replaces=exists)


def optional_output(
    path: Path | None,
    suffixes: Iterable[str],
    sources: Iterable[Path] = (),
    option: str = "--out",
) -> OutputFile | None:
    """`output_file`, if a path is given."""
    return None if path is None else output_file(path, suffixes, sources, option)


def written_files(files: Iterable[Path], existing: Iterable[Path]) -> list[OutputFile]:
    """Files that were written into a folder that held others before."""
    existing_paths = set(existing)
    return [OutputFile(path=file, replaces=file in existing_paths) for file in files]
