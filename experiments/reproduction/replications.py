"""Independent replications of the cells that claims are judged on, and what averaging over them leaves open.

A replication is the paper's experiment with noise of its own: as many runs of each cell, and their six figures. All
cells of a replication share the numbers of their runs, so that comparisons are paired.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import partial

import numpy as np
from scipy.special import stdtrit

from experiments.campaign.cells import Cell
from experiments.campaign.missions import mission_of, motion_of
from experiments.campaign.montecarlo import simulate
from experiments.campaign.plans import steps_of
from experiments.campaign.store import Record, Steps
from experiments.campaign.tasks import Task
from experiments.reproduction import stages
from experiments.reproduction.stages import METRICS, Key, Motion, Setting
from laisn.arrays import Floats
from laisn.geometry import signed_angle
from laisn.settings import Variant
from sim.scenario.settings import Follower, Scenario
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
"""The largest bearing error within this time of the top speed counts as that of the burst [s]."""
TIMED = ("e_p_abeam_m", "e_p_astern_m", "e_b_peaks_at_burst")
"""Names of what `over_time` gives."""


def sector_errors(steps: Steps) -> tuple[float, float]:
    """Mean E_P [m] while the follower is abeam, and while it is astern; NaN where it hardly ever is."""
    off_bow = np.rad2deg(np.abs(signed_angle(np.deg2rad(steps["bearing_deg"]))))
    lateral = (off_bow >= LATERAL_DEG[0]) & (off_bow <= LATERAL_DEG[1])
    astern = off_bow >= 180.0 - ASTERN_DEG
    error = steps["e_p_mean_m"]
    abeam, behind = (float(error[s].mean()) if s.sum() >= SECTOR_STEPS else np.nan for s in (lateral, astern))
    return abeam, behind


def peaks_at_burst(steps: Steps) -> bool:
    """Whether the largest E_B of all runs occurs within `NEAR_BURST_S` of 95 % of the follower's top speed."""
    fastest = steps["time_s"][steps["speed_m_s"] >= 0.95 * steps["speed_m_s"].max()]
    return bool(np.min(np.abs(steps["time_s"][np.argmax(steps["e_b_max_deg"])] - fastest)) <= NEAR_BURST_S)


def mean_distance(flight: Trajectory) -> float:
    """Mean distance of the first follower's hydrophone and the leader [m]."""
    site = flight.site(f"{flight.names[1]}/hydrophone")
    return float(np.hypot(*(flight.site_position[:, site, :2] - flight.position[:, 0, :2]).T).mean())


def over_time(steps: Steps) -> dict[str, float]:
    """What the claims ask of errors over time."""
    abeam, astern = sector_errors(steps)
    return dict(zip(TIMED, (abeam, astern, float(peaks_at_burst(steps))), strict=True))


def replicate(cells: Sequence[tuple[str, Scenario]], runs: int, replications: int) -> list[Record]:
    """Figures of cells in every replication.

    Args:
        cells: name of the setting and scenario of each.
        runs: of a replication; the first takes runs 0 to `runs` − 1, as the tables do.
        replications: how many.

    Returns:
        A row for each cell and replication.
    """
    rows = []
    for setting, scenario in cells:
        mission = mission_of(motion_of(scenario))
        distance = mean_distance(mission.seen(scenario, 0)[0])
        for number in range(replications):
            cell = Cell.of(scenario, runs=range(number * runs, (number + 1) * runs), mission=mission)
            errors, variant = asdict(simulate(cell).errors), scenario.navigation.variant
            row: Record = {"setting": setting, "mission": scenario.name, "variant": variant, "replication": number}
            row |= {metric: errors[metric] for metric in METRICS} | {"distance_m": distance}
            timed = (setting, variant) == ("base", "laisn-2")
            rows.append(row | (over_time(steps_of(cell)) if timed else dict.fromkeys(TIMED)))
    return rows


def tasks(
    settings: Iterable[Setting], followers: Mapping[str, Follower], *, motion: Motion, runs: int, seed: int
) -> dict[tuple[str, str], Task]:
    """A task for each mission: all replications of its cells."""
    judged = [(setting, variant) for setting in settings for variant in JUDGED.get(setting.name, ())]
    found: dict[tuple[str, str], Task] = {}
    for name, follower in followers.items():
        cells = [
            (setting.name, stages.scenario(setting, follower, name, variant=variant, motion=motion, seed=seed))
            for setting, variant in judged
        ]
        found["replications", name] = partial(replicate, cells, runs, REPLICATIONS)
    return found


def by_cell(rows: Iterable[Record]) -> dict[Key, dict[str, Floats]]:
    """Figures of each cell, replication by replication, shape (K,); those that a cell lacks are left out."""
    sorted_rows: dict[Key, list[Record]] = {}
    for row in sorted(rows, key=lambda row: int(row["replication"])):
        sorted_rows.setdefault((row["setting"], row["mission"], row["variant"]), []).append(row)
    return {
        key: {
            name: np.array([row[name] for row in members], dtype=np.float64)
            for name in (*METRICS, "distance_m", *TIMED)
            if members[0][name] is not None
        }
        for key, members in sorted_rows.items()
    }


def means(cells: Mapping[Key, Mapping[str, Floats]]) -> dict[Key, dict[str, float]]:
    """Figures of each cell, averaged over replications."""
    return {key: {name: float(values.mean()) for name, values in row.items()} for key, row in cells.items()}


def resampled(cells: Mapping[Key, Mapping[str, Floats]]) -> dict[Key, dict[str, Floats]]:
    """The same for replications that are drawn again with replacement, alike in all cells, shape (`RESAMPLES`,)."""
    count = next(iter(next(iter(cells.values())).values())).size
    drawn = np.random.default_rng([count, RESAMPLES]).multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES)
    weights = drawn / count
    # not by BLAS, whose sums depend on processor and threads
    return {
        key: {name: np.einsum("bk,k->b", weights, values) for name, values in row.items()} for key, row in cells.items()
    }


def limits(value: float, drawn: Floats, replications: int, *, is_share: bool) -> tuple[float, float]:
    """Limits of a figure over replications: a t interval with the bootstrap's standard error.

    Args:
        value: the figure.
        drawn: its values in resamples, shape (B,).
        replications: K; the bootstrap's variance is K / (K − 1) times too small (Davison & Hinkley 1997, section 2.2).
        is_share: the interval is symmetric about the value; else that of its logarithm is.
    """
    quantile = float(stdtrit(replications - 1, (1.0 + VERDICT_CONFIDENCE) / 2.0))
    wide = quantile * math.sqrt(replications / (replications - 1))
    if is_share:
        half = wide * float(drawn.std())
        return value - half, value + half
    factor = math.exp(wide * float(np.log(drawn).std()))
    return value / factor, value * factor
