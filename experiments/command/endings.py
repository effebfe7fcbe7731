"""How the command ends: when it is told to by a signal, and when nobody takes what it has to say."""

import errno
import io
import os
import signal
import sys
import threading
from types import FrameType
from typing import TextIO

import typer

from laisn.whole_files import sweep_scratch


class Told(KeyboardInterrupt):
    """A signal that asks the process to end; it is obeyed like Ctrl-C, with everything tidied up."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = 128 + number
        """Exit code, as a shell gives it for a process that the signal ended."""
        self.acknowledged = False
        """Whether the user has been told that the command ends for it."""


_told: list[Told] = []


def told() -> Told | None:
    """The signal that has come, if one has; a library that was being imported may have made another error of it."""
    return _told[0] if _told else None


def _obey(number: int, _: FrameType | None) -> None:
    if number != signal.SIGINT:
        # once: tidying up must not be interrupted by the same again; a second Ctrl-C may
        signal.signal(number, signal.SIG_IGN)
    _told.append(Told(number))
    raise _told[-1]


def obey_again(lost: "sys.UnraisableHookArgs") -> None:
    """Have a signal come once more that came while Python took an object away, where no error gets out."""
    if not isinstance(lost.exc_value, Told):
        sys.__unraisablehook__(lost)
        return
    _told.remove(lost.exc_value)
    number = lost.exc_value.code - 128
    signal.signal(number, _obey)
    again = threading.Timer(0.01, signal.pthread_kill, [threading.main_thread().ident, number])
    again.daemon = True
    again.start()


def _leave(number: int, _: FrameType | None) -> None:
    os._exit(128 + number)


def obey_signals() -> None:
    """Let SIGTERM and SIGHUP end the command like Ctrl-C, unless whoever started it ignores them."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _obey)
    sys.unraisablehook = obey_again


class _Output(io.RawIOBase):
    """Standard output that never fails: what cannot be written there goes to standard error."""

    def __init__(self, handle: int) -> None:
        super().__init__()
        self._handle = handle
        self.fault: OSError | None = None
        self._closed_by_reader = False

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._handle

    def isatty(self) -> bool:
        return os.isatty(self._handle)

    def write(self, content: object) -> int:
        data = bytes(content)  # type: ignore[call-overload]  # whatever a buffer hands over
        if self._closed_by_reader:
            return len(data)
        try:
            return os.write(2 if self.fault else self._handle, data)
        except OSError as error:
            if self.fault is None and error.errno != errno.EPIPE:
                self.fault = error
                typer.secho(f"laisn: output: {error.strerror}; it goes on here", fg="yellow", err=True)
                return self.write(data)
            # a reader such as `head` has enough, or nobody listens at all: the work goes on
            self._closed_by_reader = True
            return len(data)


def patient_output() -> _Output | None:
    """Make standard output one that never fails, and that shows "?" for what its encoding lacks; None without one."""
    stream: TextIO | None = sys.stdout
    if stream is None:
        return None
    output = _Output(stream.fileno())
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(output),
        encoding=stream.encoding,
        errors="replace",
        line_buffering=True,
    )
    return output


def run(app: typer.Typer) -> None:
    """Run the command; exit code 1 if it went well but standard output took nothing."""
    sweep_scratch()
    obey_signals()
    output = patient_output()
    try:
        app()
    except SystemExit as ending:
        if signal.getsignal(signal.SIGINT) is _obey:
            # what is left is Python's own end, which has nothing to say about a Ctrl-C, and no other code for it
            signal.signal(signal.SIGINT, _leave)
        signalled = told()
        if signalled is not None and not signalled.acknowledged:
            # it came before a command began, or after one ended; typer takes it without a word
            typer.secho("laisn: interrupted", fg="yellow", err=True)
        if output is None:
            raise
        sys.stdout.flush()
        raise SystemExit(ending.code or (1 if output.fault else 0)) from None
