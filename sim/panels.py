"""Panels of the overlay: numbers, map, curves and title card."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.ticker import MaxNLocator

from laisn.estimates import FixKind
from sim.annotations import OtherEstimate, RayErrors, diverging
from sim.canvas import Canvas, Colour
from sim.footage import Footage, Moment
from sim.scene import ESTIMATE

Floats = npt.NDArray[np.float64]
Place = tuple[float, float, float, float]
"""Left, top, width, height [px]."""

LEADER: Colour = (1.0, 0.68, 0.20)
"""Colour of the leader's trail and label, after its hull."""
TRUTH: Colour = (1.0, 0.95, 0.25)
"""Colour of a follower's true trail and position, after its hull."""
FIX_WORDS = {
    FixKind.TWO_POINTS: "two points",
    FixKind.TANGENT: "circles touch",
    FixKind.ASTERN: "on the axis, astern",
    FixKind.FUSED: "weighted mean",
    FixKind.GATED: "rejected by the gate",
    FixKind.SINGULAR: "already exact",
    FixKind.LOST: "ranges missing",
}

_PALE: Colour = (0.80, 0.92, 0.97)
_DIM: Colour = (0.60, 0.76, 0.83)
_LINE: Colour = (0.55, 0.80, 0.90, 0.22)


def _clock(seconds: float) -> str:
    whole = int(seconds + 1e-9)
    hours = f"{whole // 3600}:" if whole >= 3600 else ""
    return f"{hours}{whole % 3600 // 60:02d}:{whole % 60:02d}"


def _ticks(low: float, high: float, most: int) -> list[float]:
    return [float(v) for v in MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high) if low <= v <= high]


def numbers(canvas: Canvas, footage: Footage, moment: Moment, follower: int, rays: Sequence[Colour]) -> None:
    """Time, motion of leader and follower, ranges in the colours of their rays, fix and errors, at the top left."""
    s, names = canvas.scale, footage.flight.trajectory.names
    left, top, width = 16 * s, 16 * s, 292 * s
    canvas.panel(left, top, width, 236 * s)
    x, y = left + 12 * s, top + 10 * s
    canvas.text((x, y), _clock(moment.time), size=-26)
    canvas.text((left + width - 12 * s, y + 11 * s), f"of {_clock(footage.end)}", _DIM, 13, "ra")
    y += 42 * s
    columns = (left + 186 * s, left + width - 12 * s)
    for column, v, colour in zip(columns, (0, follower + 1), (LEADER, TRUTH), strict=True):
        canvas.text((column, y), names[v][:12], colour, -12, "ra")
    rows = (
        ("depth", "m", -moment.position[:, 2], "{:.1f}"),
        ("pitch", "°", np.round(np.degrees(moment.pitch), 1) + 0.0, "{:+.1f}"),
        ("heading", "°", np.round(np.degrees(moment.heading)) % 360, "{:.0f}"),
        ("speed", "m/s", moment.speed, "{:.1f}"),
    )
    for label, unit, values, form in rows:
        y += 19 * s
        canvas.text((x, y), f"{label} [{unit}]", _DIM, 13)
        for column, v in zip(columns, (0, follower + 1), strict=True):
            canvas.text((column, y), form.format(values[v]), _PALE, 13, "ra")
    y += 28 * s
    canvas.text((x, y), "ranges [m]", _DIM, 13)
    for i in range(3):
        value = moment.ranges[follower, i]
        words = "–" if np.isnan(value) else f"{value:.2f}"
        canvas.text((left + (150 + 65 * i) * s, y), words, rays[i], 13, "ra")
    y += 19 * s
    kind = moment.fix_kind[follower]
    canvas.text((x, y), "fix", _DIM, 13)
    canvas.text((left + width - 12 * s, y), "–" if kind is None else FIX_WORDS[kind], _PALE, 13, "ra")
    y += 25 * s
    position, bearing = moment.position_error[follower], np.degrees(moment.bearing_error[follower])
    first = "–" if np.isnan(position) else f"{position:.2f} m"
    second = "–" if np.isnan(bearing) else f"{abs(bearing):.1f}°"
    canvas.text((x, y), f"E_P  {first}", ESTIMATE, -16)
    canvas.text((left + width - 12 * s, y), f"E_B  {second}", ESTIMATE, -16, "ra")


