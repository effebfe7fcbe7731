"""Runs to look at: the worst and the median run of every place, and the commands that fly them alone."""

import math

from experiments.study.charts import setting_text
from experiments.study.estimate import Place, Results
from experiments.study.file import METRIC
from experiments.study.plan import Entry, Plan
from laisn.failure import LaisnError

_MOST_COMMANDS = 400


def point_text(plan: Plan, point: int) -> str:
    """A point's factors and values."""
    return ", ".join(setting_text(key, value) for key, value in plan.points[point].items())


def place_text(plan: Plan, place: Place) -> str:
    """A place in words: its point, and arm and follower where there are several."""
    parts = [point_text(plan, place[0])] if plan.points[place[0]] else []
    parts += [f"arm {place[1]}"] if len(plan.arms) > 1 else []
    parts += [place[2]] if len(plan.followers) > 1 else []
    return ", ".join(parts) or "the study's only point"


def notable(plan: Plan, results: Results, place: Place) -> tuple[tuple[int, int], tuple[int, int]]:
    """Sea and run of the worst and of the median run of a place, by the report's metric if single runs have it."""
    metric = plan.study.report.metric
    runs = results.by_run(place, metric) or results.by_run(place, METRIC)
    if runs is None:
        raise LaisnError(f"the runs of {place_text(plan, place)} have no {METRIC}")
    seas = [row["sea"] for row in results.rows[place]]
    # a run that contact ended has no value, and is the first to look at
    every = sorted(
        (math.inf if math.isnan(value) else value, sea, run)
        for sea, values in zip(seas, runs, strict=True)
        for run, value in enumerate(values.tolist())
    )
    worst, median = every[-1], every[(len(every) - 1) // 2]
    return worst[1:], median[1:]


def entry_at(plan: Plan, place: Place, sea: int) -> Entry:
    """The entry of a place and a sea."""
    return next(e for e in plan.entries if (e.point, e.arm, e.sea) == (place[0], place[1], sea))


def worst_entry(plan: Plan, results: Results) -> tuple[Entry, int, str]:
    """The scenario, run and follower of the worst run of the worst place."""

    def size(place: Place) -> float:
        value = results.estimate(place, plan.study.report.metric).value
        return -math.inf if math.isnan(value) else value

    place = max(results.rows, key=size)
    (sea, run), _ = notable(plan, results, place)
    return entry_at(plan, place, sea), run, place[2]


def commands(plan: Plan, results: Results) -> str:
    """For every place the commands that fly its worst and its median run alone."""
    entries = {(entry.point, entry.arm, entry.sea): entry for entry in plan.entries}
    lines = []
    for place in list(results.rows)[:_MOST_COMMANDS]:
        for which, (sea, run) in zip(("worst", "median"), notable(plan, results, place), strict=True):
            told = f" of sea {sea}" if plan.study.seas > 1 else ""
            lines.append(f"# {place_text(plan, place)}: {which} run, {run}{told}")
            lines.append(entries[place[0], place[1], sea].command(plan.study.scenario, run))
    return "\n".join(lines)
