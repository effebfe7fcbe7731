"""Scores of LAISN-Bench: how far estimates are from the truth, by run and by mission."""

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.benchmark.catalogue import missions
from experiments.benchmark.data import MEASUREMENTS, TASKS, TRUTH, read_manifest
from experiments.benchmark.tables import (
    Truth,
    read_columns,
    read_measurements,
    read_truth,
    require_numbers,
)
from experiments.flight.library import load_scenario
from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.messages import Measurements
from laisn.metrics import bearing_errors, normalised_square, position_errors, relative_errors
from laisn.navigators import find
from reports.intervals import Interval, mean_interval
from sim.flight import navigation_settings
from sim.scenario.parts import MotionSettings
from sim.sensing.observation import start_of
from sim.simulation import starts_of

LONGEST_GAP_S = 10.0
"""Estimates farther apart than this say nothing of the time between them [s]."""
LOST_M = 10.0
"""A follower whose error was ever larger counts as lost [m]."""
COMPLETE = 0.99
"""Share of the filter steps that estimates have to cover for a run to count."""
SEGMENTS_M = (10.0, 50.0, 100.0)
"""Lengths of the segments of relative errors [m]."""
_TIMES = ("time_s", "time [s]")
_PLACES = (("x_m", "y_m"), ("east [m]", "north [m]"))
"""Columns of time, and of east and north, that a table of estimates may have."""
COVARIANCE = ("xx_m2", "xy_m2", "yy_m2")
"""Columns of the covariance of an estimated position, which may be absent [m²]."""


class FollowerRun(NamedTuple):
    """One follower of a mission flown with one seed."""

    mission: str
    seed: int
    follower: str


class Track(NamedTuple):
    """Estimates of one run."""

    time: Floats  # increasing, shape (k,), [s]
    position: Floats  # of the hydrophone, east and north, shape (k, 2), [m]
    covariance: Floats  # xx, xy, yy, shape (k, 3), [m²]; NaN: not stated
    step_us: float = math.nan  # processor time a filter step [µs]


@dataclass(frozen=True, kw_only=True)
class RunScore:
    """Errors of one run at the filter steps that its estimates cover."""

    run: FollowerRun
    covered: float = 0.0  # share of filter steps
    mean_m: float = math.nan  # of the position error E_P
    rms_m: float = math.nan
    largest_m: float = math.nan
    bearing_deg: float = math.nan  # mean of the bearing error E_B
    bound_m: float = math.nan  # least RMS that is possible
    nees: float = math.nan  # mean; 2 if covariances are right, NaN if none is stated
    relative_m: tuple[float, ...] = (math.nan,) * len(SEGMENTS_M)
    """RMS of the error of displacements over segments of the lengths in `SEGMENTS_M`, as of
    `laisn.metrics.relative_errors`.
    """
    step_us: float = math.nan  # processor time a filter step [µs]

    @property
    def complete(self) -> bool:
        return self.covered >= COMPLETE

    def record(self) -> dict[str, Any]:
        """As a row of a table."""
        row: dict[str, Any] = {
            "mission": self.run.mission,
            "seed": self.run.seed,
            "follower": self.run.follower,
            "covered": self.covered,
            "e_p_mean_m": self.mean_m,
            "e_p_rms_m": self.rms_m,
            "e_p_max_m": self.largest_m,
            "e_b_mean_deg": self.bearing_deg,
            "bound_rms_m": self.bound_m,
            "nees": self.nees,
        }
        for length, error in zip(SEGMENTS_M, self.relative_m, strict=True):
            row[f"relative_{length:g}m_rms_m"] = error
        row["step_us"] = self.step_us
        return row


@dataclass(frozen=True, kw_only=True)
class MissionScore:
    """Errors of a mission over its seeds; those of several followers are averaged."""

    mission: str
    runs: int
    incomplete: int  # runs whose estimates do not cover the mission; they are left out
    mean_m: Interval  # of the position error E_P, over seeds
    rms_m: float
    largest_m: float
    times_bound: float  # RMS divided by the least that is possible
    nees: float
    relative_m: tuple[float, ...]  # as of `RunScore`
    lost: int  # runs with an error beyond `LOST_M`
    step_us: float


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan


def _neighbours(times: Floats, queries: Floats) -> tuple[Ints, Ints]:
    """Indices of the neighbours of each time: the last not after it, and the first not before."""
    after = np.searchsorted(times, queries - 1e-6)
    before = np.searchsorted(times, queries + 1e-6) - 1
    return before, after


