"""The page of a replay on measured data: map with ellipses, uncertainty over time, range residuals and NIS."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.pages.figures import Line, panel, svg
from experiments.pages.page import Block, Figures, Notice, Page, Section, Table, Text, number, words, write
from experiments.pages.style import ESTIMATE, FULL, INK, LEADER, SERIES, TRANSMITTERS
from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS, Estimates, FixKind
from laisn.messages import LeaderMessage, Measurements
from laisn.metrics import nis

_ELLIPSES = 24
"""Ellipses along the path of a vehicle."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 41)
_NAMES = ("rear or first transmitter", "front or second", "middle or third")


def _poses(measured: Measurements) -> list[Floats]:
    """East, north [m], heading [rad] and depth [m] of the leader in each message, shapes (m,)."""
    return [measured.message[:, LeaderMessage._fields.index(field)] for field in ("east", "north", "heading", "depth")]


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """One vehicle's replay."""

    name: str
    measured: Measurements
    estimates: Estimates
    baseline: float = np.nan
    """From the rear to the front transmitter, where messages do not hold their positions [m]."""
    path: Floats | None = None
    """Surveyed path to compare with: time [s], east, north [m], shape (t, 3); None: there is none."""

    @property
    def fixes(self) -> str:
        """Number of fixes of each kind, in words."""
        kinds = Counter(self.estimates.fix_kind.tolist())
        return ", ".join(f"{kinds[kind]} {FIX_WORDS[kind]}" for kind in FixKind if kinds[kind]) or "none"

    @property
    def sigma(self) -> Floats:
        """Root of the larger eigenvalue of the position's covariance after each step, shape (n,), [m]."""
        return np.sqrt(np.linalg.eigvalsh(np.nan_to_num(self.estimates.covariance[:, :2, :2]))[:, 1])

    @property
    def nis(self) -> Floats:
        """Squared innovation of each message in units of its covariance, per measured quantity, shape (f,).

        1 on average for a consistent filter; NaN where there is no innovation.
        """
        squared = getattr(self.estimates, "nis", None)
        if squared is not None:
            return np.asarray(squared / np.maximum(getattr(self.estimates, "used", 1), 1))
        return nis(self.estimates) / 2.0

    @property
    def residuals(self) -> Floats:
        """Measured less estimated slant range of each message, after its update, shape (m, 3), [m]."""
        measured, step = self.measured, self.measured.message_step - 1
        own = np.column_stack([self.estimates.state[step, :2], measured.last_depth[step]])
        if measured.transmitters is not None:
            places = measured.transmitters
        else:
            east, north, heading, depth = _poses(measured)
            arm = 0.5 * self.baseline * np.stack([np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=1)
            middle = np.column_stack([east, north, depth])
            places = np.stack([middle - arm, middle + arm, np.full_like(middle, np.nan)], axis=1)
        return np.asarray(measured.ranges - np.linalg.norm(places - own[:, None], axis=2))

    @property
    def errors(self) -> Floats:
        """Distance from the surveyed path at its times within the mission, shape (t,), [m]."""
        time, known = self.measured.time, np.isfinite(self.estimates.state[:, 0])
        if self.path is None or not known.any():
            return np.empty(0)
        path = self.path[(self.path[:, 0] >= time[known][0]) & (self.path[:, 0] <= time[known][-1])]
        off = [np.interp(path[:, 0], time[known], self.estimates.state[known, k]) - path[:, 1 + k] for k in (0, 1)]
        return np.asarray(np.hypot(*off))


def ellipse(centre: Floats, covariance: Floats) -> Floats:
    """Outline of the 2σ ellipse of a position, shape (m, 2), [m]: centre shape (2,), covariance shape (2, 2)."""
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
    outline: Floats = centre + 2.0 * circle * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return outline


def _map(one: Replayed) -> Figures:
    state, covariance = one.estimates.state, one.estimates.covariance
    known = np.flatnonzero(np.isfinite(state[:, 0]))
    lines = [Line(x=state[known, 0], y=state[known, 1], colour=ESTIMATE)]
    legend = [(ESTIMATE, "estimate, with 2σ ellipses")]
    for step in known[:: max(1, known.size // _ELLIPSES)]:
        outline = ellipse(state[step, :2], covariance[step, :2, :2])
        lines.append(Line(x=outline[:, 0], y=outline[:, 1], colour=ESTIMATE, width=0.5))
    if one.measured.transmitters is not None:
        places = np.unique(one.measured.transmitters[..., :2].reshape(-1, 2).round(2), axis=0)
        places = places[np.isfinite(places).all(axis=1)]
        lines.append(Line(x=places[:, 0], y=places[:, 1], colour=LEADER, marker="^", size=5.0))
        legend.append((LEADER, "transmitters"))
    elif len(one.measured.message):
        east, north, *_ = _poses(one.measured)
        lines.append(Line(x=east, y=north, colour=LEADER))
        legend.append((LEADER, "leader, as broadcast"))
    if one.path is not None:
        lines.insert(0, Line(x=one.path[:, 1], y=one.path[:, 2], colour=INK, dash="--"))
        legend.append((INK, "surveyed path"))
    figure = panel(lines, x_label="east [m]", y_label="north [m]", equal=True, width=FULL, height=5.0)
    return Figures(panels=[svg(figure, f"map-{one.name}", f"Map of {one.name}")], legend=legend)


def _curves(one: Replayed) -> list[Block]:
    time = one.measured.time
    curve = Line(x=time, y=2.0 * one.sigma, colour=ESTIMATE)
    sigma = panel([curve], x_label="time [s]", y_label="2σ of the position [m]", width=FULL)
    at, residuals = time[one.measured.message_step - 1], one.residuals
    seen = np.isfinite(residuals)
    lines = [
        Line(x=at[seen[:, i]], y=residuals[seen[:, i], i], colour=colour, marker="o")
        for i, colour in enumerate(TRANSMITTERS) if seen[:, i].any()
    ]  # fmt: skip
    panels = [panel(lines, x_label="time [s]", y_label="range residual [m]")] if lines else []
    squared = one.nis
    if np.isfinite(squared).any():
        top = max(2.0, float(np.nanpercentile(squared, 99)))
        marks = Line(x=time[one.estimates.fix_step - 1], y=squared, colour=SERIES[2], marker="o")
        panels.append(panel([marks], x_label="time [s]", y_label="NIS per quantity", y_limits=(0.0, top)))
    return [
        Figures(panels=[svg(sigma, f"sigma-{one.name}", "Standard deviation over time")],
                caption="2σ along the larger axis of the covariance ellipse."),
        Figures(panels=[svg(each, f"residual{i}-{one.name}", "Residuals") for i, each in enumerate(panels)],
                caption="Measured range less the distance to the estimate after the update, by transmitter: it holds "
                "scale errors that the navigator estimates. NIS, where the navigator has one, is the squared "
                "innovation in units of its covariance, 1 on average for a consistent filter.",
                legend=[(colour, name) for colour, name in zip(TRANSMITTERS, _NAMES, strict=True)]),
    ]  # fmt: skip


def _table(replayed: Sequence[Replayed]) -> Table:
    heads = ["vehicle", "steps", "messages", "fixes", "2σ, median [m]", "2σ, largest [m]", "mean NIS", "mean error [m]"]
    rows = []
    for one in replayed:
        squared, errors, sigma = one.nis, one.errors, one.sigma
        rows.append([
            words(one.name), number(len(one.estimates.state)), number(len(one.measured.message)), words(one.fixes),
            number(2.0 * float(np.median(sigma))), number(2.0 * float(sigma.max())),
            number(float(np.nanmean(squared)) if np.isfinite(squared).any() else None),
            number(float(errors.mean()) if errors.size else None),
        ])  # fmt: skip
    return Table(heads=heads, rows=rows, caption="Mean error: to the surveyed path, where the log has one.")


def _answer(one: Replayed) -> str:
    sigma, errors = one.sigma, one.errors
    worst = int(np.argmax(sigma))
    return (
        f"{one.name}: the position is known to {2.0 * float(np.median(sigma)):.2f} m (2σ, median), and at worst to "
        f"{2.0 * float(sigma[worst]):.2f} m, at {one.measured.time[worst]:.0f} s."
        + (f" Its mean error is {errors.mean():.2f} m." if errors.size else "")
    )


def write_replay_page(
    replayed: Sequence[Replayed], log: Path, navigator: str, remarks: Sequence[str], path: Path
) -> None:
    """Write the page of a replay, with remarks on the log as notes; OSError if the file cannot be written."""
    notes: list[Block] = [Notice(text=remark) for remark in remarks]
    first = Section(title="Result", blocks=[_map(replayed[0]), _table(replayed), *notes])
    sections = [first, *(Section(title=f"Map of {one.name}", blocks=[_map(one)]) for one in replayed[1:])]
    for one in replayed:
        heading = Text(text="Standard deviation, range residuals and NIS.")
        sections.append(Section(title=f"Consistency of {one.name}", blocks=[heading, *_curves(one)]))
    summary = " ".join(_answer(one) for one in replayed)
    path.parent.mkdir(parents=True, exist_ok=True)
    facts = [("Log", str(log)), ("Navigator", navigator)]
    write(Page(title=f"Replay of {log.name}", summary=summary, facts=facts, sections=sections), path)
