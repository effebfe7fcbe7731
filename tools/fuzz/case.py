"""One input, and what is wrong with the answer that the command gives to it."""

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType
from typing import Protocol

from typer.testing import CliRunner

from laisn.plugins import PLUGINS_VARIABLE
from laisn_sim.cli.main import app

# exit codes of the command; TOO_LONG stands for none, as it was ended
TOO_LONG = -1
DONE = 0
REFUSED = 2
FAILED = 3
INTERRUPTED = 130
LONGEST_S = 20.0  # of processor time, of one command
_LINES = 60  # of the message of a refusal
_MAX_CHARACTERS = 2000  # characters of a line
_QUOTED = 600  # characters of an answer in a report


@dataclass(frozen=True, kw_only=True)
class FuzzCase:
    """A command and the files that it is given, in an empty folder."""

    words: list[str]  # of the command line, after `laisn`
    files: dict[str, bytes] = field(default_factory=dict)
    written: tuple[str, ...] = ()  # what it writes if it succeeds, and only then
    must_be_refused: bool = False
    # words of which a refusal has at least one; empty: it may have any text
    named: tuple[str, ...] = ()
    may_interrupt: bool = False  # whether the input presses Ctrl-C
    judge: Callable[[Path], list[str]] | None = None
    """Says what is wrong with the files that the command wrote into a folder."""


class Kind(Protocol):
    """A kind of inputs."""

    def __call__(self, random: Random) -> FuzzCase:
        """An input by chance."""


class _TooLongError(BaseException):
    """A command took longer than LONGEST_S; no handler of exceptions may take it."""


@contextmanager
def _limited() -> Iterator[None]:
    """End what is in the block after LONGEST_S of processor time."""

    def end(_: int, __: FrameType | None) -> None:
        raise _TooLongError

    handler = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)


@dataclass(frozen=True)
class CommandResult:
    """What a command did."""

    code: int  # exit code
    output: str
    files: frozenset[str]  # that are in the folder afterwards, beside the input
    seconds: float  # of processor time
    untrue: tuple[str, ...] = ()  # what its files hold that is wrong


def answer_to(case: FuzzCase, folder: Path) -> CommandResult:
    """Run a case in a folder, which is emptied."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    os.environ.pop(PLUGINS_VARIABLE, None)
    begin = time.process_time()
    with chdir(folder):
        try:
            with _limited():
                result = CliRunner().invoke(app, case.words)
            code, output = result.exit_code, result.output
        except _TooLongError:
            code, output = TOO_LONG, f"not done after {LONGEST_S:g} s"
    paths = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    written = {path for path in paths if "__pycache__" not in path} - set(case.files)
    seconds = time.process_time() - begin
    untrue = tuple(case.judge(folder)) if case.judge and code == DONE else ()
    return CommandResult(code, output, frozenset(written), seconds, untrue)


def faults_of(case: FuzzCase, answer: CommandResult) -> list[str]:
    """What no answer may be, in words."""
    faults = _faults_of_any(case, answer)
    if answer.code == DONE:
        missing = [name for name in case.written if name not in answer.files]
        return faults + [f"did not write {name}" for name in missing] + list(answer.untrue)
    return faults + _faults_of_refusal(case, answer)


def _faults_of_any(case: FuzzCase, answer: CommandResult) -> list[str]:
    """What is wrong with an answer, whether it is a result or an error."""
    codes = {DONE, REFUSED, FAILED} | ({INTERRUPTED} if case.may_interrupt else set())
    faults = []
    if answer.code not in codes:
        faults.append(f"exit code {answer.code}")
    if "bug in the program" in answer.output or "Traceback" in answer.output:
        faults.append("a bug in the program")
    if not answer.output.strip():
        faults.append("silent")
    if case.must_be_refused and answer.code == DONE:
        faults.append("accepted")
    return faults + [f"left {name}" for name in answer.files if name.endswith((".part", ".tmp"))]


def _faults_of_refusal(case: FuzzCase, answer: CommandResult) -> list[str]:
    """What is wrong with an error: files beside it, a long text, no name of what is at fault."""
    faults = [f"half-written {name}" for name in sorted(answer.files)]
    lines = answer.output.splitlines()
    if len(lines) > _LINES or max(map(len, lines), default=0) > _MAX_CHARACTERS:
        faults.append("a page of text")
    refused = answer.code == REFUSED
    if refused and case.named and not any(word in answer.output for word in case.named):
        faults.append(f"names none of {', '.join(case.named)}")
    return faults


def report(case: FuzzCase, answer: CommandResult, faults: list[str]) -> str:
    """A fault on some lines."""
    words = [word if len(word) < 80 else f"{word[:60]}…" for word in case.words]
    return f"{'; '.join(faults)}\n  laisn {words}\n  {answer.output[:_QUOTED]!r}"
