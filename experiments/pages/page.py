"""Reports: one self-contained HTML page out of sections of text, tables, figures, code and films.

A page needs no network and no framework; the same content gives the same bytes.
"""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import jinja2
from markupsafe import Markup

from experiments.campaign.version import versions
from experiments.pages.figures import Panel
from experiments.pages.style import Legend, css, symbols
from sim.system import atomic_write

if TYPE_CHECKING:
    # its special functions take a tenth of a second to import, and a page needs none
    from experiments.findings import Finding

_SHOWN_VERSIONS = {"python": "Python", "mujoco": "MuJoCo", "numpy": "NumPy", "scipy": "SciPy", "numba": "Numba"}
"""Libraries that shape numbers, by name; the page lists their versions."""
_SHORT = 44
"""Text of a table cell up to this length stays on one line."""
EMBEDDED_FILM_BYTES = 600_000
"""Larger films are linked: Base64 adds a third, Plotly takes 4.8 MB, and a page stays below 6 MB."""
_POSTER_QUALITY = 80


@dataclass(frozen=True, kw_only=True)
class Text:
    """A paragraph; `code` in back quotes is set as code."""

    kind: ClassVar[str] = "text"
    text: str

    @property
    def html(self) -> Markup:
        """The paragraph with code and symbols marked up; everything else is escaped."""
        parts = self.text.split("`")
        marked = (Markup("<code>{}</code>").format(p) if i % 2 else symbols(p) for i, p in enumerate(parts))
        return Markup("").join(marked)


@dataclass(frozen=True, kw_only=True)
class Code:
    """Preformatted text, such as a scenario or a command."""

    kind: ClassVar[str] = "code"
    text: str
    title: str = ""
    folded: bool = False


@dataclass(frozen=True, kw_only=True)
class Notice:
    """Something that the reader must not miss."""

    kind: ClassVar[str] = "notice"
    text: str
    tone: Literal["failure", "warning", "note"] = "note"


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A table cell: what is shown, by what it sorts, and how it is coloured."""

    text: str
    sort: float | str = ""
    tone: str = ""
    """Class of the page's style: ratio-low2, ratio-low1, ratio-even, ratio-high1 … ratio-high3, yes, no, maybe."""
    title: str = ""
    """Shown when the pointer rests on the cell."""

    @property
    def numeric(self) -> bool:
        """Whether it is set to the right, as numbers are."""
        return not isinstance(self.sort, str)

    @property
    def style(self) -> str:
        """Classes: numbers to the right, short text on one line, long text in a column that can be read."""
        width = "n" if self.numeric else "long" if len(self.text) > _SHORT else "short"
        return " ".join(filter(None, (width, self.tone)))

    @property
    def key(self) -> str:
        """What the page sorts by."""
        return repr(self.sort) if self.numeric else str(self.sort or self.text)


@dataclass(frozen=True, kw_only=True)
class Table:
    """A sortable table; `groups` is an optional row above the heads: (text, columns)."""

    kind: ClassVar[str] = "table"
    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    groups: Sequence[tuple[str, int]] = ()

    @property
    def columns(self) -> list[tuple[str, bool]]:
        """Heads, and whether numbers stand below them, and so to the right."""
        return [
            (head, bool(self.rows) and all(row[i].numeric for row in self.rows)) for i, head in enumerate(self.heads)
        ]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.heads):
                raise ValueError(f"a row of {len(row)} cells in a table of {len(self.heads)} columns: {self.caption}")


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Panels side by side under one caption; `legend` pairs colours with texts."""

    kind: ClassVar[str] = "figures"
    panels: Sequence[Panel]
    caption: str = ""
    title: str = ""
    """Set above the panels."""
    legend: Legend = ()

    @property
    def layout(self) -> str:
        """Class of the page's style: a grid of many alike, or a row that fills the width, each panel by its own."""
        return "grid" if len(self.panels) > 2 and len({panel.width for panel in self.panels}) == 1 else "row"


