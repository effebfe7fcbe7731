"""The picture of `docs/architecture.md`: rooms on their floors, drawn from the imports as they are."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from experiments.gallery import house
from experiments.pages.style import FRAME, INK, SERIES

_WIDTH, _HEIGHT = 7.6, 8.2
_BOX = (0.9, 0.62)
"""Width and height of a room; rooms stand a unit apart."""
_COLOURS = {"models": INK, "laisn": SERIES[2], "sim": SERIES[0], "experiments": SERIES[1]}


def reduced(between: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """The arrows that say all: one from a room to another goes where a way over other rooms leads there too."""
    reach: dict[str, set[str]] = {}
    for room in sorted(between, key=house.floors(between).__getitem__):
        reach[room] = set(between[room]).union(*(reach[below] for below in between[room]))
    return {
        room: {b for b in below if not any(b in reach[other] for other in below if other != b)}
        for room, below in between.items()
    }


def places(between: Mapping[str, set[str]]) -> dict[str, tuple[float, float]]:
    """Position at which each room is drawn: its floor upwards, and beside the middle of the rooms that it imports."""
    level = house.floors(between)
    placed: dict[str, tuple[float, float]] = {}
    widest = max(list(level.values()).count(floor) for floor in set(level.values()))
    for floor in sorted(set(level.values())):
        middle = {}
        for room in sorted(room for room, on in level.items() if on == floor):
            below = [placed[name][0] for name in between[room]]
            middle[room] = sum(below) / len(below) if below else widest / 2
        start = (widest - len(middle)) / 2
        placed |= {room: (start + i, float(floor)) for i, room in enumerate(sorted(middle, key=middle.__getitem__))}
    return placed


def _draw_room(axes: Axes, room: str, place: tuple[float, float], count: int) -> None:
    x, y = place
    colour = _COLOURS[room.partition(".")[0]].placeholder
    wide, high = _BOX
    axes.add_patch(
        FancyBboxPatch(
            (x - wide / 2, y - high / 2), wide, high, boxstyle="round,pad=0,rounding_size=0.06",
            facecolor="white", edgecolor=colour, linewidth=1.0, zorder=2,
        )
    )  # fmt: skip
    name = room.rpartition(".")[2].replace("_", " ")
    files = "a file" if count == 1 else f"{count} files"
    axes.text(x, y + 0.08, name, ha="center", va="center", fontsize=6.4, color=colour, zorder=3)
    axes.text(x, y - 0.21, files, ha="center", va="center", fontsize=4.6, color=FRAME.placeholder, zorder=3)


def picture() -> Figure:
    """The house: experiments above sim above laisn and models; an arrow is an import, and all of them point down."""
    found = house.imports()
    faces = {"sim", "experiments"}
    between = {room: below - faces for room, below in house.rooms(found).items() if room not in faces}
    placed = places(between)
    figure = Figure(figsize=(_WIDTH, _HEIGHT))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    for room, below in reduced(between).items():
        for other in below:
            (x, y), (u, v) = placed[room], placed[other]
            axes.annotate(
                "", (u, v + _BOX[1] / 2), (x, y - _BOX[1] / 2), zorder=1,
                arrowprops={"arrowstyle": "-|>", "lw": 0.5, "color": FRAME.placeholder, "mutation_scale": 5,
                            "shrinkA": 0, "shrinkB": 0, "alpha": 0.8},
            )  # fmt: skip
    for room, place in placed.items():
        count = sum(house.room_of(module) == room for module in found)
        _draw_room(axes, room, place, max(1, count - ("." in room and count > 1)))
    columns, rows = zip(*placed.values(), strict=True)
    axes.set_xlim(min(columns) - 0.6, max(columns) + 0.6)
    axes.set_ylim(min(rows) - 0.5, max(rows) + 0.5)
    return figure
