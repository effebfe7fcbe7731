"""Flights or studies side by side on one page: `laisn compare`."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.store import read_table
from experiments.flight.folder import LOG
from experiments.intervals import Interval
from experiments.pages import page as pages
from experiments.pages.figures import Line, Panel, Part
from experiments.pages.page import Figures, Page, number, words
from experiments.pages.style import FULL, SERIES
from experiments.study.estimate import over_runs, shown
from experiments.study.file import METRIC
from experiments.study.measure import METRICS, SHARES
from experiments.study.study import RESULTS, RUNS, STUDY
from laisn import metrics
from laisn.failure import LaisnError, shortened
from sim.flight import Flight, position_and_bearing_errors
from sim.log.reader import read
from sim.scenario.file import dotted
from sim.scenario.file import read as read_toml

MOST = len(SERIES)
_NAMED = 3  # most points that messages name


def _differing(tables: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """Values that are not the same in all tables; one that holds nothing, such as [set], is no
    setting.
    """
    keys = dict.fromkeys(key for table in tables for key, value in table.items() if value != {})
    found = {key: [table.get(key) for table in tables] for key in keys}
    return {
        key: values for key, values in found.items() if any(value != values[0] for value in values)
    }


def differing(flights: Sequence[Flight]) -> dict[str, list[Any]]:
    """Settings that are not the same in all flights, by key; None: a flight has no such key."""
    return _differing(
        [
            dotted(flight.scenario.model_dump(mode="json", exclude={"name", "run"}))
            for flight in flights
        ]
    )


def _flights(names: Sequence[str], flights: Sequence[Flight]) -> dict[str, Any]:
    """What the template shows of flights."""
    errors = [position_and_bearing_errors(flight)[0] for flight in flights]
    times = [flight.trajectory.time[flight.step_index()] for flight in flights]
    parts = []
    for place, label, scale in ((0, "E_P [m]", 1.0), (1, "E_B [°]", 180.0 / math.pi)):
        each = zip(times, errors, SERIES, names, strict=False)
        lines = [
            Line(x=t, y=scale * e[place], colour=colour, name=name) for t, e, colour, name in each
        ]
        parts.append(Part(lines=lines, y_label=label, y_limits=(0.0, None)))
    curves = Panel(parts=parts, x_label="time [s]", width=FULL, height=4.4)
    found = [metrics.summarise(position, bearing) for position, bearing in errors]
    first = errors[0][0]
    apart = [float(np.mean(e - first)) if e.size == first.size else math.nan for e, _ in errors]
    figures = Figures(panels=[curves], legend=[*zip(SERIES, names, strict=False)])
    return {
        "errors": figures,
        "rows": [*zip(names, found, apart, strict=True)],
        "changed": differing(flights),
    }


def _points_text(points: Iterable[tuple[str, ...]]) -> str:
    texts = [", ".join(point) or "the only one" for point in points]
    more = f" and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return f"{'; '.join(texts[:_NAMED]) or 'none with a value'}{more}"


def _require_common_points(
    folders: Sequence[Path], values: Sequence[Mapping[tuple[str, ...], Any]]
) -> None:
    """LaisnError naming the first study that has no point in common with the first of them."""
    for folder, points in zip(folders[1:], values[1:], strict=True):
        if not values[0].keys() & points.keys():
            raise LaisnError(
                f"{folders[0]} and {folder} have no point in common, so that nothing can be "
                f"compared; points of {folders[0]}: {_points_text(values[0])}; of {folder}: "
                f"{_points_text(points)}"
            )


def paired(folders: Sequence[Path], metric: str) -> dict[tuple[str, ...], list[Interval | None]]:
    """For every place that studies share with the first of them: its mean, and the others' paired
    differences.

    Runs of the same seed and number are paired. None: a study has other seeds or runs there.
    LaisnError: there is no such metric of single runs, or a study has no such place.
    """
    tables = []
    for folder in folders:
        seeds = {row["realization"]: row["seed"] for row in read_table(folder / RESULTS)}
        tables.append(
            [row | {"seed": seeds[row["realization"]]} for row in read_table(folder / RUNS)]
        )
        if metric not in tables[-1][0]:
            raise LaisnError(f"{folder}: its runs have no {metric!r}")
    measured = {"point", "realization", "seed", "run", "gated", *METRICS}
    shared = [
        k for k in tables[0][0] if k not in measured and all(k in table[0] for table in tables)
    ]

    def is_drawn(key: str) -> bool:
        """Whether it differs between realizations."""
        return any(
            len({r[key] for r in t if not r["realization"]}) < len({r[key] for r in t})
            for t in tables
        )

    keys = [
        k
        for k in shared
        if not is_drawn(k) and len({repr(row[k]) for table in tables for row in table}) > 1
    ]
    values = []
    for table in tables:
        own = defaultdict[tuple[str, ...], dict[tuple[int, int], float]](dict)
        for row in table:
            if row[metric] is not None:
                own[tuple(f"{key} = {row[key]}" for key in keys)][row["seed"], row["run"]] = float(
                    row[metric]
                )
        values.append(own)

    def mean(of: Mapping[tuple[int, int], float], *, paired: bool = False) -> Interval:
        realizations = groupby(sorted(of.items()), key=lambda item: item[0][0])
        lists = [np.array([value for _, value in runs]) for _, runs in realizations]
        return over_runs(lists, shares=metric in SHARES, paired=paired)

    _require_common_points(folders, values)
    found: dict[tuple[str, ...], list[Interval | None]] = {}
    for place, first in values[0].items():
        found[place] = [mean(first)]
        for theirs in (own[place] for own in values[1:]):
            same = theirs.keys() == first.keys()
            found[place].append(
                mean({k: v - first[k] for k, v in theirs.items()}, paired=True) if same else None
            )
    return found


def _studies(folders: Sequence[Path]) -> dict[str, Any]:
    """What the template shows of studies."""
    tables = [
        dotted(read_toml(folder / STUDY) | {"name": "", "question": ""}) for folder in folders
    ]
    asked = {table.get("report.metric", METRIC) for table in tables}
    metric = asked.pop() if len(asked) == 1 else METRIC
    return {
        "metric": METRICS[metric],
        "rows": paired(folders, metric),
        "changed": _differing(tables),
    }


def names_of(sources: Sequence[str]) -> list[str]:
    """What the sources are called: the names of their folders or files, or all of their paths."""
    paths = [Path(source) for source in sources]
    names = [path.name or str(path) for path in paths]
    return list(sources) if len(set(names)) < len(names) else names


def page_of(sources: Sequence[str]) -> Page:
    """A page that shows 2 to 6 flights, or studies, side by side; LaisnError: other sources, or
    a damaged log.
    """
    if not 2 <= len(sources) <= MOST:
        raise LaisnError(
            f"{len(sources)} given to compare, expected 2 to {MOST} folders of flights or of "
            "studies"
        )
    paths = [Path(source) for source in sources]
    studies = [(path / RUNS).is_file() for path in paths]
    logs = [path if path.suffix == ".mcap" else path / LOG for path in paths]
    for path, study, log in zip(paths, studies, logs, strict=True):
        if not study and not log.is_file():
            raise LaisnError(f"{path}: neither a flight ({LOG}) nor a study ({RUNS})")
    if any(studies) and not all(studies):
        raise LaisnError("flights and studies cannot be compared with each other")
    names = names_of(sources)
    found = _studies(paths) if all(studies) else _flights(names, [read(log) for log in logs])
    tools = {"words": words, "number": number, "shown": shown, "shortened": shortened}
    facts = [("repeat it", f"laisn compare {' '.join(sources)}")]
    return pages.page_of(
        "experiments.study", facts, {"names": names, **tools, **found}, name="compare.md.j2"
    )
