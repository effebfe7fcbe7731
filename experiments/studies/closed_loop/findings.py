"""What the study found, from the rows of all followers of its arms, run by run."""

from collections.abc import Mapping
from statistics import median

from experiments.findings import Finding, of, plain
from experiments.flight.library import ROUTES
from experiments.intervals import proportion
from experiments.study.run import Outcomes

LOST_M = 50.0
"""A follower that ends farther than this from its place is called lost [m]."""


def findings_of(outcomes: Mapping[str, Outcomes]) -> dict[str, Finding]:
    """Of each route (a follower) and navigator, steered by the truth, by its estimate, and so in currents."""
    found = outcomes["study"].runs_by()
    runs = len(next(iter(found.values())))
    named: dict[str, Finding] = {"runs": plain(runs, "runs of each route"), "lost-from": plain(LOST_M, "", "m")}
    for name in dict.fromkeys(arm.rpartition(" ")[0] for arm in found):
        ends = []
        for i, route in enumerate(ROUTES):
            by_truth, own = ([rows[i] for rows in found[f"{name} {by}"]] for by in ("truth", "estimate"))
            far = [row["track_error_end_m"] for row in own]
            lost = sum(end > LOST_M for end in far)
            ends += far
            error, off = median(row["e_p_mean_m"] for row in by_truth), median(row["track_error_rms_m"] for row in own)
            named[f"error {name} {route}"] = plain(error, "mean E_P, steering by the truth; median of runs", "m")
            named[f"off {name} {route}"] = plain(off, "RMS off its place, by its estimate; median of runs", "m")
            named[f"lost {name} {route}"] = of(proportion(lost, len(own)), "share of runs lost, 95 %")
            named[f"lost-runs {name} {route}"] = plain(lost, "runs lost")
        lost = sum(end > LOST_M for end in ends)
        named[f"lost {name}"] = of(proportion(lost, len(ends)), "share of missions lost, 95 %")
        named[f"lost-runs {name}"] = plain(lost, "missions lost")
        named["missions"] = plain(len(ends), "missions of each navigator")
        swept = found[f"{name} current"]
        flown = [row for rows in swept for row in rows]
        off = [median(rows[i]["track_error_rms_m"] for rows in swept) for i in range(len(ROUTES))]
        lost = sum(row["track_error_end_m"] > LOST_M for row in flown)
        typical = median(row["track_error_rms_m"] for row in flown)
        named[f"off current {name}"] = plain(typical, "RMS off its place, in currents; median of missions", "m")
        named[f"worst current {name}"] = plain(max(off), "the same; median of runs on the worst route", "m")
        named[f"lost current {name}"] = of(proportion(lost, len(flown)), "share of missions lost in currents, 95 %")
        named[f"lost-runs current {name}"] = plain(lost, "missions lost in currents")
    return named
