"""Colours, sizes and symbols of all pages; what the film shows too has the film's hues."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from markupsafe import Markup, escape

_SYMBOL = re.compile(r"\b(?:([DEHσμτ]|Δt)_([A-Za-z0-9θ]+)|(Δt))\b")


def symbols(text: str) -> Markup:
    """Escaped text in which symbols such as E_P and H_T carry their index below the line."""

    def marked(symbol: re.Match[str]) -> str:
        return f"<i>{symbol[3]}</i>" if symbol[3] else f"<i>{symbol[1]}</i><sub>{symbol[2]}</sub>"

    return Markup(_SYMBOL.sub(marked, str(escape(text))))


class Colour(NamedTuple):
    """A colour of light and of dark pages, as CSS writes it, and the CSS variable that holds it."""

    variable: str
    light: str
    dark: str

    @property
    def css(self) -> str:
        """The colour as the page's style names it."""
        return f"var({self.variable})"


INK = Colour("--ink", "#1c2733", "#e4e9ee")
PAPER = Colour("--paper", "#ffffff", "#12181e")
FRAME = Colour("--frame", "#8894a0", "#6d7a87")
GRID = Colour("--grid", "#e3e7eb", "#29333d")
MUTED = Colour("--muted", "#9aa5b0", "#66727e")
SERIES = (
    Colour("--c1", "#0b62a8", "#6cb2f2"),
    Colour("--c2", "#c8501e", "#ff9868"),
    Colour("--c3", "#0a7d5a", "#4fcfa3"),
    Colour("--c4", "#8a4a9e", "#cf9fe2"),
    Colour("--c5", "#9a6b00", "#e6bb52"),
    Colour("--c6", "#b03060", "#f28bb0"),
)
"""Distinguishable with the common kinds of colour blindness, on light and on dark pages."""
# hues of the film, bright enough for dark pages and dark enough for white ones
LEADER = Colour("--leader", "#d17d00", "#ffad33")
FOLLOWER = Colour("--follower", "#8f8600", "#fff240")
ESTIMATE = Colour("--estimate", "#c4009d", "#ff40d9")
REAR = Colour("--rear", "#5b6670", "#f2f7ff")
FRONT = Colour("--front", "#0a8a32", "#59ff8c")
MIDDLE = Colour("--middle", "#2f6fd0", "#73b3ff")
TRANSMITTERS = (REAR, FRONT, MIDDLE)
Legend = Sequence[tuple[Colour, str]]
COLOURS = (PAPER, INK, FRAME, GRID, MUTED, *SERIES, LEADER, FOLLOWER, ESTIMATE, *TRANSMITTERS)

# width and height of a panel of which three stand side by side [inch]
WIDTH = 4.4
HEIGHT = 2.5
FULL = 12.4
"""Width of a panel that stands alone, or of panels side by side together, on the page [inch]."""
HALF = 6.1  # width of one of two panels side by side [inch]


def css() -> str:
    """The colours as CSS variables: light ones, and dark ones for readers who prefer a dark
    screen.
    """
    light, dark = (
        "; ".join(f"{c.variable}: {getattr(c, theme)}" for c in COLOURS)
        for theme in ("light", "dark")
    )
    return (
        f":root {{ {light}; }}\n@media screen and (prefers-color-scheme: dark) {{\n  :root {{ "
        f"{dark}; }}\n}}\n"
    )


ERROR_LEVELS_M = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Lower limits of the bands of a map of errors [m]."""
ERROR_COLOURS = ("#e8f1f8", "#c3dcee", "#8fbfdf", "#f3d19a", "#ea9a5c", "#d1602f", "#8e2a12")
"""Of these bands: blue below half a metre, orange to brown above; the last for 4 m and more."""
