"""What the study found, from the rows of all followers of its arms, run by run."""

from collections.abc import Mapping

import numpy as np

from experiments.findings import Finding, of, plain
from experiments.flight.library import ROUTES
from experiments.intervals import proportion
from experiments.study.run import Outcomes

LOST_M = 50.0
"""A follower that ends farther than this from its place is called lost [m]."""


def findings_of(outcomes: Mapping[str, Outcomes]) -> dict[str, Finding]:
    """Of each route (a follower) and navigator, steered by the truth, by its estimate, and so in currents."""
    arms = outcomes["study"].cells.by("arm")
    named: dict[str, Finding] = {"lost-from": plain(LOST_M, "", "m")}
    for name in dict.fromkeys(arm.rpartition(" ")[0] for arm in arms):
        by_truth, own, swept = (arms[f"{name} {by}"] for by in ("truth", "estimate", "current"))
        far, adrift = (cells.runs("track_error_end_m") > LOST_M for cells in (own, swept))
        error = np.median(by_truth.runs("e_p_mean_m"), axis=0).tolist()
        off, typical = np.median(own.runs("track_error_rms_m"), axis=0).tolist(), swept.runs("track_error_rms_m")
        named |= {
            "runs": plain(len(far), "runs of each route"),
            "missions": plain(far.size, "missions of each navigator"),
        }
        for i, route in enumerate(ROUTES):
            lost = int(far[:, i].sum())
            named[f"error {name} {route}"] = plain(error[i], "mean E_P, steering by the truth; median of runs", "m")
            named[f"off {name} {route}"] = plain(off[i], "RMS off its place, by its estimate; median of runs", "m")
            named[f"lost {name} {route}"] = of(proportion(lost, len(far)), "share of runs lost, 95 %")
            named[f"lost-runs {name} {route}"] = plain(lost, "runs lost")
        for key, lost_runs, words in ((name, far, ""), (f"current {name}", adrift, " in currents")):
            lost = int(lost_runs.sum())
            named[f"lost {key}"] = of(proportion(lost, lost_runs.size), f"share of missions lost{words}, 95 %")
            named[f"lost-runs {key}"] = plain(lost, f"missions lost{words}")
        what = "RMS off its place, in currents; median of missions"
        named[f"off current {name}"] = plain(float(np.median(typical)), what, "m")
        worst = float(np.median(typical, axis=0).max())
        named[f"worst current {name}"] = plain(worst, "the same; median of runs on the worst route", "m")
    return named
