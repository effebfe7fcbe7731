"""What the study found, from the rows of its parts: each a table of missions with an arm for each navigator."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from statistics import median
from typing import Any

import numpy as np

from experiments.campaign.store import Arrays, Record
from experiments.findings import Finding, of, plain
from experiments.intervals import Interval, mean_interval, proportion, ratio_intervals
from experiments.study.run import Outcomes
from laisn.arrays import Floats
from sim.scenario.routes import library_route

INTERVAL = "timing.message_interval_s"
SETTLED_S = 60.0
"""Errors after the leader's first turn count from this time after it on [s]."""


@dataclass(frozen=True, kw_only=True)
class Mission:
    """One mission of a part: its point, and rows, lists over runs and steps of each navigator."""

    point: Mapping[str, Any]
    rows: Mapping[str, Record]
    runs: Mapping[str, Record]
    steps: Mapping[str, Arrays]
    bound: float | None
    """RMS of the Cramér–Rao bound [m]; None where the mission has errors that it does not model."""

    @property
    def route(self) -> str:
        """Name of the route."""
        return str(self.point["scenario"])

    def column(self, metric: str, arm: str = "tight") -> Floats:
        """A metric of all runs, shape (R,)."""
        return np.array(self.runs[arm][metric], dtype=np.float64)

    def rms(self, arm: str = "tight") -> float:
        """RMS error of all runs [m]."""
        return float(np.sqrt(np.mean(self.column("e_p_rms_m", arm) ** 2)))

    @property
    def figures(self) -> dict[str, Any]:
        """Figures of all runs by both navigators."""
        error, laisn = (float(self.column("e_p_mean_m", arm).mean()) for arm in ("tight", "laisn-2"))
        return {
            "route": self.route,
            "interval": self.point.get(INTERVAL),
            "error": error,
            "laisn": laisn,
            "ratio": error / laisn,
            "rms": self.rms(),
            "over_bound": None if self.bound is None else self.rms() / self.bound,
            "bound_over_laisn": None if self.bound is None else self.bound / self.rms("laisn-2"),
            "largest": float(self.column("e_p_max_m").max()),
            "nees": float(self.column("nees").mean()),
            "inside": self.rows["tight"]["nees_inside"],
            "mirror_locked": int(self.column("mirror_locked").sum()),
            "laisn_mirror_locked": int(self.column("mirror_locked", "laisn-2").sum()),
        }


def missions_of(outcomes: Outcomes) -> list[Mission]:
    """The missions of a part, in the order of its points."""
    study, missions = outcomes.plan.study, list[Mission]()
    flown = zip(outcomes.rows, outcomes.runs, outcomes.steps, strict=True)
    for number, arms in groupby(flown, key=lambda one: int(one[0]["point"])):
        rows, runs, steps = dict[str, Record](), dict[str, Record](), dict[str, Arrays]()
        for row, (_, lists), of_steps in arms:
            rows[row["arm"]], runs[row["arm"]], steps[row["arm"]] = row, lists, of_steps
        point = outcomes.plan.points[number]
        settings = study.case_at(point).settings
        wrong = study.disturb_at(point, "tight") or settings.get("sensors.leader_heading_bias_deg")
        bound = None if wrong else next((row["bound_rms_m"] for row in rows.values() if row.get("bound_rms_m")), None)
        missions.append(Mission(point=point, rows=rows, runs=runs, steps=steps, bound=bound))
    return missions


def where(missions: Sequence[Mission], **wanted: object) -> list[Mission]:
    """Missions whose points have these values."""
    return [one for one in missions if all(one.point.get(key) == value for key, value in wanted.items())]


def over_routes(missions: Sequence[Mission], metric: str, arm: str = "tight") -> Floats:
    """A metric of the runs of all missions, shape (R, m)."""
    return np.stack([one.column(metric, arm) for one in missions], axis=1)


