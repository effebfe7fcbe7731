"""A quantity over the mission, in a panel of the overlay."""

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator

from laisn.arrays import Floats
from sim.film.canvas import DIM, PALE, Canvas, Colour

Place = tuple[float, float, float, float]
"""Left, top, width, height [px]."""

_TIME = "time [s]"
_LINE: Colour = (0.55, 0.80, 0.90, 0.22)


def _ticks(low: float, high: float, most: int) -> list[float]:
    """Round numbers within limits, zero among them if it lies there, at most about `most`."""
    ticks = [float(v) for v in MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high) if low <= v <= high]
    if len(ticks) > most + 1:
        ticks = [v for v in ticks if round(v / (ticks[1] - ticks[0])) % 2 == 0]
    return ticks


class Curve:
    """A quantity over the mission, drawn up to now; its axis holds zero and all values.

    Args:
        label: what it is, with its unit.
        dt: interval of the values [s].
        values: by colour, each of shape (n,), at steps k = 1 … n, the last on top.
        place: where it lies.
        start: time on the mission's clock before the first step [s].
    """

    def __init__(
        self, label: str, dt: float, values: Sequence[tuple[Colour, Floats]], place: Place, *, start: float = 0.0
    ) -> None:
        self._label, self.place, self._dt, self._start = label, place, dt, start
        all_values = np.stack([v for _, v in values])
        finite = all_values[np.isfinite(all_values)]
        self._low, self._high = 1.08 * float(finite.min(initial=0.0)), 1.08 * float(finite.max(initial=0.0))
        if not self._high > self._low:
            self._high = 1.0
        n = all_values.shape[1]
        self._now, self._end = np.nan_to_num(all_values), dt * n
        # the value furthest from zero in each column of pixels: thinning must not hide a peak
        every = max(1, n // max(1, int(place[2])))
        columns = self._now[:, : n // every * every].reshape(len(all_values), -1, every)
        furthest = np.abs(columns).argmax(axis=2)[..., None]
        self._past = np.take_along_axis(columns, furthest, axis=2)[..., 0]
        self._colours = [colour for colour, _ in values]
        self._time = dt * every * (np.arange(self._past.shape[1]) + 1)

    def _axes(self, canvas: Canvas) -> tuple[float, float, float, float]:
        """Left and lower end of the axes, and their width and height [px]."""
        s = canvas.text_scale
        left, top, width, height = self.place
        x0, y0 = left + 46 * s, top + height - 19 * s
        # room for the half of the last number that stands beyond the axis, and for the words above
        return x0, y0, left + width - 20 * s - x0, y0 - top - 26 * s

    def ground(self, canvas: Canvas) -> None:
        """Panel, words and axes: all that stays as it is throughout the film."""
        s = canvas.text_scale
        left, top, width, height = self.place
        x0, y0, across, up = self._axes(canvas)
        canvas.panel(left, top, width, height)
        canvas.text((left + 12 * canvas.scale, top + 5 * s), self._label, PALE, 12)
        if canvas.extent(self._label, 12)[0] + canvas.extent(_TIME, 11)[0] < width - 30 * s:
            canvas.text((left + width - 12 * s, top + 5 * s), _TIME, DIM, 11, "ra")
        span = self._high - self._low
        for tick in _ticks(self._low, self._high, 3):
            y = y0 - up * (tick - self._low) / span
            canvas.line(np.array([[x0, y], [x0 + across, y]]), _LINE, 1.0)
            canvas.text((x0 - 6 * s, y), f"{tick:g}".replace("-", "−"), DIM, 11, "rm")
        for tick in _ticks(self._start, self._start + self._end, max(1, min(5, int(across / (40 * s))))):
            x = x0 + across * (tick - self._start) / self._end
            canvas.text((x, y0 + 3 * s), f"{tick:g}", DIM, 10, "ma")

    def draw(self, canvas: Canvas, time: float) -> None:
        """The curve from the start of the film to `time` [s] after it."""
        x0, y0, across, up = self._axes(canvas)
        span = self._high - self._low
        seen = self._time <= time
        # the curve ends at the very value of now, which is the one in numbers beside it
        now = min(int(time / self._dt + 1e-9), self._now.shape[1])
        at = np.append(self._time[seen], self._dt * now) if now else np.zeros(0)
        for colour, past, exact in zip(self._colours, self._past[:, seen], self._now, strict=True):
            values = np.append(past, exact[now - 1]) if now else np.zeros(0)
            points = np.column_stack([x0 + across * at / self._end, y0 - up * (values - self._low) / span])
            if len(points) > 1:
                canvas.line(points, (*colour[:3], 0.95), 1.5)
            if len(points):
                canvas.dot(points[-1], 3.0, colour)