def score_run(run: FollowerRun, truth: Truth, track: Track) -> RunScore:
    """Compare the estimates of a run with its truth, at filter steps.

    Between two estimates that are at most `LONGEST_GAP_S` apart the position is interpolated, and
    the covariance is that of the earlier one.
    """
    usable = np.isfinite(track.time) & np.all(np.isfinite(track.position), axis=1)
    times = track.time[usable]
    position = track.position[usable]
    covariance = track.covariance[usable]
    before, after = _neighbours(times, truth.time)
    covered = (before >= 0) & (after < times.size)
    earlier = before[covered]
    covered[covered] = times[after[covered]] - times[earlier] <= LONGEST_GAP_S
    if not covered.any():
        return RunScore(run=run, step_us=track.step_us)
    time = truth.time[covered]
    estimate = np.column_stack([np.interp(time, times, column) for column in position.T])
    true = truth.position[covered]
    errors = position_errors(estimate, true)
    bearing = bearing_errors(estimate, true, truth.leader[covered])
    pxx, pxy, pyy = covariance[before[covered]].T
    east, north = (estimate - true).T
    normalised = normalised_square(east, north, pxx, pxy, pyy)
    finite = np.isfinite(normalised)
    return RunScore(
        run=run,
        covered=float(covered.mean()),
        mean_m=float(errors.mean()),
        rms_m=_rms(errors),
        largest_m=float(errors.max()),
        bearing_deg=math.degrees(float(bearing.mean())),
        bound_m=_rms(truth.bound[covered]),
        nees=float(normalised[finite].mean()) if finite.any() else math.nan,
        relative_m=tuple(_rms(relative_errors(estimate, true, s)) for s in SEGMENTS_M),
        step_us=track.step_us,
    )


def score_mission(mission: str, scores: Sequence[RunScore]) -> MissionScore:
    """Scores of a mission's runs together."""
    complete = [score for score in scores if score.complete]

    def column(name: str) -> Floats:
        return np.array([getattr(score, name) for score in complete], dtype=np.float64)

    seeds = sorted({score.run.seed for score in complete})
    means = [
        np.mean([score.mean_m for score in complete if score.run.seed == seed]) for seed in seeds
    ]
    nees = column("nees")
    nees = nees[np.isfinite(nees)]
    relative = np.array([score.relative_m for score in complete]).reshape(-1, len(SEGMENTS_M))
    rms = _rms(column("rms_m"))
    largest = column("largest_m")
    step = column("step_us")
    undefined = Interval(math.nan, math.nan, math.nan)
    return MissionScore(
        mission=mission,
        runs=len(scores),
        incomplete=len(scores) - len(complete),
        mean_m=mean_interval(np.array(means)) if means else undefined,
        rms_m=rms,
        largest_m=float(largest.max(initial=-math.inf)) if complete else math.nan,
        times_bound=rms / _rms(column("bound_m")) if complete else math.nan,
        nees=float(nees.mean()) if nees.size else math.nan,
        relative_m=tuple(_rms(errors) for errors in relative.T),
        lost=int(np.count_nonzero(largest > LOST_M)),
        step_us=float(np.median(step)) if complete else math.nan,
    )


def counted(scores: Sequence[MissionScore]) -> list[MissionScore]:
    """Those of the missions that count in the score of a navigator; all, if none does."""
    catalogue = missions()
    return [score for score in scores if catalogue[score.mission].scored] or list(scores)


def overall_score(scores: Sequence[MissionScore]) -> float:
    """The score of a navigator: geometric mean of RMS over bound of the missions that count; NaN
    where one has a run that is not complete.
    """
    ratios = [math.nan if score.incomplete else score.times_bound for score in counted(scores)]
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else math.nan


def runs_of(folder: Path) -> list[FollowerRun]:
    """All runs of the data in a folder; LaisnError if it holds no data of the benchmark."""
    manifest = read_manifest(folder)
    prefix = f"{TRUTH}/"
    paths = [Path(name) for name in manifest["files"] if name.startswith(prefix)]
    runs = [FollowerRun(path.parts[1], int(path.parts[2]), path.stem) for path in paths]
    order = {name: i for i, name in enumerate(manifest["missions"])}
    return sorted(runs, key=lambda run: (order[run.mission], run.seed, run.follower))


def _path(folder: Path, subfolder: str, run: FollowerRun) -> Path:
    return folder / subfolder / run.mission / f"{run.seed:02d}" / f"{run.follower}.csv"


def truth_of(folder: Path, run: FollowerRun) -> Truth:
    """The true path of a run."""
    return read_truth(_path(folder, TRUTH, run))


def _track(path: Path, columns: Mapping[str, Any]) -> Track:
    """All estimates in a table; LaisnError if it lacks a column."""
    time_column = next((name for name in _TIMES if name in columns), _TIMES[0])
    places = next((names for names in _PLACES if names[0] in columns), _PLACES[0])
    values = require_numbers(path, columns, (time_column, *places))
    covariance = np.full((len(values), 3), np.nan)
    if any(name in columns for name in COVARIANCE):
        covariance = require_numbers(path, columns, COVARIANCE)
    return Track(values[:, 0], values[:, 1:], covariance)


def _track_of_run(path: Path, track: Track, rows: Ints) -> Track:
    """The estimates of one run; LaisnError if their times do not increase."""
    time = track.time[rows]
    unordered = np.flatnonzero(~(np.diff(time) > 0.0))
    if unordered.size:
        before, after = time[unordered[0] : unordered[0] + 2]
        raise LaisnError(
            f"{path}: the time goes from {before:g} to {after:g} s; times of a run must increase"
        )
    return Track(time, track.position[rows], track.covariance[rows])


