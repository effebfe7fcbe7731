"""Odometry and ranges to beacons of a data set.

Those of Djugash, Hamner & Roth 2009, "Navigating with Ranging Radios", are five tables in MATLAB or
text files:

    DR   time, distance driven, change of heading          odometry
    TD   time, sender, receiver, range                     ranges to the receivers
    TL   node, x, y                                        surveyed places of the nodes
    GT   time, x, y, heading                               surveyed path; may be missing
    DRp  time, x, y, heading                               odometry summed up from the start on; may
                                                           be missing

Times are in s, places in m, headings in rad anticlockwise from east.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import reduce
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints, freeze_arrays
from laisn.errors import LaisnError, printable, shortened
from sim.system import background_process, read_text

# larger files are refused [bytes]; a table takes 20 times its size in memory
_LARGEST_BYTES = 100_000_000
LARGEST_NUMBER = 4e9  # larger numbers are no measurements, and no times in seconds
# mean speeds beyond these are doubtful [m/s]
_MIN_SPEED = 0.01
_MAX_SPEED = 50.0
# longer steps are cut in pieces: readers of a log take longer gaps for missing readings
_LONGEST_LEG_S = 5.0
_COLUMNS = {"DR": 3, "TD": 4, "TL": 3, "GT": 4, "DRp": 4}  # columns of each table
_NEEDED = ("DR", "TD", "TL")
_NODES = {"TD": [1, 2], "TL": [0]}  # columns of tables that hold numbers of nodes
_MAX_CHARACTERS = 40  # characters of a word that messages show
_MAX_NUMBERS = 10_000_000  # in all tables; a compressed file of few bytes may state any number
_TEXT = re.compile(r"(.*)_DR\.(txt|csv)")


def text_of(path: Path) -> str:
    """The text of a user's file; LaisnError if it cannot be read."""
    try:
        return read_text(path, _LARGEST_BYTES)
    except LaisnError as error:
        raise LaisnError(f"{path}: cannot be read: {error}") from None


def parse_numbers(words: Iterable[str], where: str, largest: float = LARGEST_NUMBER) -> Floats:
    """The numbers that words stand for, NaN where they are empty; LaisnError naming the first
    that is none.
    """
    numbers = list[float]()
    for word in words:
        try:
            numbers.append(float(word) if word.strip() else np.nan)
        except ValueError:
            cell = shortened(printable(word.strip()), _MAX_CHARACTERS)
            raise LaisnError(f"{where}: {cell!r} is no number") from None
    values = np.array(numbers)
    too_large = values[np.abs(values) > largest]
    if too_large.size:
        raise LaisnError(f"{where}: {too_large[0]:g} is not within ±{largest:g}")
    return values


def require_unique(names: Iterable[object], where: str) -> None:
    """LaisnError naming the first name that comes a second time."""
    seen = set[object]()
    for name in names:
        if name in seen:
            raise LaisnError(f"{where} {name} is given twice")
        seen.add(name)


def compose(first: Floats, second: Floats) -> Floats:
    """Two steps of odometry as one: way ahead and to port [m] and turn anticlockwise [rad],
    shape (3,) each.
    """
    c, s = np.cos(first[2]), np.sin(first[2])
    second_in_first = np.array(
        [c * second[0] - s * second[1], s * second[0] + c * second[1], second[2]]
    )
    return np.asarray(first + second_in_first)


