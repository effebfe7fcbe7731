"""Tables of a vehicle with columns, cells and bytes that are wrong, for `laisn log import`."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from tools.fuzz.case import FuzzCase
from tools.fuzz.values import WILD, damaged

_UNITS_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
_LEADER_FIELDS = (
    "leader_timestamp",
    "leader_east",
    "leader_north",
    "leader_heading",
    "leader_speed",
)
_FIELDS = (
    ("time", "speed", "heading", "depth"),  # of every row
    # of rows with a message
    (*_LEADER_FIELDS, "leader_depth", "range_rear", "range_front"),
)


@dataclass
class FuzzColumn:
    """A header and the cells below it."""

    header: str
    cells: list[str]


def _headers(random: Random, unit: str, degrees: bool) -> dict[str, str]:
    """Headers by field, some with units."""
    headers = {}
    for field in (*_FIELDS[0], *_FIELDS[1]):
        suffixes = ["_m", " [m]", " (m)"]
        if "heading" in field:
            suffixes = ["_deg", " [deg]"] if degrees else ["_rad", " [rad]"]
        elif "time" in field:
            suffixes = [f"_{unit}", f" [{unit}]"]
        elif "speed" in field:
            suffixes = [" [m/s]"]
        headers[field] = field + (random.choice(suffixes) if random.random() < 0.4 else "")
    return headers


def _columns(random: Random) -> list[FuzzColumn]:
    """A vehicle 20 m to port of its leader, in any units."""
    degrees = random.random() < 0.5
    unit = random.choice(list(_UNITS_PER_SECOND))
    step = random.choice((0.1, 0.2, 1.0))
    speed = random.choice((0.5, 1.0, 3.0))
    course = random.uniform(0.0, 2.0 * math.pi)
    turn = random.choice((0.0, 0.0, 0.02))
    begin = random.choice((0.0, 5.0, 1.7e9))
    east = north = 0.0
    rows = []
    for k in range(1, random.choice((60, 120)) + 1):
        course += turn * step
        east += speed * step * math.sin(course)
        north += speed * step * math.cos(course)
        time = (begin + step * k) * _UNITS_PER_SECOND[unit]
        heading = math.degrees(course % math.tau) if degrees else course % math.tau
        row = [time, speed * (1.0 + random.gauss(0.0, 0.01)), heading, 8.0]
        if k % max(1, round(1.0 / step)) == 0:
            row += [time, east + 20.0 * math.cos(course), north - 20.0 * math.sin(course)]
            row += [heading, speed, 8.0, 20.0 + random.gauss(0.0, 0.02), 20.0]
        rows.append(row)
    headers = _headers(random, unit, degrees)
    return [
        FuzzColumn(header, [f"{row[i]:.12g}" if i < len(row) else "" for row in rows])
        for i, header in enumerate(headers.values())
    ]


def _replace_cells(columns: list[FuzzColumn], random: Random) -> None:
    column = random.choice(columns)
    for _ in range(random.choice((1, 5))):
        column.cells[random.randrange(len(column.cells))] = random.choice(WILD)


def _replace_header(columns: list[FuzzColumn], random: Random) -> None:
    column = random.choice(columns)
    header = column.header
    column.header = random.choice(
        (f'"{header}', f"{header}[", f"{header} []", f"{header} [xx]", "", header * 300, "ra(nge")
    )


def _drop_column(columns: list[FuzzColumn], random: Random) -> None:
    columns.pop(random.randrange(len(columns)))


def _swap_cells(columns: list[FuzzColumn], random: Random) -> None:
    first, other = random.choices(columns, k=2)
    first.cells, other.cells = other.cells, first.cells


def _step_clock(columns: list[FuzzColumn], random: Random) -> None:
    shift = random.choice((-30.0, 30.0, -1.0, -1000.0, 1e6, -1e10))
    row = random.randrange(len(columns[0].cells))
    for i, cell in enumerate(columns[0].cells[row:], start=row):
        if cell.replace(".", "").isdigit():
            columns[0].cells[i] = f"{float(cell) + shift:.12g}"


def _lose_cells(columns: list[FuzzColumn], random: Random) -> None:
    cells = random.choice(columns).cells
    for i in random.sample(range(len(cells)), len(cells) // 3):
        cells[i] = ""


def _stand_still(columns: list[FuzzColumn], random: Random) -> None:
    column = random.choice(columns)
    column.cells = [column.cells[0]] * len(column.cells)


def _shuffle_cells(columns: list[FuzzColumn], random: Random) -> None:
    random.shuffle(random.choice(columns).cells)


def _rename_column(columns: list[FuzzColumn], random: Random) -> None:
    """Call a column by another field and unit."""
    column = random.choice(columns)
    field = random.choice(("heading", "leader_heading", "time", "leader_timestamp", "speed"))
    column.header = field + random.choice((" [deg]", "_rad", " [ms]", " [kn]", " [parsec]"))


def _negate_cells(columns: list[FuzzColumn], random: Random) -> None:
    column = random.choice(columns)
    column.cells = [f"-{cell}" if cell else "" for cell in column.cells]


def _fill_cell(columns: list[FuzzColumn], random: Random) -> None:
    cells = random.choice(columns).cells
    # the second is beyond csv's largest field, 131,072
    cells[random.randrange(len(cells))] = random.choice("1x ") * random.choice((1000, 140_000))


CHANGES: tuple[Callable[[list[FuzzColumn], Random], None], ...] = (
    _replace_cells,
    _replace_header,
    _drop_column,
    _swap_cells,
    _step_clock,
    _lose_cells,
    _stand_still,
    _shuffle_cells,
    _rename_column,
    _negate_cells,
    _fill_cell,
)


def make(random: Random) -> FuzzCase:
    """A table with up to three faults, with a column twice, or with damaged bytes."""
    columns = _columns(random)
    doubled = random.random() < 0.1
    if doubled:
        column = random.choice(columns)
        columns.append(FuzzColumn(column.header, list(column.cells)))
    else:
        for change in random.choices(CHANGES, k=random.choice((0, 1, 1, 2, 3))):
            change(columns, random)
    delimiter = random.choice(",,,;\t|")
    lines = [[column.header for column in columns]]
    lines += [list(row) for row in zip(*(column.cells for column in columns), strict=True)]
    text = "\n".join(delimiter.join(line) for line in lines)
    content = text.encode("utf-8", "surrogatepass")
    if not doubled and random.random() < 0.2:
        content = damaged(content, random, 1)
    return FuzzCase(
        words=["log", "import", "in.csv", "--out", "out.mcap"],
        files={"in.csv": content},
        written=("out.mcap",),
        must_be_refused=doubled,
    )
