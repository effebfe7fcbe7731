"""Reports: one self-contained HTML page of text, tables, figures and code, whose prose stands in a
template.

A template is Markdown with numbers by name: `# title`, perhaps `> question: text`, one paragraph of
summary that answers it, then sections `## title`; a blank line ends a paragraph, `> warning: text`
is a notice. `{{ n("lost calm", ".0% i") }}` is a finding in a format of `Finding`; `{{ table }}` on
a line of its own is a table, figure, film or code that the caller passes, or a list of these;
`{{ figure | caption("text") }}` gives it a caption. Below the rows of a Markdown table stands its
caption; a row above its heads has groups: one that ends in `||` spans two columns. A cell is text,
a number, or a `TableCell` of the caller's.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from itertools import zip_longest
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import jinja2
from markdown_it import MarkdownIt
from markdown_it.tree import SyntaxTreeNode
from markupsafe import Markup

from reports.figures import Panel
from reports.findings import Finding, Findings
from reports.scene.codec import deflated
from reports.scene.mission import Scene
from reports.style import Legend, css, symbols
from reports.version import versions
from sim.log import templates
from sim.system import atomic_write

_SHOWN_VERSIONS = {
    "python": "Python",
    "mujoco": "MuJoCo",
    "numpy": "NumPy",
    "scipy": "SciPy",
    "numba": "Numba",
}
_SHORT_CHARACTERS = 44  # longest text of a cell that stays on one line


@dataclass(frozen=True, kw_only=True)
class Text:
    """A paragraph; `code` in back quotes is set as code."""

    kind: ClassVar[str] = "text"
    text: str

    @property
    def html(self) -> Markup:
        """The paragraph with code and symbols marked up; everything else is escaped."""
        parts = self.text.split("`")
        marked = (
            Markup("<code>{}</code>").format(p) if i % 2 else symbols(p)
            for i, p in enumerate(parts)
        )
        return Markup("").join(marked)


@dataclass(frozen=True, kw_only=True)
class Code:
    """Preformatted text, such as a scenario or a command."""

    kind: ClassVar[str] = "code"
    text: str
    title: str = ""
    folded: bool = False


Tone = Literal["failure", "warning", "note"]


@dataclass(frozen=True, kw_only=True)
class Notice:
    """A paragraph in a coloured box."""

    kind: ClassVar[str] = "notice"
    text: str
    tone: Tone = "note"


@dataclass(frozen=True, kw_only=True)
class TableCell:
    """A table cell: what is shown, by what it sorts, and how it is coloured."""

    text: str
    sort: float | str = ""  # by what it sorts: a number, or a text; empty: by what is shown
    tone: str = ""
    """Class of the page's style: ratio-low2, ratio-low1, ratio-even, ratio-high1 … ratio-high3,
    yes, no, maybe.
    """
    title: str = ""  # shown under the pointer

    @property
    def numeric(self) -> bool:
        """Whether it is set to the right, as numbers are."""
        return not isinstance(self.sort, str)

    @property
    def style(self) -> str:
        """Classes: numbers to the right, short text on one line, long text in a column that can
        be read.
        """
        if self.numeric:
            width = "n"
        else:
            width = "long" if len(self.text) > _SHORT_CHARACTERS else "short"
        return " ".join(filter(None, (width, self.tone)))

    @property
    def key(self) -> str:
        """By what the page's script sorts."""
        return repr(self.sort) if self.numeric else str(self.sort or self.text)


@dataclass(frozen=True, kw_only=True)
class PageTable:
    """A sortable table; `groups` is an optional row above the heads: (text, columns)."""

    kind: ClassVar[str] = "table"
    heads: Sequence[str]
    rows: Sequence[Sequence[TableCell]]
    caption: str = ""
    groups: Sequence[tuple[str, int]] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.heads):
                raise ValueError(
                    f"a row of {len(row)} cells in a table of {len(self.heads)} columns: "
                    f"{self.caption}"
                )


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Panels side by side under one caption; `legend` pairs colours with texts."""

    kind: ClassVar[str] = "figures"
    panels: Sequence[Panel]
    caption: str = ""
    title: str = ""
    legend: Legend = ()


@dataclass(frozen=True, kw_only=True)
class Film:
    """A film beside the page, which links it."""

    kind: ClassVar[str] = "film"
    path: Path
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class Replay:
    """A mission in 3D; a page has at most one."""

    kind: ClassVar[str] = "replay"
    scene: Scene
    alternative: str = "The mission in 3D"
    """What is seen, for those who do not see it."""
    caption: str = ""
    live: bool = False
    """Whether it is under way, and the page's host sends how it goes on."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A key figure of the first screen."""

    name: str
    value: str
    remark: str = ""  # what is expected, or where it was
    tone: Literal["good", "bad", ""] = ""  # against what is expected