@dataclass(frozen=True, kw_only=True)
class RangeData:
    """A vehicle's odometry over n steps, and its m ranges to b beacons.

    Raises LaisnError if times do not increase, a number is not finite, or a range is to no beacon.
    """

    source: str  # where it is from, for messages
    start: Floats  # east, north [m] and compass heading [rad] at the first time, shape (3,)
    time: Floats  # time of each pose that odometry joins, shape (n + 1,), [s]
    odometry: Floats
    """Way ahead and to port [m], and turn anticlockwise [rad], from each pose to the next, shape
    (n, 3).
    """
    beacons: tuple[str, ...]
    places: Floats  # where they were surveyed: east, north, shape (b, 2), [m]
    range_time: Floats  # when each range was measured, shape (m,), [s]
    range_beacon: Ints  # to which beacon, counted from 0, shape (m,)
    ranges: Floats  # shape (m,), [m]
    # of the beacon of each range when it was measured: place east, north [m], compass heading [rad]
    # and speed [m/s], shape (m, 4); empty where none moves
    range_track: Floats = field(default_factory=lambda: np.empty((0, 4)))
    moving: tuple[str, ...] = ()  # beacons that move: other robots
    # time [s], east and north [m] of the path to compare with, shape (t, 3); empty if there is none
    truth: Floats
    stated: Mapping[str, float] = field(default_factory=dict)
    """What the data set states: `range_sigma`, random error of a range [m]; of its odometry `slip`,
    random walk of the position along each axis [m/√s], and `heading_walk`, that of the heading
    [rad/√s]; `track_slip` and `track_heading_walk`, the same of beacons that move."""
    remarks: tuple[str, ...] = ()  # what was left out or taken for granted, a sentence each

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray) and not np.all(np.abs(value) <= LARGEST_NUMBER):
                raise LaisnError(
                    f"{self.source}: {item.name} must be finite and within ±{LARGEST_NUMBER:g}"
                )
        if self.time.size < 3:
            raise LaisnError(
                f"{self.source}: {self.time.size} poses; odometry needs three at least"
            )
        unordered = np.flatnonzero(np.diff(self.time) <= 0.0)
        if unordered.size:
            raise LaisnError(
                f"{self.source}: the time goes from {self.time[unordered[0]]:.6f} s to "
                f"{self.time[unordered[0] + 1]:.6f} s "
                f"between poses {unordered[0]} and {unordered[0] + 1}; times must increase"
            )
        if self.time[0] < 0.0:
            raise LaisnError(
                f"{self.source}: times begin at {self.time[0]:g} s, expected 0 s or later"
            )
        if not self.ranges.size:
            raise LaisnError(
                f"{self.source}: holds no range between the vehicle and a beacon whose place is "
                "known"
            )
        freeze_arrays(self)

    @classmethod
    def collect(
        cls,
        *,
        time: Floats,
        odometry: Floats,
        ranges: npt.ArrayLike,
        remarks: Sequence[str],
        **settings: Any,
    ) -> Self:
        """Data from poses of which some may be at one time, and ranges in any order, of which some
        may be to beacons without a known place.

        Poses at the `time` of the one before, shape (n + 1,), [s], are joined to it; `odometry` are
        the steps between them, shape (n, 3). Of `ranges`, rows of time [s], beacon and range [m],
        perhaps with those of `range_track`, those to beacon −1 and those not positive are left out.
        `settings` are other fields.
        """
        is_first = np.append(True, np.diff(time) != 0.0)
        group_end = np.flatnonzero(is_first[1:])
        group_start = np.append(0, group_end[:-1] + 1)
        steps = odometry[group_end]
        for joined in np.flatnonzero(group_end > group_start).tolist():
            steps[joined] = reduce(compose, odometry[group_start[joined] : group_end[joined] + 1])
        table = np.array(ranges, dtype=np.float64)
        table = table.reshape(len(table), -1) if table.size else np.empty((0, 3))
        is_placed = table[:, 1] >= 0
        positive = table[:, 2] > 0
        received = table[is_placed & positive]
        received = received[np.argsort(received[:, 0], kind="stable")]
        counts = {
            "ranges left out that are not to a beacon of known place": int(
                np.count_nonzero(~is_placed)
            ),
            "ranges left out that are not positive": int(np.count_nonzero(is_placed & ~positive)),
            "poses at the time of the one before, joined to it": int(np.count_nonzero(~is_first)),
        }
        remarks = [
            *remarks,
            *(f"{reason}: {number}" for reason, number in counts.items() if number),
        ]
        distance = float(np.hypot(*steps[:, :2].T).sum())
        duration = float(time[-1] - time[0])
        if (
            distance >= 1.0
            and duration > 0.0
            and not _MIN_SPEED * duration <= distance <= _MAX_SPEED * duration
        ):
            speed = distance / duration
            remarks.append(
                f"a way of {distance:.0f} m in {duration:g} s, {speed:.2g} m/s: are the times in "
                "seconds?"
            )
        return cls(
            time=time[is_first],
            odometry=steps,
            range_time=received[:, 0],
            range_beacon=received[:, 1].astype(np.int64),
            ranges=received[:, 2],
            range_track=received[:, 3:] if received.shape[1] > 3 else np.empty((0, 4)),
            remarks=tuple(remarks),
            **settings,
        )

    def with_beacons(self, names: Sequence[str]) -> Self:
        """Data with the ranges to some beacons only, in the order of `names`; LaisnError naming the
        ones that it does not have.
        """
        unknown = [name for name in names if name not in self.beacons]
        if unknown or not names:
            raise LaisnError(
                f"{self.source}: no beacon {', '.join(unknown) or 'is named'}; available: "
                f"{', '.join(self.beacons)}"
            )
        beacons = list(dict.fromkeys(names))
        index = [self.beacons.index(name) for name in beacons]
        is_chosen = np.isin(self.range_beacon, index)
        new_index = np.full(len(self.beacons), -1, dtype=np.int64)
        new_index[index] = np.arange(len(index))
        return replace(
            self,
            beacons=tuple(beacons),
            places=self.places[index],
            range_time=self.range_time[is_chosen],
            range_beacon=new_index[self.range_beacon[is_chosen]],
            ranges=self.ranges[is_chosen],
            range_track=self.range_track[is_chosen] if self.moving else self.range_track,
            moving=tuple(name for name in beacons if name in self.moving),
        )

    def _cuts(self) -> Floats:
        """Ends of steps, of which long ones are cut in equal pieces [s]."""
        duration = np.diff(self.time)
        pieces = np.ceil(duration / _LONGEST_LEG_S).astype(np.int64)
        step = np.repeat(np.arange(duration.size), pieces)
        piece = np.arange(step.size) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1
        pieces_left = pieces[step] - piece
        return self.time[step + 1] - pieces_left * (duration / pieces)[step]

    def legs(self) -> tuple[Floats, Floats, Floats]:
        """The way as odometry has it, cut where a range was measured, so that each has its own
        place on it.

        Of each piece, straight and of even speed, its end [s], speed [m/s] and compass direction
        [rad], shape (k,).
        """
        ahead, port, turn = self.odometry.T
        heading = self.start[2] - np.concatenate([[0.0], np.cumsum(turn)])[:-1]
        speed = np.hypot(ahead, port) / np.diff(self.time)
        course = heading - np.arctan2(port, ahead)
        in_time = (self.range_time > self.time[0]) & (self.range_time <= self.time[-1])
        end = np.union1d(self._cuts(), self.range_time[in_time])
        step = np.searchsorted(self.time, end) - 1
        return end, speed[step], course[step]


