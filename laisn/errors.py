"""Errors and warnings that users can act on, and their text, at most a screen, without control
characters.
"""

import math
import unicodedata
from collections.abc import Iterable
from itertools import accumulate

COLUMNS = 80
ROWS = 20
"""A small terminal, less the lines around a message."""

_INVISIBLE = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
"""Categories of Unicode that are not visible."""


class LaisnError(ValueError):
    """What was given cannot be used, or the machine lacks something; any other exception is a
    bug.
    """


class LaisnWarning(UserWarning):
    """A problem that was worked around; the command shows the text alone, and no warnings of
    libraries.
    """


def printable(text: object) -> str:
    """The text on one line, with every character that is no visible one as its escape, such as
    `\\x1b`.
    """
    return "".join(
        c.encode("unicode_escape").decode("ascii") if unicodedata.category(c) in _INVISIBLE else c
        for c in str(text)
    )


def shortened(text: str, limit: int) -> str:
    """The text, its middle left out where it is longer than `limit` characters."""
    if len(text) <= limit:
        return text
    head = (limit - 1) // 2
    return f"{text[:head]}…{text[len(text) - (limit - 1 - head) :]}"


def screenful(lines: Iterable[str], rows: int = ROWS) -> list[str]:
    """Lines, made plain, at most `rows` / 2 rows of 80 columns each, that fit; the last one
    counts the others.
    """
    texts = [shortened(printable(line), COLUMNS * (rows // 2)) for line in lines]
    ends = accumulate(max(1, math.ceil(len(text) / COLUMNS)) for text in texts)
    n_fitting = sum(end <= rows - (number < len(texts)) for number, end in enumerate(ends, start=1))
    return (
        texts
        if n_fitting == len(texts)
        else [*texts[:n_fitting], f"  … and {len(texts) - n_fitting} more"]
    )
