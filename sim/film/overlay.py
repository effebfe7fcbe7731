"""What lies over the picture: rays, trails, markers and labels in place, and the dashboard beside it."""

from collections.abc import Iterator

import numpy as np

from laisn.arrays import Floats
from sim.film import labels
from sim.film.annotations import ESTIMATE, LEADER, STATION, TRANSMITTER_COLOURS, TRUTH, Annotations
from sim.film.cameras import Shot, View
from sim.film.canvas import PALE, Canvas, Colour, Shape, Stroke, corners
from sim.film.dashboard import SIGMAS, Dashboard, Trail, round_length
from sim.film.film_data import FilmData, FrameState
from sim.film.labels import Label
from sim.film.scene import Box
from sim.scenario.settings import Video

_TRAIL_FILM_S = 5.0
_TRAIL_PIECES = 12
_HULL_CLEAR_M = 0.45
_ELLIPSE_PX = 9.0
"""Half axis from which an ellipse of uncertainty is drawn, at 720 rows: below it would lie under the marker."""
_ELLIPSE = np.linspace(0.0, 2 * np.pi, 49)
_LABELS = 16
"""Followers beyond these go without a label."""
_SMALL = (640, 360)
"""Frames below this size go without panels [px]."""
_DARK: Colour = (0.0, 0.05, 0.08, 0.9)
_WHITE: Colour = (1.0, 1.0, 1.0, 0.75)


