"""What the study found, from the rows of all followers of its arms, run by run."""

from collections.abc import Mapping

import numpy as np

from experiments.flight.library import ROUTES
from experiments.study.run import StudyResults
from reports.findings import Finding, median_finding, plain_finding, share_finding

LOST_FROM_M = 50.0  # a follower that ends farther than this from its place is called lost [m]


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Findings of each navigator and route: steered by the truth, by its own estimate, and by its
    estimate in currents.
    """
    arms = outcomes["study"].cells.by("arm")
    findings: dict[str, Finding] = {"lost-from": plain_finding(LOST_FROM_M, "", "m")}
    for navigator in dict.fromkeys(arm.rpartition(" ")[0] for arm in arms):
        by_truth, by_estimate, in_current = (
            arms[f"{navigator} {guidance}"] for guidance in ("truth", "estimate", "current")
        )
        is_lost = by_estimate.values_by_run("track_error_end_m") > LOST_FROM_M
        is_lost_in_current = in_current.values_by_run("track_error_end_m") > LOST_FROM_M
        navigation_error = by_truth.values_by_run("e_p_mean_m")
        track_error = by_estimate.values_by_run("track_error_rms_m")
        track_error_in_current = in_current.values_by_run("track_error_rms_m")
        findings |= {
            "runs": plain_finding(len(is_lost), "runs of each route"),
            "missions": plain_finding(is_lost.size, "missions of each navigator"),
        }
        # each route has one follower, a column of the runs, in this order
        for i, route in enumerate(ROUTES):
            findings |= {
                f"error {navigator} {route}": median_finding(
                    navigation_error[:, i], "mean E_P, steering by the truth; median of runs", "m"
                ),
                f"off {navigator} {route}": median_finding(
                    track_error[:, i], "RMS off its place, by its estimate; median of runs", "m"
                ),
                f"lost {navigator} {route}": share_finding(
                    is_lost[:, i], "share of runs lost, 95 %"
                ),
                f"lost-runs {navigator} {route}": plain_finding(
                    int(is_lost[:, i].sum()), "runs lost"
                ),
            }
        for key, lost, words in (
            (navigator, is_lost, ""),
            (f"current {navigator}", is_lost_in_current, " in currents"),
        ):
            findings[f"lost {key}"] = share_finding(lost, f"share of missions lost{words}, 95 %")
            findings[f"lost-runs {key}"] = plain_finding(int(lost.sum()), f"missions lost{words}")
        findings[f"off current {navigator}"] = median_finding(
            track_error_in_current, "RMS off its place, in currents; median of missions", "m"
        )
        worst = float(np.median(track_error_in_current, axis=0).max())
        findings[f"worst current {navigator}"] = plain_finding(
            worst, "the same; median of runs on the worst route", "m"
        )
    return findings
