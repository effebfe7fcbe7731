"""Panels of the overlay: map, scales, title card and caption."""

from collections.abc import Sequence

import numpy as np

from laisn.arrays import Floats
from laisn.estimates import FixKind
from sim.film.annotations import OtherEstimate, RayErrors, diverging
from sim.film.canvas import DIM, PALE, Canvas, Colour, Stroke
from sim.film.footage import Footage, Moment
from sim.film.scene import ESTIMATE

Place = tuple[float, float, float, float]
"""Left, top, width, height [px]."""

SIGMAS = 2.0
"""Half axes of the ellipse of uncertainty in standard deviations."""

LEADER: Colour = (1.0, 0.68, 0.20)
"""Colour of the leader's trail and label, after its hull."""
TRUTH: Colour = (1.0, 0.95, 0.25)
"""Colour of a follower's true trail and position, after its hull."""
FIX_WORDS = {
    FixKind.TWO_POINTS: "two points",
    FixKind.TANGENT: "circles touch",
    FixKind.ASTERN: "on the axis, astern",
    FixKind.FUSED: "weighted mean",
    FixKind.GATED: "rejected",
    FixKind.SINGULAR: "already exact",
    FixKind.LOST: "ranges missing",
    FixKind.ONE_RANGE: "one range alone",
    FixKind.RANGES: "ranges themselves",
    FixKind.PARTLY: "ranges, but for echoes",
}


class Map:
    """The tracks from above, drawn up to now, north up.

    Args:
        footage: what is filmed.
        follower: index of the follower whose estimate is shown.
        place: where it lies.
        others: estimates beside the follower's own.
    """

    def __init__(self, footage: Footage, follower: int, place: Place, others: Sequence[OtherEstimate] = ()) -> None:
        self.place, self._follower = place, follower
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

    def ground(self, canvas: Canvas) -> None:
        """Panel, scale and north: all that stays as it is throughout the film."""
        s, (left, top, width, height) = canvas.scale, self.place
        canvas.panel(left, top, width, height)
        scale_bar(canvas, (left + 12 * s, top + 14 * s), width / 2 / self._reach, 0.4 * width)
        canvas.text((left + width - 10 * s, top + 8 * s), "N ↑", PALE, -12, "ra")

    def draw(self, canvas: Canvas, moment: Moment, others: Sequence[Floats] = ()) -> None:
        """Tracks to the moment, and where everything is; other estimates are at `others`, each of shape (3,), [m]."""
        left, top, width, height = self.place
        scale = width / 2 / self._reach

        def pixels(points: Floats) -> Floats:
            shifted = np.clip((points - self._centre) * scale, -width / 2, width / 2)
            return np.asarray(shifted * [1.0, -1.0] + [left + width / 2, top + height / 2])

        past = int(np.searchsorted(self._time, moment.time, side="right"))
        strokes: list[Stroke] = []
        for v in range(self._tracks.shape[1]):
            colour = LEADER if v == 0 else TRUTH
            track = pixels(np.vstack([self._tracks[:past, v], moment.position[v, :2]]))
            strokes.append(Stroke(track, (*colour, 0.85 if v in (0, self._follower + 1) else 0.4), 1.6))
        past = int(np.searchsorted(self._believed_time, moment.time, side="right"))
        ends = []
        for (colour, track), now in zip(self._believed, [*others, moment.estimate[self._follower]], strict=True):
            thought = pixels(np.vstack([track[:past], now[:2]]))
            strokes.append(Stroke(thought, (*colour, 0.8), 1.1))
            ends.append((thought[-1], colour))
        canvas.strokes(strokes)
        for end, colour in ends:
            canvas.diamond(end, 4.5, colour)
        for v, at in enumerate(pixels(moment.position[:, :2])):
            canvas.dot(at, 3.4, LEADER if v == 0 else TRUTH)


def scale_bar(canvas: Canvas, at: tuple[float, float], pixels_per_m: float, longest: float, words: str = "") -> None:
    """A bar of a round length from `at` to the right, at most `longest` [px], its length and words below it."""
    power = 10.0 ** np.floor(np.log10(longest / pixels_per_m))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power * pixels_per_m <= longest)
    (x, y), s, across = at, canvas.scale, length * pixels_per_m
    ends = np.array([[x, y - 4 * s], [x, y], [x + across, y], [x + across, y - 4 * s]])
    canvas.line(ends, (*PALE, 0.95), 2.0)
    canvas.text((x, y + 4 * s), f"{length:g} m{words}", PALE, 12, "la")


