"""Followers that steer by their own estimates, on all routes: `python -m experiments.closed_loop.study`.

Flies the leader with eight followers and writes `out/closed-loop/results.json`.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np

from experiments.campaign import campaign
from experiments.campaign.campaign import Design
from experiments.campaign.store import Record
from experiments.findings import FILE, Finding, Findings, of, plain, record
from experiments.flight.library import ROUTES
from experiments.flight.swarm import simulate_swarm
from experiments.intervals import proportion
from experiments.route_keeping.study import scenario
from laisn import metrics
from laisn.settings import Variant
from sim.assembly import routes_of
from sim.scenario.settings import Scenario
from sim.tracking import off_place

COMMAND = "python -m experiments.closed_loop.study"
MODULES = ("experiments.closed_loop.study",)
VARIANTS: tuple[Variant, ...] = ("laisn-2", "laisn-3-1", "laisn-3-2")
RUNS = range(5)
LOST_M = 50.0
"""A follower that ends farther than this from its place is called lost [m]."""


def steering(run: int, variant: Variant, steers_by: str) -> Scenario:
    """Leader and a follower on each route."""
    mission = scenario()
    return mission.model_copy(
        update={
            "run": run,
            "navigation": mission.navigation.model_copy(update={"variant": variant}),
            "followers": tuple(f.model_copy(update={"steers_by": steers_by}) for f in mission.followers),
        }
    )


def measure(run: int, variant: Variant, steers_by: str) -> list[Record]:
    """Mean E_P, RMS distance off its place, and that distance at the end, of each follower, [m]."""
    mission = steering(run, variant, steers_by)
    trajectory, beliefs, _ = simulate_swarm(mission)
    routes, rows = routes_of(mission), []
    for i, follower in enumerate(mission.followers):
        hydrophone = trajectory.site_path(f"{follower.name}/hydrophone")[1:, :2]
        error = metrics.position_errors(beliefs[1:, i, :2], hydrophone)
        off = off_place(routes[i + 1], trajectory.time, trajectory.position[:, i + 1, :2])
        rms = float(np.sqrt(np.mean(off**2)))
        rows.append({"error": float(error.mean()), "off": rms, "end": float(off[-1])})
    return rows


def findings_of(found: Mapping[tuple[Variant, str], Sequence[Sequence[Record]]]) -> Findings:
    """The record: of each variant and way of steering the rows of all followers, run by run."""
    named: dict[str, Finding] = {"runs": plain(len(RUNS), "runs of each route"), "lost-from": plain(LOST_M, "", "m")}
    for variant in VARIANTS:
        ends = []
        for i, route in enumerate(ROUTES):
            told, own = ([rows[i] for rows in found[variant, by]] for by in ("truth", "estimate"))
            far = [row["end"] for row in own]
            lost = sum(end > LOST_M for end in far)
            ends += far
            error, off = median(row["error"] for row in told), median(row["off"] for row in own)
            named[f"error {variant} {route}"] = plain(error, "mean E_P, steering by the truth; median of runs", "m")
            named[f"off {variant} {route}"] = plain(off, "RMS off its place, by its estimate; median of runs", "m")
            named[f"lost {variant} {route}"] = of(proportion(lost, len(own)), "share of runs lost, 95 %")
            named[f"lost-runs {variant} {route}"] = plain(lost, "runs lost")
        lost = sum(end > LOST_M for end in ends)
        named[f"lost {variant}"] = of(proportion(lost, len(ends)), "share of missions lost, 95 %")
        named[f"lost-runs {variant}"] = plain(lost, "missions lost")
        named["missions"] = plain(len(ends), "missions of each variant")
    return record("closed-loop", COMMAND, MODULES, named)


def run(folder: Path) -> None:
    """Fly all runs, or those that are missing, and write the record into a folder."""
    ways = [(variant, by) for variant in VARIANTS for by in ("estimate", "truth")]
    tasks = {(*way, run): partial(measure, run, *way) for way in ways for run in RUNS}
    ahead = partial(simulate_swarm, steering(0, VARIANTS[0], "estimate").first_messages)
    flown = campaign.fly(Design(tasks=tasks, what="fleets", ahead=ahead), folder).tasks
    findings_of({way: [flown[*way, run] for run in RUNS] for way in ways}).write(folder / FILE)


if __name__ == "__main__":
    run(Path("out") / "closed-loop")
