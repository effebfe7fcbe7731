"""The page of a study: values, tables and figures of its template, `page.md.j2`, and the runs to
look at.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial

from experiments.flight.library import fly_line
from experiments.intervals import Interval
from experiments.pages import page as pages
from experiments.pages.page import Cell, Code, Film, Page, Text, number, words
from experiments.study import charts
from experiments.study.design import is_number
from experiments.study.estimate import Place, Results, digits, main_effects, shown
from experiments.study.file import METRIC
from experiments.study.measure import METRICS
from experiments.study.plan import Entry, Plan, many, varied

_MOST_COMMANDS = 400
_MOST_ROWS = 60  # places in a table; of more, those of the lowest and highest values are listed
_TONES = {"lower": "yes", "higher": "no", "undecided": "maybe", "same": ""}
_COLUMNS = (
    METRIC,
    "e_p_p95_m",
    "e_b_mean_deg",
    "mirror_locked",
    "track_error_rms_m",
    "depth_error_rms_m",
    "closest_approach_m",
    "energy_j",
)
"""Columns of the page's table beside the metric of the report."""


def _place_text(plan: Plan, place: Place) -> str:
    """A place in words: its point, and arm and follower where there are several."""
    parts = [charts.point_text(plan.points[place[0]])] if plan.points[place[0]] else []
    parts += [f"arm {place[1]}"] if len(plan.arms) > 1 else []
    parts += [place[2]] if len(plan.followers) > 1 else []
    return ", ".join(parts) or "the study's only point"


def _cell(interval: Interval) -> Cell:
    return Cell(text=shown(interval), sort=number(interval.value).sort)


def _verdict(apart: Interval, value: float, base: float) -> str:
    """Whether an arm is lower or higher than the first one, by the whole interval; "same" if no
    shown digit differs.
    """
    decided = apart.high < 0 or apart.low > 0
    if digits(value) == digits(base) and (decided or apart.value == 0):
        return "same"
    if not decided:
        return "undecided"
    return "lower" if apart.value < 0 else "higher"


def notable(plan: Plan, results: Results, place: Place) -> tuple[tuple[int, int], tuple[int, int]]:
    """Realization and run of the worst and the median run of a place, by the report's metric if
    single runs have it.
    """
    runs = (
        results.by_run(place, plan.study.file.report.metric) or results.by_run(place, METRIC) or []
    )
    # a run that contact ended has no value, and is the first to look at
    every = sorted(
        (math.inf if math.isnan(value) else value, row["realization"], int(run))
        for row, lists, values in zip(results.rows[place], results.runs[place], runs, strict=True)
        for run, value in zip(lists["run"], values.tolist(), strict=True)
    )
    return every[-1][1:], every[(len(every) - 1) // 2][1:]


def worst_entry(plan: Plan, results: Results) -> tuple[Entry, int, str]:
    """The scenario, run and follower of the worst run of the worst place."""

    def size(place: Place) -> float:
        value = results.estimate(place, plan.study.file.report.metric).value
        return -math.inf if math.isnan(value) else value

    place = max(results.rows, key=size)
    (realization, run), _ = notable(plan, results, place)
    return plan.by_place[place[0], place[1], realization], run, place[2]


def commands(plan: Plan, results: Results) -> str:
    """For every place the commands that fly its worst and its median run alone."""
    lines = []
    for place in list(results.rows)[:_MOST_COMMANDS]:
        for which, (realization, run) in zip(
            ("worst", "median"), notable(plan, results, place), strict=True
        ):
            realization_text = (
                f" of realization {realization}" if plan.study.file.realizations > 1 else ""
            )
            lines.append(f"# {_place_text(plan, place)}: {which} run, {run}{realization_text}")
            entry = plan.by_place[place[0], place[1], realization]
            measured = {key: results.rows[place][0][key] for key in entry.measured}
            lines.append(fly_line(entry.source, entry.settings_at(run) | measured, run))
    return "\n".join(lines)


def page_of(
    plan: Plan, results: Results, failures: Mapping[str, list[Entry]], films: Sequence[Film] = ()
) -> Page:
    """The page of a study; `failures` are entries that could not be flown, by what happened,
    `films` its worst run.
    """
    study = plan.study
    report = plan.study.file.report
    factors = varied(plan)
    layout = charts.layout_of(plan)
    metric = METRICS[report.metric]
    found = {place: results.estimate(place, report.metric) for place in results.rows}
    known = sorted(
        (place for place in found if not math.isnan(found[place].value)),
        key=lambda p: found[p].value,
    )
    apart = results.differences(plan.arms[0], report.metric)
    said = {
        p: _verdict(d, found[p].value, found[p[0], plan.arms[0], p[2]].value)
        for p, d in apart.items()
    }
    half = _MOST_ROWS // 2
    effects = main_effects(plan, results, report.metric)
    listed = list(results.rows) if len(results.rows) <= _MOST_ROWS else known[:half] + known[-half:]
    across = layout.against if layout.against in factors else "".join(factors[:1])
    factorial = study.file.design == "factorial"
    asked = any((report.against, report.lines, report.panels))
    calm = all(entry.scenario.ocean.waves.kind == "none" for entry in plan.entries)
    values = {
        "plan": plan,
        "study": study,
        "results": results,
        "failures": failures,
        "charts": charts,
        "layout": layout,
        "metrics": METRICS,
        "metric": metric,
        "columns": [c for c in _COLUMNS if c != report.metric],
        "words": words,
        "many": many,
        "place_text": partial(_place_text, plan),
        "cell": _cell,
        "factor_cell": lambda value: Cell(
            text=charts.value_text(value), sort=value if is_number(value) else ""
        ),
        "verdict": said.get,
        "tones": _TONES,
        "listed_places": listed,
        "listed": lambda values: ", ".join(map(charts.value_text, values)),
        "changes": lambda settings: ", ".join(
            f"{key} = {charts.value_text(v)}" for key, v in settings.items()
        ),
        "found": found,
        "apart": apart,
        "effects": effects,
        "effects_first": bool(effects) and len(factors) > 2,
        "extremes": [
            (place, shown(found[place], metric.unit)) for place in known[:1] + known[1:][-1:]
        ],
        "verdicts": {
            a: Counter(text for p, text in said.items() if p[1] == a) for a in plan.arms[1:]
        },
        "question": Text(text=study.file.question.strip()),
        "factorial": factorial,
        "has_lines": factorial and (asked or len(factors) < 2),
        "map_axes": [across, *(f for f in factors if f != across)][:2]
        if factorial and len(factors) > 1
        else [],
        "idle": [draw.key for draw in study.draws if calm and draw.key.startswith("ocean.waves.")],
        "runs": study.runs * sum(len(entry.scenario.followers) for entry in plan.entries),
        "films": films,
        "commands": Code(
            text=commands(plan, results),
            title="Worst and median run of every place",
            folded=len(results.rows) > 4,
        ),
    }
    facts = [("scenario", ", ".join(study.scenarios))]
    if study.arms:
        facts.append(("arms", ", ".join(plan.arms)))
    facts += [
        ("seed", str(min(row["seed"] for rows in results.rows.values() for row in rows))),
        ("runs", str(study.runs)),
        ("realizations", str(study.file.realizations)),
        ("repeat it", "laisn study study.toml, the file in this folder"),
    ]
    return pages.page_of("experiments.study", facts, values)