def colour_bar(canvas: Canvas, rays: RayErrors, place: Place) -> None:
    """What the colours of the rays mean."""
    s = canvas.text_scale
    left, top, width, height = place
    canvas.panel(left, top, width, height)
    canvas.text((left + 12 * s, top + 8 * s), f"{rays.label} [m]", PALE, 12)
    start, across, upper, deep = left + 24 * s, width - 48 * s, top + 29 * s, 9 * s
    pieces = 64
    edges = start + across * np.arange(pieces + 1) / pieces
    for a, b, colour in zip(edges[:-1], edges[1:], diverging(np.linspace(-1.0, 1.0, pieces)), strict=True):
        # a little overlap, or the seams would show
        corners = np.array([[a, upper], [b + 0.6, upper], [b + 0.6, upper + deep], [a, upper + deep]])
        canvas.shape(corners, tuple(colour))
    for share in (-1.0, 0.0, 1.0):
        x = start + across * (share + 1) / 2
        canvas.line(np.array([[x, upper + deep], [x, upper + deep + 3 * s]]), (*PALE, 0.8), 1.0)
        canvas.text(
            (x, upper + deep + 5 * s), f"{share * rays.limit:+g}".replace("-", "−") if share else "0", DIM, 11, "ma"
        )
    for x, words, anchor in ((left + 12 * s, "too short", "la"), (left + width - 12 * s, "too long", "ra")):
        canvas.text((x, upper + deep + 20 * s), words, PALE, 11, anchor)


def card(canvas: Canvas, footage: Footage, opacity: float) -> None:
    """The title: scenario, vehicles, navigation and seed, in the middle of the frame."""
    s, scenario = canvas.text_scale, footage.flight.scenario
    width, height = 620 * s, 210 * s
    left, top = (canvas.width - width) / 2, 0.30 * canvas.height
    canvas.panel(left, top, width, height, 0.92 * opacity)
    middle = canvas.width / 2
    followers = len(scenario.followers)
    fleet = "one follower" if followers == 1 else f"{followers} followers"
    waves = scenario.ocean.waves
    sea = "calm sea" if waves.kind == "none" else f"{waves.kind} waves, {waves.height_m:g} m, {waves.period_s:g} s"
    lines = (
        (-34, 56, scenario.name, (1.0, 1.0, 1.0)),
        (15, 92, "LAISN: low-cost acoustic in-swarm navigation, simulated", PALE),
        (15, 126, f"one leader, {fleet}  ·  {footage.end - footage.start:g} s  ·  {sea}", PALE),
        (
            15,
            150,
            f"{scenario.navigation.variant}, a message every {scenario.timing.message_interval_s:g} s  ·  "
            f"{scenario.motion}",
            PALE,
        ),
        (15, 182, f"seed {scenario.seed}, run {scenario.run}  ·  {footage.speed_up:g}× real time", DIM),
    )
    for size, y, words, colour in lines:
        canvas.text((middle, top + y * s), words, (*colour[:3], opacity), size, "ms")


def caption(canvas: Canvas, words: str, legend: Sequence[tuple[str, Colour, str]], place: Place) -> None:
    """What the film is about, and below it what its marks mean: ● or ◆, colour and words of each."""
    s = canvas.scale
    left, top, width, height = place
    canvas.panel(left, top, width, height, 0.6)
    canvas.text((left + width / 2, top + 10 * s), words, size=-16, anchor="ma")
    gap, sizes = 34 * s, [canvas.extent(f"● {name}", -13)[0] for _, _, name in legend]
    x, y = left + (width - sum(sizes) - gap * (len(legend) - 1)) / 2, top + 46 * s
    for (mark, colour, name), size in zip(legend, sizes, strict=True):
        at = np.array([x + 5 * s, y])
        (canvas.dot if mark == "●" else canvas.diamond)(at, 5.0, colour)
        canvas.text((x + size, y), name, colour, -13, "rm")
        x += size + gap
