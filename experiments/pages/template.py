"""Pages whose prose stands in a template: Markdown headings and paragraphs, numbers by name, tables and figures.

A template starts with `# title` and one paragraph of summary. `## title` begins a section, a blank line ends a
paragraph, and `> warning: text` is a notice. `{{ n("lost calm", ".0% i") }}` is a finding in a format of `Finding`;
`{{ table }}` on a line of its own is a table, figure, film or code that the caller passes, or a list of these;
`{{ figure | caption("text") }}` gives it a caption.

Tables are Markdown: rows between `|`, a row of dashes below the heads, and the caption in the lines below. A row above
the heads has groups: one that ends in `||` spans two columns. A cell is text, a number, or a `Cell` of the caller's.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import resources
from typing import Any, get_args

import jinja2

from experiments.findings import Findings
from experiments.pages.page import Block, Cell, Notice, Page, Section, Table, Text

NAME = "page.md.j2"
"""Name of the template in a study's package."""
_BLOCKS = get_args(Block)
_MARK = "\0"
_NUMBER = re.compile(r"(−?\d[\d,]*(?:\.\d+)?)(?: %)?(?: \(.*\)| ± \S+)?")
"""A cell that is a number: perhaps with its limits, or in per cent."""
_TONES = ("failure", "warning", "note")


def _numbers(findings: Findings | None) -> Callable[..., str]:
    def number(name: str, spec: str, missing: str | None = None) -> str:
        if findings is None:
            raise ValueError(f"a template prints {name!r}, but the page has no findings")
        if missing is not None and name not in findings.findings:
            return missing
        return format(findings[name], spec).replace(" (– to –)", "")

    return number


def _line(text: str) -> str:
    """Text on one line; no-break spaces stay."""
    return re.sub(r"[ \t\n]+", " ", text).strip(" ")


def _paragraph(text: str) -> Text | Notice:
    words = _line(text)
    tone, colon, rest = words.removeprefix(">").strip().partition(": ")
    if text.startswith(">") and colon and tone in _TONES:
        return Notice(text=rest, tone=tone)  # type: ignore[arg-type]
    return Text(text=words)


def _cell(text: str, placed: Sequence[Any]) -> Cell:
    """A cell that was passed, or one of text, which sorts as a number if it is one."""
    if text.startswith(_MARK):
        found: Cell = placed[int(text.removeprefix(_MARK))]
        return found
    number = _NUMBER.fullmatch(text)
    sort = float(number[1].replace("−", "-").replace(",", "")) if number else math.inf if text == "–" else ""
    return Cell(text=text, sort=sort)


def _table(text: str, placed: Sequence[Any]) -> Table:
    lines = [line.strip() for line in text.splitlines()]
    rows = [line[1:-1].split("|") for line in lines if line.startswith("|")]
    rule = next(i for i, row in enumerate(rows) if all("-" in cell and not cell.strip("-: ") for cell in row))
    groups: list[tuple[str, int]] = []
    for cell in rows[0] if rule == 2 else ():
        groups = [*groups, (cell.strip(), 1)] if cell else [*groups[:-1], (groups[-1][0], groups[-1][1] + 1)]
    return Table(
        heads=[head.strip() for head in rows[rule - 1]],
        rows=[[_cell(cell.strip(), placed) for cell in row] for row in rows[rule + 1 :]],
        caption=" ".join(line for line in lines if line and not line.startswith("|")),
        groups=groups,
    )


def _render(
    package: str,
    name: str,
    values: Mapping[str, Any],
    filters: Mapping[str, Callable[..., object]] | None = None,
    finalize: Callable[[object], object] | None = None,
) -> list[str]:
    """Paragraphs of a rendered template."""
    environment = jinja2.Environment(
        finalize=finalize, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined, autoescape=False
    )
    environment.filters.update(filters or {})
    source = (resources.files(package) / name).read_text(encoding="utf-8")
    text = environment.from_string(source).render(values)
    return [part.strip() for part in re.split(r"\n\s*\n", text) if part.strip()]


def paragraphs(
    package: str, name: str, values: Mapping[str, Any], filters: Mapping[str, Callable[..., str]] | None = None
) -> list[str]:
    """Paragraphs of text from a template `name` in a package, each on one line.

    Raises:
        jinja2.UndefinedError: the template names what is neither a value nor a filter.
    """
    return [_line(part) for part in _render(package, name, values, filters)]


def page_of(
    package: str,
    facts: Sequence[tuple[str, str]],
    values: Mapping[str, Any],
    findings: Findings | None = None,
    name: str = NAME,
) -> Page:
    """The page of a template.

    Args:
        package: that the template lies in, such as `experiments.studies.formation`.
        facts: of the page.
        values: what the template names: text, numbers, or blocks of the page.
        findings: numbers that it prints with `n`.
        name: of the template.

    Raises:
        LaisnError: there is no finding of a name.
        jinja2.UndefinedError: the template names what is not given.
        ValueError: it has no title, or text before the first section that is not the summary.
    """
    placed: list[Any] = []

    def place(value: object) -> object:
        if isinstance(value, Cell):
            placed.append(value)
            return f"{_MARK}{len(placed) - 1}"
        blocks: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
        if not all(isinstance(block, _BLOCKS) for block in blocks):
            return value
        placed.extend(blocks)
        marks = (f"{_MARK}{i}" for i in range(len(placed) - len(blocks), len(placed)))
        return "\n\n" + "\n\n".join(marks) + "\n\n"

    caption = {"caption": lambda block, text: replace(block, caption=_line(text))}
    parts = _render(package, name, {**values, "n": _numbers(findings)}, caption, finalize=place)
    title, *rest = parts or [""]
    if not title.startswith("# ") or not rest:
        raise ValueError(f"{package}: {name} does not start with a title and a summary")
    sections: list[tuple[str, list[Block]]] = []
    for part in rest[1:]:
        if part.startswith("## "):
            sections.append((_line(part.removeprefix("## ")), []))
        elif not sections:
            raise ValueError(f"{package}: {name} has more than a summary before its first section")
        elif part.startswith("|"):
            sections[-1][1].append(_table(part, placed))
        elif part.startswith(_MARK):
            sections[-1][1].append(placed[int(part.removeprefix(_MARK))])
        else:
            sections[-1][1].append(_paragraph(part))
    return Page(
        title=title.removeprefix("# "),
        summary=_line(rest[0]),
        facts=facts,
        sections=[Section(title=head, blocks=blocks) for head, blocks in sections],
    )
