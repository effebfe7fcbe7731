"""What the study found, from the rows of its parts: each a table of missions with an arm for
each navigator.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from experiments.study.run import Cells, StudyResults
from laisn.arrays import Floats
from reports.findings import Finding, interval_finding, median_finding, plain_finding, share_finding
from reports.intervals import Interval, mean_interval, ratio_intervals
from sim.scenario.routes import library_route

MESSAGE_INTERVAL = "timing.message_interval_s"  # key of the time between messages
SETTLED_S = 60.0  # errors after the leader's first turn count from this time after it on [s]


def missions_of(outcomes: StudyResults) -> Cells:
    """The cells of a part, with `bound`, RMS of the Cramér–Rao bound [m]; None where it does not
    model the errors.
    """
    study = outcomes.plan.study
    bounds = dict[int, float | None]()
    for row in outcomes.rows:
        point = outcomes.plan.points[row["point"]]
        is_misstated = (
            study.disturb_at(point, "tight")
            or "sensors.leader_heading_bias_deg" in study.case_at(point).settings
        )
        if not is_misstated and row.get("bound_rms_m"):
            # the first row of a point that has a bound gives that of all its rows
            bounds.setdefault(row["point"], row["bound_rms_m"])
    return outcomes.cells._replace(
        rows=[row | {"bound": bounds.get(row["point"])} for row in outcomes.rows]
    )


def _rms_of(values: Floats) -> np.float64:
    return np.float64(np.sqrt(np.mean(values**2)))


def _rms_of_missions(cells: Cells) -> Floats:
    """RMS error of all runs of each mission, shape (m,), [m]."""
    return np.asarray(np.sqrt(np.mean(cells.values_by_run("e_p_rms_m") ** 2, axis=0)))


def figures_of(missions: Cells) -> list[dict[str, Any]]:
    """Figures of all runs of each mission: of the tightly coupled navigator, and those named
    `laisn…` of LAISN-2. `error` is the mean, `rms` the RMS and `largest` the largest of E_P [m],
    `inside` the share of steps at which NEES over the runs is within its 95 % interval, `interval`
    that of messages [s].
    """
    tight, laisn = (missions.where(arm=arm) for arm in ("tight", "laisn-2"))
    error, laisn_error = (
        cells.values_by_run("e_p_mean_m").mean(axis=0) for cells in (tight, laisn)
    )
    rms = _rms_of_missions(tight)
    laisn_rms = _rms_of_missions(laisn)
    nees = tight.values_by_run("nees").mean(axis=0)
    largest = tight.values_by_run("e_p_max_m").max(axis=0)
    locked, laisn_locked = (
        cells.values_by_run("mirror_locked").sum(axis=0) for cells in (tight, laisn)
    )
    return [
        {
            "case": row.get("case"),
            "route": row["scenario"],
            "interval": row.get(MESSAGE_INTERVAL),
            "error": float(error[i]),
            "laisn": float(laisn_error[i]),
            "ratio": float(error[i] / laisn_error[i]),
            "rms": float(rms[i]),
            "over_bound": row["bound"] and float(rms[i] / row["bound"]),
            "bound_over_laisn": row["bound"] and float(row["bound"] / laisn_rms[i]),
            "largest": float(largest[i]),
            "nees": float(nees[i]),
            "inside": row["nees_inside"],
            "mirror_locked": int(locked[i]),
            "laisn_mirror_locked": int(laisn_locked[i]),
        }
        for i, row in enumerate(tight.rows)
    ]


def median_ratio(missions: Cells) -> Interval:
    """Ratio of mean E_P to LAISN-2's of the mission in the middle, with the 95 % limits of that
    mission over its runs; of an even number of missions, the mean of the two in the middle, limits
    too.
    """
    tight, laisn = (
        missions.where(arm=arm).values_by_run("e_p_mean_m") for arm in ("tight", "laisn-2")
    )
    ratios = sorted(ratio_intervals(tight, laisn), key=lambda ratio: ratio.value)
    # of an odd number both are the one in the middle
    low, high = ratios[(len(ratios) - 1) // 2], ratios[len(ratios) // 2]
    return Interval(*np.mean([low, high], axis=0).tolist())


def mean_of(values: Floats) -> Interval:
    """Mean over R runs of m missions, shape (R, m), with limits over runs."""
    return mean_interval(values.mean(axis=1))


def mission_findings(key: str, missions: Cells) -> dict[str, Finding]:
    """Findings of some missions together, their names ending in `key`."""
    figures = figures_of(missions)
    tight, laisn = (missions.where(arm=arm) for arm in ("tight", "laisn-2"))
    missions_text = f"{len(figures)} missions"
    runs = tight.values_by_run("run").size
    column = {name: [mission[name] for mission in figures] for name in figures[0]}
    meaning = "share of instants whose mean eᵀP⁻¹e is within its 95 % χ² interval"
    locked = "locked on the mirror image"
    findings = {
        "ratio": interval_finding(
            median_ratio(missions), f"mean E_P over LAISN-2's, median of {missions_text}, 95 %"
        ),
        "worst": plain_finding(max(column["ratio"]), f"the same, largest of {missions_text}"),
        "error": interval_finding(
            mean_of(tight.values_by_run("e_p_mean_m")),
            f"mean E_P, mean of {missions_text}, 95 %",
            "m",
        ),
        "laisn-2": interval_finding(
            mean_of(laisn.values_by_run("e_p_mean_m")),
            f"of LAISN-2, mean of {missions_text}, 95 %",
            "m",
        ),
        "largest": plain_finding(max(column["largest"]), f"largest E_P of {missions_text}", "m"),
        "nees": interval_finding(
            mean_of(tight.values_by_run("nees")),
            f"mean eᵀP⁻¹e, mean of {missions_text}, 95 %; right: 2",
        ),
        "nees-least": plain_finding(min(column["nees"]), f"smallest of {missions_text}"),
        "nees-most": plain_finding(max(column["nees"]), f"largest of {missions_text}"),
        "inside": plain_finding(float(np.mean(column["inside"])), meaning),
        # `nis` sums two squares; half of it is that of one range
        "nis": interval_finding(
            mean_of(0.5 * tight.values_by_run("nis")),
            f"squared residual of a range, mean of {missions_text}; right: 1",
        ),
        "mirror-locked": share_finding(
            tight.values_by_run("mirror_locked"), f"share of runs {locked}, 95 %"
        ),
        "mirror-locked-runs": plain_finding(
            sum(column["mirror_locked"]), f"runs {locked} of {runs}"
        ),
        "mirror-locked-laisn-2": share_finding(
            laisn.values_by_run("mirror_locked"), f"share of LAISN-2's runs {locked}, 95 %"
        ),
    }
    smoothed = [row.get("bound_smoothed_rms_m") for row in tight.rows]
    if None not in smoothed:
        ratios = [
            bound / row["bound_rms_m"] for bound, row in zip(smoothed, tight.rows, strict=True)
        ]
        findings["smoothing"] = median_finding(
            ratios, f"bound of smoothing over that of filtering, median of {missions_text}"
        )
    if None not in column["over_bound"]:
        findings["bound"] = median_finding(
            column["over_bound"], f"RMS E_P over the bound, median of {missions_text}"
        )
        findings["least"] = median_finding(
            column["bound_over_laisn"],
            f"the bound over LAISN-2's RMS E_P, median of {missions_text}",
        )
        findings["bound-worst"] = plain_finding(
            max(column["over_bound"]), f"the same, largest of {missions_text}"
        )
    return {f"{name} {key}": finding for name, finding in findings.items()}


def clock_findings(missions: Cells) -> dict[str, Finding]:
    """Findings of an unknown clock before the leader's first turn, where it is not observable,
    and after it.
    """
    findings = {}
    first_turn_s = float(library_route("L").time[1])
    pairs = [
        [missions.where(scenario=route, case=case).steps[0] for case in ("unknown", "exact")]
        for route in dict.fromkeys(row["scenario"] for row in missions.rows)
    ]
    missions_text = f"{len(pairs)} missions"
    for phase, begin_s, end_s in (
        ("before", 0.0, first_turn_s),
        ("after", first_turn_s + SETTLED_S, np.inf),
    ):
        ratios: dict[str, list[float]] = {"e_p_mean_m": [], "bound_m": []}
        for pair in pairs:
            (in_phase,) = np.nonzero(
                (pair[0]["time_s"] > begin_s + 0.01) & (pair[0]["time_s"] < end_s + 0.01)
            )
            for name, values in ratios.items():
                pair_values = [steps[name][in_phase].astype(np.float64) for steps in pair]
                average: Callable[[Floats], np.float64] = _rms_of if name == "bound_m" else np.mean
                unknown, exact = map(average, pair_values)
                values.append(float(unknown / exact))
        errors = ratios["e_p_mean_m"]
        bounds = ratios["bound_m"]
        meaning = (
            f"mean E_P with an unknown clock over that with exact ones, {phase} the leader's "
            "first turn"
        )
        findings[f"clock {phase}"] = median_finding(errors, f"{meaning}, median of {missions_text}")
        findings[f"clock-worst {phase}"] = plain_finding(
            max(errors), f"the same, largest of {missions_text}"
        )
        findings[f"clock-bound {phase}"] = median_finding(
            bounds, f"RMS of the bound likewise, median of {missions_text}"
        )
        findings[f"clock-bound-worst {phase}"] = plain_finding(
            max(bounds), f"the same, largest of {missions_text}"
        )
    return findings


def plain_filter_findings(key: str, missions: Cells) -> dict[str, Finding]:
    """Findings of a plain extended Kalman filter, and of the tightly coupled navigator on the
    same noise.
    """
    ekf, tight = (missions.where(arm=arm) for arm in ("ekf", "tight"))
    missions_text = f"{len(ekf.rows)} missions"
    meaning = "mean E_P of the tightly coupled navigator over a plain EKF's"
    tight_errors = tight.values_by_run("e_p_mean_m")
    ekf_errors = ekf.values_by_run("e_p_mean_m")
    locked = ekf.values_by_run("mirror_locked")
    total_ratio = ratio_intervals(
        tight_errors.sum(axis=1, keepdims=True), ekf_errors.sum(axis=1, keepdims=True)
    )[0]
    findings = {
        f"ekf {key}": interval_finding(
            mean_of(ekf_errors), f"mean E_P of a plain EKF, mean of {missions_text}, 95 %", "m"
        ),
        f"over-ekf {key}": interval_finding(total_ratio, f"{meaning}, {missions_text}, 95 %"),
        f"ekf-nees {key}": interval_finding(
            mean_of(ekf.values_by_run("nees")),
            f"mean eᵀP⁻¹e of a plain EKF, {missions_text}, 95 %; right: 2",
        ),
        f"ekf-mirror-locked {key}": share_finding(
            locked, "share of a plain EKF's runs locked on the mirror image, 95 %"
        ),
    }
    for row, mean, ratio in zip(
        ekf.rows, ekf_errors.T, ratio_intervals(tight_errors, ekf_errors), strict=True
    ):
        findings[f"over-ekf {key} {row['scenario']}"] = interval_finding(ratio, f"{meaning}, 95 %")
        findings[f"ekf {key} {row['scenario']}"] = interval_finding(
            mean_interval(mean), "mean E_P of a plain EKF, 95 %", "m"
        )
    return findings


def mirror_lock_findings(key: str, mission: Cells) -> dict[str, Finding]:
    """Findings of many runs of one mission that were flown for their mirror locks alone."""
    tight, laisn = (
        mission.where(arm=arm).values_by_run("mirror_locked") for arm in ("tight", "laisn-2")
    )
    return {
        f"many-runs {key}": plain_finding(tight.size, "runs"),
        f"many {key}": share_finding(tight, "share of runs locked on the mirror image, 95 %"),
        f"many-mirror-locked {key}": plain_finding(
            int(tight.sum()), "runs locked on the mirror image"
        ),
        f"many-laisn-2 {key}": share_finding(
            laisn, "share of LAISN-2's runs locked on the mirror image, 95 %"
        ),
    }


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Findings of all parts of the study."""
    parts = {name: missions_of(part_results) for name, part_results in outcomes.items()}
    study = outcomes["cases"].plan.study
    seed = study.file.seed
    runs = study.runs
    findings = {
        "seed": plain_finding(seed, "of all noise"),
        "runs": plain_finding(runs, "runs of each mission of G1 to G7"),
    }
    for key, missions in parts["cases"].by("case", MESSAGE_INTERVAL).items():
        findings |= mission_findings(key, missions)
        if missions.where(arm="ekf").rows:
            findings |= plain_filter_findings(key, missions)
    # the bound is that of the sensors, which stay as they are
    bound_of_route = {
        row["scenario"]: row["bound"]
        for row in parts["cases"].where(case="G1", **{MESSAGE_INTERVAL: 5.0}).rows
    }
    sigma = parts["sigma"]
    parts["sigma"] = sigma._replace(
        rows=[row | {"bound": bound_of_route[row["scenario"]]} for row in sigma.rows]
    )
    for part, name in (
        ("sea", "case"),
        ("wrong", "case"),
        ("offset", "leader.middle_offset_m"),
        ("sigma", "case"),
    ):
        for key, missions in parts[part].by(name).items():
            findings |= mission_findings(f"{part} {key}", missions)
    findings |= clock_findings(parts["clock"])
    for key, mission in parts["weave"].by("case", "scenario").items():
        (rms,) = _rms_of_missions(mission.where(arm="tight")).tolist()
        row, *_ = mission.rows
        findings[f"rms {key}"] = plain_finding(rms, "RMS E_P with two transmitters", "m")
        findings[f"rms-bound {key}"] = plain_finding(row["bound"], "its bound", "m")
    for key, mission in parts["locks"].by("case", "scenario").items():
        findings |= mirror_lock_findings(key, mission)
    return findings
