"""Beyond eight routes: the stages on many drawn routes, with confidence intervals in place of single rows.

Routes are drawn in the classes by which the paper chose its own. Intervals come from a bootstrap over routes: what
would change if other routes of the same classes had been drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.campaign.store import Record
from experiments.intervals import Interval
from experiments.reproduction import stages
from experiments.reproduction.claims import CLAIMS, Claim
from experiments.reproduction.replications import mean_distance
from experiments.reproduction.stages import METRICS, Key, Motion, Setting
from experiments.reproduction.verdict import Judgement, Results, Verdict
from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.geometry import signed_angle
from sim.scenario.point_motion import plan as plan_motion
from sim.scenario.random_routes import CLASSES, random_route
from sim.scenario.routes import FOLLOWER_DEPTH, Route
from sim.scenario.settings import Follower
from sim.trajectory import Trajectory

RESAMPLES = 1000
CLAIM_RESAMPLES = 200
CONFIDENCE = 0.95
BURST_QUANTILE = 0.9


@dataclass(frozen=True, kw_only=True)
class Study:
    """Everything that came out."""

    motion: Motion
    runs: int
    seed: int
    routes: int
    """Routes of each class."""
    settings: tuple[Setting, ...]
    rows: Mapping[Key, Record]
    classes: Mapping[str, str]
    """Class of each mission."""
    judgements: Sequence[tuple[Claim, Judgement, Mapping[Verdict, float]]]
    """Each claim, its judgement on all routes, and the share of each verdict among resampled routes."""


def draw_followers(missions: int, seed: int) -> dict[str, Follower]:
    """Followers on drawn routes: more missions leave those before as they were.

    Raises:
        LaisnError: fewer than two missions, of which no interval could be made.
    """
    if missions < 2:
        raise LaisnError(f"missions is {missions}, expected at least 2 of each class")
    return {
        f"{name}-{number}": Follower(waypoints=_flyable(name, [seed, index, number]), depth_m=FOLLOWER_DEPTH)
        for index, name in enumerate(CLASSES)
        for number in range(missions)
    }


def _flyable(name: str, address: Sequence[int]) -> tuple[tuple[float, float, float], ...]:
    """Waypoints of a drawn route that can be flown from the first leg's course, too."""
    for attempt in range(100):
        route = random_route(np.random.default_rng([*address, attempt]), CLASSES[name])
        points = np.column_stack([route.time, route.waypoint.round(1)])
        try:
            plan_motion(Route.timed(name, points, FOLLOWER_DEPTH))
        except LaisnError:
            continue
        return tuple((float(t), float(x), float(y)) for t, x, y in points)
    raise LaisnError(f"no route of class {name} can be flown")


def bootstrap(values: Floats, rng: np.random.Generator) -> Interval:
    """Mean of values over routes, shape (m,), and its percentile interval (Efron & Tibshirani 1993, Section 13.3)."""
    means = values[rng.integers(values.size, size=(RESAMPLES, values.size))].mean(axis=1)
    low, high = np.quantile(means, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return Interval(float(values.mean()), float(low), float(high))


def geometry(flight: Trajectory) -> tuple[float, float]:
    """Share of time that the follower is within 10° of astern, and its top speed [m/s]."""
    away = flight.position[:, 1, :2] - flight.position[:, 0, :2]
    off = np.arctan2(away[:, 0], away[:, 1]) - flight.heading[:, 0] - np.pi
    astern = np.abs(signed_angle(off)) < np.deg2rad(10.0)
    return float(astern.mean()), float(flight.forward_speed[:, 1].max())


def results_of(rows: Mapping[Key, Record], flights: Mapping[str, Trajectory]) -> Results:
    """All routes; groups by geometry: the third least and most astern, and the tenth with the highest speed."""
    names = list(flights)
    shapes = np.array([geometry(flights[name]) for name in names])
    distance = {name: mean_distance(flights[name]) for name in names}
    low, high = np.quantile(shapes[:, 0], [1 / 3, 2 / 3])
    fast = np.quantile(shapes[:, 1], BURST_QUANTILE)
    return Results(
        rows={key: {**row, "distance_m": distance[key[1]]} for key, row in rows.items()},
        missions=names,
        lateral=[n for n, s in zip(names, shapes[:, 0], strict=True) if s <= low],
        astern=[n for n, s in zip(names, shapes[:, 0], strict=True) if s >= high],
        burst=[n for n, v in zip(names, shapes[:, 1], strict=True) if v >= fast],
    )


def _resampled(results: Results, classes: Mapping[str, str], rng: np.random.Generator) -> Results:
    """The results with routes drawn again, with replacement, within each class."""
    drawn: list[str] = []
    for name in CLASSES:
        members = [m for m in results.missions if classes[m] == name]
        drawn += [members[i] for i in rng.integers(len(members), size=len(members))]
    return Results(
        rows=results.rows, missions=drawn, lateral=results.lateral, astern=results.astern, burst=results.burst
    )


def judge(
    results: Results, classes: Mapping[str, str], seed: int
) -> list[tuple[Claim, Judgement, dict[Verdict, float]]]:
    """Every claim on all routes, and how often each verdict comes out on resampled ones."""
    rng = np.random.default_rng([seed, len(CLASSES)])
    samples = [_resampled(results, classes, rng) for _ in range(CLAIM_RESAMPLES)]
    result = []
    for claim in CLAIMS:
        verdicts = [claim.judge(sample).verdict for sample in samples]
        shares: dict[Verdict, float] = {v: verdicts.count(v) / len(verdicts) for v in dict.fromkeys(verdicts)}
        result.append((claim, claim.judge(results), shares))
    return result


def distributions(
    settings: Sequence[Setting], rows: Mapping[Key, Record], classes: Mapping[str, str], seed: int
) -> list[Record]:
    """A row for each setting, variant and class, and one for all classes: mean over routes with its interval."""
    rng = np.random.default_rng([seed, len(CLASSES) + 1])
    table = []
    for setting in settings:
        for variant in setting.variants:
            for name in [*CLASSES, "all"]:
                members = [m for m, c in classes.items() if name in (c, "all")]
                line: Record = {**stages.columns(setting), "class": name, "variant": variant, "routes": len(members)}
                for metric in METRICS:
                    values = np.array([rows[setting.name, m, variant][metric] for m in members])
                    interval = bootstrap(values, rng)
                    line |= {metric: interval.value, f"{metric}_low": interval.low, f"{metric}_high": interval.high}
                captured = sum(rows[setting.name, m, variant]["captured_runs"] for m in members)
                table.append({**line, "captured_runs": captured})
    return table
