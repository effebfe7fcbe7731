"""Tables in docstrings, which a formatter that fills lines takes apart."""

import ast
import re
import unicodedata
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("laisn", "sim", "reports", "experiments", "laisn_sim", "tools", "tests")
GAP = re.compile(r"(?<=\S) {3,}(?=\S)")


def docstrings(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            yield ast.get_docstring(node, clean=False) or ""


def columns(line: str) -> set[int]:
    """Where a column of a table begins in a line: after a gap of three spaces or more."""
    letters = "".join(letter for letter in line if not unicodedata.combining(letter))
    return {match.end() for match in GAP.finditer(letters)}


def broken_tables(docstring: str) -> list[str]:
    """Paragraphs with gaps in several lines, but no column that these lines have in common."""
    paragraphs = groupby(docstring.splitlines(), key=lambda line: bool(line.strip()))
    texts = [list(lines) for is_text, lines in paragraphs if is_text]
    return [
        "\n".join(lines)
        for lines in texts
        for gaps in [[columns(line) for line in lines if columns(line)]]
        if len(gaps) > 1 and not set.intersection(*gaps)
    ]


def test_a_filled_table_is_noticed() -> None:
    table = ["    speed       in proportion", "    heading     by line of sight"]
    assert broken_tables("\n".join(table)) == []
    filled = ["    speed       in proportion heading    by", "    line       of sight"]
    assert len(broken_tables("\n".join(filled))) == 1


@pytest.mark.parametrize("package", PACKAGES)
def test_columns_of_tables_stand_below_one_another(package: str) -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in (ROOT / package).rglob("*.py")}
    assert texts
    broken = {
        str(path.relative_to(ROOT)): tables
        for path, text in texts.items()
        # to parse a source takes long, and most have no gap
        if GAP.search(text)
        for docstring in docstrings(text)
        if (tables := broken_tables(docstring))
    }
    assert broken == {}
