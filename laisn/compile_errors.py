"""Why code of the user's own cannot be compiled, in a line: file, line of the file, and numba's
reason.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from numba.core.errors import NumbaError

from laisn.custom_sources import is_custom
from laisn.errors import shortened
from laisn.plugins import PluginError

_ESCAPES = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")
_PLACE = re.compile(r'^\s*File "(?P<file>.+)", line (?P<line>\d+):')
_MAX_REASON = 160  # characters
# lines of numba's text that say no reason
_ABOUT = re.compile(
    r"\s*($|Failed in |During: |This error |raised from |There are \d|- Of which|No match\.|\^"
    r"|.*[Oo]verload (of|in) function|With argument|Rejected as|\w*Error: Failed in )"
)


def _reason(lines: list[str]) -> str:
    """The first line that says what is wrong, with the call that it is about."""
    for i, line in enumerate(lines):
        if _ABOUT.match(line):
            continue
        text = line.strip()
        if text.endswith("found for signature:"):
            calls = [after.strip() for after in lines[i + 1 :] if after.strip().startswith(">>>")]
            called = calls[0].removeprefix(">>>").strip() if calls else ""
            text = f"no such operation: {called}" if called else text
        return shortened(text, _MAX_REASON)
    return "numba does not say why"


def reason_of(error: NumbaError) -> str:
    """Place and reason, "FILE:LINE: reason", of the innermost code of the user's own; without
    place where numba names none.

    An error has the errors of the calls that led to it after its own, and within them.
    """
    lines = _ESCAPES.sub("", str(error)).splitlines()
    # the innermost error is the one after the last of its headings, before the first place
    places = [(i, match) for i, line in enumerate(lines) if (match := _PLACE.match(line))]
    own = [(i, match) for i, match in places if is_custom(Path(match["file"]).resolve())]
    end = places[0][0] if places else len(lines)
    headings = [i for i, line in enumerate(lines[:end]) if "Failed in " in line]
    reason = _reason(lines[headings[-1] if headings else 0 : end])
    if not own:
        return reason
    _, match = own[0]
    return f"{Path(match['file']).resolve()}:{match['line']}: {reason}"


@contextmanager
def compiling_own(description: str) -> Iterator[None]:
    """Code of the user's own that is compiled in the block: PluginError with the reason if it
    cannot be.
    """
    try:
        yield
    except NumbaError as error:
        raise PluginError(f"{description} cannot be compiled: {reason_of(error)}") from error
