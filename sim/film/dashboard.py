"""The panels of a film: numbers and curves at the left, map and colour bar at the right, a caption
between them.

All that stays as it is from frame to frame, curves of the whole mission included, is drawn once by
matplotlib; a frame adds the numbers, cursors on the curves, and vehicles on the map.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import IdentityTransform

from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS
from laisn.messages import Ranges
from sim.film.canvas import (
    DIM,
    PALE,
    Area,
    Canvas,
    Colour,
    Layer,
    Stroke,
    layer_of,
    new_figure,
)
from sim.film.film_data import (
    ESTIMATE,
    LEADER,
    STATION,
    TRUTH,
    FilmData,
    FilmFrame,
    RayErrors,
    diverging,
)

Trail = tuple[Floats, Colour]  # positions, shape (p, 3), [m], and the colour of their line
Text = tuple[float, str, Colour, float]
"""Distance from the left edge of a panel, or from the right one if negative, words, colour, and
size, bold if negative; both in pixels at 720 rows.
"""
Row = tuple[float, list[Text]]
"""A line of the panel of numbers: distance from the line above, in pixels at 720 rows, and
texts.
"""

SIGMAS = 2.0  # half axes of the ellipse of uncertainty in standard deviations
_SHORT_ROWS = 576
"""Frames of fewer rows have the short panel of numbers and one curve: text that can be read
leaves no room for more.
"""
_PANEL: Colour = (0.01, 0.06, 0.10)
_EDGE: Colour = (0.55, 0.80, 0.90)
# a map of the whole mission shows several followers apart if they take at least this share of it
_FLEET_SHARE = 0.25
# right edges of the leader's and the follower's numbers, from the right edge of the panel
_COLUMNS = (-106.0, -12.0)
_MARGIN_PX = 2  # around a panel's area, for the line of its edge


def clock(seconds: float) -> str:
    """Time as [hours:]minutes:seconds."""
    full_seconds = int(seconds + 1e-9)
    hours = f"{full_seconds // 3600}:" if full_seconds >= 3600 else ""
    return f"{hours}{full_seconds % 3600 // 60:02d}:{full_seconds % 60:02d}"


def format_half_axes(*half_axes: float) -> str:
    """Half axes of an ellipse [m], the longest last, in millimetres while that is below a metre."""
    longest = half_axes[-1]
    if longest < 0.0005:
        return "below 1 mm"
    unit, scale, digits = ("mm", 1e3, 0) if longest < 0.9995 else ("m", 1.0, 2)
    return f"{' by '.join(f'±{scale * half_axis:.{digits}f}' for half_axis in half_axes)} {unit}"


def round_length(longest_m: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten up to a length [m]."""
    power = 10.0 ** np.floor(np.log10(longest_m))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest_m))


