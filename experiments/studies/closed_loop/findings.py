"""What the study found, from the rows of all followers of its arms, run by run."""

from collections.abc import Mapping

import numpy as np

from experiments.flight.library import ROUTES
from experiments.study.run import StudyResults
from reports.findings import Finding, median_finding, plain_finding, share_finding

FAR_OFF_M = 50.0  # A follower that ends farther than this from its place is called lost [m]


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Of each route (a follower) and navigator, steered by the truth, by its estimate, and so in
    currents.
    """
    arms = outcomes["study"].cells.by("arm")
    findings: dict[str, Finding] = {"lost-from": plain_finding(FAR_OFF_M, "", "m")}
    for name in dict.fromkeys(arm.rpartition(" ")[0] for arm in arms):
        by_truth, by_estimate, in_current = (
            arms[f"{name} {guidance}"] for guidance in ("truth", "estimate", "current")
        )
        is_far_off = by_estimate.values_by_run("track_error_end_m") > FAR_OFF_M
        is_lost_in_current = in_current.values_by_run("track_error_end_m") > FAR_OFF_M
        error = by_truth.values_by_run("e_p_mean_m")
        track_error = by_estimate.values_by_run("track_error_rms_m")
        error_in_current = in_current.values_by_run("track_error_rms_m")
        findings |= {
            "runs": plain_finding(len(is_far_off), "runs of each route"),
            "missions": plain_finding(is_far_off.size, "missions of each navigator"),
        }
        for i, route in enumerate(ROUTES):
            findings |= {
                f"error {name} {route}": median_finding(
                    error[:, i], "mean E_P, steering by the truth; median of runs", "m"
                ),
                f"off {name} {route}": median_finding(
                    track_error[:, i], "RMS off its place, by its estimate; median of runs", "m"
                ),
                f"lost {name} {route}": share_finding(is_far_off[:, i], "share of runs lost, 95 %"),
                f"lost-runs {name} {route}": plain_finding(
                    int(is_far_off[:, i].sum()), "runs lost"
                ),
            }
        for key, lost, words in (
            (name, is_far_off, ""),
            (f"current {name}", is_lost_in_current, " in currents"),
        ):
            findings[f"lost {key}"] = share_finding(lost, f"share of missions lost{words}, 95 %")
            findings[f"lost-runs {key}"] = plain_finding(int(lost.sum()), f"missions lost{words}")
        findings[f"off current {name}"] = median_finding(
            error_in_current, "RMS off its place, in currents; median of missions", "m"
        )
        worst = float(np.median(error_in_current, axis=0).max())
        findings[f"worst current {name}"] = plain_finding(
            worst, "the same; median of runs on the worst route", "m"
        )
    return findings
