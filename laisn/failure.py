"""Errors and warnings that users can act on, and their text for a terminal.

Nothing that others wrote steers a terminal, and no message is longer than a screen.
"""

import math
import unicodedata
from collections.abc import Iterable

COLUMNS, ROWS = 80, 20
"""A small terminal, less the lines around a message."""

_STEERING = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
"""Categories of Unicode whose characters move the cursor, turn the line around, show nothing, or cannot be encoded."""


class LaisnError(ValueError):
    """What was given cannot be used, or the machine lacks something; the text states what was expected and what exists.

    The command shows the text alone. Any other exception is a bug. It is a `ValueError`, so that
    callers from Python may catch it without knowing this class.
    """


class LaisnWarning(UserWarning):
    """A problem that was worked around; the command shows the text alone, and no warnings of libraries."""


def plain(text: object) -> str:
    """The text on one line, with every character that is no visible one as its escape, such as `\\x1b`."""
    return "".join(
        c.encode("unicode_escape").decode("ascii") if unicodedata.category(c) in _STEERING else c for c in str(text)
    )


def shortened(text: str, limit: int) -> str:
    """The text, its middle left out where it is longer than `limit` characters."""
    if len(text) <= limit:
        return text
    head = (limit - 1) // 2
    return f"{text[:head]}…{text[len(text) - (limit - 1 - head) :]}"


def screenful(lines: Iterable[str], rows: int = ROWS) -> list[str]:
    """The lines, made plain, that fit into `rows` rows of 80 columns; the last one counts those left out.

    A line takes as many rows as it needs, but one alone may not take them all.
    """
    given = list(lines)
    shown: list[str] = []
    left = rows
    for number, line in enumerate(given):
        text = shortened(plain(shortened(line, COLUMNS * rows)), COLUMNS * max(1, rows // 2))
        left -= max(1, math.ceil(len(text) / COLUMNS))
        if left < (number < len(given) - 1):
            return [*shown, f"  … and {len(given) - number} more"]
        shown.append(text)
    return shown
