"""The panels of a film: numbers and curves of the whole mission at the left, a map at the right."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS
from sim.film.canvas import DIM, PALE, Canvas, Colour, Place, Shape, Stroke, corners
from sim.film.film_data import ESTIMATE, LEADER, STATION, TRANSMITTER_COLOURS, TRUTH, FilmData, FrameState

Trail = tuple[Floats, Colour]  # positions, shape (p, 3), [m], and the colour of their line
Text = tuple[float, str, Colour, float]
"""Distance from the left edge of a panel, or from the right one if negative, words, colour and size."""

SIGMAS = 2.0  # half axes of the ellipse of uncertainty in standard deviations
_SHORT = 576
"""Frames of fewer rows have the short panel of numbers and one curve: text that can be read leaves no room for more."""
_PANEL: Colour = (0.01, 0.06, 0.10)
_EDGE: Colour = (0.55, 0.80, 0.90)
_FLEET_SHARE = 0.25  # a map of the whole mission shows several followers apart if they take at least this share of it
_TRANSMITTERS = ("rear", "front", "middle")
_COLUMNS = (-106.0, -12.0)  # right edges of the leader's and the follower's numbers


def clock(seconds: float) -> str:
    """Time as [hours:]minutes:seconds."""
    whole = int(seconds + 1e-9)
    hours = f"{whole // 3600}:" if whole >= 3600 else ""
    return f"{hours}{whole % 3600 // 60:02d}:{whole % 60:02d}"


def format_half_axes(*half_axes: float) -> str:
    """Half axes of an ellipse [m], the longest last, in millimetres while that is below a metre."""
    longest = half_axes[-1]
    if longest < 0.0005:
        return "below 1 mm"
    unit, scale, digits = ("mm", 1e3, 0) if longest < 0.9995 else ("m", 1.0, 2)
    return f"{' by '.join(f'±{scale * half:.{digits}f}' for half in half_axes)} {unit}"


def round_length(longest_m: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten up to a length [m]."""
    power = 10.0 ** np.floor(np.log10(longest_m))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest_m))


def _ticks(most: int, low: float, high: float) -> list[float]:
    """Round values between two limits, about `most` of them."""
    values = MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high)
    return [float(value) + 0.0 for value in values if low <= value <= high]


def _line(points: Floats, colour: Colour, width: float) -> Iterator[Stroke]:
    """A line through many points, shape (n, 2), [px], without those that do not show; broken at NaN."""
    return (Stroke(np.asarray(part), colour, width) for part in Path(points).to_polygons(closed_only=False))