def median_ratio(missions: Sequence[Mission]) -> Interval:
    """Median over missions of mean E_P over LAISN-2's, with limits over runs, which all missions share."""
    limits = ratio_intervals(over_routes(missions, "e_p_mean_m"), over_routes(missions, "e_p_mean_m", "laisn-2"))
    middle = sorted(limits, key=lambda limit: limit.value)[(len(limits) - 1) // 2 : len(limits) // 2 + 1]
    return Interval(*(float(np.mean(column)) for column in zip(*middle, strict=True)))


def mean_of(values: Floats) -> Interval:
    """Mean over all runs of all missions, shape (R, m), with limits over runs."""
    return mean_interval(values.mean(axis=1))


def of_missions(key: str, missions: Sequence[Mission]) -> dict[str, Finding]:
    """Findings of some missions together, their names ending in `key`."""
    several, runs = f"{len(missions)} missions", sum(one.column("run").size for one in missions)
    each = [one.figures for one in missions]
    column = {name: [one[name] for one in each] for name in each[0]}
    lost, laisn_lost = sum(column["mirror_locked"]), sum(column["laisn_mirror_locked"])
    laisn, nis = (over_routes(missions, *key) for key in (("e_p_mean_m", "laisn-2"), ("nis",)))
    inside, locked = "share of instants whose mean eᵀP⁻¹e is within its 95 % χ² interval", "locked on the mirror image"
    found = {
        "ratio": of(median_ratio(missions), f"mean E_P over LAISN-2's, median of {several}, 95 %"),
        "worst": plain(max(column["ratio"]), f"the same, largest of {several}"),
        "error": of(mean_of(over_routes(missions, "e_p_mean_m")), f"mean E_P, mean of {several}, 95 %", "m"),
        "laisn-2": of(mean_of(laisn), f"of LAISN-2, mean of {several}, 95 %", "m"),
        "largest": plain(max(column["largest"]), f"largest E_P of {several}", "m"),
        "nees": of(mean_of(over_routes(missions, "nees")), f"mean eᵀP⁻¹e, mean of {several}, 95 %; right: 2"),
        "nees-least": plain(min(column["nees"]), f"smallest of {several}"),
        "nees-most": plain(max(column["nees"]), f"largest of {several}"),
        "inside": plain(float(np.mean(column["inside"])), inside),
        # of a range, where the engine counts pairs
        "nis": of(mean_of(0.5 * nis), f"squared residual of a range, mean of {several}; right: 1"),
        "mirror-locked": of(proportion(lost, runs), f"share of runs {locked}, 95 %"),
        "mirror-locked-runs": plain(lost, f"runs {locked} of {runs}"),
        "mirror-locked-laisn-2": of(proportion(laisn_lost, runs), f"share of LAISN-2's runs {locked}, 95 %"),
    }
    smoothed = [one.rows["tight"].get("bound_smoothed_rms_m") for one in missions]
    if None not in smoothed:
        best = median(least / one.rows["tight"]["bound_rms_m"] for least, one in zip(smoothed, missions, strict=True))
        found["smoothing"] = plain(best, f"bound of smoothing over that of filtering, median of {several}")
    if None not in column["over_bound"]:
        found["bound"] = plain(median(column["over_bound"]), f"RMS E_P over the bound, median of {several}")
        best = median(column["bound_over_laisn"])
        found["least"] = plain(best, f"the bound over LAISN-2's RMS E_P, median of {several}")
        found["bound-worst"] = plain(max(column["over_bound"]), f"the same, largest of {several}")
    return {f"{name} {key}": finding for name, finding in found.items()}


def of_clocks(missions: Sequence[Mission]) -> dict[str, Finding]:
    """Findings of an unknown clock before the leader's first turn, where it is not observable, and after it."""
    found, turn = {}, float(library_route("L").time[1])
    pairs = [[where(missions, scenario=route, case=case)[0].steps["tight"] for case in ("unknown", "exact")]
             for route in dict.fromkeys(one.route for one in missions)]  # fmt: skip
    several = f"{len(pairs)} missions"
    for part, first, last in (("before", 0.0, turn), ("after", turn + SETTLED_S, np.inf)):
        ratios: dict[str, list[float]] = {"e_p_mean_m": [], "bound_m": []}
        for pair in pairs:
            (inside,) = np.nonzero((pair[0]["time_s"] > first + 0.01) & (pair[0]["time_s"] < last + 0.01))
            for name, values in ratios.items():
                of_steps = [steps[name][inside].astype(np.float64) for steps in pair]
                unknown, exact = (np.sqrt(np.mean(x**2)) if name == "bound_m" else np.mean(x) for x in of_steps)
                values.append(float(unknown / exact))
        errors, bounds = ratios.values()
        what = f"mean E_P with an unknown clock over that with exact ones, {part} the leader's first turn"
        found[f"clock {part}"] = plain(median(errors), f"{what}, median of {several}")
        found[f"clock-worst {part}"] = plain(max(errors), f"the same, largest of {several}")
        found[f"clock-bound {part}"] = plain(median(bounds), f"RMS of the bound likewise, median of {several}")
        found[f"clock-bound-worst {part}"] = plain(max(bounds), f"the same, largest of {several}")
    return found


def of_plain_filter(key: str, missions: Sequence[Mission]) -> dict[str, Finding]:
    """Findings of a plain extended Kalman filter, and of the tightly coupled navigator on the same noise."""
    several, over = f"{len(missions)} missions", "mean E_P of the tightly coupled navigator over a plain EKF's"
    theirs, means = (over_routes(missions, "e_p_mean_m", arm) for arm in ("tight", "ekf"))
    normalised, lost = over_routes(missions, "nees", "ekf"), over_routes(missions, "mirror_locked", "ekf")
    whole = ratio_intervals(theirs.sum(axis=1, keepdims=True), means.sum(axis=1, keepdims=True))[0]
    share, what = proportion(int(lost.sum()), lost.size), "share of a plain EKF's runs locked on the mirror image, 95 %"
    found = {
        f"ekf {key}": of(mean_of(means), f"mean E_P of a plain EKF, mean of {several}, 95 %", "m"),
        f"over-ekf {key}": of(whole, f"{over}, {several}, 95 %"),
        f"ekf-nees {key}": of(mean_of(normalised), f"mean eᵀP⁻¹e of a plain EKF, {several}, 95 %; right: 2"),
        f"ekf-mirror-locked {key}": of(share, what),
    }
    for one, ratio in zip(missions, ratio_intervals(theirs, means), strict=True):
        found[f"over-ekf {key} {one.route}"] = of(ratio, f"{over}, 95 %")
        limits = mean_interval(one.column("e_p_mean_m", "ekf"))
        found[f"ekf {key} {one.route}"] = of(limits, "mean E_P of a plain EKF, 95 %", "m")
    return found


def of_mirror_locks(mission: Mission) -> dict[str, Finding]:
    """Findings of many runs of one mission that were flown for their mirror locks alone."""
    key, runs = f"{mission.point['case']} {mission.route}", mission.column("run").size
    tight, laisn = (int(mission.column("mirror_locked", arm).sum()) for arm in ("tight", "laisn-2"))
    return {
        f"many-runs {key}": plain(runs, "runs"),
        f"many {key}": of(proportion(tight, runs), "share of runs locked on the mirror image, 95 %"),
        f"many-mirror-locked {key}": plain(tight, "runs locked on the mirror image"),
        f"many-laisn-2 {key}": of(proportion(laisn, runs), "share of LAISN-2's runs locked on the mirror image, 95 %"),
    }


def grouped(missions: Sequence[Mission], *keys: str) -> Iterator[tuple[str, list[Mission]]]:
    """Missions of all routes that have the same values of keys, by these values."""
    values = dict.fromkeys(tuple(one.point[key] for key in keys) for one in missions)
    for each in values:
        name = " ".join(f"{part:g}" if isinstance(part, float) else str(part) for part in each)
        yield name, where(missions, **dict(zip(keys, each, strict=True)))


def findings_of(outcomes: Mapping[str, Outcomes]) -> dict[str, Finding]:
    """Findings of all parts of the study."""
    parts = {name: missions_of(one) for name, one in outcomes.items()}
    study = outcomes["cases"].plan.study
    seed, runs = study.file.seed, study.runs
    named = {"seed": plain(seed, "of all noise"), "runs": plain(runs, "runs of each mission of G1 to G7")}
    for key, missions in grouped(parts["cases"], "case", INTERVAL):
        named |= of_missions(key, missions)
        if "ekf" in missions[0].runs:
            named |= of_plain_filter(key, missions)
    # the bound is that of the sensors, which stay as they are
    least = {one.route: one.bound for one in where(parts["cases"], case="G1", **{INTERVAL: 5.0})}
    parts["sigma"] = [replace(one, bound=least[one.route]) for one in parts["sigma"]]
    for part, name in (("sea", "case"), ("wrong", "case"), ("offset", "leader.middle_offset_m"), ("sigma", "case")):
        for key, missions in grouped(parts[part], name):
            named |= of_missions(f"{part} {key}", missions)
    named |= of_clocks(parts["clock"])
    for one in parts["weave"]:
        key = f"{one.point['case']} {one.route}"
        named[f"rms {key}"] = plain(one.rms(), "RMS E_P with two transmitters", "m")
        named[f"rms-bound {key}"] = plain(one.bound, "its bound", "m")
    for one in parts["locks"]:
        named |= of_mirror_locks(one)
    return named
