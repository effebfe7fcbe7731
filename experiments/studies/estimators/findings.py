"""The record of the study of the estimators, made of the rows of its tasks."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np

from experiments.campaign.store import Record
from experiments.findings import Finding, Findings, of, plain, record
from experiments.intervals import Interval, mean_interval, proportion, ratio_intervals
from experiments.studies.estimators import cases
from laisn.arrays import Floats

COMMAND = "laisn estimators"
MODULES = ("experiments.studies.estimators.findings", "experiments.studies.estimators.runs")
Rows = Mapping[tuple[Any, ...], Record]
"""Rows of tasks by the tasks' names."""


def chosen(rows: Rows, *first: Any) -> list[Record]:
    """Rows of the tasks whose names begin so."""
    return [row for name, row in rows.items() if name[: len(first)] == first]


def over_routes(missions: Sequence[Record], name: str) -> Floats:
    """A figure of the runs of all missions, shape (R, m)."""
    return np.stack([one[name] for one in missions], axis=1)


def of_route(one: Record) -> dict[str, Any]:
    """Figures of all runs of one mission by both navigators."""
    rms, laisn_rms = (float(np.sqrt(one[f"{who}_squares"].mean())) for who in ("tight", "laisn"))
    least = one["bound_rms"]
    return {
        "route": one["route"],
        "interval": one["interval"],
        "error": float(one["tight_means"].mean()),
        "laisn": float(one["laisn_means"].mean()),
        "ratio": float(one["tight_means"].mean()) / float(one["laisn_means"].mean()),
        "rms": rms,
        "over_bound": None if least is None else rms / least,
        "bound_over_laisn": None if least is None else least / laisn_rms,
        "largest": float(one["largest"].max()),
        "nees": float(one["normalised"].mean()),
        "mirror_locked": int(one["tight_lost"].sum()),
        "laisn_mirror_locked": int(one["laisn_lost"].sum()),
    }


