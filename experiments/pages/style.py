"""Colours and sizes of all pages; what the film shows too has the film's hues."""

from collections.abc import Sequence
from typing import NamedTuple


class Colour(NamedTuple):
    """A colour of the page."""

    placeholder: str
    """What matplotlib draws with, until the drawing takes the page's own colours."""
    variable: str
    """Name of the CSS variable."""
    light: str
    dark: str


INK = Colour("#010101", "--ink", "#1c2733", "#e4e9ee")
FRAME = Colour("#010102", "--frame", "#8894a0", "#6d7a87")
GRID = Colour("#010103", "--grid", "#e3e7eb", "#29333d")
MUTED = Colour("#010104", "--muted", "#9aa5b0", "#66727e")
SERIES = (
    Colour("#010111", "--c1", "#0b62a8", "#6cb2f2"),
    Colour("#010112", "--c2", "#c8501e", "#ff9868"),
    Colour("#010113", "--c3", "#0a7d5a", "#4fcfa3"),
    Colour("#010114", "--c4", "#8a4a9e", "#cf9fe2"),
    Colour("#010115", "--c5", "#9a6b00", "#e6bb52"),
    Colour("#010116", "--c6", "#b03060", "#f28bb0"),
)
"""Distinguishable with the common kinds of colour blindness, on light and on dark pages."""
LEADER = Colour("#010121", "--leader", "#d17d00", "#ffad33")
FOLLOWER = Colour("#010122", "--follower", "#8f8600", "#fff240")
ESTIMATE = Colour("#010123", "--estimate", "#c4009d", "#ff40d9")
REAR = Colour("#010124", "--rear", "#5b6670", "#f2f7ff")
FRONT = Colour("#010125", "--front", "#0a8a32", "#59ff8c")
MIDDLE = Colour("#010126", "--middle", "#2f6fd0", "#73b3ff")
TRANSMITTERS = (REAR, FRONT, MIDDLE)
"""Hues of the film, bright enough for dark pages and dark enough for white ones."""
Legend = Sequence[tuple[Colour, str]]
"""Colours and what they stand for."""
COLOURS = (INK, FRAME, GRID, MUTED, *SERIES, LEADER, FOLLOWER, ESTIMATE, *TRANSMITTERS)

WIDTH, HEIGHT = 4.4, 2.5
"""Size of a panel of which three stand side by side [inch]; 72 units of the drawing to an inch."""
FULL = 12.4
"""Width of a panel that stands alone, or of panels side by side together [inch]; the page shows them at this size."""
HALF = 6.1
"""Width of a panel of two side by side [inch]."""


def css() -> str:
    """The colours as CSS variables: light ones, and dark ones for readers who prefer a dark screen."""
    light, dark = ("; ".join(f"{c.variable}: {getattr(c, theme)}" for c in COLOURS) for theme in ("light", "dark"))
    return f":root {{ {light}; }}\n@media screen and (prefers-color-scheme: dark) {{\n  :root {{ {dark}; }}\n}}\n"
