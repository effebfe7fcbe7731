"""Pages whose prose stands in a template: Markdown headings and paragraphs, numbers by name, tables and figures.

A template starts with `# title` and one paragraph of summary. `## title` begins a section, a blank line ends a
paragraph, and `> warning: text` is a notice. `{{ n("lost calm", ".0% i") }}` is a finding in a format of `Finding`;
`{{ table }}` on a line of its own is a table, figure, film or code that the caller passes, or a list of these.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from typing import Any, get_args

import jinja2

from experiments.findings import Findings
from experiments.pages.page import Block, Notice, Page, Section, Text

NAME = "page.md.j2"
"""Name of the template in a study's package."""
_BLOCKS = get_args(Block)
_MARK = "\0"
_TONES = ("failure", "warning", "note")


def _blocks_of(value: object) -> list[Block] | None:
    """The blocks that a value of a template stands for; None if it is text."""
    given: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
    return list(given) if all(isinstance(item, _BLOCKS) for item in given) else None


def _numbers(findings: Findings | None) -> Callable[[str, str], str]:
    def number(name: str, spec: str) -> str:
        if findings is None:
            raise ValueError(f"a template prints {name!r}, but the page has no findings")
        return format(findings[name], spec)

    return number


def _paragraph(text: str) -> Text | Notice:
    words = " ".join(text.split())
    tone, colon, rest = words.removeprefix(">").strip().partition(": ")
    if text.startswith(">") and colon and tone in _TONES:
        return Notice(text=rest, tone=tone)  # type: ignore[arg-type]
    return Text(text=words)


def page_of(
    package: str, facts: Sequence[tuple[str, str]], values: Mapping[str, Any], findings: Findings | None = None
) -> Page:
    """The page of a template.

    Args:
        package: that the template lies in, such as `experiments.formation`.
        facts: of the page.
        values: what the template names: text, numbers, or blocks of the page.
        findings: numbers that it prints with `n`.

    Raises:
        LaisnError: there is no finding of a name.
        jinja2.UndefinedError: the template names what is not given.
        ValueError: it has no title, or text before the first section that is not the summary.
    """
    placed: list[Block] = []

    def place(value: object) -> object:
        blocks = _blocks_of(value)
        if blocks is None:
            return value
        placed.extend(blocks)
        marks = (f"{_MARK}{i}" for i in range(len(placed) - len(blocks), len(placed)))
        return "\n\n" + "\n\n".join(marks) + "\n\n"

    environment = jinja2.Environment(
        finalize=place, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined, autoescape=False
    )
    source = (resources.files(package) / NAME).read_text(encoding="utf-8")
    text = environment.from_string(source).render(values, n=_numbers(findings))
    parts = [part.strip() for part in re.split(r"\n\s*\n", text) if part.strip()]
    title, *rest = parts or [""]
    if not title.startswith("# ") or not rest:
        raise ValueError(f"{package}: {NAME} does not start with a title and a summary")
    sections: list[tuple[str, list[Block]]] = []
    for part in rest[1:]:
        if part.startswith("## "):
            sections.append((" ".join(part.removeprefix("## ").split()), []))
        elif not sections:
            raise ValueError(f"{package}: {NAME} has more than a summary before its first section")
        elif part.startswith(_MARK):
            sections[-1][1].append(placed[int(part.removeprefix(_MARK))])
        else:
            sections[-1][1].append(_paragraph(part))
    return Page(
        title=title.removeprefix("# "),
        summary=" ".join(rest[0].split()),
        facts=facts,
        sections=[Section(title=head, blocks=blocks) for head, blocks in sections],
    )
