"""Signals that end the command: SIGTERM and SIGHUP interrupt it like Ctrl-C."""

import io
import os
import signal
import sys
import threading
from types import FrameType

import typer


class SignalInterrupt(KeyboardInterrupt):
    """A signal that asks the process to end.

    Attributes:
        code: exit code, as a shell gives it for a process that the signal ended.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = 128 + number


_received: list[SignalInterrupt] = []


def received() -> SignalInterrupt | None:
    """The signal that was received, if any; a library that was being imported may have raised another error for it."""
    return _received[0] if _received else None


def _interrupt(number: int, _: FrameType | None) -> None:
    if number != signal.SIGINT:
        # once, so that cleaning up is not interrupted by a repetition; a second Ctrl-C may
        signal.signal(number, signal.SIG_IGN)
    _received.append(SignalInterrupt(number))
    raise _received[-1]


def resend_signal(lost: "sys.UnraisableHookArgs") -> None:
    """Send a signal again whose exception was raised in a finaliser, where Python drops it."""
    if not isinstance(lost.exc_value, SignalInterrupt):
        sys.__unraisablehook__(lost)
        return
    _received.remove(lost.exc_value)
    number = lost.exc_value.code - 128
    signal.signal(number, _interrupt)
    again = threading.Timer(0.01, signal.pthread_kill, [threading.main_thread().ident, number])
    again.daemon = True
    again.start()


def handle_signals() -> None:
    """Raise `SignalInterrupt` for SIGINT, SIGTERM and SIGHUP, unless the process was started to ignore them."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
    sys.unraisablehook = resend_signal


def run(app: typer.Typer) -> None:
    """Run the command; exit code 1 if standard output cannot be written."""
    handle_signals()
    if not os.environ.get("LAISN_DEBUG"):
        # warnings of libraries in child processes
        os.environ.setdefault("PYTHONWARNINGS", "ignore")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        app()
    finally:
        if signal.getsignal(signal.SIGINT) is _interrupt:
            # Python's own finalisation has nothing to clean up
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        try:
            if sys.stdout is not None:
                sys.stdout.flush()
        except OSError as error:
            # Python would try once more when it ends, and print a traceback
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            sys.exit(1 if isinstance(error, BrokenPipeError) else f"laisn: output: {error.strerror}")