class Dashboard:
    """Panels of one film; if it is about the leader's pitch, that curve replaces the one of the
    bearing error.
    """

    def __init__(self, data: FilmData, canvas: Canvas, show_pitch: bool = False) -> None:
        self._data = data
        self._follower = data.follower
        self._annotations = data.annotations
        s = canvas.scale
        t = canvas.text_scale
        # pixels to a pixel of a frame of 720 rows, in which sizes are given here; those of text and
        # of what holds it shrink with the frame only as far as it can be read
        self._scale = s
        self._text_scale = t
        self._size = (canvas.width, canvas.height)
        self._short = canvas.height < _SHORT_ROWS
        left = 16 * s
        top = 16 * s
        width = 292 * s
        gap = 6 * s
        side = 232 * s
        rows = self._rows(data.at(data.start))
        self._numbers: Area = (left, top, width, (9 + sum(height for height, _ in rows)) * t)
        first = top + self._numbers[3] + gap
        height = 92 * t
        curves: list[Area] = [
            (left, first + n * (height + gap), width, height) for n in range(2 - self._short)
        ]
        corner = canvas.width - side - left
        self._map: Area = (corner, top, side, side)
        bar: Area = (corner, top + side + gap, side, 72 * t)
        left_edge = left + width + gap
        caption: Area = (left_edge, top, corner - gap - left_edge, 60 * s)
        self.scale_bar_area: Area = (left, canvas.height - 26 * s - 32 * t, 240 * s, 36 * t)
        """Where the scale of the picture stands."""
        left_column = [self._numbers, *curves]
        right_column = [self._map]
        if self._annotations.rays:
            right_column.append(bar)
        words = [caption] if self._annotations.caption else []
        self.places: list[Area] = [*left_column, *right_column, *words]  # places of all panels
        lower_left, lower_right = (
            max(y + h for _, y, _, h in column) for column in (left_column, right_column)
        )
        self.covered: list[Area] = [
            (0.0, 0.0, left + width, lower_left),
            (corner, 0.0, canvas.width - corner, lower_right),
            *words,
        ]
        """Where nothing of the picture is drawn: between panels, snippets of lines would remain."""

        self.figure = new_figure(*self._size)  # static content of all panels
        for x, y, width, height in self.places:
            self.figure.add_artist(
                Rectangle(
                    (x, canvas.height - y - height),
                    width,
                    height,
                    fc=(*_PANEL, 0.55),
                    ec=(*_EDGE, 0.35),
                    lw=s,
                    zorder=-1,
                    transform=IdentityTransform(),
                )
            )
        quantities = self._quantities(show_pitch)
        self._curves = [
            (self._add_curve(area, label, values), values)
            for area, (label, values) in zip(curves, quantities, strict=False)
        ]
        self._add_map()
        if self._annotations.rays:
            self._add_colour_bar(bar, self._annotations.rays)
        if self._annotations.caption:
            self._add_caption(caption)
        self._layers = self._drawn()

    def _drawn(self) -> list[tuple[int, int, Layer]]:
        """The figure as an image for each panel, with the image's left and upper edge [px]."""
        agg: Any = FigureCanvasAgg(self.figure)
        agg.draw()
        pixels = np.asarray(agg.buffer_rgba())
        images = []
        for x, y, width, height in self.places:
            left, top = (max(0, int(v) - _MARGIN_PX) for v in (x, y))
            panel = pixels[top : int(y + height) + _MARGIN_PX, left : int(x + width) + _MARGIN_PX]
            images.append((left, top, layer_of(panel)))
        return images

    def _write(
        self,
        position: tuple[float, float],
        words: str,
        colour: Colour,
        size: float,
        ha: str,
        va: str,
    ) -> None:
        """Static text at an anchor, with matplotlib's names of alignments; bold if size < 0."""
        x = position[0] / self._size[0]
        y = 1 - position[1] / self._size[1]
        weight = "bold" if size < 0 else "normal"
        self.figure.text(
            x,
            y,
            words,
            color=colour,
            fontsize=abs(size) * self._text_scale,
            fontweight=weight,
            ha=ha,
            va=va,
        )

    def _axes(self, area: Area) -> Axes:
        """Axes without a frame at a place."""
        x, y, width, height = area
        columns, rows = self._size
        axes = self.figure.add_axes(
            (x / columns, 1 - (y + height) / rows, width / columns, height / rows)
        )
        axes.set_frame_on(False)
        axes.tick_params(length=0, pad=3, colors=DIM, labelsize=10.5 * self._text_scale)
        return axes

    def _quantities(self, show_pitch: bool) -> list[tuple[str, list[tuple[Colour, Floats]]]]:
        """Label and curves, each a colour and values at filter steps, of what the panels of
        curves show.
        """
        data = self._data
        follower = self._follower
        truth = data.flight.hydrophone(follower)[:, :2]
        errors: list[tuple[Colour, Floats]] = [
            *(
                (other.colour, np.linalg.norm(other.position - truth, axis=1))
                for other in self._annotations.others
            ),
            (ESTIMATE, data.position_error[follower]),
        ]
        position = ("position error [m]", errors)
        if show_pitch:
            # pitch is the cause of what the errors show, and stands above them
            pitch = np.degrees(data.flight.trajectory.pitch[data.flight.step_index(), 0])
            return [("leader's pitch [°]", [(LEADER, pitch)]), position]
        station_error = data.station_error(follower)
        if station_error is not None:
            return [position, ("distance from station [m]", [(STATION, station_error)])]
        return [
            position,
            ("bearing error [°]", [(ESTIMATE, np.degrees(np.abs(data.bearing_error[follower])))]),
        ]

    def _add_curve(self, area: Area, label: str, curves: list[tuple[Colour, Floats]]) -> Axes:
        left, top, width, height = area
        t = self._text_scale
        data = self._data
        axes = self._axes((left + 46 * t, top + 26 * t, width - 66 * t, height - 45 * t))
        for colour, values in curves:
            axes.plot(data.step_times, values, color=colour, lw=1.5 * self._scale, clip_on=False)
        finite = np.concatenate([values[np.isfinite(values)] for _, values in curves])
        low, high = 1.08 * finite.min(initial=0.0), 1.08 * finite.max(initial=0.0)
        axes.set_ylim(low, high if high > low else 1.0)
        axes.set_xlim(data.start, float(data.step_times[-1]))
        axes.tick_params(axis="y", pad=7 * t)
        axes.grid(axis="y", color=(*_EDGE, 0.22), lw=self._scale)
        axes.yaxis.set_major_locator(MaxNLocator(3, steps=[1, 2, 5, 10]))
        axes.xaxis.set_major_locator(
            MaxNLocator(2 if self._scale < self._text_scale else 5, steps=[1, 2, 5, 10])
        )
        self._write((left + 12 * self._scale, top + 17 * t), label, PALE, 12, "left", "baseline")
        if self._scale >= self._text_scale:
            self._write(
                (left + width - 12 * t, top + 17 * t), "time [s]", DIM, 11, "right", "baseline"
            )
        return axes

    def _add_map(self) -> None:
        data = self._data
        left, top, width, _ = self._map
        s = self._scale
        tracks = data.flight.trajectory.position[..., :2]
        low, high = tracks.min(axis=(0, 1)), tracks.max(axis=(0, 1))
        self._centre = (low + high) / 2
        # half of the map's side [m]: the tracks, and a tenth more
        self._reach = 0.55 * float(max((high - low).max(), 20.0))
        # most that the vehicles are ever apart, along an axis [m]
        fleet_width = float(np.ptp(tracks, axis=1).max())
        self._map_follows_fleet = (
            tracks.shape[1] > 2 and fleet_width < _FLEET_SHARE * 2 * self._reach
        )
        if self._map_follows_fleet:
            self._reach = 0.75 * fleet_width
        else:
            axes = self._axes(self._map)
            axes.set_axis_off()
            axes.set_xlim(self._centre[0] - self._reach, self._centre[0] + self._reach)
            axes.set_ylim(self._centre[1] - self._reach, self._centre[1] + self._reach)
            for v in range(tracks.shape[1]):
                highlighted = v in (0, self._follower + 1)
                axes.plot(
                    *tracks[:, v].T,
                    color=TRUTH if v else LEADER,
                    alpha=0.7 if highlighted else 0.35,
                    lw=1.6 * s,
                )
            estimate = data.flight.estimates[self._follower].state
            for colour, track in [
                *((o.colour, o.position) for o in self._annotations.others),
                (ESTIMATE, estimate),
            ]:
                axes.plot(*track[:, :2].T, color=colour, alpha=0.6, lw=1.1 * s)
        length = round_length(0.4 * 2 * self._reach)
        x = left + 12 * s
        y = self._size[1] - top - 14 * s
        across = length / 2 / self._reach * width
        bar = ([x, x, x + across, x + across], [y + 4 * s, y, y, y + 4 * s])
        look: Any = {"color": PALE, "lw": 2 * s, "transform": IdentityTransform()}
        self.figure.add_artist(Line2D(*bar, **look))
        self._write((x, top + 18 * s), f"{length:g} m", PALE, 12, "left", "top")
        self._write((left + width - 10 * s, top + 10 * s), "N ↑", PALE, -12, "right", "top")

    def _add_colour_bar(self, area: Area, rays: RayErrors) -> None:
        """What the colours of the rays mean."""
        left, top, width, _ = area
        t = self._text_scale
        axes = self._axes((left + 24 * t, top + 29 * t, width - 48 * t, 9 * t))
        gradient = diverging(np.linspace(-1.0, 1.0, 256))[None]
        axes.imshow(gradient, aspect="auto", extent=(-rays.limit, rays.limit, 0.0, 1.0))
        axes.set_yticks([])
        axes.set_xticks(
            [-rays.limit, 0.0, rays.limit], [f"−{rays.limit:g}", "0", f"+{rays.limit:g}"]
        )
        self._write((left + 12 * t, top + 8 * t), f"{rays.label} [m]", PALE, 12, "left", "top")
        self._write((left + 12 * t, top + 68 * t), "too short", PALE, 11, "left", "baseline")
        self._write(
            (left + width - 12 * t, top + 68 * t), "too long", PALE, 11, "right", "baseline"
        )

    def _add_caption(self, area: Area) -> None:
        """What the film is about, and below it what its marks mean."""
        left, top, width, height = area
        s = self._scale
        middle = left + width / 2
        self._write(
            (middle, top + 25 * s),
            self._annotations.caption,
            (1, 1, 1),
            -16 * s / self._text_scale,
            "center",
            "baseline",
        )
        others = [("D", o.colour, o.label) for o in self._annotations.others]
        marks = [("o", TRUTH, "truth"), ("D", ESTIMATE, self._annotations.label), *others]
        handles = [
            Line2D([], [], marker=m, ls="", ms=7 * s, color=colour, label=name)
            for m, colour, name in marks
        ]
        self.figure.legend(
            handles=handles,
            loc="lower center",
            ncols=len(marks),
            frameon=False,
            labelcolor="linecolor",
            bbox_to_anchor=(middle / self._size[0], 1 - (top + height) / self._size[1]),
            prop={"size": 13 * s, "weight": "bold"},
            handletextpad=0.1,
        )

    def draw(self, canvas: Canvas, state: FilmFrame, trails: Sequence[Trail]) -> None:
        """Draw all panels on a frame, with recent tracks of vehicles and estimates."""
        for column, row, layer in self._layers:
            canvas.image(layer, column, row)
        self._draw_cursors(canvas, state.time)
        self._draw_map(canvas, state, trails)
        left, baseline, width, _ = self._numbers
        for height, texts in self._rows(state):
            baseline += height * self._text_scale
            for x, words, colour, size in texts:
                position = left + x * self._text_scale + (0.0 if x > 0 else width)
                canvas.text((position, baseline), words, colour, size, "ls" if x > 0 else "rs")

    def _rows(self, state: FilmFrame) -> list[Row]:
        """Lines of the panel of numbers."""
        f = self._follower
        kind = state.fix_kind[f]
        position = state.position_error[f]
        bearing = state.bearing_error[f]
        fix = "–" if kind is None else FIX_WORDS[kind]
        e_p = "–" if np.isnan(position) else f"{position:.2f} m"
        e_b = "–" if np.isnan(bearing) else f"{abs(np.degrees(bearing)):.1f}°"
        half_axes = SIGMAS * np.sqrt(np.maximum(np.linalg.eigvalsh(state.covariance[f]), 0.0))
        # the short panel has room for the longer one alone
        sigma = "" if np.isnan(position) else format_half_axes(*half_axes[self._short :])
        end = f"of {clock(self._data.end)}"
        if self._short:
            return [
                (22, [(6, clock(state.time), PALE, -18), (-6, end, DIM, 11)]),
                (24, [(6, "position error", ESTIMATE, 11), (-6, e_p, ESTIMATE, -12)]),
                (19, [(6, "bearing error", ESTIMATE, 11), (-6, e_b, ESTIMATE, -12)]),
                (19, [(6, f"{SIGMAS:g}σ", DIM, 11), (-6, sigma, ESTIMATE, 12)]),
                (19, [(6, fix, PALE, 12)]),
            ]
        return [
            (34, [(12, clock(state.time), (1, 1, 1), -26), (-12, end, DIM, 13)]),
            *self._motion_rows(state),
            *self._range_rows(state),
            (19, [(12, "fix", DIM, 13), (-12, fix, PALE, 13)]),
            (24, [(12, "position error", ESTIMATE, -14), (-12, e_p, ESTIMATE, -14)]),
            (20, [(12, "bearing error", ESTIMATE, -14), (-12, e_b, ESTIMATE, -14)]),
            (19, [(12, f"filter's {SIGMAS:g}σ", DIM, 13), (-12, sigma, ESTIMATE, 13)]),
        ]

    def _motion_rows(self, state: FilmFrame) -> list[Row]:
        """Names of leader and follower, and how they move."""
        vehicles = (0, self._follower + 1)
        names = [self._data.flight.trajectory.names[v][:12] for v in vehicles]
        # an angle that is rounded to nothing has no minus sign
        pitch = [round(float(np.degrees(state.pitch[v])), 1) + 0.0 for v in vehicles]
        heading = [round(float(np.degrees(state.heading[v]))) % 360 for v in vehicles]
        motion = {
            "depth [m]": [f"{-state.position[v, 2]:.1f}" for v in vehicles],
            "pitch [°]": [f"{angle:+z.1f}" for angle in pitch],
            "heading [°]": [f"{angle}" for angle in heading],
            "speed [m/s]": [f"{state.speed[v]:.1f}" for v in vehicles],
        }
        heads = zip(_COLUMNS, names, (LEADER, TRUTH), strict=True)
        rows: list[Row] = [(27, [(x, name, colour, -12) for x, name, colour in heads])]
        for name, values in motion.items():
            columns = zip(_COLUMNS, values, strict=True)
            rows.append((19, [(12, name, DIM, 13), *((x, text, PALE, 13) for x, text in columns)]))
        return rows

    def _range_rows(self, state: FilmFrame) -> list[Row]:
        """Names of the transmitters in the colours of their rays, as their legend, and ranges."""
        f = self._follower
        count = self._data.flight.scenario.navigation_of(f).transmitters
        colours = self._annotations.ray_colours(state.message[f])
        right = [-12.0 - 65.0 * (count - 1 - i) for i in range(count)]
        ranges = ["–" if np.isnan(r) else f"{r:.2f}" for r in state.ranges[f, :count]]
        return [
            (20, [(right[i], Ranges._fields[i], colours[i], 11) for i in range(count)]),
            (
                17,
                [
                    (12, "ranges [m]", DIM, 13),
                    *((right[i], ranges[i], colours[i], 13) for i in range(count)),
                ],
            ),
        ]

    def _draw_cursors(self, canvas: Canvas, time: float) -> None:
        step = self._data.step(time)
        strokes = []
        dots = []
        for axes, curves in self._curves:
            ends = axes.transData.transform([(time, limit) for limit in axes.get_ylim()])
            strokes.append(Stroke(self._downward(ends), (*PALE, 0.8), 1.5))
            for colour, values in curves:
                if step and np.isfinite(values[step - 1]):
                    latest = axes.transData.transform(
                        [(self._data.step_times[step - 1], values[step - 1])]
                    )
                    dots.append(canvas.disc(self._downward(latest)[0], 3.5, colour, PALE))
        canvas.strokes(strokes)
        canvas.shapes(dots)

    def _downward(self, points: Floats) -> Floats:
        """Points of the figure, shape (n, 2), counted from the top left [px]."""
        return np.asarray(points * [1.0, -1.0] + [0.0, self._size[1]])

    def _draw_map(self, canvas: Canvas, state: FilmFrame, trails: Sequence[Trail]) -> None:
        left, top, width, height = self._map
        fleet = state.position[:, :2]
        centre = (
            (fleet.min(axis=0) + fleet.max(axis=0)) / 2 if self._map_follows_fleet else self._centre
        )

        def pixels(points: Floats) -> Floats:
            shifted = (points[..., :2] - centre) * (width / 2 / self._reach)
            return np.asarray(shifted * [1.0, -1.0] + [left + width / 2, top + height / 2])

        if self._map_follows_fleet:
            lines = [Stroke(pixels(points), (*colour[:3], 0.5), 1.2) for points, colour in trails]
            canvas.strokes(lines, self._map)
        estimates = [
            (o.colour, position)
            for o, position in zip(self._annotations.others, state.others, strict=True)
        ]
        marks = [
            canvas.diamond(pixels(position), 4.5, colour)
            for colour, position in [*estimates, (ESTIMATE, state.estimate[self._follower])]
        ]
        marks += [
            canvas.disc(pixel, 3.4, TRUTH if v else LEADER) for v, pixel in enumerate(pixels(fleet))
        ]
        canvas.shapes(marks, self._map)
