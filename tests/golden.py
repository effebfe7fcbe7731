"""Golden pages: a page as text, held against a file that was read and found right.

`make golden` writes the files anew; what has changed in them is then read as any other change.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from difflib import unified_diff
from pathlib import Path

from reports.findings import Finding, Findings
from reports.page import Code, Figures, Notice, Page, PageTable, TableCell, Text

FOLDER = Path(__file__).parent / "data" / "pages"
IS_REWRITTEN = os.environ.get("GOLDEN") == "write"


def _cell(cell: TableCell) -> str:
    """Text of a cell, with the class that colours it and its tooltip."""
    remarks = ": ".join(filter(None, (cell.tone, cell.title)))
    return f"{cell.text} {{{remarks}}}" if remarks else cell.text


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _table(table: PageTable) -> Iterator[str]:
    if table.groups:
        yield _row([f"{text} ×{columns}" for text, columns in table.groups])
    yield _row(list(table.heads))
    for row in table.rows:
        yield _row([_cell(cell) for cell in row])
    if table.caption:
        yield f"({table.caption})"


def _block(block: object) -> Iterator[str]:
    match block:
        case Text():
            yield block.text
        case Notice():
            yield f"{block.tone}: {block.text}"
        case PageTable():
            yield from _table(block)
        case Code():
            yield f"[code: {block.title}]"
            yield block.text
        case Figures():
            titles = "; ".join(panel.title or panel.x_label for panel in block.panels)
            yield f"[figures: {titles}]"
            if block.caption:
                yield f"({block.caption})"
        case _:
            yield f"[{type(block).__name__}]"


def _lines(page: Page) -> Iterator[str]:
    yield f"# {page.title}"
    if page.question:
        yield f"question: {page.question}"
    yield page.summary
    for name, fact in page.facts:
        yield f"{name}: {fact}"
    for section in page.sections:
        yield ""
        yield f"## {section.title}"
        for block in section.blocks:
            yield ""
            yield from _block(block)


def text_of(page: Page) -> str:
    """A page as text: its words, tables and code in order; of drawings their titles."""
    return "\n".join(line.rstrip() for line in _lines(page)) + "\n"


def require_golden(page: Page, name: str) -> None:
    """AssertionError with the difference if a page is not that of the file NAME.txt."""
    file = FOLDER / f"{name}.txt"
    text = text_of(page)
    if IS_REWRITTEN:
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
    golden = file.read_text(encoding="utf-8")
    difference = "\n".join(
        unified_diff(golden.splitlines(), text.splitlines(), str(file), "page", lineterm="", n=1)
    )
    assert text == golden, f"{difference}\nif that is meant: make golden, and read what it changes"


def numbered(findings: Mapping[str, Finding]) -> dict[str, Finding]:
    """The same findings with distinct values, so that a page shows which of them it prints where.

    Values are 1.25, 2.25 …, those of shares 0.1 %, 0.2 % …; limits are 0.5 and 1.5 times these.
    """
    result = {}
    for number, (name, finding) in enumerate(findings.items(), start=1):
        if not isinstance(finding.value, float):
            result[name] = finding
            continue
        is_share = finding.unit == "" and finding.high is not None
        value = 1e-3 * number if is_share else number + 0.25
        low, high = (None, None) if finding.low is None else (0.5 * value, 1.5 * value)
        result[name] = replace(finding, value=value, low=low, high=high)
    return result


def numbered_record(study: str, findings: Mapping[str, Finding]) -> Findings:
    """A record of `numbered` findings."""
    return Findings(
        study=study, command=f"laisn {study}", modules=(), version="", findings=numbered(findings)
    )
