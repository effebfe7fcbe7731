"""The panel of numbers at the top left: time, motion, ranges, fix and errors."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sim.film.canvas import DIM, PALE, Canvas, Colour
from sim.film.footage import Footage, Moment
from sim.film.panels import FIX_WORDS, LEADER, SIGMAS, TRUTH, Place
from sim.film.scene import ESTIMATE

HEIGHT, SHORT_HEIGHT = 258.0, 118.0
"""Height of the panel, and of the short one [px times the scale of words]."""
_TRANSMITTERS = ("rear", "front", "middle")
_MOTION = ("depth [m]", "pitch [°]", "heading [°]", "speed [m/s]")


def _clock(seconds: float) -> str:
    whole = int(seconds + 1e-9)
    hours = f"{whole // 3600}:" if whole >= 3600 else ""
    return f"{hours}{whole % 3600 // 60:02d}:{whole % 60:02d}"


def in_words(*half_axes: float) -> str:
    """Half axes of an ellipse [m], the longest last, in millimetres while that is below a metre."""
    longest = half_axes[-1]
    if longest < 0.0005:
        return "below 1 mm"
    unit, scale, digits = ("mm", 1e3, 0) if longest < 0.9995 else ("m", 1.0, 2)
    return f"{' by '.join(f'±{scale * half:.{digits}f}' for half in half_axes)} {unit}"


class Numbers:
    """Numbers of the leader and of one follower.

    Args:
        footage: what is filmed.
        follower: index of the follower.
        place: where the panel lies.
        short: whether there is room for time, errors and fix alone.
    """

    def __init__(self, footage: Footage, follower: int, place: Place, *, short: bool) -> None:
        self.place, self._short = place, short
        self._follower = follower
        self._end = f"of {_clock(footage.end)}"
        names = footage.flight.trajectory.names
        self._heads = ((names[0][:12], LEADER), (names[follower + 1][:12], TRUTH))
        self._heard = range(footage.flight.scenario.navigation.transmitters)

    def _edges(self, canvas: Canvas) -> tuple[float, float, float]:
        """Left and right edge of the words, and the height of the first."""
        left, top, width, _ = self.place
        gap = (6 if self._short else 12) * canvas.text_scale
        return left + gap, left + width - gap, top + (6 if self._short else 10) * canvas.text_scale

    def _rows(self, canvas: Canvas) -> dict[str, float]:
        """Heights of the rows [px]."""
        _, _, top = self._edges(canvas)
        s = canvas.text_scale
        if self._short:
            return {"E_P": top + 30 * s, "E_B": top + 50 * s, "sigma": top + 72 * s, "fix": top + 90 * s}
        motion = {label: top + (61 + 19 * n) * s for n, label in enumerate(_MOTION)}
        after = {"names": 142, "ranges": 157, "fix": 176, "E_P": 200, "E_B": 200, "sigma": 222}
        return {"heads": top + 42 * s, **motion, **{key: top + y * s for key, y in after.items()}}

    def _column(self, canvas: Canvas, transmitter: int) -> float:
        """Right edge of a range."""
        _, right, _ = self._edges(canvas)
        return right - 65 * canvas.text_scale * (len(self._heard) - 1 - transmitter)

    def ground(self, canvas: Canvas) -> None:
        """Panel and words: all that stays as it is throughout the film."""
        canvas.panel(*self.place)
        (x, right, top), rows, s = self._edges(canvas), self._rows(canvas), canvas.text_scale
        canvas.text((right, top + (6 if self._short else 11) * s), self._end, DIM, 11 if self._short else 13, "ra")
        if self._short:
            canvas.text((x, rows["sigma"]), f"{SIGMAS:g}σ", DIM, 12)
            return
        for edge, (name, colour) in zip((right - 94 * s, right), self._heads, strict=True):
            canvas.text((edge, rows["heads"]), name, colour, -12, "ra")
        for label in _MOTION:
            canvas.text((x, rows[label]), label, DIM, 13)
        canvas.text((x, rows["ranges"]), "ranges [m]", DIM, 13)
        canvas.text((x, rows["fix"]), "fix", DIM, 13)
        canvas.text((x, rows["sigma"]), f"filter's own {SIGMAS:g}σ", DIM, 13)

    def draw(self, canvas: Canvas, moment: Moment, rays: Sequence[Colour]) -> None:
        """The numbers of a moment, ranges in the colours of their rays."""
        (x, right, top), rows = self._edges(canvas), self._rows(canvas)
        canvas.text((x, top), _clock(moment.time), size=-18 if self._short else -26)
        if not self._short:
            self._motion(canvas, moment)
            # what the colours of the rays mean
            for i in self._heard:
                value, edge = moment.ranges[self._follower, i], self._column(canvas, i)
                canvas.text((edge, rows["names"]), _TRANSMITTERS[i], rays[i], 11, "ra")
                canvas.text((edge, rows["ranges"]), "–" if np.isnan(value) else f"{value:.2f}", rays[i], 13, "ra")
        self._errors(canvas, moment)
        kind = moment.fix_kind[self._follower]
        words = "–" if kind is None else FIX_WORDS[kind]
        if self._short:
            canvas.text((x, rows["fix"]), words, PALE, 12)
        else:
            canvas.text((right, rows["fix"]), words, PALE, 13, "ra")

    def _motion(self, canvas: Canvas, moment: Moment) -> None:
        _, right, _ = self._edges(canvas)
        quantities: tuple[tuple[npt.NDArray[np.floating], str], ...] = (
            (-moment.position[:, 2], "{:.1f}"),
            (np.round(np.degrees(moment.pitch), 1) + 0.0, "{:+.1f}"),
            (np.round(np.degrees(moment.heading)) % 360, "{:.0f}"),
            (moment.speed, "{:.1f}"),
        )
        rows = self._rows(canvas)
        for label, (values, form) in zip(_MOTION, quantities, strict=True):
            for edge, v in zip((right - 94 * canvas.text_scale, right), (0, self._follower + 1), strict=True):
                canvas.text((edge, rows[label]), form.format(values[v]), PALE, 13, "ra")

    def _errors(self, canvas: Canvas, moment: Moment) -> None:
        (x, right, _), rows = self._edges(canvas), self._rows(canvas)
        position, bearing = (errors[self._follower] for errors in (moment.position_error, moment.bearing_error))
        first = "–" if np.isnan(position) else f"{position:.2f} m"
        second = "–" if np.isnan(bearing) else f"{abs(np.degrees(bearing)):.1f}°"
        size = -14 if self._short else -16
        canvas.text((x, rows["E_P"]), f"E_P  {first}", ESTIMATE, size)
        edge, anchor = (x, "la") if self._short else (right, "ra")
        canvas.text((edge, rows["E_B"]), f"E_B  {second}", ESTIMATE, size, anchor)
        if not np.isnan(position):
            half_axes = SIGMAS * np.sqrt(np.maximum(np.linalg.eigvalsh(moment.covariance[self._follower]), 0.0))
            words = in_words(*half_axes[1:]) if self._short else in_words(*half_axes)
            canvas.text((right, rows["sigma"]), words, ESTIMATE, 12 if self._short else 13, "ra")