@dataclass(frozen=True, kw_only=True)
class Film:
    """A film beside the page: embedded if small, linked if not."""

    kind: ClassVar[str] = "film"
    path: Path
    caption: str = ""

    @property
    def poster(self) -> str:
        """Data of a frame from the film's middle, seen before it plays; FFmpegError if it is no film."""
        # most pages have no film
        import av

        with av.open(str(self.path)) as source:
            stream = source.streams.video[0]
            source.seek((stream.duration or 0) // 2, stream=stream)
            frame: Any = next(source.decode(stream))
            target = BytesIO()
            frame.to_image().save(target, "JPEG", quality=_POSTER_QUALITY, optimize=True)
        return "data:image/jpeg;base64," + base64.b64encode(target.getvalue()).decode()

    @property
    def source(self) -> str:
        """Data of a small film, name of a large one."""
        if self.path.stat().st_size > EMBEDDED_FILM_BYTES:
            return self.path.name
        return "data:video/mp4;base64," + base64.b64encode(self.path.read_bytes()).decode()


Block = Text | Code | Notice | Table | Figures | Film


@dataclass(frozen=True, kw_only=True)
class Section:
    """A headed part of a page."""

    title: str
    blocks: Sequence[Block]

    @property
    def anchor(self) -> str:
        """Id to link to."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower()).strip("-")


@dataclass(frozen=True, kw_only=True)
class Page:
    """A report."""

    title: str
    summary: str
    facts: Sequence[tuple[str, str]]
    """What was run: seed, version, command to repeat it and so on."""
    sections: Sequence[Section]


def number(value: float | int | None, digits: int = 2, tone: str = "", title: str = "") -> Cell:
    """A number with a fixed count of decimals; a dash for None and NaN, sorted last."""
    if value is None or math.isnan(value):
        return Cell(text="–", sort=math.inf, title=title)
    shown = f"{value:d}" if isinstance(value, int) else f"{value:.{digits}f}"
    # what is rounded to zero has no sign
    shown = shown.replace("-", "−" if float(shown) else "")
    return Cell(text=shown, sort=value, tone=tone, title=title)


def with_limits(finding: "Finding", digits: int = 2) -> Cell:
    """A finding with its interval in brackets, if it has one."""
    return Cell(text=f"{finding:.{digits}f i}".replace(" (– to –)", ""), sort=float(finding.value or 0.0))


def share_of(finding: "Finding") -> Cell:
    """A finding that is a share, in per cent with its interval; a dash for what the study did not determine."""
    values = [math.nan if value is None else float(value) for value in (finding.value, finding.low, finding.high)]
    share, low, high = (number(100 * value, 1).text for value in values)
    return Cell(text=f"{share} ({low} … {high})", sort=number(values[0]).sort)


def words(text: str, tone: str = "", title: str = "") -> Cell:
    """A cell of text."""
    return Cell(text=text, tone=tone, title=title)


def ratio_tone(ratio: float) -> str:
    """Colour of ours over theirs: even within a fifth, then up to 1.5, 2 and beyond, either way."""
    if math.isnan(ratio):
        return ""
    size = abs(math.log(ratio)) if ratio > 0 else math.inf
    level = sum(size > math.log(bound) for bound in (1.2, 1.5, 2.0))
    return "ratio-even" if level == 0 else f"ratio-{'high' if ratio > 1 else 'low'}{level}"


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_template),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["symbols"] = symbols
    return environment


def _template(name: str) -> str:
    return (resources.files("experiments.pages") / "templates" / name).read_text(encoding="utf-8")


def render(page: Page) -> str:
    """The page as HTML text."""
    found = versions()
    made_with = ", ".join(f"{name} {found[package]}" for package, name in _SHOWN_VERSIONS.items())
    blocks = [block for section in page.sections for block in section.blocks]
    drawn = any(isinstance(block, Figures) and block.panels for block in blocks)
    plotly = resources.files("plotly") / "package_data" / "plotly.min.js" if drawn else None
    values = {
        "style": Markup(css() + _template("page.css")),
        "plotly": Markup(plotly.read_text(encoding="utf-8")) if plotly else "",
        "script": Markup(_template("page.js")),
    }
    return _environment().get_template("page.html").render(page=page, made_with=made_with, **values)


def write(page: Page, path: Path) -> None:
    """Write the page, whole or not at all."""
    with atomic_write(path) as part:
        part.write_text(render(page), encoding="utf-8")
