"""Tables of a vehicle whose numbers are known, in any units, for `laisn log import`: what is read
is right, or the table is refused.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.datasets.table_columns import ANGLE, LENGTH, SPEED, TIME, quantity_of
from sim.log.reader import read_recording
from tools.fuzz.case import FuzzCase

_LOG = "out.mcap"
_OWN_COLUMNS = ("time", "speed", "heading", "depth")
_LEADER = ("leader_east", "leader_north", "leader_heading", "leader_speed", "leader_depth")
_RANGES = ("range_rear", "range_front")


@dataclass
class Passage:
    """A vehicle beside its leader: fields by their names in SI units, shape (n,), NaN where a row
    has none.
    """

    fields: dict[str, Floats]
    interval: float  # between rows [s]

    @property
    def received(self) -> np.ndarray:
        """Rows with a message, shape (n,)."""
        return np.isfinite(self.fields["range_rear"])


def _passage(random: Random) -> Passage:
    """On straight, curved or broken ways at one speed."""
    interval = random.choice((0.1, 0.2, 1.0, 5.0))
    k: Floats = np.arange(1.0, random.choice((80, 200, 300)) + 1)
    time = interval * k + random.choice((0.0, 37.3, 259_200.0, 1.7e9))
    speed = random.choice((0.5, 1.0, 2.5))
    course = random.choice((0.0, math.radians(3.0), random.uniform(0.0, math.tau)))
    turns = random.choice((0.0 * k, 0.3 * np.sin(k / 15.0), 1.5 * (k // 40 % 2), 0.02 * k))
    heading: Floats = (course + turns) % math.tau
    ahead = np.column_stack([np.sin(heading), np.cos(heading)])
    leader = np.cumsum(speed * interval * ahead, axis=0) + random.uniform(-300.0, 300.0)
    own_position = leader + np.array([random.uniform(-40.0, 40.0), random.uniform(15.0, 40.0)])
    depth, leader_depth = random.choice(((8.0, 8.0), (2.0, 30.0)))
    # transmitters 1 m behind and ahead of the leader's middle
    ranges = [
        np.hypot(np.linalg.norm(leader + x * ahead - own_position, axis=1), depth - leader_depth)
        for x in (-1.0, 1.0)
    ]
    message_stride = max(1, round(random.choice((1.0, 10.0)) / interval))
    ones = np.ones(k.size)
    received = np.where(k % message_stride == 0, 1.0, np.nan)
    own_values: list[Floats] = [time, speed * ones, heading, depth * ones]
    leader_values: list[Floats] = [*leader.T, heading, speed * ones, leader_depth * ones]
    fields: dict[str, Floats] = dict(zip(_OWN_COLUMNS, own_values, strict=True))
    names = ("leader_timestamp", *_LEADER, *_RANGES)
    for name, values in zip(names, [time, *leader_values, *ranges], strict=True):
        fields[name] = values * received
    return Passage(fields, interval)


def _units(random: Random) -> dict[str, dict[str, float]]:
    """Units that may stand in headers, with their sizes in SI units, by quantity: one of each, or
    any.
    """
    mixed = random.random() < 0.4
    chosen = dict[str, dict[str, float]]()
    for quantity in (TIME, SPEED, ANGLE, LENGTH):
        sizes = dict(quantity.units)
        name = random.choice(list(sizes))
        chosen[quantity.name] = sizes if mixed else {name: sizes[name]}
    return chosen


def _step_back(time: Floats, interval: float, random: Random) -> Floats:
    """A recorder whose clock is corrected once."""
    step = min(random.choice((3.0 * interval, 30.0, 3600.0)), 0.9 * float(time[len(time) // 2]))
    return np.where(np.arange(time.size) < time.size // 2, time, time - step)


def _cells(values: Floats, size: float, comma: bool) -> list[str]:
    """Values in a unit of a size in SI units, with a comma for the decimal point or without; NaN is
    empty.
    """
    cells = ["" if math.isnan(value) else f"{value / size:.15g}" for value in values.tolist()]
    return [cell.replace(".", ",") for cell in cells] if comma else cells


def _header(field: str, unit: str, random: Random) -> str:
    return field + random.choice((f" [{unit}]", f" ({unit})", f"_{unit}"))


def _judge(passage: Passage) -> Callable[[Path], list[str]]:
    """Says what in the imported log differs from the truth."""

    def faults(folder: Path) -> list[str]:
        try:
            read = read_recording(folder / _LOG).measurements
        except LaisnError as error:
            return [f"an unreadable log: {error}"]
        fields = passage.fields
        if read.speed.size != fields["speed"].size:
            return [f"{read.speed.size} of {fields['speed'].size} rows are left"]
        messages = np.column_stack([fields[name] for name in _LEADER])[passage.received]
        ranges = np.column_stack([fields[name] for name in _RANGES])[passage.received]
        heading_error = np.remainder(read.heading - fields["heading"] + math.pi, math.tau) - math.pi
        differences = {
            "speed": read.speed - fields["speed"],
            "heading": heading_error,
            "depth": read.depth - fields["depth"],
            "interval": np.array([read.dt - passage.interval]),
            "messages": read.message[:, 1:6] - messages,
            "ranges": read.ranges[:, :2] - ranges,
        }
        return [
            f"{name} differs by {np.abs(difference).max():.3g}"
            for name, difference in differences.items()
            if difference.size and not np.abs(difference).max() < 1e-3
        ]

    return faults


@dataclass(frozen=True, kw_only=True)
class _Style:
    """How a table is written; a bare column is one whose header states no unit."""

    units: dict[str, dict[str, float]]  # of other columns: size in SI units by name, by quantity
    bare_units: dict[str, str]  # of bare columns, by quantity
    bare_share: float  # chance that a column is bare
    comma: bool  # whether decimals have a comma

    def column(self, field: str, values: Floats, random: Random) -> list[str]:
        """Header and cells."""
        quantity = quantity_of(field)
        if random.random() < self.bare_share:
            unit = self.bare_units[quantity.name]
            header = field
        else:
            unit = random.choice(list(self.units[quantity.name]))
            header = _header(field, unit, random)
        return [header, *_cells(values, quantity.units[unit], self.comma)]


def _style(random: Random, delimiter: str) -> _Style:
    units = _units(random)
    bare_share = random.choice((0.0, 0.3, 0.7))
    if bare_share > 0.0:
        # lengths and speeds without a unit have that of the others, or of the SI
        units |= {SPEED.name: {SPEED.si: 1.0}, LENGTH.name: {LENGTH.si: 1.0}}
        # near north nothing tells radians from degrees but the others
        name, size = random.choice([*units[ANGLE.name].items()])
        units[ANGLE.name] = {name: size}
    # times and angles without a unit are in one
    bare_units = {name: random.choice(list(sizes)) for name, sizes in units.items()}
    return _Style(
        units=units,
        bare_units=bare_units,
        bare_share=bare_share,
        comma=delimiter != "," and random.random() < 0.5,
    )


def make(random: Random) -> FuzzCase:
    """A table with units in its headers, or without where these are SI units or times or angles;
    some with a clock that steps back, a column twice, or heights in place of depths.
    """
    passage = _passage(random)
    fault = random.choice(("", "", "", "step", "twice", "heights"))
    delimiter = random.choice(",;\t|")
    style = _style(random, delimiter)
    fields = dict(passage.fields)
    if fault == "step":
        fields["time"] = _step_back(fields["time"], passage.interval, random)
    elif fault == "heights":
        fields["depth"] = -fields["depth"]
    columns = [style.column(field, values, random) for field, values in fields.items()]
    if fault == "twice":
        header, *cells = random.choice(columns)
        columns.append([random.choice((header, header.upper(), f" {header}")), *cells])
    text = "\n".join(delimiter.join(row) for row in zip(*columns, strict=True))
    byte_order_mark = "\ufeff" if random.random() < 0.2 else ""
    wrong = fault in ("twice", "heights")
    return FuzzCase(
        words=["log", "import", "in.csv", "--out", _LOG],
        files={"in.csv": f"{byte_order_mark}{text}".encode()},
        written=(_LOG,),
        must_be_refused=wrong,
        judge=None if wrong else _judge(passage),
    )