class Overlay:
    """Draws over the frames of one film.

    Args:
        data: what is filmed.
        follower: index of the follower whose numbers are shown.
        video: camera and size of the frames.
        annotations: what a study adds.
    """

    def __init__(self, data: FilmData, follower: int, video: Video, annotations: Annotations) -> None:
        self._data, self._added, self._follower = data, annotations, follower
        self.canvas = Canvas(video.width_px, video.height_px)
        self._box: Box = (0, 0, video.width_px, video.height_px)
        self._transmitters = range(data.flight.scenario.navigation.transmitters)
        # that camera is for the leader's pitch: a line shows its axis as it would lie in a level hull
        self._level_axis = video.camera == "profile"
        self._dashboard = None
        if video.width_px >= _SMALL[0] and video.height_px >= _SMALL[1]:
            self._dashboard = Dashboard(data, follower, self.canvas, annotations, self._level_axis)

    def inset_boxes(self, shot: Shot) -> tuple[Box, ...]:
        """Places of a shot's insets along the lower edge, from one side on: left, top, width, height [px]."""
        c = self.canvas
        width, height = round(0.25 * c.width), round(0.25 * c.height)
        top, gap, edge = c.height - height - round(30 * c.scale), round(12 * c.scale), round(16 * c.scale)
        lefts = [edge + i * (width + gap) for i in range(len(shot.insets))]
        return tuple((x if shot.insets_left else c.width - width - x, top, width, height) for x in lefts)

    def draw(self, state: FrameState, shot: Shot) -> None:
        """Draw over the picture on the canvas."""
        c, board = self.canvas, self._dashboard
        boxes, trails, covered = self.inset_boxes(shot), self._trails(state), board.covered if board else []
        # lines of the whole picture pass below insets and panels: across a curve they would look like one
        regions = [
            (slice(int(top), int(top + height) + 1), slice(int(left), int(left + width) + 1))
            for left, top, width, height in (*boxes, *covered)
        ]
        kept = [c.pixels[region].copy() for region in regions]
        self._draw_view(state, shot.view, self._box, trails)
        for region, pixels in zip(regions, kept, strict=True):
            c.pixels[region] = pixels
        for (view, vehicle), box in zip(shot.insets, boxes, strict=True):
            left, top, _, height = box
            self._draw_view(state, view, box, trails)
            edge = corners(box)
            c.strokes([Stroke(np.vstack([edge, edge[:1]]), (0.7, 0.9, 1.0, 0.8), 1.5)])
            words = self._data.flight.trajectory.names[vehicle] + (", from above" if view.plane_m else "")
            labels.plates(c, [(words, TRUTH if vehicle else LEADER, left + 5 * c.scale, top + 4 * c.scale)])
            self._scale_bar(view, box, (left + 10 * c.scale, top + height - 26 * c.text_scale), 0.35)
        if board:
            board.draw(c, state, self._ray_colours(state, self._follower), trails)
            words = "" if shot.view.axes[2][2] < -0.99 else " at mid-distance"
            self._scale_bar(shot.view, self._box, board.scale[:2], 0.12, words)
        labels.draw(self._labels(state, shot.view), [*boxes, *covered, *([board.scale] if board else [])], c)
        self._draw_footer()

    # what stands in the water

    def _draw_view(self, state: FrameState, view: View, box: Box, trails: list[Trail]) -> None:
        """Lines and markers as one camera sees them, inside its box."""
        strokes = [
            Stroke(pixels, (*colour[:3], 0.75 * along**0.8))
            for points, colour in trails
            for pixels, along in self._lines(view, box, points, _TRAIL_PIECES)
        ]
        strokes += [*self._rays(state, view, box), *self._ellipses(state, view, box)]
        lines, markers = self._markers(state, view, box)
        self.canvas.strokes([*strokes, *lines], box)
        self.canvas.shapes(markers, box)

    def _lines(self, view: View, box: Box, points: Floats, pieces: int = 1) -> Iterator[tuple[Floats, float]]:
        """A polyline in about so many pieces: pixels, and place of the middle along the line, in [0, 1]."""
        left, top, width, height = box
        for pixels, along in view.line(points, width, height):
            step = max(1, -(-(len(pixels) - 1) // pieces))
            for first in range(0, len(pixels) - 1, step):
                last = min(first + step, len(pixels) - 1)
                yield np.add(pixels[first : last + 1], (left, top)), float(along[first] + along[last]) / 2

    def _rays(self, state: FrameState, view: View, box: Box) -> Iterator[Stroke]:
        for f, i in np.argwhere(state.ray > 0.03):
            if i in self._transmitters:
                red, green, blue, *_ = self._ray_colours(state, int(f))[i]
                clear = float(state.ray[f, i]) * (0.7 if f == self._follower else 0.3)
                for pixels, _ in self._lines(view, box, np.array([state.transmitter[i], state.hydrophone[f]])):
                    yield Stroke(pixels, (red, green, blue, 0.16 * clear), 7.0)
                    yield Stroke(pixels, (red, green, blue, 0.85 * clear), 1.8)

    def _trails(self, state: FrameState) -> list[Trail]:
        """Trails of all vehicles, of the other estimates and of the filmed follower's own, which lies on top."""
        vehicles = len(state.position)
        own = vehicles + self._follower
        first_other = vehicles + len(state.estimate)
        colours = [(v, TRUTH if v else LEADER) for v in range(vehicles)]
        colours += [(first_other + i, other.colour) for i, other in enumerate(self._added.others)]
        return [(self._data.trail(i, state, _TRAIL_FILM_S), colour) for i, colour in (*colours, (own, ESTIMATE))]

    def _ellipses(self, state: FrameState, view: View, box: Box) -> Iterator[Stroke]:
        """The filters' uncertainty about their estimates, where it is large enough to be seen."""
        for weight, centre, covariance in (h for hypotheses in state.hypotheses for h in hypotheses):
            if not np.all(np.isfinite(covariance)):
                continue
            variance, axes = np.linalg.eigh(covariance)
            radii = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
            least = _ELLIPSE_PX * self.canvas.height / box[3] * metres_per_pixel(view, centre)
            if radii.max() >= least:
                flat = (np.column_stack([np.cos(_ELLIPSE), np.sin(_ELLIPSE)]) * radii) @ axes.T
                ring = centre + np.column_stack([flat, np.zeros(len(flat))])
                for pixels, _ in self._lines(view, box, ring):
                    yield Stroke(pixels, (*ESTIMATE, 0.3 + 0.6 * weight), 1.5)

    def _markers(self, state: FrameState, view: View, box: Box) -> tuple[list[Stroke], list[Shape]]:
        """Transmitters, stations, estimates and hydrophones, and dashed lines between what belongs together."""
        c, shapes = self.canvas, list[Shape]()
        links = [level_axis(state)] if self._level_axis else []
        links += [nearest(state.position)] if self._data.on_stations else []
        colours = self._ray_colours(state, self._follower)
        others = [(self._follower, o, other.colour)
                  for o, other in zip(state.others, self._added.others, strict=True)]  # fmt: skip
        for i in self._transmitters:
            at = self._pixel(view, box, state.transmitter[i])
            shapes += [c.disc(at, 2.6, colours[i], _DARK)] if at is not None else []
        for station, hydrophone in zip(state.station, state.hydrophone, strict=True):
            at = self._pixel(view, box, station) if np.isfinite(station).all() else None
            if at is not None:
                shapes.append(c.disc(at, 9.0, (*STATION, 0.15), STATION))
                links.append(np.array([station, hydrophone]))
        for f, estimate, colour in [*others, *((f, e, ESTIMATE) for f, e in enumerate(state.estimate))]:
            at = self._pixel(view, box, estimate)
            if at is not None:
                shapes.append(c.diamond(at, 6.0, colour, _DARK))
                links.append(np.array([state.hydrophone[f], estimate]))
        there = [self._pixel(view, box, hydrophone) for hydrophone in state.hydrophone]
        shapes += [c.disc(at, 4.5, TRUTH, _DARK) for at in there if at is not None]
        lines = [line for ends in links for line in self._lines(view, box, ends)]
        return [Stroke(pixels, _WHITE, 1.3, dashed=True) for pixels, _ in lines], shapes

    def _pixel(self, view: View, box: Box, point: Floats) -> Floats | None:
        """Where a point appears inside a box, shape (2,), or None."""
        left, top, width, height = box
        (pixel,), (ahead,) = view.project(point, width, height)
        inside = ahead > 0.15 and 0 <= pixel[0] < width and 0 <= pixel[1] < height
        return np.add(pixel, (left, top)) if inside else None

    def _ray_colours(self, state: FrameState, follower: int) -> tuple[Colour, ...]:
        rays = self._added.rays
        return rays.colours(state.message[follower]) if rays and follower == self._follower else TRANSMITTER_COLOURS

    # what is written

    def _labels(self, state: FrameState, view: View) -> list[Label]:
        """Labels of the picture, the most important first."""
        c, f, names = self.canvas, self._follower, self._data.flight.trajectory.names
        truth, leader = state.hydrophone[f], state.position[0]
        pitch = f", pitch {np.degrees(state.pitch[0]):+.1f}°" if self._level_axis else ""
        apart = float(np.linalg.norm(leader - state.position[f + 1]))

        def off(name: str, at: Floats) -> str:
            return f"{name}, off by {float(np.hypot(*(at - truth)[:2])):.1f} m"

        # side of the label: above the point if negative
        wanted: list[tuple[Floats, str, Colour, int]] = [
            (leader, f"{names[0]}{pitch}, {apart:.0f} m away", LEADER, -1),
            (truth, names[f + 1], TRUTH, -1),
            (state.estimate[f], off(self._added.label, state.estimate[f]), ESTIMATE, 1),
        ]
        if np.isfinite(state.station[f]).all():
            wanted.append((state.station[f], off("station", state.station[f]), STATION, 1))
        if self._data.on_stations:
            pair = nearest(state.position)
            distance = f"{float(np.linalg.norm(pair[1] - pair[0])):.1f} m apart, the nearest"
            wanted.append((pair.mean(axis=0), distance, (1.0, 1.0, 1.0), 1))
        for other, there in zip(self._added.others, state.others, strict=True):
            wanted.append((there, off(other.label, there), other.colour, 1))
        rest = [i for i in range(len(state.hydrophone)) if i != f][: _LABELS - 1]
        wanted += [(state.hydrophone[i], names[i + 1], TRUTH, -1) for i in rest]
        if self._level_axis:
            wanted.append((level_axis(state)[0], "level", (1.0, 1.0, 1.0), 0))
        found, covered = [], self._dashboard.covered if self._dashboard else []
        for point, words, colour, side in wanted:
            at = self._pixel(view, self._box, point)
            if at is not None and not any(x <= at[0] <= x + w and y <= at[1] <= y + h for x, y, w, h in covered):
                # the line leads clear of a hull
                clear = float(np.clip(_HULL_CLEAR_M / metres_per_pixel(view, point), 30.0, 90.0))
                found.append(Label(at, words, colour, (side * clear if side else -20.0) * c.scale))
        return found

    def _scale_bar(self, view: View, box: Box, at: tuple[float, float], share: float, words: str = "") -> None:
        """A bar of a round length, at most a share of the box's width, where one scale holds."""
        if view.plane_m:
            (x, y), s = at, self.canvas.scale
            pixels_per_m = box[3] / 2 / np.tan(np.radians(view.fovy_deg) / 2) / view.plane_m
            length = round_length(share * box[2] / pixels_per_m)
            across = length * pixels_per_m
            bar = np.array([[x, y - 4 * s], [x, y], [x + across, y], [x + across, y - 4 * s]])
            self.canvas.strokes([Stroke(bar, (*PALE, 0.95), 2.0)])
            self.canvas.text((x, y + 4 * s), f"{length:g} m{words}", PALE, 12)

    def _draw_footer(self) -> None:
        c, scenario = self.canvas, self._data.flight.scenario
        words = f"LAISN-Sim  ·  {scenario.name}  ·  seed {scenario.seed}, run {scenario.run}"
        if self._dashboard:
            words += f"  ·  {scenario.navigation.variant}  ·  {self._data.speed_up:g}× real time"
        c.text((c.width / 2, c.height - 8 * c.scale), words, (0.85, 0.95, 1.0, 0.85), 12, "ms")


def level_axis(state: FrameState) -> Floats:
    """Ends, shape (2, 3), [m], of the leader's axis as it would lie in a level hull, a little longer than that."""
    rear, front = state.transmitter[:2]
    middle, heading = state.position[0], state.heading[0]
    reach = 0.8 * float(np.linalg.norm(front - rear)) * np.array([np.sin(heading), np.cos(heading), 0.0])
    return np.array([middle - reach, middle + reach])


def nearest(positions: Floats) -> Floats:
    """The two of several points, shape (v, 3), that are nearest to each other, shape (2, 3)."""
    first, second = np.triu_indices(len(positions), 1)
    pair = int(np.argmin(np.linalg.norm(positions[first] - positions[second], axis=1)))
    return positions[[first[pair], second[pair]]]


def metres_per_pixel(view: View, point: Floats) -> float:
    """Scale at a point of shape (3,) in a frame of 720 rows [m]."""
    _, (ahead,) = view.project(point, 1, 1)
    return float(max(ahead, 0.15) * np.tan(np.radians(view.fovy_deg) / 2) / 360)