def _load_matlab(path: Path) -> dict[str, Floats]:
    # data sets in text, and logs, need none of it
    from scipy.io import loadmat, whosmat

    number_count = sum(math.prod(shape) for name, shape, _ in whosmat(path) if name in _COLUMNS)
    if number_count > _MAX_NUMBERS:
        raise LaisnError(
            f"its tables have {number_count:,} numbers, at most {_MAX_NUMBERS:,} are read"
        )
    variables = loadmat(path, variable_names=tuple(_COLUMNS))
    return {name: variables[name] for name in _COLUMNS if name in variables}


def _from_matlab(path: Path) -> dict[str, Floats]:
    try:
        # damaged files crash the library
        with background_process() as process:
            return process.submit(_load_matlab, path).result()
    except (OSError, LaisnError) as error:
        raise LaisnError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    except Exception as error:
        # foreign bytes make the library fail in many ways
        raise LaisnError(f"{path}: no MATLAB file of version 5, or damaged: {error}") from None


def _from_text(path: Path) -> dict[str, Floats]:
    match = _TEXT.fullmatch(path.name)
    if match is None:
        raise LaisnError(
            f"{path}: name the table of odometry, such as Plaza1_DR.txt; the others are found "
            "beside it"
        )
    tables = dict[str, Floats]()
    for name in _COLUMNS:
        table = path.with_name(f"{match[1]}_{name}.{match[2]}")
        delimiter = "," if match[2] == "csv" else None
        if table.is_file():
            lines = text_of(table).splitlines()
            try:
                tables[name] = np.loadtxt(lines, delimiter=delimiter, ndmin=2)
            except ValueError as error:
                raise LaisnError(f"{table}: no table of numbers: {error}") from None
    return tables