class Curve:
    """An error over the mission, drawn up to now.

    Args:
        label: what it is.
        unit: of the values.
        dt: interval of the values [s].
        values: by colour, each of shape (n,), the last on top.
        place: where it lies.
    """

    def __init__(self, label: str, unit: str, dt: float, values: Sequence[tuple[Colour, Floats]], place: Place) -> None:
        self._label, self._unit, self._place = label, unit, place
        sizes = np.abs(np.stack([v for _, v in values]))
        finite = sizes[np.isfinite(sizes)]
        self._top = 1.08 * float(finite.max()) if finite.size and finite.max() > 0 else 1.0
        n = sizes.shape[1]
        self._dt, self._sizes = dt, np.nan_to_num(sizes)
        self._end = dt * n
        # the largest value in each column of pixels: thinning must not hide a peak
        every = max(1, n // max(1, int(place[2])))
        columns = sizes[:, : n // every * every].reshape(len(sizes), -1, every)
        self._values = np.nan_to_num(columns.max(axis=2))
        self._colours = [colour for colour, _ in values]
        self._time = dt * every * (np.arange(self._values.shape[1]) + 1)

    def draw(self, canvas: Canvas, time: float) -> None:
        """The curve from the start of the mission to `time` [s] after it."""
        s = canvas.scale
        left, top, width, height = self._place
        canvas.panel(left, top, width, height)
        x0, y0 = left + 46 * s, top + height - 18 * s
        # room for the half of the last number that stands beyond the axis
        across, up = left + width - 20 * s - x0, y0 - top - 10 * s
        for tick in _ticks(0.0, self._top, 3):
            y = y0 - up * tick / self._top
            canvas.line(np.array([[x0, y], [x0 + across, y]]), _LINE, 1.0)
            canvas.text((x0 - 6 * s, y), f"{tick:g}", _DIM, 11, "rm")
        for tick in _ticks(0.0, self._end, 5):
            x = x0 + across * tick / self._end
            canvas.text((x, y0 + 3 * s), f"{tick:g}", _DIM, 10, "ma")
        seen = self._time <= time
        # the curve ends at the very value of now, which is the one in numbers beside it
        now = min(int(time / self._dt + 1e-9), self._sizes.shape[1])
        at = np.append(self._time[seen], self._dt * now) if now else np.zeros(0)
        for colour, past, sizes in zip(self._colours, self._values[:, seen], self._sizes, strict=True):
            values = np.append(past, sizes[now - 1]) if now else np.zeros(0)
            points = np.column_stack([x0 + across * at / self._end, y0 - up * values / self._top])
            if len(points) > 1:
                canvas.line(points, (*colour, 0.95), 1.5)
            if len(points):
                canvas.dot(points[-1], 3.0, colour)
        canvas.text(
            (left + width - 12 * s, top + 6 * s), f"{self._label} [{self._unit}]  over time [s]", _PALE, 11, "ra"
        )


class Map:
    """The tracks from above, drawn up to now, north up.

    Args:
        footage: what is filmed.
        follower: index of the follower whose estimate is shown.
        place: where it lies.
        others: estimates beside the follower's own.
    """

    def __init__(self, footage: Footage, follower: int, place: Place, others: Sequence[OtherEstimate] = ()) -> None:
        self._place, self._follower = place, follower
        flight = footage.flight
        every = max(1, flight.trajectory.time.size // 500)
        self._time = flight.trajectory.time[::every]
        self._tracks = flight.trajectory.position[::every, :, :2]
        steps = flight.step_index()
        keep = slice(None, None, max(1, steps.size // 500))
        own = flight.estimates[follower].state[:, :2]
        self._believed = [(o.colour, o.position[keep]) for o in others] + [(ESTIMATE, own[keep])]
        self._believed_time = flight.trajectory.time[steps[keep]]
        low, high = self._tracks.min(axis=(0, 1)), self._tracks.max(axis=(0, 1))
        self._centre = (low + high) / 2
        self._reach = 0.55 * float(max((high - low).max(), 20.0))

    def draw(self, canvas: Canvas, moment: Moment, others: Sequence[Floats] = ()) -> None:
        """Tracks to the moment, and where everything is; other estimates are at `others`, each of shape (3,), [m]."""
        s = canvas.scale
        left, top, width, height = self._place
        canvas.panel(left, top, width, height)
        scale = width / 2 / self._reach

        def pixels(points: Floats) -> Floats:
            shifted = np.clip((points - self._centre) * scale, -width / 2, width / 2)
            return np.asarray(shifted * [1.0, -1.0] + [left + width / 2, top + height / 2])

        past = self._time <= moment.time
        for v in range(self._tracks.shape[1]):
            colour = LEADER if v == 0 else TRUTH
            track = pixels(np.vstack([self._tracks[past, v], moment.position[v, :2]]))
            canvas.line(track, (*colour, 0.85 if v in (0, self._follower + 1) else 0.4), 1.6)
        past = self._believed_time <= moment.time
        for (colour, track), now in zip(self._believed, [*others, moment.estimate[self._follower]], strict=True):
            thought = pixels(np.vstack([track[past], now[:2]]))
            canvas.line(thought, (*colour, 0.8), 1.1)
            canvas.diamond(thought[-1], 4.5, colour)
        for v in range(self._tracks.shape[1]):
            canvas.dot(pixels(moment.position[[v], :2])[0], 3.4, LEADER if v == 0 else TRUTH)
        bar = next(
            b for b in (1000.0, 500.0, 200.0, 100.0, 50.0, 20.0, 10.0, 5.0) if b * scale < 0.4 * width or b == 5.0
        )
        x, y = left + 12 * s, top + 14 * s
        canvas.line(np.array([[x, y], [x + bar * scale, y]]), (*_PALE, 0.9), 2.0)
        canvas.text((x, y + 5 * s), f"{bar:g} m", _PALE, 11, "la")
        canvas.text((left + width - 10 * s, top + 8 * s), "N ↑", _PALE, -12, "ra")


def colour_bar(canvas: Canvas, rays: RayErrors, place: Place) -> None:
    """What the colours of the rays mean."""
    s = canvas.scale
    left, top, width, height = place
    canvas.panel(left, top, width, height)
    canvas.text((left + 12 * s, top + 8 * s), f"{rays.label} [m]", _PALE, 12)
    start, across, upper, deep = left + 24 * s, width - 48 * s, top + 29 * s, 9 * s
    pieces = 64
    edges = start + across * np.arange(pieces + 1) / pieces
    for a, b, colour in zip(edges[:-1], edges[1:], diverging(np.linspace(-1.0, 1.0, pieces)), strict=True):
        # a little overlap, or the seams would show
        corners = np.array([[a, upper], [b + 0.6, upper], [b + 0.6, upper + deep], [a, upper + deep]])
        canvas.shape(corners, tuple(colour))
    for share in (-1.0, 0.0, 1.0):
        x = start + across * (share + 1) / 2
        canvas.line(np.array([[x, upper + deep], [x, upper + deep + 3 * s]]), (*_PALE, 0.8), 1.0)
        canvas.text(
            (x, upper + deep + 5 * s), f"{share * rays.limit:+g}".replace("-", "−") if share else "0", _DIM, 11, "ma"
        )


def card(canvas: Canvas, footage: Footage, opacity: float) -> None:
    """The title: scenario, vehicles, navigation and seed, in the middle of the frame."""
    s, scenario = canvas.scale, footage.flight.scenario
    width, height = 620 * s, 210 * s
    left, top = (canvas.width - width) / 2, 0.30 * canvas.height
    canvas.panel(left, top, width, height, 0.72 * opacity)
    middle = canvas.width / 2
    followers = len(scenario.followers)
    fleet = "one follower" if followers == 1 else f"{followers} followers"
    waves = scenario.ocean.waves
    sea = "calm sea" if waves.kind == "none" else f"{waves.kind} waves, {waves.height_m:g} m, {waves.period_s:g} s"
    lines = (
        (-34, 56, scenario.name, (1.0, 1.0, 1.0)),
        (15, 92, "LAISN: low-cost acoustic in-swarm navigation, simulated", _PALE),
        (15, 126, f"one leader, {fleet}  ·  {footage.end - footage.start:g} s  ·  {sea}", _PALE),
        (
            15,
            150,
            f"{scenario.navigation.variant}, a message every {scenario.timing.message_interval_s:g} s  ·  "
            f"{scenario.motion}",
            _PALE,
        ),
        (15, 182, f"seed {scenario.seed}, run {scenario.run}  ·  {footage.speed_up:g}× real time", _DIM),
    )
    for size, y, words, colour in lines:
        canvas.text((middle, top + y * s), words, (*colour[:3], opacity), size, "ms")
