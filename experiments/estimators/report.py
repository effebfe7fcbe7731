"""The page of the study of the estimators."""

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
    Block,
    Cell,
    Figures,
    Page,
    Section,
    Table,
    Text,
    number,
    share_of,
    with_limits,
    words,
    write,
)

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


_PLAIN = (
    "Five states (position, bias of log and compass, scale of the ranges), one Gaussian, all ranges of a message in "
    "one update: the textbook filter for the same sensors, on the same noise. The tightly coupled navigator adds two "
    "transmitters, by hypotheses on both sides of the leader's axis, and a covariance that stays consistent."
)


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


def _limits(findings: Findings) -> str:
    """How far the bound is away, in sentences."""
    f = findings
    general = (
        f"In G7 the bound is {f['least G7 5']:.2f} of LAISN-2's RMS error with messages every 5 s. It is the mean over "
        "all that who switches all states on takes for possible, and the truth is at its likeliest there; the tightly "
        f"coupled navigator's RMS error is {f['bound G7 5']:.2f} times the bound."
    )
    later = ", ".join(
        f"{f[f'smoothing {case} 1']:.2f} and {f[f'smoothing {case} 5']:.2f} in {case}" for case in ("G1", "G5", "G6")
    )
    return f"{general} Of a filter's error smoothing could leave, with messages every 1 s and 5 s, {later}."


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


def _varied(findings: Findings) -> list[Section]:
    physical = [_row(findings, f"sea {sea}", words(text)) for sea, (text, _) in SEAS.items()]
    wrong = [_row(findings, f"wrong {case.name}", words(case.title)) for case in WRONG]
    sigma = [
        _row(
            findings,
            f"sigma {name} {factor:g}",
            words(name.replace("_", " ")),
            words("halved" if factor < 1 else "doubled"),
        )
        for name in SIGMAS
        for factor in (0.5, 2.0)
    ]
    offset = [
        _row(findings, f"offset {value:g}", number(value))
        for value in OFFSETS_M
        if f"error offset {value:g}" in findings.findings
    ]
    weave = [
        [
            words(route),
            *(
                _value(findings, f"{what} {how} {route}")
                for how in ("straight", "weaving")
                for what in ("rms", "rms-bound")
            ),
        ]
        for route in ON_AXIS
    ]
    return [
        Section(title="At sea", blocks=[
            Text(text="Rigid bodies in water, messages every 1 s. The bound knows no sideslip."),
            Table(heads=["sea", *_HEADS], rows=physical)]),
        Section(title="What can go wrong", blocks=[
            Text(text="One thing at a time, messages every 5 s; whether the navigator was told to reckon with it."),
            Table(heads=["what", *_HEADS], rows=wrong)]),
        Section(title="An unknown clock", blocks=[
            Text(text="A clock 1 ms off that drifts by 1 ppm, estimated, over exact clocks; messages every 5 s. On a "
                 "straight leg the clock's drift and the log's bias move all ranges alike: only a turn of the leader "
                 "separates them. The offset itself is not separated from the mean scale error, which is harmless: "
                 "only their sum enters a range."),
            Table(heads=["", "E_P over that with exact clocks", "largest of the routes", "of the bound", "largest"],
                  rows=[[words(f"{part} the leader's first turn"),
                         *(_value(findings, f"{name} {part}")
                           for name in ("clock", "clock-worst", "clock-bound", "clock-bound-worst"))]
                        for part in ("before", "after")])]),
        Section(title="Wrong settings", blocks=[
            Text(text="Each σ that the navigator is told, halved and doubled, while the sensors stay as they are."),
            Table(heads=["setting", "", *_HEADS], rows=sigma)]),
        Section(title="How far aside the middle transmitter is", blocks=[
            Table(heads=["H_T [m]", *_HEADS], rows=offset)]),
        Section(title="A leader that weaves", blocks=[
            Text(text="Legs that alternate by 5° every 20 s tell two transmitters the side that the follower is on."),
            Table(heads=["route", "RMS E_P, straight [m]", "bound", "weaving [m]", "bound"], rows=weave,
                  caption="Two transmitters, messages every 1 s.")]),
    ]  # fmt: skip


def write_page(findings: Findings, found: Mapping[tuple[Any, ...], Any], path: Path, *, quick: bool) -> Path:
    """Write the page of a study; returns its path."""
    figure, legend = picture(findings)
    blocks: list[Block] = [
        Text(
            text="LAISN makes a point of its ranges and hands it to a filter; the tightly coupled navigator hands the "
            "ranges themselves to a filter that carries the sensors' biases. Both get the same measurements."
        ),
        Figures(
            panels=[svg(figure, "ratio", "Mean position error of both navigators in all cases")],
            caption="Mean E_P over all routes, messages every 5 s.",
            legend=legend,
        ),
        _cases(findings),
        Text(text=_limits(findings)),
    ]
    runs = findings["runs"]
    page = Page(
        title="Estimators",
        summary="LAISN-2, the tightly coupled navigator, and the Cramér–Rao bound of dead reckoning with log and "
        "compass as inputs, corrected by these ranges, on the same noise."
        + (" A first look: too few runs and routes to go by." if quick else ""),
        facts=[
            ("Seed", str(findings["seed"].value)),
            ("Runs of each mission", str(runs.value)),
            ("Version", findings.version),
            ("Repeat with", findings.command + (" --quick" if quick else "")),
        ],
        sections=[
            Section(title="Seven cases", blocks=blocks),
            Section(
                title="A plain extended Kalman filter",
                blocks=[
                    Text(text=_PLAIN),
                    _plain(findings),
                ],
            ),
            Section(title="Captures", blocks=[_many(findings)]),
            *_varied(findings),
            Section(title="Route by route", blocks=[_routes(found)]),
        ],
    )
    write(page, path)
    return path


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