Block = Text | Code | Notice | PageTable | Figures | Film | Replay


@dataclass(frozen=True, kw_only=True)
class PageSection:
    title: str
    blocks: Sequence[Block]

    @property
    def anchor(self) -> str:
        return "".join(c if c.isalnum() else "-" for c in self.title.lower()).strip("-")


@dataclass(frozen=True, kw_only=True)
class Page:
    title: str
    summary: str
    facts: Sequence[tuple[str, str]]  # what was run: seed, version, command to repeat it and so on
    sections: Sequence[PageSection]
    tiles: Sequence[Tile] = ()
    replay: Replay | None = None  # before the first section
    question: str = ""  # that the summary answers, before it

    @property
    def shown_replay(self) -> Replay | None:
        """The mission in 3D, before the first section or in one."""
        blocks = [block for section in self.sections for block in section.blocks]
        replays = [block for block in (self.replay, *blocks) if isinstance(block, Replay)]
        if len(replays) > 1:
            raise ValueError(f"page {self.title!r} has {len(replays)} missions in 3D")
        return replays[0] if replays else None


def number(
    value: float | int | None, digits: int = 2, tone: str = "", title: str = ""
) -> TableCell:
    """A number with a fixed count of decimals; a dash for None and NaN, sorted last."""
    if value is None or math.isnan(value):
        return TableCell(text="–", sort=math.inf, title=title)
    text = f"{value:d}" if isinstance(value, int) else f"{value:.{digits}f}"
    # what is rounded to zero has no sign
    text = text.replace("-", "−" if float(text) else "")
    return TableCell(text=text, sort=value, tone=tone, title=title)


def with_limits(finding: Finding, digits: int = 2) -> TableCell:
    """A finding with its interval in brackets, if it has one."""
    return TableCell(
        text=f"{finding:.{digits}f i}".replace(" (– to –)", ""), sort=float(finding.value or 0.0)
    )


def share_of(finding: Finding) -> TableCell:
    """A finding that is a share, in per cent with its interval; a dash for what the study did
    not determine.
    """
    values = [
        math.nan if value is None else float(value)
        for value in (finding.value, finding.low, finding.high)
    ]
    share, low, high = (number(100 * value, 1).text for value in values)
    return TableCell(text=f"{share} ({low} … {high})", sort=number(values[0]).sort)


def words(text: str, tone: str = "", title: str = "") -> TableCell:
    return TableCell(text=text, tone=tone, title=title)


def ratio_tone(ratio: float) -> str:
    """Tone of a cell for the ratio of our value to another one: even within a fifth, then up to
    1.5, 2 and beyond, either way.
    """
    if math.isnan(ratio):
        return ""
    size = abs(math.log(ratio)) if ratio > 0 else math.inf
    level = sum(size > math.log(bound) for bound in (1.2, 1.5, 2.0))
    if level == 0:
        return "ratio-even"
    side = "high" if ratio > 1 else "low"
    return f"ratio-{side}{level}"


def _scene_file(name: str) -> str:
    return (resources.files("reports.scene") / name).read_text(encoding="utf-8")


def _template(name: str) -> str:
    return (resources.files("reports") / "templates" / name).read_text(encoding="utf-8")


def render(page: Page) -> str:
    """The page as HTML text."""
    in_use = versions()
    made_with = ", ".join(f"{name} {in_use[package]}" for package, name in _SHOWN_VERSIONS.items())
    blocks = [block for section in page.sections for block in section.blocks]
    panels = [panel for block in blocks if isinstance(block, Figures) for panel in block.panels]
    replay = page.shown_replay
    styles = ["page.css"]
    scripts = ["page.js"]
    if panels:
        scripts.append("figures.js")
    if replay:
        styles.append("scene.css")
        scripts.append("boot.js")
    values = {
        "style": Markup(css() + "".join(map(_template, styles))),
        # together, as curves over one time have much in common
        "figures": deflated(f"[{','.join(panel.json for panel in panels)}]".encode()),
        "figure_of": {id(panel): number for number, panel in enumerate(panels)}.get,
        "identity": id,
        "drawn": bool(panels),
        "scripts": [Markup(_template(name)) for name in scripts],
        "code": deflated(_scene_file("replay.js").encode()) if replay else "",
        "licence": Markup(_scene_file("three.LICENSE")) if replay else "",
    }
    environment = templates.environment(loader=jinja2.FunctionLoader(_template), autoescape=True)
    environment.filters["symbols"] = symbols
    return environment.get_template("page.html").render(page=page, made_with=made_with, **values)


