"""Monte Carlo campaigns: noise, navigation and metrics fused over runs, in memory that does not
grow with them.

The motion of a mission is simulated once and serves all its cells. A cell is a mission flown many
times. Its runs are flown in blocks side by side. Every block is computed alone and added up in the
order of runs, so that results depend neither on the number of threads nor on how runs are split
into blocks, to the bit. Run k takes exactly the noise that `sim.sensing.observation.measure(…,
run=k)` gives a single flight.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import chain, islice
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.special import chdtri

from experiments.campaign import lane_flight
from experiments.campaign.store import Arrays, CampaignError, Record
from laisn import lanes
from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.lanes import LANES
from laisn.messages import Measurements
from laisn.navigators import MissionResult, NavigatorSpec, find, spec_of
from laisn.plugins import calling, class_and_file
from laisn.settings import NavigationSettings, Settings
from sim.flight import navigation_settings
from sim.scenario.parts import MotionSettings, SensingSettings
from sim.scenario.settings import Navigation, Scenario
from sim.sensing.observation import IdealMeasurements, measure, observe
from sim.sensing.sensors import SensorErrors, further_errors_of, navigated_errors_of
from sim.side_by_side import simulate_side_by_side
from sim.simulation import EndedError, require_open_loop, simulate_open_loop
from sim.trajectory import Trajectory
from sim.vehicle.mjcf import transmitter_places
from sim.vehicle.plant import PlantError

PERCENTILES = (50, 90, 95, 99)
_NO_HISTORY = np.empty((0, 4 * LANES))
Disturbance = Any
"""Errors of the user's own: `disturb(measurements, seed, run)` gives changed measurements, by
its arguments alone.
"""


@dataclass(frozen=True, kw_only=True)
class CellSettings:
    """What the numbers of a cell follow from, beside its runs: its key is made of these."""

    motion: MotionSettings
    # site, index of the axis (0 forward, 1 to port, 2 up) and coordinate [m] of each transmitter
    transmitters: tuple[tuple[str, int, float], ...]
    sensing: SensingSettings  # of run 0
    navigation: Navigation

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """The settings of a scenario."""
        places = transmitter_places(scenario.leader)
        return cls(
            motion=MotionSettings.of(scenario),
            transmitters=tuple((name, *offset) for name, offset in places.items()),
            sensing=replace(SensingSettings.of(scenario), run=0),
            navigation=scenario.navigation,
        )


def with_transmitter_sites(
    trajectory: Trajectory, transmitters: Sequence[tuple[str, int, float]]
) -> Trajectory:
    """A trajectory with its motion unchanged and transmitters moved, as of `CellSettings`."""
    offset = trajectory.site_offset.copy()
    for name, axis, value in transmitters:
        offset[trajectory.site(f"leader/{name}"), axis] = value
    return replace(trajectory, site_offset=offset)


@contextmanager
def _ends_reported(name: str) -> Iterator[None]:
    """Errors of motion as CampaignError; they carry the motion so far, which no process can hand to
    another.
    """
    try:
        yield
    except (EndedError, PlantError) as error:
        raise CampaignError(f"mission {name!r}: {error}") from None


def simulate_mission(scenario: Scenario) -> Trajectory:
    """Motion of a mission's vehicles, with transmitters where the leader's hull has them.

    LaisnError if the motion depends on the noise of the run; CampaignError naming the mission, and
    how it ended, if that was before its time.
    """
    require_open_loop(scenario.name, scenario.keys_needing_closed_loop())
    with _ends_reported(scenario.name):
        return simulate_open_loop(MotionSettings.of(scenario))


def simulate_missions(scenarios: Sequence[Scenario]) -> list[Trajectory | None]:
    """The same of missions side by side, as of `sim.side_by_side.groups_for_lanes`; None:
    `simulate_mission` raises an error.
    """
    return simulate_side_by_side([MotionSettings.of(scenario) for scenario in scenarios])


class CampaignMission:
    """The motion of a mission; what its cells share is computed once."""

    def __init__(self, motion: MotionSettings, trajectory: Trajectory) -> None:
        """Of a trajectory that follows from these settings."""
        self._motion = motion
        # dictionaries, since a cached method would hold the mission, and all its arrays, in a cycle
        # that the collector of garbage may take hundreds of missions to find
        self._placed = dict[tuple[tuple[str, int, float], ...], Trajectory]()
        self._observed = dict[Any, IdealMeasurements]()
        self._trajectory = trajectory

    def motion_and_measurements(
        self, settings: CellSettings, follower: int
    ) -> tuple[Trajectory, IdealMeasurements]:
        """Motion with the transmitters of a cell, and what one follower measures in it without
        errors; LaisnError if vehicles move otherwise.
        """
        if settings.motion != self._motion:
            raise LaisnError("the scenario moves otherwise than the mission that was simulated")
        sensing = settings.sensing.without_random_errors
        places = settings.transmitters
        if places not in self._placed:
            self._placed[places] = with_transmitter_sites(self._trajectory, places)
        trajectory = self._placed[places]
        key = places, sensing, follower
        if key not in self._observed:
            self._observed[key] = observe(trajectory, sensing, follower, use_compiled=True)
        return trajectory, self._observed[key]


@lru_cache(maxsize=4)
def _cached_mission(motion: MotionSettings) -> CampaignMission:
    return CampaignMission(motion, simulate_open_loop(motion))


def mission_of(scenario: Scenario) -> CampaignMission:
    """The mission of a scenario, simulated once for all that move alike; errors as of
    `simulate_mission`.
    """
    require_open_loop(scenario.name, scenario.keys_needing_closed_loop())
    with _ends_reported(scenario.name):
        return _cached_mission(MotionSettings.of(scenario))


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell of a campaign: one mission, one set of errors, one navigator, many runs."""

    truth: IdealMeasurements
    errors: SensorErrors = field(default_factory=SensorErrors)
    # errors of sensors by the names of further links
    further: Mapping[str, SensorErrors] = field(default_factory=dict)
    settings: Settings = field(default_factory=NavigationSettings)
    # None: the navigator of this project that takes these settings
    navigator: NavigatorSpec | None = None
    seed: int = 1
    runs: range = range(60)  # in steps of one
    follower: int = 0
    disturbance: Disturbance | None = None

    @property
    def spec(self) -> NavigatorSpec:
        """The navigator."""
        return self.navigator or spec_of(self.settings)

    @property
    def blocks(self) -> list[range]:
        """Runs of each block."""
        return [self.runs[i : i + LANES] for i in range(0, len(self.runs), LANES)]

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        follower: int = 0,
        runs: int | range = 60,
        *,
        mission: CampaignMission | None = None,
        disturbance: Disturbance | None = None,
    ) -> Self:
        """The cell of a scenario: its run k is the scenario flown with `run = k`, noise and all.

        Runs are a number, from run 0 on, or which. Without a mission it is flown, once for
        scenarios that follow each other and move alike. LaisnError: there is no such follower, or
        the mission is not the scenario's, or it cannot be flown.
        """
        if not 0 <= follower < len(scenario.followers):
            raise LaisnError(f"follower is {follower}, the scenario has {len(scenario.followers)}")
        scenario = scenario.navigated_as(follower)
        cell = CellSettings.of(scenario)
        trajectory, truth = (mission or mission_of(scenario)).motion_and_measurements(
            cell, follower
        )
        return cls(
            truth=truth,
            errors=navigated_errors_of(cell.sensing, follower),
            further=further_errors_of(cell.sensing, follower),
            navigator=find(scenario.navigation.variant),
            settings=navigation_settings(scenario, trajectory.sites, follower),
            seed=scenario.seed,
            follower=follower,
            runs=range(runs) if isinstance(runs, int) else runs,
            disturbance=disturbance,
        )