def median_ratio(missions: Sequence[Record]) -> Interval:
    """Median over missions of mean E_P over LAISN-2's, with limits over runs, which all missions share."""
    limits = ratio_intervals(over_routes(missions, "tight_means"), over_routes(missions, "laisn_means"))
    middle = sorted(limits, key=lambda limit: limit.value)[(len(limits) - 1) // 2 : len(limits) // 2 + 1]
    return Interval(*(float(np.mean(column)) for column in zip(*middle, strict=True)))


def mean_of(missions: Sequence[Record], name: str) -> Interval:
    """Mean over all runs of all missions of a figure, with limits over runs."""
    return mean_interval(over_routes(missions, name).mean(axis=1))


def of_missions(key: str, missions: Sequence[Record]) -> dict[str, Finding]:
    """Findings of some missions together, their names ending in `key`."""
    several, runs = f"{len(missions)} missions", sum(one["tight_means"].size for one in missions)
    each = [of_route(one) for one in missions]
    column = {name: [one[name] for one in each] for name in each[0]}
    lost, laisn_lost = sum(column["mirror_locked"]), sum(column["laisn_mirror_locked"])
    found = {
        "ratio": of(median_ratio(missions), f"mean E_P over LAISN-2's, median of {several}, 95 %"),
        "worst": plain(max(column["ratio"]), f"the same, largest of {several}"),
        "error": of(mean_of(missions, "tight_means"), f"mean E_P, mean of {several}, 95 %", "m"),
        "laisn-2": of(mean_of(missions, "laisn_means"), f"of LAISN-2, mean of {several}, 95 %", "m"),
        "largest": plain(max(column["largest"]), f"largest E_P of {several}", "m"),
        "nees": of(mean_of(missions, "normalised"), f"mean eᵀP⁻¹e, mean of {several}, 95 %; right: 2"),
        "nees-least": plain(min(column["nees"]), f"smallest of {several}"),
        "nees-most": plain(max(column["nees"]), f"largest of {several}"),
        "inside": plain(
            float(np.mean([one["inside"] for one in missions])),
            "share of instants whose mean eᵀP⁻¹e is within its 95 % χ² interval",
        ),
        "nis": of(mean_of(missions, "residuals"), f"squared residual of a range, mean of {several}; right: 1"),
        "mirror-locked": of(proportion(lost, runs), "share of runs locked on the mirror image, 95 %"),
        "mirror-locked-runs": plain(lost, f"runs locked on the mirror image of {runs}"),
        "mirror-locked-laisn-2": of(
            proportion(laisn_lost, runs), "share of LAISN-2's runs locked on the mirror image, 95 %"
        ),
    }
    if all("smoothing" in one for one in missions):
        best = median(one["smoothing"] for one in missions)
        found["smoothing"] = plain(best, f"bound of smoothing over that of filtering, median of {several}")
    if None not in column["over_bound"]:
        found["bound"] = plain(median(column["over_bound"]), f"RMS E_P over the bound, median of {several}")
        best = median(column["bound_over_laisn"])
        found["least"] = plain(best, f"the bound over LAISN-2's RMS E_P, median of {several}")
        found["bound-worst"] = plain(max(column["over_bound"]), f"the same, largest of {several}")
    return {f"{name} {key}": finding for name, finding in found.items()}


def of_clocks(costs: Sequence[Record]) -> dict[str, Finding]:
    """Findings of an unknown clock before the leader's first turn and after it."""
    found, several = {}, f"{len(costs)} missions"
    ratios = [one["unknown"].mean(axis=0) / one["exact"].mean(axis=0) for one in costs]
    for i, part in enumerate(("before", "after")):
        errors, bounds = ([float(each[i]) for each in given] for given in (ratios, [one["bound"] for one in costs]))
        what = f"mean E_P with an unknown clock over that with exact ones, {part} the leader's first turn"
        found[f"clock {part}"] = plain(median(errors), f"{what}, median of {several}")
        found[f"clock-worst {part}"] = plain(max(errors), f"the same, largest of {several}")
        found[f"clock-bound {part}"] = plain(median(bounds), f"RMS of the bound likewise, median of {several}")
        found[f"clock-bound-worst {part}"] = plain(max(bounds), f"the same, largest of {several}")
    return found


def of_plain_filter(key: str, missions: Sequence[Record], tight: Sequence[Record]) -> dict[str, Finding]:
    """Findings of a plain extended Kalman filter, and of the tightly coupled navigator on the same noise."""
    several, over = f"{len(missions)} missions", "mean E_P of the tightly coupled navigator over a plain EKF's"
    means, theirs = over_routes(missions, "means"), over_routes(tight, "tight_means")
    normalised, lost = over_routes(missions, "normalised").mean(axis=1), over_routes(missions, "lost")
    whole = ratio_intervals(theirs.sum(axis=1, keepdims=True), means.sum(axis=1, keepdims=True))[0]
    found = {
        f"ekf {key}": of(mean_interval(means.mean(axis=1)), f"mean E_P of a plain EKF, mean of {several}, 95 %", "m"),
        f"over-ekf {key}": of(whole, f"{over}, {several}, 95 %"),
        f"ekf-nees {key}": of(mean_interval(normalised), f"mean eᵀP⁻¹e of a plain EKF, {several}, 95 %; right: 2"),
        f"ekf-mirror-locked {key}": of(
            proportion(int(lost.sum()), lost.size), "share of a plain EKF's runs locked on the mirror image, 95 %"
        ),
    }
    for one, ratio in zip(missions, ratio_intervals(theirs, means), strict=True):
        found[f"over-ekf {key} {one['route']}"] = of(ratio, f"{over}, 95 %")
        found[f"ekf {key} {one['route']}"] = of(mean_interval(one["means"]), "mean E_P of a plain EKF, 95 %", "m")
    return found


def of_mirror_locks(key: str, parts: Sequence[Record]) -> dict[str, Finding]:
    """Findings of many runs of one mission that were flown for their mirror locks alone."""
    runs, laisn, tight = (sum(part[name] for part in parts) for name in ("runs", "laisn", "tight"))
    return {
        f"many-runs {key}": plain(runs, "runs"),
        f"many {key}": of(proportion(tight, runs), "share of runs locked on the mirror image, 95 %"),
        f"many-mirror-locked {key}": plain(tight, "runs locked on the mirror image"),
        f"many-laisn-2 {key}": of(proportion(laisn, runs), "share of LAISN-2's runs locked on the mirror image, 95 %"),
    }


def findings_of(rows: Rows) -> Findings:
    """The record of the rows of all tasks."""
    runs = min(one["tight_means"].size for one in chosen(rows, "case"))
    named = {"seed": plain(cases.SEED, "of all noise"), "runs": plain(runs, "runs of each mission of G1 to G7")}
    for name in dict.fromkeys(name[:-1] for name in rows if name[0] in ("case", "sea", "wrong", "offset", "sigma")):
        parts = name[1:] if name[0] == "case" else name
        key = " ".join(f"{part:g}" if isinstance(part, float) else part for part in parts)
        named |= of_missions(key, chosen(rows, *name))
    for case in cases.BASELINED:
        for interval in cases.INTERVALS:
            flown = (chosen(rows, kind, case.name, interval) for kind in ("ekf", "case"))
            named |= of_plain_filter(f"{case.name} {interval:g}", *flown)
    named |= of_clocks(chosen(rows, "clock"))
    for route in cases.ON_AXIS:
        for weave, how in ((False, "straight"), (True, "weaving")):
            one = rows["weave", weave, route]
            named[f"rms {how} {route}"] = plain(of_route(one)["rms"], "RMS E_P with two transmitters", "m")
            named[f"rms-bound {how} {route}"] = plain(one["bound_rms"], "its bound", "m")
        for transmitters in (2, 3):
            named |= of_mirror_locks(f"{transmitters} {route}", chosen(rows, "mirror_locks", transmitters, route))
    return record("estimators", COMMAND, MODULES, named)
