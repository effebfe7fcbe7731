"""The study of the estimators: `laisn estimators`. LAISN-2, the tightly coupled navigator and the bound, paired."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Unpack

import numpy as np

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions
from experiments.campaign.store import Record
from experiments.campaign.tasks import with_arrays
from experiments.estimators.cases import CASES
from experiments.estimators.clock import ClockCost
from experiments.estimators.paired import Captured, Paired, Plain
from experiments.estimators.plan import (
    BASELINED,
    INTERVALS,
    ON_AXIS,
    QUICK,
    SEAS,
    SEED,
    SIGMAS,
    Size,
    first_look,
    tasks,
)
from experiments.findings import FILE, Finding, Findings, of, plain, record
from experiments.intervals import Interval, mean_interval, proportion, ratio_intervals

COMMAND = "laisn estimators"
MODULES = ("experiments.estimators.study",)
Found = Mapping[tuple[Any, ...], Any]
"""What the tasks came to, by their names."""


def chosen(found: Found, *first: Any) -> list[Any]:
    """What tasks whose names begin so came to."""
    return [value for name, value in found.items() if name[: len(first)] == first]


def ratio(missions: Sequence[Paired]) -> Interval:
    """Median over missions of mean E_P over LAISN-2's, with limits over runs, which all missions share."""
    runs = min(one.runs for one in missions)
    above = np.stack([one.tight_means[:runs] for one in missions], axis=1)
    below = np.stack([one.laisn_means[:runs] for one in missions], axis=1)
    limits = ratio_intervals(above, below)
    middle = sorted(limits, key=lambda limit: limit.value)[(len(limits) - 1) // 2 : len(limits) // 2 + 1]
    return Interval(*(float(np.mean(column)) for column in zip(*middle, strict=True)))


def over_bound(missions: Sequence[Paired]) -> list[float]:
    """RMS E_P over the bound, mission by mission."""
    return [one.tight_rms / one.bound_rms for one in missions]


def mean_of(missions: Sequence[Paired], name: str) -> Interval:
    """Mean over all runs of all missions of a figure, with limits over runs."""
    runs = min(one.runs for one in missions)
    values = np.mean([getattr(one, name)[:runs] for one in missions], axis=0)
    return mean_interval(values)


def _of_missions(key: str, missions: Sequence[Paired], named: dict[str, Finding]) -> None:
    """What is said of some missions together."""
    several = f"{len(missions)} missions"
    ratios = [one.ratio for one in missions]
    named[f"ratio {key}"] = of(ratio(missions), f"mean E_P over LAISN-2's, median of {several}, 95 %")
    named[f"worst {key}"] = plain(max(ratios), f"the same, largest of {several}")
    named[f"error {key}"] = of(mean_of(missions, "tight_means"), f"mean E_P, mean of {several}, 95 %", "m")
    named[f"laisn-2 {key}"] = of(mean_of(missions, "laisn_means"), f"of LAISN-2, mean of {several}, 95 %", "m")
    named[f"largest {key}"] = plain(max(one.tight_max for one in missions), f"largest E_P of {several}", "m")
    named[f"nees {key}"] = of(mean_of(missions, "normalised"), f"mean eᵀP⁻¹e, mean of {several}, 95 %; right: 2")
    every = [one.nees for one in missions]
    named[f"nees-least {key}"] = plain(min(every), f"smallest of {several}")
    named[f"nees-most {key}"] = plain(max(every), f"largest of {several}")
    inside = float(np.mean([one.inside for one in missions]))
    named[f"inside {key}"] = plain(inside, "share of instants whose mean eᵀP⁻¹e is within its 95 % χ² interval")
    named[f"nis {key}"] = of(
        mean_of(missions, "residuals"), f"squared residual of a range, mean of {several}; right: 1"
    )
    lost, runs = sum(one.tight_captured for one in missions), sum(one.runs for one in missions)
    named[f"captured {key}"] = of(proportion(lost, runs), "share of runs captured, 95 %")
    named[f"captured-runs {key}"] = plain(lost, f"runs captured of {runs}")
    laisn = sum(one.laisn_captured for one in missions)
    named[f"captured-laisn-2 {key}"] = of(proportion(laisn, runs), "share of LAISN-2's runs captured, 95 %")
    if not any(np.isnan(one.smoothing) for one in missions):
        best = median([one.smoothing for one in missions])
        named[f"smoothing {key}"] = plain(best, f"bound of smoothing over that of filtering, median of {several}")
    if not any(np.isnan(one.bound_rms) for one in missions):
        least = over_bound(missions)
        named[f"bound {key}"] = plain(median(least), f"RMS E_P over the bound, median of {several}")
        best = median([one.bound_rms / one.laisn_rms for one in missions])
        named[f"least {key}"] = plain(best, f"the bound over LAISN-2's RMS E_P, median of {several}")
        named[f"bound-worst {key}"] = plain(max(least), f"the same, largest of {several}")


def _of_clocks(costs: Sequence[ClockCost]) -> dict[str, Finding]:
    """What an unknown clock costs before the leader's first turn and after it."""
    named, several = {}, f"{len(costs)} missions"
    runs = min(one.after_exact.size for one in costs)
    for part in ("before", "after"):
        unknown = np.stack([getattr(one, f"{part}_unknown")[:runs] for one in costs], axis=1)
        exact = np.stack([getattr(one, f"{part}_exact")[:runs] for one in costs], axis=1)
        ratios, bounds = unknown.mean(axis=0) / exact.mean(axis=0), [getattr(one, f"{part}_bound") for one in costs]
        what = f"mean E_P with an unknown clock over that with exact ones, {part} the leader's first turn"
        named[f"clock {part}"] = plain(float(np.median(ratios)), f"{what}, median of {several}")
        named[f"clock-worst {part}"] = plain(float(ratios.max()), f"the same, largest of {several}")
        named[f"clock-bound {part}"] = plain(median(bounds), f"RMS of the bound likewise, median of {several}")
        named[f"clock-bound-worst {part}"] = plain(max(bounds), f"the same, largest of {several}")
    return named


def _of_plain(key: str, missions: Sequence[Plain], tight: Sequence[Paired], named: dict[str, Finding]) -> None:
    """What is said of a plain extended Kalman filter, beside the tightly coupled navigator on the same noise."""
    several, runs = f"{len(missions)} missions", missions[0].runs
    means = np.stack([one.means for one in missions], axis=1)
    theirs = np.stack([one.tight_means[:runs] for one in tight], axis=1)
    named[f"ekf {key}"] = of(
        mean_interval(means.mean(axis=1)), f"mean E_P of a plain EKF, mean of {several}, 95 %", "m"
    )
    limits = zip(missions, ratio_intervals(theirs, means), strict=True)
    for one, ratio_to_plain in limits:
        what = "mean E_P of the tightly coupled navigator over a plain EKF's, 95 %"
        named[f"over-ekf {key} {one.route}"] = of(ratio_to_plain, what)
    whole = ratio_intervals(theirs.sum(axis=1, keepdims=True), means.sum(axis=1, keepdims=True))[0]
    named[f"over-ekf {key}"] = of(
        whole, f"mean E_P of the tightly coupled navigator over a plain EKF's, {several}, 95 %"
    )
    for one in missions:
        named[f"ekf {key} {one.route}"] = of(mean_interval(one.means), "mean E_P of a plain EKF, 95 %", "m")
    normalised = np.mean([one.normalised for one in missions], axis=0)
    named[f"ekf-nees {key}"] = of(mean_interval(normalised), f"mean eᵀP⁻¹e of a plain EKF, {several}, 95 %; right: 2")
    lost = sum(int(one.lost.sum()) for one in missions)
    named[f"ekf-captured {key}"] = of(
        proportion(lost, sum(one.runs for one in missions)), "share of a plain EKF's runs captured, 95 %"
    )


def findings_of(found: Found) -> Findings:
    """The record of what the tasks came to."""
    named: dict[str, Finding] = {"seed": plain(SEED, "of all noise")}
    named["runs"] = plain(min(one.runs for one in chosen(found, "case")), "runs of each mission of G1 to G7")
    for case in CASES:
        for interval in INTERVALS:
            _of_missions(f"{case.name} {interval:g}", chosen(found, "case", case.name, interval), named)
    for case in BASELINED:
        for interval in INTERVALS:
            flown = chosen(found, "ekf", case.name, interval), chosen(found, "case", case.name, interval)
            _of_plain(f"{case.name} {interval:g}", *flown, named)
    for sea in SEAS:
        _of_missions(f"sea {sea}", chosen(found, "sea", sea), named)
    for name in dict.fromkeys(name[1] for name in found if name[0] == "wrong"):
        _of_missions(f"wrong {name}", chosen(found, "wrong", name), named)
    for offset in dict.fromkeys(name[1] for name in found if name[0] == "offset"):
        _of_missions(f"offset {offset:g}", chosen(found, "offset", offset), named)
    for sigma in SIGMAS:
        for factor in (0.5, 2.0):
            _of_missions(f"sigma {sigma} {factor:g}", chosen(found, "sigma", sigma, factor), named)
    named |= _of_clocks(chosen(found, "clock"))
    for weave in (False, True):
        for route in ON_AXIS:
            one: Paired = found["weave", weave, route]
            key = f"{'weaving' if weave else 'straight'} {route}"
            named[f"rms {key}"] = plain(one.tight_rms, "RMS E_P with two transmitters", "m")
            named[f"rms-bound {key}"] = plain(one.bound_rms, "its bound", "m")
    for transmitters in (2, 3):
        for route in ON_AXIS:
            parts: list[Captured] = chosen(found, "captures", transmitters, route)
            runs, laisn, tight = (sum(getattr(part, name) for part in parts) for name in ("runs", "laisn", "tight"))
            key = f"{transmitters} {route}"
            named[f"many-runs {key}"] = plain(runs, "runs")
            named[f"many {key}"] = of(proportion(tight, runs), "share of runs captured, 95 %")
            named[f"many-captured {key}"] = plain(tight, "runs captured")
            named[f"many-laisn-2 {key}"] = of(proportion(laisn, runs), "share of LAISN-2's runs captured, 95 %")
    return record("estimators", COMMAND, MODULES, named)


def _result(name: tuple[Any, ...], row: Record) -> Paired | Captured | ClockCost | Plain:
    if name[0] == "captures":
        return Captured(**row)
    kinds: dict[str, type[Paired | ClockCost | Plain]] = {"clock": ClockCost, "ekf": Plain}
    return kinds.get(name[0], Paired)(**with_arrays(row))


def fly(size: Size, folder: Path, **options: Unpack[ExecutionOptions]) -> dict[tuple[Any, ...], Any]:
    """Fly all tasks, or those that are missing; `options` as of `campaign.fly`."""
    design = Design(tasks=dict(tasks(size)), what="missions", ahead=first_look)
    flown = campaign.fly(design, folder, **options).tasks
    return {name: _result(name, row) for name, (row,) in flown.items()}


def run(folder: Path, *, quick: bool = False, **options: Unpack[ExecutionOptions]) -> dict[tuple[Any, ...], Any]:
    """Fly the study and write its record.

    Args:
        folder: for the record; made if it is not there.
        quick: a first look, of few runs and routes.
        options: as of `campaign.fly`.

    Returns:
        What the tasks came to, by their names.
    """
    found = fly(QUICK if quick else Size(), folder, **options)
    findings_of(found).write(folder / FILE)
    return found