class CellResult(NamedTuple):
    """What a cell comes to."""

    row: Record
    """Figures of all steps of all runs by their columns:

    - `seed`, `runs`, `steps` of one run; `worst_run`, that with the largest E_P;
    - `e_p_{max,mean,std}_m`, `e_b_{max,mean,std}_deg`, as of `laisn.metrics.Summary`, and
      `e_p_pQ_m`, `e_b_pQ_deg`, percentiles Q of `PERCENTILES`, to within 1 %;
    - `nees`, `nis`: mean normalised squared error of the position, and innovation of the fixes that
      were used (2 if P and S are right); `nees_inside`: share of steps at which the sum of the
      former over the runs is within its 95 % interval, of χ² with two degrees of freedom a run
      (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2);
    - `mirror_locked_runs`: runs that were mirror locked (`laisn.metrics.is_mirror_locked`) for a
      message interval; `e_p_mean_unlocked_m`: mean E_P of the others;
    - `fixes_KIND`: number of fixes of each `FixKind`.
    """
    runs: Arrays  # likewise of each run, shape (R,)


_Block = tuple[Floats, Ints, Floats]
"""Tally, histograms, and sums over the runs of the NEES of each step, as of `fly_block`."""


def _summed(cell: Cell, blocks: Iterator[_Block]) -> CellResult:
    """The result of a cell from its blocks in the order of runs; LaisnError naming the run if an
    estimate diverged.
    """
    truth = cell.truth
    steps = cell.truth.speed.size
    size = len(cell.runs)
    tally = np.empty((lane_flight.SIZE // LANES, size))
    nees = np.zeros(steps)
    histograms = np.zeros((2, lane_flight.BINS), dtype=np.int64)
    for block in cell.blocks:
        sums, counts, nees_sums = next(blocks)
        table = sums.reshape(-1, LANES)[:, : len(block)]
        diverged = np.flatnonzero(~np.isfinite(table[lane_flight.SUM_P // LANES]))
        if diverged.size:
            raise LaisnError(
                f"the estimate of run {block[int(diverged[0])]} left finite numbers; check the "
                "settings"
            )
        first = block[0] - cell.runs[0]
        tally[:, first : first + len(block)] = table
        histograms += counts
        nees += nees_sums

    def of_runs(row: int) -> Floats:
        """A row of the tally, such as `lane_flight.SUM_P`, shape (R,)."""
        return np.asarray(tally[row // LANES])

    gaps = np.diff(truth.message_step)
    mirror_locked = of_runs(lane_flight.LONGEST_MIRROR_LOCK) >= (
        np.median(gaps) if gaps.size else steps
    )
    runs: Arrays = {
        "run": np.array(cell.runs, dtype=np.int64),
        "e_p_max_m": of_runs(lane_flight.MAX_P),
        "e_p_mean_m": of_runs(lane_flight.SUM_P) / steps,
        "e_p_rms_m": np.sqrt(of_runs(lane_flight.SQUARES_P) / steps),
        "e_b_max_deg": np.rad2deg(of_runs(lane_flight.MAX_B)),
        "e_b_mean_deg": np.rad2deg(of_runs(lane_flight.SUM_B) / steps),
        "mirror_locked": mirror_locked,
        "gated": of_runs(lane_flight.KINDS + FixKind.GATED * LANES).astype(np.int64),
    }
    errors: Record = {"seed": cell.seed, "runs": size, "steps": steps}
    percentiles: Record = {}
    for kind, unit, convert, total, squared, largest, lowest, histogram in (
        (
            "p",
            "m",
            float,
            lane_flight.SUM_P,
            lane_flight.SQUARES_P,
            lane_flight.MAX_P,
            lane_flight.LOWEST_P,
            histograms[0],
        ),
        (
            "b",
            "deg",
            math.degrees,
            lane_flight.SUM_B,
            lane_flight.SQUARES_B,
            lane_flight.MAX_B,
            lane_flight.LOWEST_B,
            histograms[1],
        ),
    ):
        top = float(of_runs(largest).max())
        mean = float(of_runs(total).sum() / (steps * size))
        variance = float(of_runs(squared).sum() / (steps * size)) - mean * mean
        for name, value in (("max", top), ("mean", mean), ("std", math.sqrt(max(variance, 0.0)))):
            errors[f"e_{kind}_{name}_{unit}"] = convert(value)
        for p in PERCENTILES:
            percentiles[f"e_{kind}_p{p}_{unit}"] = convert(
                lane_flight.percentile(histogram, lowest, p / 100.0, top)
            )
    means: Record = {}
    for name, total, count in (
        ("nees", lane_flight.SUM_NEES, lane_flight.COUNT_NEES),
        ("nis", lane_flight.SUM_NIS, lane_flight.COUNT_NIS),
    ):
        number = of_runs(count)
        count_of_all = of_runs(count).sum()
        runs[name] = np.divide(
            of_runs(total), number, out=np.full(size, np.nan), where=number > 0.0
        )
        means[name] = float(of_runs(total).sum() / count_of_all) if count_of_all else math.nan
    low, high = chdtri(2.0 * size, np.array([0.975, 0.025]))
    finite = nees[np.isfinite(nees)]
    fixes = tally[lane_flight.KINDS // LANES :].sum(axis=1)
    others: Record = {
        "nees": means["nees"],
        "nees_inside": float(np.mean((finite >= low) & (finite <= high))) if finite.size else None,
        "nis": means["nis"],
        "mirror_locked_runs": int(np.count_nonzero(mirror_locked)),
        "worst_run": cell.runs[int(np.argmax(runs["e_p_max_m"]))],
        **{f"fixes_{kind.name.lower()}": int(fixes[kind]) for kind in FixKind},
        "e_p_mean_unlocked_m": None
        if mirror_locked.all()
        else float(runs["e_p_mean_m"][~mirror_locked].mean()),
    }
    return CellResult(errors | percentiles | others, runs)


_STATED = 6  # columns of messages that the leader states always


def _first_unreadable(changed: Measurements, given: Measurements) -> str:
    """Name, value and time of a number that no sensor reads: one that is infinite, or NaN where no
    reading can be missing; "" if there is none.
    """
    time = changed.time
    received: Floats = time[changed.message_step - 1]
    messages_may_lack = bool(np.isnan(given.message[:, :_STATED]).any())
    numbers = [
        ("speed", changed.speed, time, False),
        ("heading", changed.heading, time, False),
        ("depth", changed.depth, time, True),
        ("message", changed.message[:, :_STATED], received, messages_may_lack),
        ("message", changed.message[:, _STATED:], received, True),
        ("ranges", changed.ranges, received, True),
        *((f"custom[{name!r}]", rows, time, True) for name, rows in changed.custom.items()),
    ]
    for name, link in changed.links.items():
        link_times: Floats = time[link.message_step - 1]
        numbers.append((f"links[{name!r}].message", link.message, link_times, True))
        numbers.append((f"links[{name!r}].ranges", link.ranges, link_times, True))
    for name, values, times, may_lack in numbers:
        bad = np.isinf(values) if may_lack else ~np.isfinite(values)
        if bad.any():
            first = np.argwhere(bad)[0]
            return f"{name} = {values[tuple(first)]} at {times[first[0]]:g} s"
    return ""


def _disturbed(cell: Cell, measurements: Measurements, run: int) -> Measurements:
    """What the disturbance of a cell makes of the measurements of a run; LaisnError if it gives
    none, for another number of steps, or numbers that no sensor reads.
    """
    disturbance: Any = cell.disturbance
    where = f"disturbance {class_and_file(disturbance)}"
    with calling(f"{where}: disturb"):
        changed = disturbance.disturb(measurements, cell.seed, run)
    gave = f"{where}, {disturbance!r:.100}: `disturb` gave"
    in_run = f"in run {run}"
    if not isinstance(changed, Measurements):
        raise LaisnError(
            f"{gave} {changed!r:.60} {in_run}; expected changed laisn.messages.Measurements"
        )
    if changed.speed.size != measurements.speed.size:
        raise LaisnError(
            f"{gave} {changed.speed.size} steps {in_run}; expected {measurements.speed.size}"
        )
    problem = _first_unreadable(changed, measurements)
    if problem:
        raise LaisnError(f"{gave} {problem} {in_run}; expected finite numbers, or NaN for no range")
    return changed


def _measured(cell: Cell, runs: Sequence[int]) -> list[Measurements]:
    """Measurements of some runs; LaisnError if a disturbance changes the steps of messages for
    lanes.
    """
    truth = cell.truth
    seed = cell.seed
    options: dict[str, Any] = {
        "follower": cell.follower,
        "transmitters": cell.settings.transmitters,
        "further": cell.further,
    }
    measured = [
        measure(truth, cell.errors, seed=seed, run=run, use_compiled=True, **options)
        for run in runs
    ]
    if cell.disturbance is not None:
        measured = [
            _disturbed(cell, measurements, run)
            for measurements, run in zip(measured, runs, strict=True)
        ]
    if cell.spec.lanes and any(
        not np.array_equal(measurements.message_step, truth.message_step)
        for measurements in measured
    ):
        raise LaisnError(
            "a disturbance changes when messages arrive; LAISN in campaigns takes lost ranges as "
            "NaN"
        )
    return measured


def single_runs(cell: Cell, runs: Sequence[int]) -> list[MissionResult]:
    """Runs of a cell one by one; errors as of its navigator."""
    return [
        cell.spec.fly(cell.settings, measurements, cell.truth.start)
        for measurements in _measured(cell, runs)
    ]


def _fly(
    cell: Cell, truth: lane_flight.TruthRecord, runs: range, history: Floats = _NO_HISTORY
) -> _Block:
    """Results of up to LANES runs. Where a navigator flies runs one by one, each squared innovation
    of r dimensions counts as r/2 updates of a position, so that `nis` is 2 if S is right.

    Raises:
        LaisnError: the start is unknown, so that a run has no error before its first message.
        ArithmeticError: a covariance is not positive definite.
    """
    settings = cell.settings
    prepared = lane_flight.Prepared()
    results = list[MissionResult]()
    steps = cell.truth.speed.size
    if not cell.spec.lanes:
        if not settings.known_start:
            raise LaisnError(
                "navigation.assume.known_start = false is for single flights: cells need all errors"
            )
        results = single_runs(cell, runs)
        settings = NavigationSettings()
        prepared = lane_flight.Prepared(states=np.ones((steps, 5, LANES)))
        for i, estimates in enumerate(results):
            prepared.states[:, :2, i] = estimates.state[:, :2]
            prepared.states[:, 2:, i] = estimates.covariance
    elif cell.disturbance:
        prepared = lane_flight.Prepared(*lanes.stacked(_measured(cell, runs)))
    address = np.uint64(cell.seed), np.uint64(runs[0]), np.uint64(cell.follower)
    block = lane_flight.fly_block(
        truth, cell.errors, lanes.tuning(settings), address, len(runs), prepared, history
    )
    for i, estimates in enumerate(results):
        of_run = block[0][i::LANES]
        of_run[lane_flight.SUM_NIS // LANES] = estimates.nis_sum
        of_run[lane_flight.COUNT_NIS // LANES] = 0.5 * estimates.nis_dof
        for kind in estimates.kinds:
            of_run[lane_flight.KINDS // LANES + kind] += 1.0
    return block


def simulate(cell: Cell, *, threads: int = 1) -> CellResult:
    """Fly a cell with so many threads; LaisnError if an estimate left finite numbers."""
    fly = partial(_fly, cell, lane_flight.truth_record(cell.truth))
    if threads == 1:
        return _summed(cell, map(fly, cell.blocks))
    blocks = iter(cell.blocks)
    with ThreadPoolExecutor(threads) as pool:
        # the number of tallies that wait is bounded, and with it the memory
        batches = iter(lambda: [*islice(blocks, 4 * threads)], [])
        return _summed(cell, chain.from_iterable(pool.map(fly, batch) for batch in batches))


def histories(cell: Cell) -> Floats:
    """States of all runs of a cell after each step: x, y [m], vx, vy [m/s], shape (n, 4, R)."""
    if not cell.spec.lanes:
        return np.stack(
            [estimates.state for runs in cell.blocks for estimates in single_runs(cell, runs)],
            axis=-1,
        )
    truth = lane_flight.truth_record(cell.truth)
    parts = []
    for runs in cell.blocks:
        history = np.empty((cell.truth.speed.size, 4 * LANES))
        _fly(cell, truth, runs, history)
        parts.append(history.reshape(-1, 4, LANES)[..., : len(runs)])
    return np.concatenate(parts, axis=-1)
