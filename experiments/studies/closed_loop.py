"""Followers that steer by their own estimates, on all routes: `python -m experiments.studies.closed_loop`.

Flies the leader with eight followers and writes `out/closed-loop/results.json`.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median

from experiments.campaign import campaign
from experiments.campaign.campaign import Design
from experiments.campaign.store import Record
from experiments.findings import FILE, Finding, Findings, of, plain, record
from experiments.flight.library import ROUTES
from experiments.intervals import proportion
from experiments.studies.route_keeping import scenario
from experiments.study.measure import records_of_run
from sim.closed_loop import simulate_closed_loop
from sim.scenario.settings import Scenario

COMMAND = "python -m experiments.studies.closed_loop"
MODULES = ("experiments.studies.closed_loop",)
NAVIGATORS: dict[str, tuple[str, int]] = {
    "laisn-2": ("laisn-2", 2),
    "laisn-3-1": ("laisn-3-1", 3),
    "laisn-3-2": ("laisn-3-2", 3),
    "tight-2": ("tight", 2),
    "tight-3": ("tight", 3),
}
"""Variant and number of transmitters of each."""
WAYS = ("estimate", "truth", "current")
"""By the estimate and by the truth in calm water, and by the estimate in a current."""
RUNS = range(60)
CURRENT_M_S = 0.5
"""Greatest current: of five runs one after the other each has a fifth more, from another direction."""
_GOLDEN_DEG = 137.508
LOST_M = 50.0
"""A follower that ends farther than this from its place is called lost [m]."""


def steering(run: int, navigator: str, way: str) -> Scenario:
    """Leader and a follower on each route, steered in one of WAYS; in a current the tight navigator estimates it."""
    mission, (variant, transmitters) = scenario(), NAVIGATORS[navigator]
    flows, guidance_position = way == "current", "truth" if way == "truth" else "estimate"
    assume = mission.navigation.assume.model_copy(update={"transmitters": transmitters, "current": flows})
    speed = CURRENT_M_S * (1 + run % 5) / 5 if flows else 0.0
    current = {"current_speed_m_s": speed, "current_direction_deg": run * _GOLDEN_DEG % 360}
    return mission.model_copy(
        update={
            "run": run,
            "ocean": mission.ocean.model_copy(update=current),
            "navigation": mission.navigation.model_copy(update={"variant": variant, "assume": assume}),
            "followers": tuple(
                f.model_copy(update={"guidance_position": guidance_position}) for f in mission.followers
            ),
        }
    )


def findings_of(found: Mapping[tuple[str, str], Sequence[Sequence[Record]]]) -> Findings:
    """The record: of each navigator and one of WAYS the rows of all followers, run by run."""
    runs = len(next(iter(found.values())))
    named: dict[str, Finding] = {"runs": plain(runs, "runs of each route"), "lost-from": plain(LOST_M, "", "m")}
    for name in NAVIGATORS:
        ends = []
        for i, route in enumerate(ROUTES):
            by_truth, own = ([rows[i] for rows in found[name, by]] for by in ("truth", "estimate"))
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
        flown = [row for rows in found[name, "current"] for row in rows]
        off = [median(rows[i]["track_error_rms_m"] for rows in found[name, "current"]) for i in range(len(ROUTES))]
        lost = sum(row["track_error_end_m"] > LOST_M for row in flown)
        typical = median(row["track_error_rms_m"] for row in flown)
        named[f"off current {name}"] = plain(typical, "RMS off its place, in currents; median of missions", "m")
        named[f"worst current {name}"] = plain(max(off), "the same; median of runs on the worst route", "m")
        named[f"lost current {name}"] = of(proportion(lost, len(flown)), "share of missions lost in currents, 95 %")
        named[f"lost-runs current {name}"] = plain(lost, "missions lost in currents")
    return record("closed-loop", COMMAND, MODULES, named)


def run(folder: Path) -> None:
    """Fly all runs, or those that are missing, and write the record into a folder."""
    ways = [(name, way) for name in NAVIGATORS for way in WAYS]
    tasks = {(*way, run): partial(records_of_run, steering(run, *way), run) for way in ways for run in RUNS}
    ahead = partial(simulate_closed_loop, steering(0, "laisn-2", "estimate").first_messages)
    flown = campaign.fly(Design(tasks=tasks, what="fleets", ahead=ahead), folder).tasks
    findings_of({way: [flown[*way, run] for run in RUNS] for way in ways}).write(folder / FILE)


if __name__ == "__main__":
    run(Path("out") / "closed-loop")