def read_range_tables(path: Path) -> RangeData:
    """A data set of ranging radios: a MATLAB file with all tables, or the text file `NAME_DR.txt`
    beside the others.

    LaisnError: a file cannot be read, or a table, a column or the pose at the start is missing.
    """
    tables = _from_matlab(path) if path.suffix == ".mat" else _from_text(path)
    missing = [name for name in _NEEDED if name not in tables]
    if missing:
        raise LaisnError(
            f"{path}: lacks {', '.join(missing)}; it has "
            f"{', '.join(tables) or 'none of the tables'}"
        )
    tables = {name: _checked(path, name, table) for name, table in tables.items()}
    odometry, ranges, nodes = (tables[name] for name in _NEEDED)
    start = _start_pose(path, tables, odometry[0, 0])
    names = nodes[:, 0].astype(np.int64).tolist()
    require_unique(names, f"{path}: table TL: node")
    index = {name: i for i, name in enumerate(names)}
    beacons = [index.get(node, -1) for node in ranges[:, 2].tolist()]
    return RangeData.collect(
        source=str(path),
        start=np.array([start[1], start[2], 0.5 * np.pi - start[3]]),
        time=np.concatenate([start[:1], odometry[:, 0]]),
        odometry=np.column_stack([odometry[:, 1], np.zeros(len(odometry)), odometry[:, 2]]),
        beacons=tuple(map(str, names)),
        places=nodes[:, 1:].copy(),
        ranges=np.column_stack([ranges[:, 0], beacons, ranges[:, 3]]),
        truth=tables["GT"][:, :3].copy() if "GT" in tables else np.empty((0, 3)),
        remarks=(),
    )


def _checked(path: Path, name: str, table: npt.NDArray[Any]) -> Floats:
    """A table of the data set; LaisnError if it is none of numbers, whole ones for nodes."""
    if (
        not np.issubdtype(table.dtype, np.number)
        or table.ndim != 2
        or table.shape[1] != _COLUMNS[name]
    ):
        raise LaisnError(
            f"{path}: table {name} has the shape {table.shape}, expected {_COLUMNS[name]} columns"
        )
    node_columns = table[:, _NODES.get(name, [])]
    usable = np.all(np.abs(table) <= LARGEST_NUMBER, axis=1) & np.all(
        node_columns == np.rint(node_columns), axis=1
    )
    if not usable.all():
        raise LaisnError(
            f"{path}: table {name}, row {int(np.argmin(usable)) + 1}: expected numbers within "
            f"±{LARGEST_NUMBER:g}, and whole ones for nodes"
        )
    return np.asarray(table, dtype=np.float64)


def _start_pose(path: Path, tables: Mapping[str, Floats], begin: float) -> Floats:
    """The last row of DRp, or else of GT, before the first odometry; LaisnError without one."""
    for name in ("DRp", "GT"):
        is_early = tables[name][:, 0] < begin if name in tables else np.zeros(0, dtype=np.bool_)
        if is_early.any():
            pose: Floats = tables[name][is_early][-1]
            return pose
    raise LaisnError(
        f"{path}: neither DRp nor GT has a pose before the first odometry, at {begin:.3f} s"
    )
