"""Independent replications of the cells that claims are judged on, and what averaging over them leaves open.

A replication is the paper's experiment with noise of its own: as many runs of each cell, and their six figures. All
cells of a replication share the numbers of their runs, so that comparisons are paired.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.special import stdtrit

from experiments.campaign.campaign import Task
from experiments.campaign.cells import Cell
from experiments.campaign.missions import mission_of, motion_of
from experiments.campaign.montecarlo import simulate
from experiments.campaign.plans import steps_of
from experiments.campaign.store import Arrays, Record
from experiments.flight.library import ROUTES
from experiments.studies.reproduction import settings
from experiments.studies.reproduction.settings import METRICS, Motion, Setting
from laisn.arrays import Floats
from laisn.geometry import signed_angle
from laisn.settings import Variant
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory

REPLICATIONS = 20
RESAMPLES = 2000
VERDICT_CONFIDENCE = 0.998
"""Of the interval of each criterion; of all 26 together 95 % (Bonferroni)."""
JUDGED: Mapping[str, tuple[Variant, ...]] = {
    "base": ("laisn-2", "laisn-3-1", "laisn-3-2"), "5s": ("laisn-2", "laisn-3-2"), "10s": ("laisn-2",),
    "L1": ("laisn-2", "laisn-3-2"), "HT0.2": ("laisn-3-2",), "asymmetric": ("laisn-2", "laisn-3-2"),
    "muD0.3": ("laisn-2",), "heading5": ("laisn-2",),
}  # fmt: skip
"""Settings and variants that the tests of the claims compare."""
ASTERN_DEG = 10.0
"""A follower within this angle of dead astern counts as astern."""
LATERAL_DEG = (45.0, 135.0)
"""Angle off the bow, either side, that counts as abeam."""
SECTOR_STEPS = 300
"""Steps (of 0.1 s) that a mission must spend in a sector to say something about it."""
NEAR_BURST_S = 30.0
"""The largest bearing error within this time of 95 % of the follower's top speed counts as that of the burst [s]."""
TIMED = ("e_p_abeam_m", "e_p_astern_m", "e_b_peaks_at_burst")
"""Mean E_P [m] abeam and astern, and whether the largest E_B of all runs is that of the burst: 1 or 0."""

Figures = Mapping[tuple[str, str], Floats]
"""Figures of the eight missions by setting with variant ("base laisn-2") and metric, shape (8,) or (K, 8)."""


def over_time(steps: Arrays) -> dict[str, float]:
    """What the claims ask of errors over time, named as in `TIMED`; NaN for a sector where the follower hardly is."""
    off_bow = np.rad2deg(np.abs(signed_angle(np.deg2rad(steps["bearing_deg"]))))
    abeam = (off_bow >= LATERAL_DEG[0]) & (off_bow <= LATERAL_DEG[1])
    error, time = steps["e_p_mean_m"], steps["time_s"]
    sectors = (abeam, off_bow >= 180.0 - ASTERN_DEG)
    means = (float(error[sector].mean()) if sector.sum() >= SECTOR_STEPS else np.nan for sector in sectors)
    fastest = time[steps["speed_m_s"] >= 0.95 * steps["speed_m_s"].max()]
    away = np.min(np.abs(time[np.argmax(steps["e_b_max_deg"])] - fastest))
    return dict(zip(TIMED, (*means, float(away <= NEAR_BURST_S)), strict=True))


def mean_distance(flight: Trajectory) -> float:
    """Mean distance of the first follower's hydrophone and the leader [m]."""
    site = flight.site(f"{flight.names[1]}/hydrophone")
    return float(np.hypot(*(flight.site_position[:, site, :2] - flight.position[:, 0, :2]).T).mean())


def replicate(cells: Sequence[tuple[str, Scenario]], runs: int, replications: int) -> list[Record]:
    """A row of figures for each cell, given by its setting's name and its scenario, and each replication.

    A replication has so many runs; the first takes runs 0 to `runs` − 1, as the tables do.
    """
    rows = []
    for setting, scenario in cells:
        mission = mission_of(motion_of(scenario))
        distance = mean_distance(mission.seen(scenario, 0)[0])
        for number in range(replications):
            cell = Cell.of(scenario, runs=range(number * runs, (number + 1) * runs), mission=mission)
            found, variant = simulate(cell).row, scenario.navigation.variant
            row: Record = {"setting": setting, "mission": scenario.name, "variant": variant, "replication": number}
            row |= {metric: found[metric] for metric in METRICS} | {"distance_m": distance}
            timed = (setting, variant) == ("base", "laisn-2")
            rows.append(row | (over_time(steps_of(cell)) if timed else {}))
    return rows


def tasks(chosen: Iterable[Setting], *, motion: Motion, runs: int, seed: int) -> dict[str, Task]:
    """A task for each mission, by its name: all replications of its cells."""
    judged = [(setting, variant) for setting in chosen for variant in JUDGED.get(setting.name, ())]
    found: dict[str, Task] = {}
    for route in ROUTES:
        cells = [(s.name, settings.scenario(s, route, variant=v, motion=motion, seed=seed)) for s, v in judged]
        found[route] = partial(replicate, cells, runs, REPLICATIONS)
    return found


def by_replication(rows: Iterable[Record]) -> Figures:
    """Figures of each replication, shape (K, 8), of rows as `replicate` gives them, of all missions."""
    found: dict[tuple[str, str], dict[int, dict[str, float]]] = {}
    for row in rows:
        for metric in (*METRICS, "distance_m", *TIMED):
            if metric in row:
                missions = found.setdefault((f"{row['setting']} {row['variant']}", metric), {})
                missions.setdefault(row["replication"], {})[row["mission"]] = row[metric]
    return {key: np.array([[by[k][m] for m in ROUTES] for k in sorted(by)]) for key, by in found.items()}


def means(each: Figures) -> Figures:
    """Figures averaged over replications."""
    return {key: values.mean(axis=0) for key, values in each.items()}


def resampled(each: Figures) -> Figures:
    """The same for replications that are drawn again with replacement, alike in all cells, shape (`RESAMPLES`, 8)."""
    count = next(iter(each.values())).shape[0]
    drawn = np.random.default_rng([count, RESAMPLES]).multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES)
    # not by BLAS, whose sums depend on processor and threads
    return {key: np.einsum("bk,km->bm", drawn / count, values) for key, values in each.items()}


def limits(value: float, drawn: Floats, replications: int, *, is_share: bool) -> tuple[float, float]:
    """Limits of a figure over K replications, given its values in resamples, shape (B,): a t interval.

    Its standard error is the bootstrap's, whose variance is K / (K − 1) times too small (Davison & Hinkley 1997,
    section 2.2). The interval of a share is symmetric about the value, else that of its logarithm is.
    """
    quantile = float(stdtrit(replications - 1, (1.0 + VERDICT_CONFIDENCE) / 2.0))
    wide = quantile * math.sqrt(replications / (replications - 1))
    if is_share:
        half = wide * float(drawn.std())
        return value - half, value + half
    factor = math.exp(wide * float(np.log(drawn).std()))
    return value / factor, value * factor
