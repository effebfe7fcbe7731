"""What lies over the picture: rays, trails, markers and labels in place, numbers, map and curves beside it."""

import numpy as np

from laisn.arrays import Floats
from sim.film import labels
from sim.film.annotations import Annotations
from sim.film.cameras import Shot, View
from sim.film.canvas import Canvas, Colour, Stroke
from sim.film.dashboard import Dashboard
from sim.film.footage import Footage, Moment
from sim.film.formation import marks
from sim.film.formation.stations import Stations
from sim.film.labels import Label
from sim.film.panels import LEADER, SIGMAS, TRUTH, card, scale_bar
from sim.film.scene import ESTIMATE, TRANSMITTER_COLOURS, Box

_TRAIL_FILM_S = 5.0
_TRAIL_PIECES = 12
_RAY_PIECES = 6
_TITLE_FILM_S = 3.0
_HULL_CLEAR_M = 0.45
_ELLIPSE_PX = 9.0
"""Half axis from which an ellipse of uncertainty is drawn, at 720 rows: below it would lie under the marker."""
_ELLIPSE = np.linspace(0.0, 2 * np.pi, 49)
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
        self._heard = range(footage.flight.scenario.navigation.transmitters)
        self._panels = size[0] >= _SMALL[0] and size[1] >= _SMALL[1]
        self._stations = Stations(footage.flight)
        self._dashboard = (
            Dashboard(footage, follower, self.canvas, annotations, self._stations.off(follower))
            if self._panels
            else None
        )
        self._covered = self._dashboard.covered if self._dashboard else []
        self._taken = [*self._dashboard.places, self._dashboard.scale] if self._dashboard else []

    def inset_boxes(self, shot: Shot) -> tuple[Box, ...]:
        """Places of a shot's insets along the lower edge, from one side on: left, top, width, height [px]."""
        c = self.canvas
        width, height = round(0.25 * c.width), round(0.25 * c.height)
        top, gap, edge = c.height - height - round(30 * c.scale), round(12 * c.scale), round(16 * c.scale)
        lefts = [edge + i * (width + gap) for i in range(len(shot.insets))]
        return tuple((x if shot.insets_left else c.width - width - x, top, width, height) for x in lefts)

    def draw(self, moment: Moment, shot: Shot, title: bool = True) -> None:
        """Everything over the picture that is on the canvas; the title at the start of the film, if wanted."""
        c = self.canvas
        boxes = self.inset_boxes(shot)
        # lines of the whole picture pass below insets and panels: across a curve they would look like one
        regions = [
            (slice(int(top), int(top + height) + 1), slice(int(left), int(left + width) + 1))
            for left, top, width, height in (*boxes, *self._covered)
        ]
        kept = [c.pixels[region].copy() for region in regions]
        self._in_view(moment, shot.view, (0, 0, c.width, c.height), shot.fog[1])
        for region, pixels in zip(regions, kept, strict=True):
            c.pixels[region] = pixels
        names = self._footage.flight.trajectory.names
        for (view, vehicle), box in zip(shot.insets, boxes, strict=True):
            left, top, width, height = box
            frame = np.array([[left, top], [left + width, top], [left + width, top + height], [left, top + height]])
            c.line(np.vstack([frame, frame[:1]]), (0.7, 0.9, 1.0, 0.8), 1.5)
            self._in_view(moment, view, box, 60.0)
            words = names[vehicle] + (", from above" if view.plane_m else "")
            labels.plate(c, words, LEADER if vehicle == 0 else TRUTH, (left + 5 * c.scale, top + 4 * c.scale))
            self._scale_bar(view, box, (left + 10 * c.scale, top + height - 26 * c.text_scale), 0.35)
        if self._dashboard:
            self._dashboard.draw(c, moment, self._ray_colours(moment, self._follower), self._others(moment))
            words = "" if shot.view.axes[2][2] < -0.99 else " at mid-distance"
            self._scale_bar(shot.view, (0, 0, c.width, c.height), self._dashboard.scale[:2], 0.12, words)
        labels.draw(self._labels(moment, shot.view), [*boxes, *self._taken], c)
        self._footer(moment)
        shown = min(1.0, 4.0 * (1.0 - moment.film_time / min(_TITLE_FILM_S, 0.2 * self._film_s)))
        if title and shown > 0 and self._panels and not self._added.caption:
            card(c, self._footage, shown)

    def _scale_bar(self, view: View, box: Box, at: tuple[float, float], share: float, words: str = "") -> None:
        """A bar of at most a share of the box's width, where one scale holds."""
        if view.plane_m:
            pixels_per_m = box[3] / 2 / np.tan(np.radians(view.fovy_deg) / 2) / view.plane_m
            scale_bar(self.canvas, at, pixels_per_m, share * box[2], words)

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
        """Positions of the other estimates, each of shape (3,), [m]."""
        now = np.array([moment.time])
        return [self._footage.on_plane(self._follower, o.position, now)[0] for o in self._added.others]

    def _in_view(self, moment: Moment, view: View, box: Box, sight: float) -> None:
        strokes = self._formation(moment, view, box) + self._trails(moment, view, box)
        for f in range(len(moment.hydrophone)):
            colours = self._ray_colours(moment, f)
            for i in self._heard:
                if moment.ray[f, i] > 0.03:
                    ends = np.array([moment.transmitter[i], moment.hydrophone[f]])
                    strength = float(moment.ray[f, i]) * (1.0 if f == self._follower else 0.4)
                    strokes += self._ray(view, box, ends, colours[i], strength, sight)
        self.canvas.strokes([*strokes, *self._ellipses(moment, view, box)])
        self._markers(moment, view, box)

    def _pieces(self, view: View, box: Box, points: Floats, pieces: int) -> list[tuple[Floats, float, float]]:
        """A polyline in about so many pieces: pixels within the box, and of its middle distance ahead [m] and place."""
        left, top, width, height = box
        whole, corner = width == self.canvas.width, np.array([left, top])
        kept = []
        for pixels, ahead, place in view.line(points, width, height):
            step = max(1, -(-(len(pixels) - 1) // pieces))
            for first in range(0, len(pixels) - 1, step):
                part = slice(first, first + step + 1)
                drawn = pixels[part] if whole else _clipped(pixels[part], width, height)
                if len(drawn) > 1:
                    last = min(first + step, len(pixels) - 1)
                    depth, along = (float(values[first] + values[last]) / 2 for values in (ahead, place))
                    kept.append((drawn + corner, depth, along))
        return kept

    def _ray(self, view: View, box: Box, ends: Floats, colour: Colour, strength: float, sight: float) -> list[Stroke]:
        pieces = _RAY_PIECES if box[2] == self.canvas.width else 1
        points = np.linspace(ends[0], ends[1], pieces + 1)
        strokes = []
        for pixels, ahead, _ in self._pieces(view, box, points, pieces):
            clear = min(max(1.0 - ahead / (1.3 * sight), 0.3), 1.0)
            strokes.append(Stroke(pixels, (*colour, 0.16 * strength * clear), 7.0))
            strokes.append(Stroke(pixels, (*colour, 0.85 * strength * clear), 1.8))
        return strokes

    def _formation(self, moment: Moment, view: View, box: Box) -> list[Stroke]:
        """Stations and the nearest pair; nothing where followers keep to routes."""
        if not self._stations:
            return []
        stations, whole = self._stations.at(moment.time), box[2] == self.canvas.width
        found = marks.of_stations(stations, moment.hydrophone, lambda place: _metres_per_pixel(view, place))
        return [
            Stroke(pixels, (*mark.colour, mark.opacity), mark.width)
            for mark in (*found, *marks.between(marks.nearest(moment.position)))
            # an inset's edge cuts pieces, and a straight line alone is cut rightly
            for pixels, _, _ in self._pieces(view, box, mark.points, 1 if whole else len(mark.points))
        ]

    def _trails(self, moment: Moment, view: View, box: Box) -> list[Stroke]:
        footage, time = self._footage, moment.time
        trails = [
            (footage.trail(v, time, _TRAIL_FILM_S), LEADER if v == 0 else TRUTH) for v in range(len(moment.position))
        ]
        times = footage.trail_times(time, _TRAIL_FILM_S)
        trails.extend((footage.on_plane(self._follower, o.position, times), o.colour) for o in self._added.others)
        trails.append((footage.estimate_trail(self._follower, time, _TRAIL_FILM_S), ESTIMATE))
        return [
            Stroke(pixels, (*colour, 0.75 * place**0.8), 2.0)
            for points, colour in trails
            for pixels, _, place in self._pieces(view, box, points, _TRAIL_PIECES)
        ]

    def _place(self, view: View, box: Box, point: Floats) -> Floats | None:
        left, top, width, height = box
        pixels, ahead = view.project(point, width, height)
        inside = ahead[0] > 0.15 and 0 <= pixels[0, 0] < width and 0 <= pixels[0, 1] < height
        return pixels[0] + [left, top] if inside else None

    def _ellipses(self, moment: Moment, view: View, box: Box) -> list[Stroke]:
        """The filters' uncertainty about their estimates, where it is large enough to be seen."""
        height, strokes = box[3], []
        for weight, centre, covariance in (side for sides in moment.sides for side in sides):
            if not np.all(np.isfinite(covariance)):
                continue
            variance, axes = np.linalg.eigh(covariance)
            radii = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
            _, (ahead,) = view.project(centre, box[2], height)
            pixels_per_m = height / 2 / np.tan(np.radians(view.fovy_deg) / 2) / max(float(ahead), 0.15)
            if radii.max() * pixels_per_m < _ELLIPSE_PX * self.canvas.scale:
                continue
            flat = (np.column_stack([np.cos(_ELLIPSE), np.sin(_ELLIPSE)]) * radii) @ axes.T
            ring = centre + np.column_stack([flat, np.zeros(len(flat))])
            for pixels, _, _ in self._pieces(view, box, ring, len(ring)):
                strokes.append(Stroke(pixels, (*ESTIMATE, 0.3 + 0.6 * weight), 1.5))
        return strokes

    def _markers(self, moment: Moment, view: View, box: Box) -> None:
        c, dark = self.canvas, (0.0, 0.05, 0.08, 0.9)
        if self._added.level_axis:
            for pixels, _, _ in self._pieces(view, box, self._level_axis(moment), 1):
                c.line(pixels, (1.0, 1.0, 1.0, 0.75), 1.3, (7, 5))
        colours = self._ray_colours(moment, self._follower)
        for i in self._heard:
            place, colour = self._place(view, box, moment.transmitter[i]), colours[i]
            if place is not None:
                c.dot(place, 2.6, colour, dark)
        pairs = [(self._follower, other, o.colour) for other, o in zip(self._others(moment), self._added.others,
                                                                       strict=True)]  # fmt: skip
        pairs += [(f, belief, ESTIMATE) for f, belief in enumerate(moment.estimate)]
        for f, belief, colour in pairs:
            there, thought = self._place(view, box, moment.hydrophone[f]), self._place(view, box, belief)
            if there is not None and thought is not None:
                c.line(np.array([there, thought]), (1, 1, 1, 0.7), 1.2, (3, 3))
            if thought is not None:
                c.diamond(thought, 6.0, colour, dark)
        for truth in moment.hydrophone:
            there = self._place(view, box, truth)
            if there is not None:
                c.dot(there, 4.5, TRUTH, dark)

    def _labels(self, moment: Moment, view: View) -> list[Label]:
        """Labels of the whole picture, the most important first."""
        c, f, names = self.canvas, self._follower, self._footage.flight.trajectory.names
        truth = moment.hydrophone[f]
        away = float(np.linalg.norm(moment.position[0] - truth))
        pitch = f", pitch {np.round(np.degrees(moment.pitch[0]), 1) + 0.0:+.1f}°" if self._added.level_axis else ""
        wanted = [(moment.position[0], f"{names[0]}{pitch}, {away:.0f} m away", LEADER, -1)]
        wanted.append((truth, names[f + 1], TRUTH, -1))
        if np.isfinite(moment.position_error[f]):
            off = f"{self._added.label}, off by {moment.position_error[f]:.1f} m"
            wanted.append((moment.estimate[f], off, ESTIMATE, 1))
        if self._stations:
            station, pair = self._stations.at(moment.time)[f], marks.nearest(moment.position)
            if np.isfinite(station).all():
                missed = float(np.hypot(*(station - truth)[:2]))
                wanted.append((station, f"station, {missed:.1f} m off", marks.STATION, 1))
            apart = f"{float(np.linalg.norm(pair[1] - pair[0])):.1f} m apart, the nearest"
            wanted.append((pair.mean(axis=0), apart, marks.APART, 1))
        for belief, other in zip(self._others(moment), self._added.others, strict=True):
            off = f"{other.label}, off by {float(np.hypot(*(belief - truth)[:2])):.1f} m"
            wanted.append((belief, off, other.colour, 1))
        some = [i for i in range(len(moment.hydrophone)) if i != f][: _LABELS - 1]
        wanted += [(moment.hydrophone[i], names[i + 1], TRUTH, -1) for i in some]
        if self._added.level_axis:
            wanted.append((self._level_axis(moment)[0], "level", (1.0, 1.0, 1.0), 0))
        found = []
        for point, words, colour, side in wanted:
            at = self._place(view, (0, 0, c.width, c.height), point)
            if at is not None and not any(x <= at[0] <= x + w and y <= at[1] <= y + h for x, y, w, h in self._covered):
                rise = side * self._clear(view, point) if side else -20.0 * c.scale
                found.append(Label(at, words, colour, rise))
        return found

    def _level_axis(self, moment: Moment) -> Floats:
        """Ends, shape (2, 3), [m], of the leader's axis as it would lie in a level hull, a little longer than that."""
        rear, front = moment.transmitter[:2]
        middle, heading = moment.position[0], moment.heading[0]
        reach = 0.8 * float(np.linalg.norm(front - rear)) * np.array([np.sin(heading), np.cos(heading), 0.0])
        return np.array([middle - reach, middle + reach])

    def _clear(self, view: View, point: Floats) -> float:
        """Length of a label's line that leads clear of a hull at `point` [px]."""
        pixels, ahead = view.project(np.array([point, point + _HULL_CLEAR_M * view.axes[1]]), 1, self.canvas.height)
        rise = abs(pixels[1, 1] - pixels[0, 1]) / self.canvas.scale if ahead[0] > 0 else 0.0
        return float(np.clip(rise, 30.0, 90.0)) * self.canvas.scale


def _metres_per_pixel(view: View, place: Floats) -> float:
    """Scale at a place of shape (3,) in a frame of 720 rows [m]."""
    _, (ahead,) = view.project(place, 1, 1)
    return float(max(ahead, 0.0) * np.tan(np.radians(view.fovy_deg) / 2) / 360)


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