def _seed(path: Path, text: str) -> int:
    """A seed as a table or a path states it; LaisnError unless it is a whole number."""
    try:
        seed = float(text)
    except ValueError:
        seed = math.nan
    if not seed.is_integer():
        raise LaisnError(f"{path}: seed {text!r:.60}; expected a whole number, as of the data")
    return int(seed)


def _rows_by_run(
    path: Path, columns: Mapping[str, Any], stated: Mapping[str, str]
) -> Iterator[tuple[FollowerRun, Ints]]:
    """The runs in a table with the rows of each, by its columns, or by what its path states."""
    n = len(next(iter(columns.values()), ()))
    labels = []
    for name in FollowerRun._fields:
        if name in columns:
            labels.append([str(value) for value in columns[name].tolist()])
        elif name in stated:
            labels.append([stated[name]] * n)
        else:
            raise LaisnError(
                f"{path}: says not of which {name} it is; expected a column {name!r}, or a folder "
                "of MISSION/SEED/FOLLOWER.csv"
            )
    rows_of = dict[tuple[str, ...], list[int]]()
    for row, key in enumerate(zip(*labels, strict=True)):
        rows_of.setdefault(key, []).append(row)
    for (mission, seed, follower), rows in rows_of.items():
        yield FollowerRun(mission, _seed(path, seed), follower), np.array(rows)


def _tables(source: Path) -> Iterator[tuple[Path, dict[str, str]]]:
    """Tables of estimates, and what their paths say of them."""
    if source.is_file():
        yield source, {}
        return
    paths = sorted(source.rglob("*.csv"))
    if not paths:
        raise LaisnError(
            f"{source}: expected a table of estimates, or a folder of MISSION/SEED/FOLLOWER.csv"
        )
    for path in paths:
        yield (
            path,
            dict(
                zip(
                    FollowerRun._fields,
                    path.relative_to(source).with_suffix("").parts,
                    strict=False,
                )
            ),
        )


def read_estimates(source: Path) -> Iterator[tuple[FollowerRun, Track]]:
    """Estimates of a CSV file or a folder of them, run by run; LaisnError names file and column of
    what cannot be read.
    """
    for path, stated in _tables(source):
        columns = read_columns(path)
        track = _track(path, columns)
        for run, rows in _rows_by_run(path, columns, stated):
            yield run, _track_of_run(path, track, rows)


def navigate(
    folder: Path, runs: Iterable[FollowerRun], navigator: str, changes: Sequence[str] = ()
) -> Iterator[tuple[FollowerRun, Track]]:
    """Estimates of a navigator of this project or of a plug-in, run by run, by what the tasks let
    it know. `changes` are of the task, "key=value".
    """
    for run in runs:
        task = folder / TASKS / f"{run.mission}.toml"
        assignments = [f"navigation.variant={navigator}", *changes]
        scenario = load_scenario(str(task), assignments, flyable=True)
        motion = starts_of(MotionSettings.of(scenario), scenario.leader)
        follower = motion.names[1:].index(run.follower)
        measurements = read_measurements(_path(folder, MEASUREMENTS, run))
        settings = replace(
            navigation_settings(scenario, motion.sites, follower), dt=measurements.dt
        )
        instance = find(navigator).make(settings, start_of(motion, follower))
        yield run, _timed(instance, measurements)


def _timed(navigator: Any, measurements: Measurements) -> Track:
    begin = time.process_time()
    estimates = navigator.run(measurements)
    step_us = 1e6 * (time.process_time() - begin) / measurements.speed.size
    covariance = estimates.covariance[:, [0, 0, 1], [0, 1, 1]]
    return Track(measurements.time, estimates.state[:, :2], covariance, step_us)


def score_all(
    folder: Path, tracks: Iterable[tuple[FollowerRun, Track]], expected: Sequence[FollowerRun]
) -> list[RunScore]:
    """Scores of estimates against the data in a folder, in the order of the runs expected; runs
    without estimates cover nothing. LaisnError for estimates of another run, or of one run twice.
    """
    expected_runs = set(expected)
    scores = dict[FollowerRun, RunScore]()
    for run, track in tracks:
        if run not in expected_runs:
            raise LaisnError(
                f"estimates of {run.mission}, seed {run.seed}, {run.follower}: {folder} has no "
                "such run"
            )
        if run in scores:
            raise LaisnError(
                f"estimates of {run.mission}, seed {run.seed}, {run.follower} are given twice"
            )
        scores[run] = score_run(run, truth_of(folder, run), track)
    return [scores.get(run, RunScore(run=run)) for run in expected]


def by_mission(scores: Sequence[RunScore]) -> list[MissionScore]:
    """Scores of each mission, in the order of its first run."""
    names = dict.fromkeys(score.run.mission for score in scores)
    return [score_mission(name, [s for s in scores if s.run.mission == name]) for name in names]
