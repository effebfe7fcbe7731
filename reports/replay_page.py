"""The page of a replay on measured data: map with ellipses, uncertainty over time, range
residuals and NIS.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.errors import printable
from laisn.estimates import FIX_WORDS, Estimates, FixKind
from laisn.messages import LeaderMessage, Measurements
from laisn.metrics import nis
from reports.figures import Line, Panel, Subplot, panel
from reports.headline import figure_text, tone_of
from reports.page import Figures, Replay, Tile, number, page_of, write
from reports.scene.measured import Measured, scene_of_measured
from reports.style import ESTIMATE, FULL, INK, LEADER, SERIES, TRANSMITTERS, Colour
from reports.summary import largest_sigma

_HEIGHT = 5.0  # of the figures [inch]
_MAP_WIDTH = 5.4  # [inch]
_TRACK_POINTS = 1500  # about so many points of a track are drawn
_ELLIPSES = 24  # about so many ellipses along a track
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 41)  # of the points of an ellipse [rad]
GOOD_NIS = (0.5, 2.0)
TOLERABLE_NIS = (0.1, 4.0)
"""Mean NIS per measured quantity: of a filter that is right, and outside which it is far from that
(`tone_of`).
"""
_TRANSMITTER_NAMES = ("rear or first", "front or second", "middle or third")


def _poses(measurements: Measurements) -> list[Floats]:
    """East, north [m], heading [rad] and depth [m] of the leader in each message, shapes (m,)."""
    return [
        measurements.message[:, LeaderMessage._fields.index(field)]
        for field in ("east", "north", "heading", "depth")
    ]


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """A vehicle whose measurements were replayed, and what the navigator made of them."""

    name: str
    measurements: Measurements
    estimates: Estimates
    # when each filter step ends, by the log, shape (n,), [s]
    time: Floats
    # from the rear to the front transmitter, where messages do not hold their positions [m]
    baseline: float = np.nan
    path: Floats | None = None  # surveyed reference path: time [s], east, north [m], shape (t, 3)
    mean_error: float = np.nan  # mean distance from that path [m]

    @property
    def fixes(self) -> str:
        """Number of fixes of each kind, in words."""
        kinds = Counter(self.estimates.fix_kind.tolist())
        return (
            ", ".join(f"{kinds[kind]} {FIX_WORDS[kind]}" for kind in FixKind if kinds[kind])
            or "none"
        )

    @property
    def sigma(self) -> Floats:
        """Standard deviation along the larger axis of the position ellipse after each step,
        shape (n,), [m].
        """
        return largest_sigma(np.nan_to_num(self.estimates.covariance))

    @property
    def nis(self) -> Floats:
        """Normalised squared innovation of each message per measured quantity, shape (f,); NaN
        if it has none.
        """
        squared = getattr(self.estimates, "nis", None)
        if squared is not None:
            return np.asarray(squared / np.maximum(getattr(self.estimates, "used", 1), 1))
        return nis(self.estimates) / 2.0

    @property
    def residuals(self) -> Floats:
        """Measured less estimated slant range of each message, after its update, shape (m, 3),
        [m].
        """
        measurements = self.measurements
        # steps count from 1
        step = measurements.message_step - 1
        depth = measurements.last_depth[step]
        hydrophone = np.column_stack([self.estimates.state[step, :2], depth])
        places = measurements.transmitters
        if places is None:
            east, north, heading, leader_depth = _poses(measurements)
            arm = (
                0.5
                * self.baseline
                * np.stack([np.sin(heading), np.cos(heading), np.zeros_like(heading)], axis=1)
            )
            middle = np.column_stack([east, north, leader_depth])
            places = np.stack([middle - arm, middle + arm, np.full_like(middle, np.nan)], axis=1)
        return np.asarray(
            measurements.ranges - np.linalg.norm(places - hydrophone[:, None], axis=2)
        )


def ellipse(centre: Floats, covariance: Floats) -> Floats:
    """Outline of the 2σ ellipse of a position, shape (m, 2), [m]: centre shape (2,), covariance
    shape (2, 2).
    """
    values, vectors = np.linalg.eigh(covariance)
    circle = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
    outline: Floats = centre + 2.0 * circle * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    return outline


def _map(replayed: Replayed) -> tuple[Panel, list[tuple[Colour, str]]]:
    state = replayed.estimates.state
    covariance = replayed.estimates.covariance
    estimated = np.flatnonzero(np.isfinite(state[:, 0]))
    rows = estimated[:: max(1, estimated.size // _TRACK_POINTS)]
    track = state[rows]
    time = replayed.time[rows]
    lines = [Line(x=track[:, 0], y=track[:, 1], colour=ESTIMATE, name="estimate", time=time)]
    legend = [(ESTIMATE, "estimate, with 2σ ellipses")]
    for step in estimated[:: max(1, estimated.size // _ELLIPSES)]:
        outline = ellipse(state[step, :2], covariance[step, :2, :2])
        lines.append(Line(x=outline[:, 0], y=outline[:, 1], colour=ESTIMATE, width=0.5))
    if replayed.measurements.transmitters is not None:
        places = np.unique(
            replayed.measurements.transmitters[..., :2].reshape(-1, 2).round(2), axis=0
        )
        places = places[np.isfinite(places).all(axis=1)]
        lines.append(
            Line(
                x=places[:, 0],
                y=places[:, 1],
                colour=LEADER,
                marker="^",
                size=5.0,
                name="transmitter",
            )
        )
        legend.append((LEADER, "transmitters"))
    elif len(replayed.measurements.message):
        east, north, *_ = _poses(replayed.measurements)
        times = replayed.time[replayed.measurements.message_step - 1]
        lines.append(Line(x=east, y=north, colour=LEADER, name="leader", time=times))
        legend.append((LEADER, "leader, as broadcast"))
    if replayed.path is not None:
        lines.insert(0, Line(x=replayed.path[:, 1], y=replayed.path[:, 2], colour=INK, dash="--"))
        legend.append((INK, "surveyed path"))
    chart = panel(
        lines,
        x_label="east [m]",
        y_label="north [m]",
        equal_scales=True,
        width=_MAP_WIDTH,
        height=_HEIGHT,
        link=replayed.name,
    )
    return chart, legend


def _over_time(replayed: Replayed) -> Panel:
    """2σ of the position, range residuals of each transmitter, and NIS, where there are any."""
    times_of_messages = replayed.time[replayed.measurements.message_step - 1]
    residuals = replayed.residuals
    nis_values = replayed.nis
    is_known = np.isfinite(residuals)
    curve = Line(x=replayed.time, y=2.0 * replayed.sigma, colour=ESTIMATE, name="2σ")
    parts = [Subplot(lines=[curve], y_label="2σ of position [m]", y_limits=(0.0, None))]
    lines = [
        Line(
            x=times_of_messages[is_known[:, i]],
            y=residuals[is_known[:, i], i],
            colour=colour,
            marker="o",
            name=f"{_TRANSMITTER_NAMES[i]} transmitter",
        )
        for i, colour in enumerate(TRANSMITTERS)
        if is_known[:, i].any()
    ]
    parts += [Subplot(lines=lines, y_label="range residual [m]")] if lines else []
    if np.isfinite(nis_values).any():
        top = max(2.0, float(np.nanpercentile(nis_values, 99)))
        time = replayed.time[replayed.estimates.fix_step - 1]
        marks = Line(x=time, y=nis_values, colour=SERIES[2], marker="o", name="NIS")
        parts.append(Subplot(lines=[marks], y_label="NIS per quantity", y_limits=(0.0, top)))
    ends = (float(replayed.time[0]), float(replayed.time[-1]))
    width = FULL - _MAP_WIDTH
    return Panel(
        parts=parts,
        x_label="time [s]",
        x_limits=ends,
        width=width,
        height=_HEIGHT,
        link=replayed.name,
    )


def _values(replayed: Replayed) -> dict[str, Any]:
    two_sigma = 2.0 * replayed.sigma
    nis_values = replayed.nis
    worst = int(two_sigma.argmax())
    chart, legend = _map(replayed)
    residual_legend = [
        (colour, f"residual of the {name} transmitter")
        for colour, name in zip(TRANSMITTERS, _TRANSMITTER_NAMES, strict=True)
    ]
    received = [bool(np.isfinite(column).any()) for column in replayed.residuals.T]
    legend += [entry for entry, used in zip(residual_legend, received, strict=True) if used]
    legend += [(SERIES[2], "NIS")] if np.isfinite(nis_values).any() else []
    return {
        "name": replayed.name,
        "steps": len(replayed.estimates.state),
        "messages": len(replayed.measurements.message),
        "fixes": replayed.fixes,
        "median_two_sigma_m": number(float(np.median(two_sigma))).text,
        "largest_two_sigma_m": number(float(two_sigma[worst])).text,
        "largest_s": number(float(replayed.time[worst]), 0).text,
        "nis_judgement": nis_judgement(_mean_nis(replayed)),
        "mean_nis": number(
            float(np.nanmean(nis_values)) if np.isfinite(nis_values).any() else None
        ).text,
        "mean_error": number(replayed.mean_error).text,
        "figure": Figures(panels=[chart, _over_time(replayed)], legend=legend),
    }


def _mean_nis(replayed: Replayed) -> float:
    """Mean NIS per measured quantity; NaN without any."""
    nis_values = replayed.nis
    return float(np.nanmean(nis_values)) if np.isfinite(nis_values).any() else np.nan


def nis_judgement(value: float) -> str:
    """What a mean NIS tells of the filter; empty where there is none."""
    tone = tone_of(value, GOOD_NIS, TOLERABLE_NIS)
    if not np.isfinite(value):
        return ""
    if tone == "good":
        return "the filter is as sure as it should be"
    adverb = "far " if tone == "bad" else ""
    if value > 1.0:
        return f"the filter is {adverb}surer than its measurements agree with"
    return f"the filter is {adverb}less sure than its measurements allow"


def _tiles(replayed: Sequence[Replayed]) -> list[Tile]:
    """Key figures of the vehicle with the largest NIS, or of the only one."""
    worst = max(replayed, key=lambda vehicle: np.nan_to_num(_mean_nis(vehicle), nan=-1.0))
    owner = f"{worst.name}, " if len(replayed) > 1 else ""
    two_sigma = 2.0 * worst.sigma
    value = _mean_nis(worst)
    tiles = [
        Tile(
            name="2σ of position",
            value=figure_text(float(np.median(two_sigma)), " m"),
            remark=f"{owner}median; {figure_text(float(two_sigma.max()), ' m')} at most",
        ),
    ]
    if np.isfinite(value):
        tone = tone_of(value, GOOD_NIS, TOLERABLE_NIS)
        remark = f"{owner}1 expected"
        tiles.append(
            Tile(name="NIS per quantity", value=figure_text(value), remark=remark, tone=tone)
        )
    if np.isfinite(worst.mean_error):
        error = figure_text(worst.mean_error, " m")
        tiles.insert(0, Tile(name="mean error", value=error, remark=f"{owner}from the path"))
    kinds = worst.estimates.fix_kind
    rejected = float(np.mean(np.isin(kinds, (FixKind.GATED, FixKind.LOST)))) if kinds.size else 0.0
    share = f"{100 * rejected:.0f} %"
    return [*tiles, Tile(name="rejected or lost", value=share, remark=f"of {kinds.size} messages")]


def write_replay_page(
    replayed: Sequence[Replayed], log: Path, navigator: str, remarks: Sequence[str], path: Path
) -> None:
    """Write the page of a replay, with remarks on the log as notes; OSError if the file cannot
    be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    values = {
        "log": printable(log.name),
        "vehicles": [_values(vehicle) for vehicle in replayed],
        "remarks": remarks,
    }
    facts = [("Log", str(log)), ("Navigator", navigator)]
    measured = [
        Measured(
            name=vehicle.name,
            measurements=vehicle.measurements,
            time=vehicle.time,
            estimates=vehicle.estimates,
            baseline=vehicle.baseline,
            path=vehicle.path,
        )
        for vehicle in replayed
    ]
    replay = Replay(
        scene=scene_of_measured(printable(log.name), measured),
        alternative=f"Replay of {printable(log.name)} in 3D",
        caption="Hulls, floor and depths that a log does not tell are stand-ins.",
    )
    page = page_of(
        "reports",
        facts,
        values,
        name="replay_page.md.j2",
        tiles=_tiles(replayed),
        replay=replay,
    )
    write(page, path)
