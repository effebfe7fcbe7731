"""Shapes of formations: stations for any number of followers."""

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field

from sim.scenario.section import NonNegative, Section

Offset = tuple[float, float]
"""Behind the leader and to port, in spacings."""


class Shape(Section):
    """Followers that a formation is made of, in place of `[[followers]]`."""

    kind: Literal["line", "v", "column", "grid", "ring"] = Field(
        ..., description="line abreast, a V of wings, a column astern, a grid four wide, a ring about a point astern"
    )
    count: Annotated[int, Field(ge=1, le=50)] = Field(..., description="number of followers")
    spacing_m: Annotated[float, Field(ge=3, le=200)] = Field(10.0, description="distance of neighbours")
    behind_m: Annotated[float, Field(ge=0, le=500)] = Field(10.0, description="how far astern the formation begins")
    depth_m: NonNegative = Field(10.0, description="depth of the first follower")
    layer_m: Annotated[float, Field(ge=0, le=20)] = Field(
        1.0, description="how much deeper each is than the one before; 0: all in one layer"
    )
    layers: Annotated[int, Field(ge=1, le=50)] | None = Field(
        None, description="number of layers, taken in turn: a grid of 4 has one for each of its columns; default: count"
    )


def _line(i: int, count: int) -> Offset:
    return 0.0, i - 0.5 * (count - 1)


def _wings(i: int, count: int) -> Offset:
    rank, side = i // 2 + 1, 1.0 if i % 2 == 0 else -1.0
    # twice as far aside as behind: at 45° all of a wing would meet where the leader turns by 90°
    return (rank - 1) * math.sqrt(0.2), side * rank * 2.0 * math.sqrt(0.2)


def _column(i: int, count: int) -> Offset:
    return float(i), 0.0


def _grid(i: int, count: int) -> Offset:
    return float(i // 4), i % 4 - 0.5 * (min(count, 4) - 1)


def _ring(i: int, count: int) -> Offset:
    radius = 0.5 / math.sin(math.pi / count) if count > 1 else 0.0
    angle = 2.0 * math.pi * i / count
    return radius * (1.0 - math.cos(angle)), radius * math.sin(angle)


_PLACES: dict[str, Callable[[int, int], Offset]] = {
    "line": _line, "v": _wings, "column": _column, "grid": _grid, "ring": _ring,
}  # fmt: skip


def followers_of(shape: Shape) -> list[dict[str, Any]]:
    """Tables of the followers of a shape: names and stations, each in its layer."""
    tables = []
    for i in range(shape.count):
        behind, port = _PLACES[shape.kind](i, shape.count)
        station = {
            "behind_m": round(shape.behind_m + behind * shape.spacing_m, 6),
            "port_m": round(port * shape.spacing_m, 6),
            "depth_m": shape.depth_m + i % (shape.layers or shape.count) * shape.layer_m,
        }
        tables.append({"name": f"follower-{i + 1}", "station": station})
    return tables
