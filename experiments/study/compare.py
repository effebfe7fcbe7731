"""Flights or studies side by side on one page: `laisn compare`."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.store import Record, read_table
from experiments.flight.folder import LOG, title_of
from experiments.study.estimate import interval_text, over_runs, verdict_of, verdicts_text
from experiments.study.file import METRIC
from experiments.study.measure import METRICS, SHARES
from experiments.study.study import RESULTS, RUNS, STUDY
from laisn import metrics
from laisn.arrays import Floats
from laisn.errors import LaisnError, shortened
from reports import page as pages
from reports.figures import Line, Panel, Subplot
from reports.intervals import Interval
from reports.page import Figures, Page, number, words
from reports.style import FULL, SERIES
from sim.flight import FlightRecord, position_and_bearing_errors
from sim.log.reader import read
from sim.scenario.file import dotted
from sim.scenario.file import read as read_toml

MAX_COMPARED = len(SERIES)
_MAX_NAMED_POINTS = 3  # most points that messages name


def _differing(tables: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """Values that are not the same in all tables; one that holds nothing, such as [set], is no
    setting.
    """
    keys = dict.fromkeys(key for table in tables for key, value in table.items() if value != {})
    settings = {key: [table.get(key) for table in tables] for key in keys}
    return {
        key: values
        for key, values in settings.items()
        if any(value != values[0] for value in values)
    }


def differing(flights: Sequence[FlightRecord]) -> dict[str, list[Any]]:
    """Settings that are not the same in all flights, by key; None: a flight has no such key."""
    return _differing(
        [
            dotted(flight.scenario.model_dump(mode="json", exclude={"name", "run"}))
            for flight in flights
        ]
    )


def _summary(position: Floats, bearing: Floats) -> metrics.Summary:
    """Figures of errors at n steps from the first estimate on, all NaN without one."""
    has_estimate = np.isfinite(position)
    if not has_estimate.any():
        return metrics.Summary(*[math.nan] * len(metrics.Summary._fields))
    return metrics.summarise(position[has_estimate], bearing[has_estimate])


def _mean_difference(differences: Floats) -> float:
    """Mean over the steps at which both flights have an estimate; NaN without one."""
    finite = differences[np.isfinite(differences)]
    return float(finite.mean()) if finite.size else math.nan


def _flights(names: Sequence[str], flights: Sequence[FlightRecord]) -> dict[str, Any]:
    """What the template shows of flights."""
    errors = [position_and_bearing_errors(flight)[0] for flight in flights]
    times = [flight.trajectory.time[flight.step_index()] for flight in flights]
    parts = []
    for row, label, scale in ((0, "E_P [m]", 1.0), (1, "E_B [°]", 180.0 / math.pi)):
        flight_curves = zip(times, errors, SERIES, names, strict=False)
        lines = [
            Line(x=t, y=scale * e[row], colour=colour, name=name)
            for t, e, colour, name in flight_curves
        ]
        parts.append(Subplot(lines=lines, y_label=label, y_limits=(0.0, None)))
    curves = Panel(parts=parts, x_label="time [s]", width=FULL, height=4.4)
    summaries = [_summary(position, bearing) for position, bearing in errors]
    first = errors[0][0]
    differences = [
        _mean_difference(e - first) if e.size == first.size else math.nan for e, _ in errors
    ]
    figures = Figures(panels=[curves], legend=[*zip(SERIES, names, strict=False)])
    changed = differing(flights)
    equal = all(np.array_equal(e, first, equal_nan=True) for e, _ in errors)
    no_difference = ""
    if equal and not changed:
        no_difference = "the flights have the same settings and the same errors"
    return {
        "errors": figures,
        "rows": [*zip(names, summaries, differences, strict=True)],
        "changed": changed,
        "nothing": no_difference,
    }


Place = tuple[str, ...]
"""Settings in words that tell a place of a study, a point, arm and follower, from its others; the
same words are the same place in all studies."""


def _points_text(points: Iterable[Place]) -> str:
    texts = [", ".join(point) or "the only one" for point in points]
    omitted = (
        f" and {len(texts) - _MAX_NAMED_POINTS} more" if len(texts) > _MAX_NAMED_POINTS else ""
    )
    return f"{'; '.join(texts[:_MAX_NAMED_POINTS]) or 'none with a value'}{omitted}"


def _require_common_points(folders: Sequence[Path], values: Sequence[Mapping[Place, Any]]) -> None:
    """LaisnError naming the first study that has no point in common with the first of them."""
    for folder, points in zip(folders[1:], values[1:], strict=True):
        if not values[0].keys() & points.keys():
            raise LaisnError(
                f"{folders[0]} and {folder} have no point in common, so that nothing can be "
                f"compared; points of {folders[0]}: {_points_text(values[0])}; of {folder}: "
                f"{_points_text(points)}"
            )


def paired(folders: Sequence[Path], metric: str) -> dict[Place, list[Interval | None]]:
    """For every place of the first study: its mean, and the others' paired differences.

    Runs of the same seed and number are paired. None: a study lacks the place, or has other seeds
    or runs there. LaisnError: there is no such metric of single runs, or a study has no place in
    common with the first.
    """
    tables = [_runs_of(folder, metric) for folder in folders]
    keys = _place_keys(tables)
    values = [_values_of(table, keys, metric) for table in tables]
    _require_common_points(folders, values)
    first, *others = values
    shares = metric in SHARES
    intervals: dict[Place, list[Interval | None]] = {}
    for place, runs in first.items():
        intervals[place] = [_mean(runs, shares=shares)]
        for other in others:
            other_runs = other.get(place, {})
            if other_runs.keys() == runs.keys():
                differences = {run: value - runs[run] for run, value in other_runs.items()}
                intervals[place].append(_mean(differences, shares=shares, paired=True))
            else:
                intervals[place].append(None)
    return intervals


def _runs_of(folder: Path, metric: str) -> list[Record]:
    """The runs of a study, with the seeds of their realizations; LaisnError if they have no such
    metric.
    """
    seeds = {row["realization"]: row["seed"] for row in read_table(folder / RESULTS)}
    rows = [row | {"seed": seeds[row["realization"]]} for row in read_table(folder / RUNS)]
    if metric not in rows[0]:
        raise LaisnError(f"{folder}: its runs have no {metric!r}")
    return rows


def _place_keys(tables: Sequence[list[Record]]) -> list[str]:
    """Columns that all tables have and that distinguish places: of several values, but the same
    in all realizations.
    """
    measured = {"point", "realization", "seed", "run", "gated", *METRICS}
    shared = [
        key
        for key in tables[0][0]
        if key not in measured and all(key in table[0] for table in tables)
    ]
    return [
        key
        for key in shared
        if not any(_is_drawn(key, table) for table in tables)
        and len({repr(row[key]) for table in tables for row in table}) > 1
    ]


def _is_drawn(key: str, table: Sequence[Record]) -> bool:
    """Whether a column differs between realizations."""
    first = {row[key] for row in table if not row["realization"]}
    return len(first) < len({row[key] for row in table})


Runs = dict[tuple[int, int], float]
"""Values by seed and number of the run."""


def _values_of(table: Sequence[Record], keys: Sequence[str], metric: str) -> dict[Place, Runs]:
    values = defaultdict[Place, Runs](dict)
    for row in table:
        if row[metric] is not None:
            place = tuple(f"{key} = {row[key]}" for key in keys)
            values[place][row["seed"], row["run"]] = float(row[metric])
    return values


def _mean(runs: Runs, *, shares: bool, paired: bool = False) -> Interval:
    """Mean over runs by realization, as of `over_runs`."""
    realizations = groupby(sorted(runs.items()), key=lambda item: item[0][0])
    values = [np.array([value for _, value in seed_runs]) for _, seed_runs in realizations]
    return over_runs(values, shares=shares, paired=paired)


def _answers(
    names: Sequence[str], rows: Mapping[Place, Sequence[Interval | None]]
) -> dict[str, Counter[str]]:
    """How often each further study is lower, higher, undecided or the same as the first, at the
    places with the same runs, by its name.
    """
    answers = dict[str, Counter[str]]()
    for i, name in enumerate(names[1:], start=1):
        verdicts = Counter[str]()
        for intervals in rows.values():
            base = intervals[0]
            difference = intervals[i]
            if base is not None and difference is not None:
                verdicts[verdict_of(difference, base.value + difference.value, base.value)] += 1
        answers[name] = verdicts
    return answers


def _studies(names: Sequence[str], folders: Sequence[Path]) -> dict[str, Any]:
    """What the template shows of studies."""
    tables = [
        dotted(read_toml(folder / STUDY) | {"name": "", "question": ""}) for folder in folders
    ]
    metric_names = {table.get("report.metric", METRIC) for table in tables}
    metric = metric_names.pop() if len(metric_names) == 1 else METRIC
    rows = paired(folders, metric)
    changed = _differing(tables)
    differences = [interval for intervals in rows.values() for interval in intervals[1:]]
    comparable = [interval for interval in differences if interval is not None]
    no_difference = ""
    if not comparable:
        no_difference = "the studies share places, but neither seeds nor numbers of runs"
    elif (
        not changed and len(comparable) == len(differences) and not any(i.value for i in comparable)
    ):
        no_difference = "the studies have the same settings and the same results"
    return {
        "metric": METRICS[metric],
        "rows": rows,
        "answers": _answers(names, rows),
        "changed": changed,
        "nothing": no_difference,
    }


def names_of(sources: Sequence[str]) -> list[str]:
    """What the sources are called: the names of their folders or files, or all of their paths."""
    paths = [Path(source) for source in sources]
    names = [title_of(path) if path.name == LOG else path.name or str(path) for path in paths]
    return list(sources) if len(set(names)) < len(names) else names


def page_of(sources: Sequence[str]) -> Page:
    """A page that shows 2 to 6 flights, or studies, side by side; LaisnError: other sources, or
    a damaged log.
    """
    if not 2 <= len(sources) <= MAX_COMPARED:
        raise LaisnError(
            f"{len(sources)} given to compare, expected 2 to {MAX_COMPARED} folders of flights or "
            "of studies"
        )
    paths = [Path(source) for source in sources]
    logs = [path if path.suffix == ".mcap" else path / LOG for path in paths]
    names = names_of(sources)
    if _are_studies(paths, logs):
        values = _studies(names, paths)
    else:
        values = _flights(names, [read(log) for log in logs])
    tools = {
        "words": words,
        "number": number,
        "shown": interval_text,
        "shortened": shortened,
        "verdicts_text": verdicts_text,
    }
    facts = [("repeat it", f"laisn compare {' '.join(sources)}")]
    values |= {"names": names, **tools}
    return pages.page_of("experiments.study", facts, values, name="compare.md.j2")


def _are_studies(paths: Sequence[Path], logs: Sequence[Path]) -> bool:
    """Whether all sources are studies; LaisnError unless they are, or all are flights."""
    studies = [(path / RUNS).is_file() for path in paths]
    for path, study, log in zip(paths, studies, logs, strict=True):
        if not study and not log.is_file():
            raise LaisnError(f"{path}: neither a flight ({LOG}) nor a study ({RUNS})")
    if any(studies) and not all(studies):
        raise LaisnError("flights and studies cannot be compared with each other")
    return all(studies)
