"""Tables of the estimators' page, whose text is page.md.j2."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.estimators.cases import CASES, WRONG
from experiments.estimators.figures import picture
from experiments.estimators.paired import Paired
from experiments.estimators.plan import BASELINED, INTERVALS, OFFSETS_M, ON_AXIS, SEAS, SIGMAS
from experiments.findings import Findings
from experiments.pages.figures import svg
from experiments.pages.page import (
    Cell,
    Figures,
    Table,
    number,
    share_of,
    with_limits,
    words,
    write,
)
from experiments.pages.template import page_of

_HEADS = ["E_P [m]", "LAISN-2 [m]", "over LAISN-2", "worst", "RMS over bound", "worst", "bound over LAISN-2's RMS",
          "NEES", "least", "most", "instants in χ² [%]", "NIS of a range", "captured [%]",
          "LAISN-2 captured [%]"]  # fmt: skip


def _value(findings: Findings, key: str, digits: int = 2) -> Cell:
    found = findings.findings.get(key)
    return number(None if found is None else found.number, digits)


def _row(findings: Findings, key: str, *first: Cell) -> list[Cell]:
    f = findings.findings
    return [
        *first,
        with_limits(f[f"error {key}"]),
        with_limits(f[f"laisn-2 {key}"]),
        with_limits(f[f"ratio {key}"]),
        _value(findings, f"worst {key}"),
        _value(findings, f"bound {key}"),
        _value(findings, f"bound-worst {key}"),
        _value(findings, f"least {key}"),
        with_limits(f[f"nees {key}"]),
        _value(findings, f"nees-least {key}"),
        _value(findings, f"nees-most {key}"),
        number(100.0 * f[f"inside {key}"].number, 0),
        with_limits(f[f"nis {key}"]),
        share_of(f[f"captured {key}"]),
        share_of(f[f"captured-laisn-2 {key}"]),
    ]


def _cases(findings: Findings) -> Table:
    rows = [
        [
            *_row(findings, f"{case.name} {interval:g}", words(case.name), words(case.title), number(interval, 0)),
            _value(findings, f"smoothing {case.name} {interval:g}"),
        ]
        for case in CASES
        for interval in INTERVALS
    ]
    caption = (
        "Mean over routes; the ratio is the median of the routes' ratios. NEES is the mean of eᵀP⁻¹e, 2 if the "
        "covariance is right; least and most of all routes. Brackets hold 95 % intervals. The last column is the least "
        "that smoothing with the messages of the next 60 s could leave of a filter's error, as bounds have it."
    )
    return Table(heads=["", "case", "every [s]", *_HEADS, "smoothing"], rows=rows, caption=caption)


def _plain(findings: Findings) -> Table:
    f, rows = findings, []
    for case in BASELINED:
        for interval in INTERVALS:
            key = f"{case.name} {interval:g}"
            cells = [words(case.name), words(case.title), number(interval, 0), with_limits(f[f"ekf {key}"])]
            cells += [
                with_limits(f[f"error {key}"]),
                with_limits(f[f"over-ekf {key}"]),
                with_limits(f[f"ekf-nees {key}"]),
            ]
            rows.append([*cells, share_of(f[f"ekf-captured {key}"]), share_of(f[f"captured {key}"])])
    heads = ["", "case", "every [s]", "plain EKF: E_P [m]", "tight: E_P [m]", "tight over EKF", "NEES of the EKF",
             "EKF captured [%]", "tight captured [%]"]  # fmt: skip
    return Table(heads=heads, rows=rows, caption="Mean over routes; brackets hold 95 % intervals.")


def _many(findings: Findings) -> Table:
    f, rows = findings.findings, []
    for transmitters in (3, 2):
        for route in ON_AXIS:
            key = f"{transmitters} {route}"
            cells = [number(transmitters), words(route), number(int(f[f"many-runs {key}"].value or 0))]
            rows.append(
                [*cells, _value(findings, f"many-captured {key}", 0), share_of(f[f"many {key}"]),
                 share_of(f[f"many-laisn-2 {key}"])]
            )  # fmt: skip
    heads = ["transmitters", "route", "runs", "captured", "share [%]", "LAISN-2 [%]"]
    return Table(heads=heads, rows=rows, caption="Captures at the mirror image; messages every 5 s.")


def _varied(findings: Findings) -> dict[str, Table]:
    """Tables in which one thing differs from row to row, by their names in the template."""
    physical = [_row(findings, f"sea {sea}", words(text)) for sea, (text, _) in SEAS.items()]
    wrong = [_row(findings, f"wrong {case.name}", words(case.title)) for case in WRONG]
    clock = [
        [words(f"{part} the leader's first turn"),
         *(_value(findings, f"{name} {part}") for name in ("clock", "clock-worst", "clock-bound", "clock-bound-worst"))]
        for part in ("before", "after")
    ]  # fmt: skip
    sigma = [
        _row(findings, f"sigma {name} {factor:g}", words(name.replace("_", " ")),
             words("halved" if factor < 1 else "doubled"))
        for name in SIGMAS
        for factor in (0.5, 2.0)
    ]  # fmt: skip
    offset = [
        _row(findings, f"offset {value:g}", number(value))
        for value in OFFSETS_M
        if f"error offset {value:g}" in findings.findings
    ]
    weave = [
        [words(route), *(_value(findings, f"{what} {how} {route}")
                         for how in ("straight", "weaving") for what in ("rms", "rms-bound"))]
        for route in ON_AXIS
    ]  # fmt: skip
    return {
        "seas": Table(heads=["sea", *_HEADS], rows=physical),
        "wrong": Table(heads=["what", *_HEADS], rows=wrong),
        "clock": Table(
            heads=["", "E_P over that with exact clocks", "largest of the routes", "of the bound", "largest"],
            rows=clock,
        ),
        "sigma": Table(heads=["setting", "", *_HEADS], rows=sigma),
        "offset": Table(heads=["H_T [m]", *_HEADS], rows=offset),
        "weave": Table(
            heads=["route", "RMS E_P, straight [m]", "bound", "weaving [m]", "bound"],
            rows=weave,
            caption="Two transmitters, messages every 1 s.",
        ),
    }


def _routes(found: Mapping[tuple[Any, ...], Any]) -> Table:
    rows: list[Sequence[Cell]] = []
    for name, one in found.items():
        if name[0] == "case" and isinstance(one, Paired):
            cells = [words(name[1]), number(one.interval, 0), words(one.route), number(one.tight_mean, 3)]
            cells += [number(one.laisn_mean, 3), number(one.ratio, 3), number(one.tight_rms, 3)]
            cells += [number(one.tight_rms / one.bound_rms if np.isfinite(one.bound_rms) else None)]
            rows.append([*cells, number(one.tight_max, 1), number(one.nees), number(one.tight_captured),
                         number(one.laisn_captured)])  # fmt: skip
    heads = ["", "every [s]", "route", "E_P [m]", "LAISN-2 [m]", "ratio", "RMS [m]", "over bound", "largest [m]",
             "NEES", "captured", "LAISN-2 captured"]  # fmt: skip
    return Table(heads=heads, rows=rows)


def write_page(findings: Findings, found: Mapping[tuple[Any, ...], Any], path: Path, *, quick: bool) -> Path:
    """Write the page of a study; returns its path."""
    figure, legend = picture(findings)
    ratio = Figures(
        panels=[svg(figure, "ratio", "Mean position error of both navigators in all cases")],
        caption="Mean E_P over all routes, messages every 5 s.",
        legend=legend,
    )
    facts = [
        ("Seed", str(findings["seed"].value)),
        ("Runs of each mission", str(findings["runs"].value)),
        ("Version", findings.version),
        ("Repeat with", findings.command + (" --quick" if quick else "")),
    ]
    values = {
        "quick": quick,
        "ratio": ratio,
        "cases": _cases(findings),
        "plain": _plain(findings),
        "captures": _many(findings),
        "routes": _routes(found),
        **_varied(findings),
    }
    write(page_of("experiments.estimators", facts, values, findings), path)
    return path