class Dashboard:
    """Panels of one film; if it is about the leader's pitch, that curve replaces the one of the bearing error."""

    def __init__(self, data: FilmData, canvas: Canvas, show_pitch: bool = False) -> None:
        self._data, self._follower = data, data.follower
        s, t = canvas.scale, canvas.text_scale
        self._s, self._t, self._short = s, t, canvas.height < _SHORT
        left, top, width, gap, side = 16 * s, 16 * s, 292 * s, 6 * s, 232 * s
        rows = self._rows(data.at(data.start))
        self._numbers: Place = (left, top, width, (9 + sum(height for height, _ in rows)) * t)
        first, height = top + self._numbers[3] + gap, 92 * t
        curves: list[Place] = [(left, first + n * (height + gap), width, height) for n in range(2 - self._short)]
        corner = canvas.width - side - left
        self._map: Place = (corner, top, side, side)
        self.scale: Place = (left, canvas.height - 26 * s - 32 * t, 240 * s, 36 * t)
        """Where the scale of the picture stands."""
        self.places: list[Place] = [self._numbers, *curves, self._map]  # places of all panels
        lowest = max(y + h for _, y, _, h in (self._numbers, *curves))
        self.covered: list[Place] = [
            (0.0, 0.0, left + width, lowest),
            (corner, 0.0, canvas.width - corner, top + side),
        ]
        """Where nothing of the picture is drawn: between panels, snippets of lines would remain."""
        # what all frames have: lines, those of the map, and texts with their anchors
        self._lines, self._tracks = list[Stroke](), list[Stroke]()
        self._texts: list[tuple[tuple[float, float], str, Colour, float, str]] = []
        self._curves = [
            self._add_curve(place, *quantity)
            for place, quantity in zip(curves, self._quantities(show_pitch), strict=False)
        ]
        self._add_map()

    def _quantities(self, show_pitch: bool) -> list[tuple[str, Colour, Floats]]:
        """Label, colour and values at filter steps of the curves."""
        data, follower = self._data, self._follower
        position = ("position error [m]", ESTIMATE, data.position_error[follower])
        if show_pitch:
            # pitch is the cause of what the errors show, and stands above them
            pitch = np.degrees(data.flight.trajectory.pitch[data.flight.step_index(), 0])
            return [("leader's pitch [°]", LEADER, pitch), position]
        station_error = data.station_error(follower)
        if station_error is not None:
            return [position, ("distance from station [m]", STATION, station_error)]
        return [position, ("bearing error [°]", ESTIMATE, np.degrees(np.abs(data.bearing_error[follower])))]

    def _across(self, axes: Place, time: Floats | float) -> Floats:
        """Columns of times on the axes of a curve [px]."""
        start, end = self._data.start, self._data.steps[-1]
        return np.asarray(axes[0] + (time - start) / (end - start) * axes[2])

    def _add_curve(self, place: Place, label: str, colour: Colour, values: Floats) -> tuple[Place, Colour, Floats]:
        """Add the lines and texts of a curve; its axes, its colour and its points, shape (n, 2), [px]."""
        (left, top, width, height), s, t, data = place, self._s, self._t, self._data
        axes: Place = (left + 46 * t, top + 26 * t, width - 66 * t, height - 45 * t)
        finite = values[np.isfinite(values)]
        low, high = 1.08 * finite.min(initial=0.0), 1.08 * finite.max(initial=0.0)
        high = high if high > low else 1.0
        rows = axes[1] + (high - values) / (high - low) * axes[3]
        points = np.column_stack([self._across(axes, data.steps), rows])
        for tick in _ticks(3, low, high):
            y = axes[1] + (high - tick) / (high - low) * axes[3]
            self._lines.append(Stroke(np.array([[axes[0], y], [axes[0] + axes[2], y]]), (*_EDGE, 0.22), 1.0))
            self._texts.append(((axes[0] - 7 * t, y), f"{tick:g}", DIM, 11, "rm"))
        for tick in _ticks(2 if s < t else 5, data.start, float(data.steps[-1])):
            at = float(self._across(axes, tick)), axes[1] + axes[3] + 3 * t
            self._texts.append((at, f"{tick:g}", DIM, 11, "ma"))
        self._lines += _line(points, colour, 1.5)
        self._texts.append(((left + 12 * s, top + 17 * t), label, PALE, 12, "ls"))
        if s >= t:
            self._texts.append(((left + width - 12 * t, top + 17 * t), "time [s]", DIM, 11, "rs"))
        return axes, colour, points

    def _on_map(self, points: Floats, centre: Floats) -> Floats:
        """Places of points, shape (…, 2 or more), [m], on the map about a centre [px]."""
        left, top, width, height = self._map
        shifted = (points[..., :2] - centre) * (width / 2 / self._reach)
        return np.asarray(shifted * [1.0, -1.0] + [left + width / 2, top + height / 2])

    def _add_map(self) -> None:
        data, (left, top, width, _), s = self._data, self._map, self._s
        tracks = data.flight.trajectory.position[..., :2]
        low, high = tracks.min(axis=(0, 1)), tracks.max(axis=(0, 1))
        self._centre = (low + high) / 2
        self._reach = 0.55 * float(max((high - low).max(), 20.0))
        fleet = float(np.ptp(tracks, axis=1).max())
        self._moves = tracks.shape[1] > 2 and fleet < _FLEET_SHARE * 2 * self._reach
        if self._moves:
            self._reach = 0.75 * fleet
        else:
            for v in range(tracks.shape[1]):
                colour = (*(TRUTH if v else LEADER), 0.7 if v in (0, self._follower + 1) else 0.35)
                self._tracks += _line(self._on_map(tracks[:, v], self._centre), colour, 1.6)
            own = data.flight.estimates[self._follower].state
            self._tracks += _line(self._on_map(own, self._centre), (*ESTIMATE, 0.6), 1.1)
        length = round_length(0.4 * 2 * self._reach)
        x, y, across = left + 12 * s, top + 14 * s, length / 2 / self._reach * width
        bar = [[x, y - 4 * s], [x, y], [x + across, y], [x + across, y - 4 * s]]
        self._lines.append(Stroke(np.array(bar), PALE, 2.0))
        self._texts.append(((x, top + 29 * s), f"{length:g} m", PALE, 12, "ls"))
        self._texts.append(((left + width - 10 * s, top + 20 * s), "N ↑", PALE, -12, "rs"))

    def draw(self, canvas: Canvas, state: FrameState, trails: Sequence[Trail]) -> None:
        """Draw all panels on a frame, with recent tracks of vehicles and estimates."""
        canvas.shapes([Shape(corners(place), (*_PANEL, 0.55), (*_EDGE, 0.35)) for place in self.places])
        canvas.strokes(self._lines)
        self._draw_cursors(canvas, state.time)
        self._draw_map(canvas, state, trails)
        for text in self._texts:
            canvas.text(*text)
        left, baseline, width, _ = self._numbers
        for height, texts in self._rows(state):
            baseline += height * self._t
            for x, words, colour, size in texts:
                at = left + x * self._t + (0.0 if x > 0 else width)
                canvas.text((at, baseline), words, colour, size, "ls" if x > 0 else "rs")

    def _rows(self, state: FrameState) -> list[tuple[float, list[Text]]]:
        """Lines of the panel of numbers: distance from the line above, and texts."""
        f, data = self._follower, self._data
        kind, position, bearing = state.fix_kind[f], state.position_error[f], state.bearing_error[f]
        fix = "–" if kind is None else FIX_WORDS[kind]
        e_p = "–" if np.isnan(position) else f"{position:.2f} m"
        e_b = "–" if np.isnan(bearing) else f"{abs(np.degrees(bearing)):.1f}°"
        half_axes = SIGMAS * np.sqrt(np.maximum(np.linalg.eigvalsh(state.covariance[f]), 0.0))
        sigma = "" if np.isnan(position) else format_half_axes(*half_axes[self._short :])
        end = f"of {clock(data.end)}"
        if self._short:
            return [
                (22, [(6, clock(state.time), PALE, -18), (-6, end, DIM, 11)]),
                (24, [(6, "position error", ESTIMATE, 11), (-6, e_p, ESTIMATE, -12)]),
                (19, [(6, "bearing error", ESTIMATE, 11), (-6, e_b, ESTIMATE, -12)]),
                (19, [(6, f"{SIGMAS:g}σ", DIM, 11), (-6, sigma, ESTIMATE, 12)]),
                (19, [(6, fix, PALE, 12)]),
            ]
        vehicles = (0, f + 1)
        motion: dict[str, list[str]] = {
            "depth [m]": [f"{-state.position[v, 2]:.1f}" for v in vehicles],
            "pitch [°]": [f"{round(float(np.degrees(state.pitch[v])), 1) + 0.0:+.1f}" for v in vehicles],
            "heading [°]": [f"{round(float(np.degrees(state.heading[v]))) % 360}" for v in vehicles],
            "speed [m/s]": [f"{state.speed[v]:.1f}" for v in vehicles],
        }
        rows: list[tuple[float, list[Text]]] = [
            (19, [(12, name, DIM, 13), *((x, words, PALE, 13) for x, words in zip(_COLUMNS, values, strict=True))])
            for name, values in motion.items()
        ]
        heads = zip(_COLUMNS, vehicles, (LEADER, TRUTH), strict=True)
        transmitters = range(data.flight.scenario.navigation.transmitters)
        # names in the colours of the rays, as their legend
        rays = TRANSMITTER_COLOURS
        right = [-12.0 - 65.0 * (len(transmitters) - 1 - i) for i in transmitters]
        ranges = ["–" if np.isnan(state.ranges[f, i]) else f"{state.ranges[f, i]:.2f}" for i in transmitters]
        return [
            (34, [(12, clock(state.time), (1, 1, 1), -26), (-12, end, DIM, 13)]),
            (27, [(x, data.flight.trajectory.names[v][:12], colour, -12) for x, v, colour in heads]),
            *rows,
            (20, [(right[i], _TRANSMITTERS[i], rays[i], 11) for i in transmitters]),
            (17, [(12, "ranges [m]", DIM, 13), *((right[i], ranges[i], rays[i], 13) for i in transmitters)]),
            (19, [(12, "fix", DIM, 13), (-12, fix, PALE, 13)]),
            (24, [(12, "position error", ESTIMATE, -14), (-12, e_p, ESTIMATE, -14)]),
            (20, [(12, "bearing error", ESTIMATE, -14), (-12, e_b, ESTIMATE, -14)]),
            (19, [(12, f"filter's {SIGMAS:g}σ", DIM, 13), (-12, sigma, ESTIMATE, 13)]),
        ]  # fmt: skip

    def _draw_cursors(self, canvas: Canvas, time: float) -> None:
        step, strokes, dots = self._data.step(time), [], []
        for axes, colour, points in self._curves:
            x = float(self._across(axes, time))
            strokes.append(Stroke(np.array([[x, axes[1]], [x, axes[1] + axes[3]]]), (*PALE, 0.8), 1.5))
            if step and np.isfinite(points[step - 1, 1]):
                dots.append(canvas.disc(points[step - 1], 3.5, colour, PALE))
        canvas.strokes(strokes)
        canvas.shapes(dots)

    def _draw_map(self, canvas: Canvas, state: FrameState, trails: Sequence[Trail]) -> None:
        fleet = state.position[:, :2]
        centre = (fleet.min(axis=0) + fleet.max(axis=0)) / 2 if self._moves else self._centre
        moving = [Stroke(self._on_map(points, centre), (*colour[:3], 0.5), 1.2) for points, colour in trails]
        canvas.strokes(moving if self._moves else self._tracks, self._map)
        marks = [canvas.diamond(self._on_map(state.estimate[self._follower], centre), 4.5, ESTIMATE)]
        marks += [canvas.disc(at, 3.4, TRUTH if v else LEADER) for v, at in enumerate(self._on_map(fleet, centre))]
        canvas.shapes(marks, self._map)