def write(page: Page, path: Path) -> None:
    """Write the page, whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_text(render(page), encoding="utf-8")


TEMPLATE_NAME = "page.md.j2"  # of the template in the package of a study
_BLOCKS = get_args(Block)
_MARK = "\ue000{}\ue000"
"""Stands for a block or cell of the caller's in the text of a template, by its number."""
_MARKED = re.compile("\ue000([0-9]+)\ue000")
_NUMBER = re.compile(r"(−?\d[\d,]*(?:\.\d+)?)(?: %)?(?: \(.*\)| ± \S+)?")
"""A cell that is a number: perhaps with its limits, or in per cent."""
_TONES: Mapping[str, Tone] = {"failure": "failure", "warning": "warning", "note": "note"}
_QUESTION = "question: "
_RULE = re.compile(r"\s*\|[-| ]*-[-| ]*")  # the line |---|---| below the heads of a table
# text within blocks is no Markdown: names of settings hold underscores
_MARKDOWN = MarkdownIt("zero").enable(["heading", "blockquote", "table"])


def _line(text: str) -> str:
    return re.sub(r"[ \t\n]+", " ", text).strip(" ")


def _text_of(node: SyntaxTreeNode) -> str:
    """The text of a paragraph, a cell, or the paragraphs of a quotation."""
    if node.type == "inline":
        return node.content
    return " ".join(map(_text_of, node.children))


def _span(node: SyntaxTreeNode) -> tuple[int, int]:
    """Numbers of the first line of a node, and of the line after its last one."""
    if node.map is None:
        raise ValueError(f"{node.type} has no lines")
    return node.map


@dataclass(frozen=True, kw_only=True)
class _Rendered:
    """The text of a template, and the blocks and cells that stand for its marks."""

    name: str  # of the template, for messages
    text: str
    placed: Sequence[Any]  # by the number in its mark

    def page(self, facts: Sequence[tuple[str, str]], **first_screen: Any) -> Page:
        """Its page, with tiles and a replay of it; ValueError: it has not the form of one."""
        nodes = SyntaxTreeNode(_MARKDOWN.parse(self.text)).children
        if len(nodes) > 1 and nodes[1].type == "blockquote":
            question = _line(_text_of(nodes.pop(1))).removeprefix(_QUESTION)
            first_screen = first_screen | {"question": question}
        if len(nodes) < 2 or nodes[0].tag != "h1" or nodes[1].type != "paragraph":
            raise ValueError(f"{self.name} does not start with a title and a summary")
        sections: list[tuple[str, list[Block]]] = []
        groups: list[tuple[str, int]] = []
        for node, following in zip_longest(nodes[2:], nodes[3:]):
            if node.tag == "h2":
                sections.append((self._heading(node), []))
            elif not sections:
                raise ValueError(f"{self.name} has more than a summary before its first section")
            elif node.type == "table":
                sections[-1][1].append(self._table(node, groups))
                groups = []
            elif following and following.type == "table" and _span(node)[1] == _span(following)[0]:
                groups = _groups(_text_of(node))
            else:
                sections[-1][1].append(self._block(node))
        return Page(
            title=self._heading(nodes[0]),
            summary=_line(_text_of(nodes[1])),
            facts=facts,
            sections=[PageSection(title=title, blocks=blocks) for title, blocks in sections],
            **first_screen,
        )

    def _heading(self, node: SyntaxTreeNode) -> str:
        """Title of a heading, with a # at its end, which Markdown would drop."""
        line = self.text.split("\n")[_span(node)[0]]
        return _line(line.strip().removeprefix(node.markup))

    def _block(self, node: SyntaxTreeNode) -> Block:
        """A block of the caller's, a notice or a paragraph."""
        text = _line(_text_of(node))
        if node.type == "blockquote":
            tone, colon, remark = text.partition(": ")
            if colon and tone in _TONES:
                return Notice(text=remark, tone=_TONES[tone])
        elif node.type != "paragraph" or text.startswith("|"):
            raise ValueError(f"{self.name}: neither a paragraph nor a table: {text!r:.80}")
        mark = _MARKED.fullmatch(text)
        return self.placed[int(mark[1])] if mark else Text(text=text)

    def _table(self, node: SyntaxTreeNode, groups: list[tuple[str, int]]) -> PageTable:
        """A table; of the lines that Markdown counts as its rows, those without a bar at their
        beginning are its caption.
        """
        lines = self.text.split("\n")
        head, *bodies = node.children
        (heads,) = head.children
        rows = []
        caption = []
        for row in bodies[0].children if bodies else ():
            line = lines[_span(row)[0]].strip()
            if line.startswith("|"):
                rows.append([self._cell(_text_of(cell)) for cell in row.children])
            else:
                caption.append(line)
        return PageTable(
            heads=[_text_of(cell) for cell in heads.children],
            rows=rows,
            caption=" ".join(caption),
            groups=groups,
        )

    def _cell(self, text: str) -> Any:
        """A cell of the caller's, or one of text, which sorts as a number if it is one."""
        mark = _MARKED.fullmatch(text)
        if mark:
            return self.placed[int(mark[1])]
        if text == "–":
            return TableCell(text=text, sort=math.inf)
        number = _NUMBER.fullmatch(text)
        if number:
            return TableCell(text=text, sort=float(number[1].replace("−", "-").replace(",", "")))
        return TableCell(text=text)


