"""What lies over the picture: rays, trails, markers and labels in place, numbers, map and curves beside it."""

import numpy as np
import numpy.typing as npt

from sim.annotations import Annotations
from sim.cameras import Shot, View
from sim.canvas import Canvas, Colour
from sim.footage import Footage, Moment
from sim.panels import LEADER, TRUTH, Curve, Map, card, colour_bar, numbers
from sim.scene import ESTIMATE, TRANSMITTER_COLOURS, Box

Floats = npt.NDArray[np.float64]

_TRAIL_FILM_S = 5.0
_TRAIL_PIECES = 12
_RAY_PIECES = 6
_TITLE_FILM_S = 3.0
_HULL_CLEAR_M = 0.45
_LABELS = 8
"""Followers beyond these go without a label."""
_SMALL = (640, 360)
"""Frames below this size go without panels [px]."""


class Overlay:
    """Draws over the frames of one film.

    Args:
        footage: what is filmed.
        follower: index of the follower whose numbers are shown.
        size: width and height of the frames [px].
        film_s: length of the film [s].
        annotations: what a study adds.
    """

    def __init__(
        self, footage: Footage, follower: int, size: tuple[int, int], film_s: float, annotations: Annotations
    ) -> None:
        self._footage, self._added = footage, annotations
        self._follower = follower
        self.canvas = Canvas(*size)
        self._film_s = film_s
        self._panels = size[0] >= _SMALL[0] and size[1] >= _SMALL[1]
        s = self.canvas.scale
        left, top, width, height = 16 * s, 258 * s, 292 * s, 84 * s
        dt, p, b = footage.flight.measurements[0].dt, footage.position_error, np.degrees(footage.bearing_error)
        truth = footage.flight.hydrophone(follower)[:, :2]
        others = [(o.colour, np.linalg.norm(o.position - truth, axis=1)) for o in annotations.others]
        self._curves = (
            Curve("E_P", "m", dt, [(ESTIMATE, p[follower]), *others], (left, top, width, height)),
            Curve("E_B", "°", dt, [(ESTIMATE, b[follower])], (left, top + height + 6 * s, width, height)),
        )
        side = 232 * s
        self._map = Map(footage, follower, (size[0] - side - 16 * s, 16 * s, side, side), annotations.others)
        self._bar = (size[0] - side - 16 * s, 22 * s + side, side, 62 * s)

    def inset_boxes(self, n: int) -> tuple[Box, ...]:
        """Places of n insets, right to left along the lower edge: left, top, width, height [px]."""
        c = self.canvas
        width, height = round(0.25 * c.width), round(0.25 * c.height)
        top = c.height - height - round(30 * c.scale)
        gap = round(12 * c.scale)
        return tuple((c.width - (i + 1) * (width + gap) - round(4 * c.scale), top, width, height) for i in range(n))

    def draw(self, moment: Moment, shot: Shot, title: bool = True) -> None:
        """Everything over the picture that is on the canvas; the title at the start of the film, if wanted."""
        c = self.canvas
        boxes = self.inset_boxes(len(shot.insets))
        # insets lie over the lines of the whole picture
        regions = [(slice(top, top + height), slice(left, left + width)) for left, top, width, height in boxes]
        insets = [c.pixels[region].copy() for region in regions]
        self._in_view(moment, shot.view, (0, 0, c.width, c.height), shot.fog[1], labels=True)
        names = self._footage.flight.trajectory.names
        for region, inset in zip(regions, insets, strict=True):
            c.pixels[region] = inset
        for (view, vehicle), box in zip(shot.insets, boxes, strict=True):
            left, top, width, height = box
            frame = np.array([[left, top], [left + width, top], [left + width, top + height], [left, top + height]])
            c.line(np.vstack([frame, frame[:1]]), (0.7, 0.9, 1.0, 0.8), 1.5)
            self._in_view(moment, view, box, 60.0, labels=False)
            c.text((left + 8 * c.scale, top + 6 * c.scale), names[vehicle], LEADER if vehicle == 0 else TRUTH, -13)
        if self._panels:
            numbers(c, self._footage, moment, self._follower, self._ray_colours(moment, self._follower))
            for curve in self._curves:
                curve.draw(c, moment.time - self._footage.start)
            self._map.draw(c, moment, self._others(moment))
            if self._added.rays:
                colour_bar(c, self._added.rays, self._bar)
        self._footer(moment)
        shown = min(1.0, 4.0 * (1.0 - moment.film_time / min(_TITLE_FILM_S, 0.2 * self._film_s)))
        if title and shown > 0 and self._panels:
            card(c, self._footage, shown)

    def _footer(self, moment: Moment) -> None:
        c, scenario = self.canvas, self._footage.flight.scenario
        words = f"LAISN-Sim  ·  {scenario.name}  ·  seed {scenario.seed}, run {scenario.run}"
        if self._panels:
            words += f"  ·  {scenario.navigation.variant}  ·  {self._footage.speed_up:g}× real time"
        c.text((c.width / 2, c.height - 8 * c.scale), words, (0.85, 0.95, 1.0, 0.85), 12, "ms")

    def _ray_colours(self, moment: Moment, follower: int) -> tuple[Colour, ...]:
        rays = self._added.rays
        return rays.colours(moment.message[follower]) if rays and follower == self._follower else TRANSMITTER_COLOURS

    def _others(self, moment: Moment) -> list[Floats]:
        """Where the other estimates are, each of shape (3,), [m]."""
        now = np.array([moment.time])
        return [self._footage.on_plane(self._follower, o.position, now)[0] for o in self._added.others]

    def _in_view(self, moment: Moment, view: View, box: Box, sight: float, labels: bool) -> None:
        self._trails(moment, view, box)
        for f in range(len(moment.hydrophone)):
            colours = self._ray_colours(moment, f)
            for i in range(3):
                if moment.ray[f, i] > 0.03:
                    ends = np.array([moment.transmitter[i], moment.hydrophone[f]])
                    strength = float(moment.ray[f, i]) * (1.0 if f == self._follower else 0.4)
                    self._ray(view, box, ends, colours[i], strength, sight)
        self._markers(moment, view, box, labels)

    def _pieces(self, view: View, box: Box, points: Floats, pieces: int) -> list[tuple[Floats, float, float]]:
        """A polyline in about so many pieces: pixels within the box, mean distance ahead [m], mean place in [0, 1]."""
        left, top, width, height = box
        whole = width == self.canvas.width
        kept = []
        for pixels, ahead, place in view.line(points, width, height):
            step = max(1, -(-(len(pixels) - 1) // pieces))
            for first in range(0, len(pixels) - 1, step):
                part = slice(first, first + step + 1)
                drawn = pixels[part] if whole else _clipped(pixels[part], width, height)
                if len(drawn) > 1:
                    kept.append((drawn + np.array([left, top]), float(ahead[part].mean()), float(place[part].mean())))
        return kept

    def _ray(self, view: View, box: Box, ends: Floats, colour: Colour, strength: float, sight: float) -> None:
        pieces = _RAY_PIECES if box[2] == self.canvas.width else 1
        points = np.linspace(ends[0], ends[1], pieces + 1)
        for pixels, ahead, _ in self._pieces(view, box, points, pieces):
            clear = min(max(1.0 - ahead / (1.3 * sight), 0.3), 1.0)
            self.canvas.line(pixels, (*colour, 0.16 * strength * clear), 7.0)
            self.canvas.line(pixels, (*colour, 0.85 * strength * clear), 1.8)

    def _trails(self, moment: Moment, view: View, box: Box) -> None:
        footage, time = self._footage, moment.time
        trails = [
            (footage.trail(v, time, _TRAIL_FILM_S), LEADER if v == 0 else TRUTH) for v in range(len(moment.position))
        ]
        times = footage.trail_times(time, _TRAIL_FILM_S)
        trails.extend((footage.on_plane(self._follower, o.position, times), o.colour) for o in self._added.others)
        trails.append((footage.estimate_trail(self._follower, time, _TRAIL_FILM_S), ESTIMATE))
        for points, colour in trails:
            for pixels, _, place in self._pieces(view, box, points, _TRAIL_PIECES):
                self.canvas.line(pixels, (*colour, 0.75 * place**0.8), 2.0)

    def _place(self, view: View, box: Box, point: Floats) -> Floats | None:
        left, top, width, height = box
        pixels, ahead = view.project(point, width, height)
        inside = ahead[0] > 0.15 and 0 <= pixels[0, 0] < width and 0 <= pixels[0, 1] < height
        return pixels[0] + [left, top] if inside else None

    def _markers(self, moment: Moment, view: View, box: Box, labels: bool) -> None:
        c, dark = self.canvas, (0.0, 0.05, 0.08, 0.9)
        names = self._footage.flight.trajectory.names
        if self._added.level_axis:
            self._level_axis(moment, view, box)
        for i, colour in enumerate(self._ray_colours(moment, self._follower)):
            place = self._place(view, box, moment.transmitter[i])
            if place is not None:
                c.dot(place, 2.6, colour, dark)
        self._other_markers(moment, view, box, labels)
        for f, (truth, belief) in enumerate(zip(moment.hydrophone, moment.estimate, strict=True)):
            there, thought = self._place(view, box, truth), self._place(view, box, belief)
            if there is not None and thought is not None:
                c.line(np.array([there, thought]), (1, 1, 1, 0.7), 1.2, (3, 3))
            if thought is not None:
                c.diamond(thought, 6.0, ESTIMATE, dark)
            if there is not None:
                c.dot(there, 4.5, TRUTH, dark)
            if labels and f < _LABELS:
                if there is not None:
                    self._label(there, f"{names[f + 1]}", TRUTH, -self._clear(view, truth))
                if thought is not None and f == self._follower and np.isfinite(moment.position_error[f]):
                    words = f"{self._added.label}, off by {moment.position_error[f]:.1f} m"
                    self._label(thought, words, ESTIMATE, self._clear(view, belief))
        leader = self._place(view, box, moment.position[0])
        if labels and leader is not None:
            away = float(np.linalg.norm(moment.position[0] - moment.hydrophone[self._follower]))
            self._label(leader, f"{names[0]}, {away:.0f} m away", LEADER, -self._clear(view, moment.position[0]))

    def _other_markers(self, moment: Moment, view: View, box: Box, labels: bool) -> None:
        c, truth = self.canvas, moment.hydrophone[self._follower]
        there = self._place(view, box, truth)
        for number, (other, belief) in enumerate(zip(self._added.others, self._others(moment), strict=True)):
            thought = self._place(view, box, belief)
            if thought is None:
                continue
            if there is not None:
                c.line(np.array([there, thought]), (1, 1, 1, 0.7), 1.2, (3, 3))
            c.diamond(thought, 6.0, other.colour, (0.0, 0.05, 0.08, 0.9))
            if labels:
                off = float(np.hypot(*(belief - truth)[:2]))
                # each in a row of its own, below that of the follower's own estimate
                rise = self._clear(view, belief) + 24.0 * (number + 1) * c.scale
                self._label(thought, f"{other.label}, off by {off:.1f} m", other.colour, rise, leftward=True)

    def _level_axis(self, moment: Moment, view: View, box: Box) -> None:
        """The leader's axis as it would lie in a level hull, a little longer than the hull."""
        rear, front = moment.transmitter[:2]
        middle, heading = moment.position[0], moment.heading[0]
        reach = 0.8 * float(np.linalg.norm(front - rear)) * np.array([np.sin(heading), np.cos(heading), 0.0])
        for pixels, _, _ in self._pieces(view, box, np.array([middle - reach, middle + reach]), 1):
            self.canvas.line(pixels, (1.0, 1.0, 1.0, 0.75), 1.3, (7, 5))

    def _clear(self, view: View, point: Floats) -> float:
        """Length of a label's line that leads clear of a hull at `point` [px]."""
        pixels, ahead = view.project(np.array([point, point + _HULL_CLEAR_M * view.axes[1]]), 1, self.canvas.height)
        rise = abs(pixels[1, 1] - pixels[0, 1]) / self.canvas.scale if ahead[0] > 0 else 0.0
        return float(np.clip(rise, 30.0, 90.0)) * self.canvas.scale

    def _label(self, at: Floats, words: str, colour: Colour, rise: float, leftward: bool = False) -> None:
        """Words above (`rise` below 0) or below a point, at the end of a line; to the right where there is room."""
        c = self.canvas
        side = np.sign(rise)
        room = at[0] + c.scale * (20 + 8.5 * len(words)) < c.width
        way, anchor = (1.0, "lm") if room and not leftward else (-1.0, "rm")
        end = at + np.array([16.0 * c.scale * way, rise])
        c.line(np.array([at + c.scale * np.array([4.0 * way, 7.5 * side]), end]), (*colour, 0.8), 1.2)
        shade = (0.0, 0.05, 0.08, 0.8)
        x, y = float(end[0]) + 4 * c.scale * way, float(end[1])
        c.text((x + 1, y + 1), words, shade, -13, anchor)
        c.text((x, y), words, colour, -13, anchor)


def _clipped(pixels: Floats, width: int, height: int) -> Floats:
    """The part of a short polyline inside the box, as a line from its first to its last point (Liang and Barsky)."""
    a, b = pixels[0], pixels[-1]
    low, high = 0.0, 1.0
    for start, step, limit in ((a[0], b[0] - a[0], width), (a[1], b[1] - a[1], height)):
        if step == 0:
            if not 0 <= start <= limit:
                return pixels[:0]
            continue
        near, far = sorted(((0 - start) / step, (limit - start) / step))
        low, high = max(low, near), min(high, far)
    return np.array([a + low * (b - a), a + high * (b - a)]) if low < high else pixels[:0]
