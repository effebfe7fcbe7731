"""Findings of the study of rival methods: pure functions of its rows."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from experiments.campaign.store import Record
from experiments.findings import Finding, of, plain
from experiments.intervals import mean_over_missions, proportion
from experiments.studies.rivals import design
from laisn.arrays import Floats

LOST_M = 50.0
"""A run whose error, or whose distance from its place at the end, is beyond this is called lost [m]."""
Runs = Sequence[Sequence[Record]]
"""Records of an arm: of each run one for each route."""


def per_route(runs: Runs, column: str) -> Floats:
    """A column of all runs, a row for each route, shape (routes, runs)."""
    return np.array([[float(row[column]) for row in rows] for rows in runs]).T


def _share(flags: Any, what: str) -> Finding:
    return of(proportion(int(np.count_nonzero(flags)), flags.size), f"share of missions {what}, 95 %")


def of_arm(name: str, runs: Runs) -> Iterator[tuple[str, Finding]]:
    """Mean error, 95th percentile, NEES, mirror-locked and lost shares of an arm on the routes."""
    yield f"error {name}", of(mean_over_missions([*per_route(runs, "e_p_mean_m")]), "mean E_P over routes, 95 %", "m")
    first = runs[0]
    high, nees = (np.array([float(row[key]) for row in first]) for key in ("e_p_p95_m", "nees"))
    yield f"high {name}", plain(float(high.mean()), "95th percentile of E_P, mean over routes", "m")
    yield f"nees {name}", plain(float(np.median(nees)), "NEES, median of routes; 2 if the covariance is right")
    yield f"locked {name}", _share(per_route(runs, "mirror_locked"), "locked on the mirror image")
    yield f"lost {name}", _share(per_route(runs, "e_p_max_m") > LOST_M, f"with an error beyond {LOST_M:g} m")


def difference(one: Runs, other: Runs, what: str) -> Finding:
    """Paired difference of mean errors of two arms, over the runs that both have."""
    n = min(len(one), len(other))
    apart = per_route(one[:n], "e_p_mean_m") - per_route(other[:n], "e_p_mean_m")
    return of(mean_over_missions([*apart]), f"paired difference of mean E_P: {what}, 95 %", "m")


def compared(found: Mapping[str, Runs]) -> Iterator[tuple[str, Finding]]:
    """Differences of every rival from LAISN-3(2) and from the tightly coupled navigator, and how often it is better."""
    rivals = [name for name in design.NAVIGATORS if name not in design.OURS]
    for ours, rival in product(("laisn-3-2", "tight"), rivals):
        better = total = 0
        for condition, interval in product(design.CONDITIONS, design.INTERVALS):
            one, other = (design.arm_name(name, condition, interval) for name in (rival, ours))
            if one not in found:
                continue
            apart = difference(found[one], found[other], f"{rival} less {ours}")
            yield f"less {ours} {one}", apart
            total += 1
            better += apart.high is not None and apart.high < 0.0
        yield f"better-than {ours} {rival}", plain(better, "cases with a smaller mean E_P, the whole interval below 0")
        yield f"cases {ours} {rival}", plain(total, "cases of condition and message interval")


def steered(found: Mapping[str, Runs]) -> Iterator[tuple[str, Finding]]:
    """How followers keep their routes that steer by their estimates."""
    for name in design.NAVIGATORS:
        runs = found[design.arm_name(name, "calm", design.USUAL)]
        yield f"closed-error {name}", of(mean_over_missions([*per_route(runs, "e_p_mean_m")]), "mean E_P, 95 %", "m")
        off = per_route(runs, "track_error_rms_m")
        yield f"closed-off {name}", plain(float(np.median(off)), "RMS off its place, median of missions", "m")
        ends = per_route(runs, "track_error_end_m")
        yield f"closed-lost {name}", _share(ends > LOST_M, f"that end more than {LOST_M:g} m off their place")


def mapped(found: Mapping[str, Runs]) -> Iterator[tuple[str, Finding]]:
    """Mean errors over range, compass bias and baseline, and where the inverted USBL is better than LAISN-3(2)."""
    better = total = 0
    for reach, bias, baseline in product(design.RANGES_M, design.BIASES_DEG, design.BASELINES_M):
        names = [design.map_name(name, reach, bias, baseline) for name in design.MAPPED]
        laisn, usbl = (per_route(found[name], "e_p_mean_m")[:1] for name in names)
        for name, errors in zip(names, (laisn, usbl), strict=True):
            yield name, of(mean_over_missions([*errors]), "mean E_P, 95 %", "m")
        apart = of(mean_over_missions([*(usbl - laisn)]), "paired difference of mean E_P, 95 %", "m")
        yield f"map-less {reach:g} {bias:g} {baseline:g}", apart
        better, total = better + int(apart.high is not None and apart.high < 0.0), total + 1
    yield "map-better", plain(better, "points where the inverted USBL's mean E_P is smaller")
    yield "map-points", plain(total, "points of the map")


def shared(found: Mapping[str, Runs]) -> Iterator[tuple[str, Finding]]:
    """Errors of vehicles that interrogate in turn, interpolated over the interval, on logarithmic scales."""
    flown = sorted({*design.INTERVALS, *design.FURTHER})
    for name in design.SHARING:
        arms = [found[design.arm_name(name, "calm", interval)] for interval in flown]
        errors = [float(per_route(runs, "e_p_mean_m").mean()) for runs in arms]
        for interval, error in zip(flown, errors, strict=True):
            yield f"interval {name} {interval:g}", plain(error, "mean E_P over routes", "m")
        for vehicles, reach in product(design.VEHICLES, design.REACHES_M):
            interval = design.shared_interval_s(vehicles, reach)
            error = math.exp(np.interp(math.log(interval), np.log(flown), np.log(errors)))
            yield f"shared {name} {vehicles} {reach:g}", plain(error, "mean E_P where vehicles ask in turn", "m")
    for vehicles, reach in product(design.VEHICLES, design.REACHES_M):
        interval = design.shared_interval_s(vehicles, reach)
        yield f"turn {vehicles} {reach:g}", plain(interval, "interval of ranges of one vehicle", "s")


def findings_of(
    routes: Mapping[str, Runs], closed: Mapping[str, Runs], points: Mapping[str, Runs], step_us: Mapping[str, float]
) -> dict[str, Finding]:
    """All findings.

    Args:
        routes: records by arm on the routes, in open loop.
        closed: in closed loop.
        points: of the map.
        step_us: processor time of a filter step by navigator [µs].
    """
    found = {name: finding for arm, runs in routes.items() for name, finding in of_arm(arm, runs)}
    for more in (compared(routes), steered(closed), mapped(points), shared(routes)):
        found |= dict(more)
    calm = {name: found[f"error {design.arm_name(name, 'calm', design.USUAL)}"] for name in design.NAVIGATORS}
    best = min((name for name in calm if name not in design.OURS), key=lambda name: calm[name].number)
    found["best-rival"] = plain(best, "rival of least mean E_P in calm water, messages every 5 s")
    for ours in ("laisn-3-2", "tight"):
        wins = [finding.number for name, finding in found.items() if name.startswith(f"better-than {ours} ")]
        found[f"better-than {ours}"] = plain(int(sum(wins)), "the same of all rivals together")
    found |= {f"step {name}": plain(time, "processor time of a filter step", "µs") for name, time in step_us.items()}
    return found | {
        "runs": plain(len(next(iter(routes.values()))), "runs of each mission"),
        "slow-runs": plain(len(routes[design.arm_name(design.SLOW, "calm", design.USUAL)]), "of the factor graph"),
        "closed-runs": plain(len(next(iter(closed.values()))), "in closed loop"),
    }