def _with_rules(text: str) -> str:
    """The text with a rule of as many columns as the heads above it, below those of each table,
    however many the template writes.
    """
    # lines as Markdown counts them
    lines = re.split(r"\r\n?|\n", text)
    for i, line in enumerate(lines[1:], start=1):
        if _RULE.fullmatch(line):
            columns = lines[i - 1].strip().removeprefix("|").removesuffix("|").count("|") + 1
            lines[i] = "|" + "---|" * columns
    return "\n".join(lines)


def _groups(text: str) -> list[tuple[str, int]]:
    """Groups of columns of the row above the heads of a table: their text, and how many columns
    they span, one more for each bar that follows another.
    """
    groups: list[tuple[str, int]] = []
    for cell in text.strip().removeprefix("|").removesuffix("|").split("|"):
        if cell:
            groups.append((cell.strip(), 1))
        else:
            name, columns = groups.pop()
            groups.append((name, columns + 1))
    return groups


def page_of(
    package: str,
    facts: Sequence[tuple[str, str]],
    values: Mapping[str, Any],
    findings: Findings | None = None,
    name: str = TEMPLATE_NAME,
    tiles: Sequence[Tile] = (),
    replay: Replay | None = None,
    question: str = "",
) -> Page:
    """The page of a template, a file of this name in a package such as
    `experiments.studies.formation`, with a question, key figures and a mission in 3D before its
    first section.

    The template names `values`, and prints `findings` with `n`. LaisnError: there is no finding of
    a name. ValueError: no title, or text before the first section that is not the summary.
    """
    placed: list[Any] = []

    def number(name: str, spec: str, missing: str | None = None) -> str:
        if findings is None:
            raise ValueError(f"a template prints {name!r}, but the page has no findings")
        if missing is not None and name not in findings.findings:
            return missing
        return format(findings[name], spec).replace(" (– to –)", "")

    def mark(value: object) -> str:
        placed.append(value)
        return _MARK.format(len(placed) - 1)

    def place(value: object) -> object:
        if isinstance(value, TableCell):
            return mark(value)
        blocks: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
        if not all(isinstance(block, _BLOCKS) for block in blocks):
            return value
        return "".join(f"\n\n{mark(block)}" for block in blocks) + "\n\n"

    def source(_: str) -> str:
        return (resources.files(package) / name).read_text(encoding="utf-8")

    loader = jinja2.FunctionLoader(source)
    environment = templates.environment(loader=loader, finalize=place, autoescape=False)
    environment.filters["caption"] = lambda block, text: replace(block, caption=_line(text))
    template = environment.get_template(f"{package}/{name}")
    text = _with_rules(template.render({**values, "n": number}))
    return _Rendered(name=f"{package}: {name}", text=text, placed=placed).page(
        facts, tiles=tiles, replay=replay, question=question
    )
