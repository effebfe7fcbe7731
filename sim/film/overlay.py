"""What lies over the picture: rays, trails, markers and labels in place, and the dashboard
beside it.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.film.cameras import Shot, View
from sim.film.canvas import PALE, Area, Canvas, Colour, Polygon, Stroke, corners
from sim.film.dashboard import SIGMAS, Dashboard, Trail, round_length
from sim.film.film_data import (
    ESTIMATE,
    LEADER,
    STATION,
    TRANSMITTER_COLOURS,
    TRUTH,
    FilmData,
    FilmFrame,
)
from sim.film.scene import Box
from sim.scenario.settings import Video

_TRAIL_PIECES = 12
_HULL_CLEAR_M = 0.45
_ELLIPSE_PX = 9.0
"""Half axis from which an ellipse of uncertainty is drawn, at 720 rows: below it would lie under
the marker.
"""
_ELLIPSE = np.linspace(0.0, 2 * np.pi, 49)
_LABELS = 16  # followers beyond these go without a label
_SMALL = (640, 360)  # frames below this size go without panels [px]
_DARK: Colour = (0.0, 0.05, 0.08, 0.9)
_WHITE: Colour = (1.0, 1.0, 1.0, 0.75)
_LABEL_SIZE = 13
_LABEL_GAP = 3.0
_LABEL_ROWS = 5
_LABEL_STEP = 22.0
_LABEL_ASIDE = (16.0, 70.0)
"""Rows of places for labels, the distance between them, and distances aside from the point, at
720 rows [px].
"""
_MARKER = 8.0
_FOOT = 24.0
"""Half the side of the square that a marker keeps free, and height of the footer, at 720 rows
[px].
"""
_LABEL_GROUND: Colour = (0.0, 0.05, 0.08, 0.55)


class Label(NamedTuple):
    """Words for a point of the frame, shape (2,), [px]."""

    at: Floats
    words: str
    colour: Colour
    # length of the line to the words [px]; above the point if negative, below it if positive
    rise: float


class Overlay:
    """Draws over the frames of one film."""

    def __init__(self, data: FilmData, video: Video, *, plain: bool = False) -> None:
        self._data = data
        self._plain = plain
        self._annotations = data.annotations
        self._follower = data.follower
        self.canvas = Canvas(video.width_px, video.height_px)
        self._box: Box = (0, 0, video.width_px, video.height_px)
        navigation = data.flight.scenario.navigation_of(data.follower)
        self._transmitters = range(navigation.transmitters)
        # that camera is for the leader's pitch: a line shows its axis as it would lie in a level
        # hull
        self._level_axis = video.camera == "profile"
        self._dashboard = None
        if not plain and video.width_px >= _SMALL[0] and video.height_px >= _SMALL[1]:
            self._dashboard = Dashboard(data, self.canvas, self._level_axis)

    def inset_boxes(self, shot: Shot) -> tuple[Box, ...]:
        """Places of a shot's insets along the lower edge, from one side on: left, top, width,
        height [px].
        """
        c = self.canvas
        width = round(0.25 * c.width)
        height = round(0.25 * c.height)
        top = c.height - height - round(30 * c.scale)
        gap = round(12 * c.scale)
        edge = round(16 * c.scale)
        left_edges = [edge + i * (width + gap) for i in range(len(shot.insets))]
        return tuple(
            (x if shot.insets_left else c.width - width - x, top, width, height) for x in left_edges
        )

    def draw(self, state: FilmFrame, shot: Shot) -> None:
        """Draw over the picture on the canvas."""
        c = self.canvas
        board = self._dashboard
        boxes = self.inset_boxes(shot)
        trails = self._trails(state)
        covered = board.covered if board else []
        # lines of the whole picture pass below insets and panels: across a curve they would look
        # like one
        regions = [
            (slice(int(top), int(top + height) + 1), slice(int(left), int(left + width) + 1))
            for left, top, width, height in (*boxes, *covered)
        ]
        pictures = [c.pixels[region].copy() for region in regions]
        self._draw_view(state, shot.view, self._box, trails)
        for region, pixels in zip(regions, pictures, strict=True):
            c.pixels[region] = pixels
        for (view, vehicle), box in zip(shot.insets, boxes, strict=True):
            left, top, _, height = box
            self._draw_view(state, view, box, trails)
            edge = corners(box)
            c.strokes([Stroke(np.vstack([edge, edge[:1]]), (0.7, 0.9, 1.0, 0.8), 1.5)])
            words = self._data.flight.trajectory.names[vehicle] + (
                ", from above" if view.plane_m else ""
            )
            draw_plates(
                c, [(words, TRUTH if vehicle else LEADER, left + 5 * c.scale, top + 4 * c.scale)]
            )
            self._scale_bar(
                view, box, (left + 10 * c.scale, top + height - 26 * c.text_scale), 0.35
            )
        if self._plain:
            return
        occupied = [*boxes, *covered]
        if board:
            occupied.append(board.scale)
            board.draw(c, state, trails)
            words = "" if shot.view.axes[2][2] < -0.99 else " at mid-distance"
            self._scale_bar(shot.view, self._box, board.scale[:2], 0.12, words)
        draw_labels(self._labels(state, shot.view), occupied, c)
        scenario = self._data.flight.scenario
        words = f"LAISN-Sim  ·  {scenario.name}  ·  seed {scenario.seed}, run {scenario.run}"
        if board:
            words += f"  ·  {scenario.variants}  ·  {self._data.speed_up:g}× real time"
        c.text((c.width / 2, c.height - 8 * c.scale), words, (0.85, 0.95, 1.0, 0.85), 12, "ms")

    def _draw_view(self, state: FilmFrame, view: View, box: Box, trails: list[Trail]) -> None:
        """Lines and markers as one camera sees them, inside its box."""
        strokes = [
            Stroke(pixels, (*colour[:3], 0.75 * age**0.8))
            for points, colour in trails
            for pixels, age in self._lines(view, box, points, _TRAIL_PIECES)
        ]
        strokes += [*self._rays(state, view, box), *self._ellipses(state, view, box)]
        lines, markers = self._markers(state, view, box)
        self.canvas.strokes([*strokes, *lines], box)
        self.canvas.shapes(markers, box)

    def _lines(
        self, view: View, box: Box, points: Floats, pieces: int = 1
    ) -> Iterator[tuple[Floats, float]]:
        """A polyline in about this number of pieces: pixels, and place of the middle along the
        line, in [0, 1].
        """
        left, top, width, height = box
        for pixels, fractions in view.line(points, width, height):
            step = max(1, -(-(len(pixels) - 1) // pieces))
            for first in range(0, len(pixels) - 1, step):
                last = min(first + step, len(pixels) - 1)
                yield (
                    np.add(pixels[first : last + 1], (left, top)),
                    float(fractions[first] + fractions[last]) / 2,
                )

    def _rays(self, state: FilmFrame, view: View, box: Box) -> Iterator[Stroke]:
        for f, i in np.argwhere(state.ray > 0.03):
            if i in self._transmitters:
                filmed = f == self._follower
                colours = (
                    self._annotations.ray_colours(state.message[f])
                    if filmed
                    else TRANSMITTER_COLOURS
                )
                clear = float(state.ray[f, i]) * (0.7 if filmed else 0.3)
                for pixels, _ in self._lines(
                    view, box, np.array([state.transmitter[i], state.hydrophone[f]])
                ):
                    yield Stroke(pixels, (*colours[i], 0.16 * clear), 7.0)
                    yield Stroke(pixels, (*colours[i], 0.85 * clear), 1.8)

    def _trails(self, state: FilmFrame) -> list[Trail]:
        """Trails of all vehicles, of the other estimates and of the filmed follower's own, which
        lies on top.
        """
        trails = self._data.trails(state)
        f = len(state.estimate)
        colours = [
            LEADER,
            *[TRUTH] * f,
            *(other.colour for other in self._annotations.others),
            ESTIMATE,
        ]
        return list(
            zip(
                [*trails[: f + 1], *trails[2 * f + 1 :], trails[f + 1 + self._follower]],
                colours,
                strict=True,
            )
        )

    def _ellipses(self, state: FilmFrame, view: View, box: Box) -> Iterator[Stroke]:
        """The filters' uncertainty about their estimates, where it is large enough to be seen."""
        for weight, centre, covariance in (
            h for hypotheses in state.hypotheses for h in hypotheses
        ):
            if not np.all(np.isfinite(covariance)):
                continue
            variance, axes = np.linalg.eigh(covariance)
            radii = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
            smallest = _ELLIPSE_PX * self.canvas.height / box[3] * metres_per_pixel(view, centre)
            if radii.max() >= smallest:
                flat = (np.column_stack([np.cos(_ELLIPSE), np.sin(_ELLIPSE)]) * radii) @ axes.T
                ring = centre + np.column_stack([flat, np.zeros(len(flat))])
                for pixels, _ in self._lines(view, box, ring):
                    yield Stroke(pixels, (*ESTIMATE, 0.3 + 0.6 * weight), 1.5)

    def _markers(
        self, state: FilmFrame, view: View, box: Box
    ) -> tuple[list[Stroke], list[Polygon]]:
        """Transmitters, stations, estimates and hydrophones, and dashed lines between what
        belongs together.
        """
        c = self.canvas
        shapes = list[Polygon]()
        links = [level_axis(state)] if self._level_axis else []
        links += [nearest(state.position)] if self._data.on_stations else []
        colours = self._annotations.ray_colours(state.message[self._follower])
        hydrophone_followed = state.hydrophone[self._follower]
        hydrophones = state.hydrophone
        others = [
            (hydrophone_followed, o, other.colour)
            for o, other in zip(state.others, self._annotations.others, strict=True)
        ]
        others += [
            (hydrophone, e, ESTIMATE)
            for hydrophone, e in zip(hydrophones, state.estimate, strict=True)
        ]
        marks: list[tuple[Any, Floats, float, Colour, Colour, list[Floats]]] = [
            *(
                (c.disc, state.transmitter[i], 2.6, colours[i], _DARK, [])
                for i in self._transmitters
            ),
            *(
                (c.disc, s, 9.0, (*STATION, 0.15), STATION, [s, h])
                for s, h in zip(state.station, hydrophones, strict=True)
            ),
            *(
                (c.diamond, estimate, 6.0, colour, _DARK, [h, estimate])
                for h, estimate, colour in others
            ),
            *((c.disc, hydrophone, 4.5, TRUTH, _DARK, []) for hydrophone in hydrophones),
        ]
        for make, point, radius, fill, outline, link in marks:
            pixel = self._pixel(view, box, point)
            if pixel is not None:
                shapes.append(make(pixel, radius, fill, outline))
                links += [np.array(link)] if link else []
        lines = [line for ends in links for line in self._lines(view, box, ends)]
        return [Stroke(pixels, _WHITE, 1.3, dashed=True) for pixels, _ in lines], shapes

    def _pixel(self, view: View, box: Box, point: Floats) -> Floats | None:
        """Where a point appears inside a box, shape (2,), or None; None for a point of NaN."""
        left, top, width, height = box
        (pixel,), (ahead,) = view.project(point, width, height)
        is_visible = ahead > 0.15 and 0 <= pixel[0] < width and 0 <= pixel[1] < height
        return np.add(pixel, (left, top)) if is_visible else None

    def _labels(self, state: FilmFrame, view: View) -> list[Label]:
        """Labels of the picture, the most important first."""
        c = self.canvas
        f = self._follower
        names = self._data.flight.trajectory.names
        truth = state.hydrophone[f]
        leader = state.position[0]
        pitch = f", pitch {np.degrees(state.pitch[0]):+.1f}°" if self._level_axis else ""
        distance_to_leader = float(np.linalg.norm(leader - state.position[f + 1]))

        def off(name: str, pixel: Floats) -> str:
            return f"{name}, off by {float(np.hypot(*(pixel - truth)[:2])):.1f} m"

        # side of the label: above the point if negative
        candidates: list[tuple[Floats, str, Colour, int]] = [
            (leader, f"{names[0]}{pitch}, {distance_to_leader:.0f} m away", LEADER, -1),
            (truth, names[f + 1], TRUTH, -1),
            (state.estimate[f], off(self._annotations.label, state.estimate[f]), ESTIMATE, 1),
            (state.station[f], off("station", state.station[f]), STATION, 1),
        ]
        if self._data.on_stations:
            pair = nearest(state.position)
            distance = f"{float(np.linalg.norm(pair[1] - pair[0])):.1f} m apart, the nearest"
            candidates.append((pair.mean(axis=0), distance, (1.0, 1.0, 1.0), 1))
        for other, position in zip(self._annotations.others, state.others, strict=True):
            candidates.append((position, off(other.label, position), other.colour, 1))
        other_followers = [i for i in range(len(state.hydrophone)) if i != f][: _LABELS - 1]
        candidates += [(state.hydrophone[i], names[i + 1], TRUTH, -1) for i in other_followers]
        if self._level_axis:
            candidates.append((level_axis(state)[0], "level", (1.0, 1.0, 1.0), 0))
        labels = []
        covered = self._dashboard.covered if self._dashboard else []
        for point, words, colour, side in candidates:
            at = self._pixel(view, self._box, point)
            if at is not None and not any(
                x <= at[0] <= x + w and y <= at[1] <= y + h for x, y, w, h in covered
            ):
                # the line leads clear of a hull
                clear = float(np.clip(_HULL_CLEAR_M / metres_per_pixel(view, point), 30.0, 90.0))
                labels.append(Label(at, words, colour, (side * clear if side else -20.0) * c.scale))
        return labels

    def _scale_bar(
        self, view: View, box: Box, pixel: tuple[float, float], share: float, words: str = ""
    ) -> None:
        """A bar of a round length, at most a share of the box's width, where one scale holds."""
        if view.plane_m:
            x, y = pixel
            s = self.canvas.scale
            pixels_per_m = view.focal(box[3]) / view.plane_m
            length = round_length(share * box[2] / pixels_per_m)
            across = length * pixels_per_m
            bar = np.array([[x, y - 4 * s], [x, y], [x + across, y], [x + across, y - 4 * s]])
            self.canvas.strokes([Stroke(bar, (*PALE, 0.95), 2.0)])
            self.canvas.text((x, y + 4 * s), f"{length:g} m{words}", PALE, 12)


def level_axis(state: FilmFrame) -> Floats:
    """Ends, shape (2, 3), [m], of the leader's axis as it would lie in a level hull, a little
    longer than that.
    """
    rear, front = state.transmitter[:2]
    middle = state.position[0]
    heading = state.heading[0]
    reach = (
        0.8
        * float(np.linalg.norm(front - rear))
        * np.array([np.sin(heading), np.cos(heading), 0.0])
    )
    return np.array([middle - reach, middle + reach])


def nearest(positions: Floats) -> Floats:
    """The two of several points, shape (v, 3), that are nearest to each other, shape (2, 3)."""
    first, second = np.triu_indices(len(positions), 1)
    pair = int(np.argmin(np.linalg.norm(positions[first] - positions[second], axis=1)))
    return positions[[first[pair], second[pair]]]


def metres_per_pixel(view: View, point: Floats) -> float:
    """Scale at a point of shape (3,) in a frame of 720 rows [m]."""
    _, (ahead,) = view.project(point, 1, 1)
    return float(max(ahead, 0.15)) / view.focal(720)


def _places(label: Label, width: float, height: float, scale: float) -> list[tuple[Area, Floats]]:
    """Places for the words, the most wanted first, with the end of the line that leads there."""
    candidates = []
    for distance, side, n, direction in product(
        _LABEL_ASIDE, (1, -1), range(_LABEL_ROWS), (1.0, -1.0)
    ):
        rise = side * label.rise + np.sign(side * label.rise) * _LABEL_STEP * scale * n
        end = label.at + np.array([distance * scale * direction, rise])
        left = end[0] + 2 * scale if direction > 0 else end[0] - 2 * scale - width
        candidates.append(((float(left), float(end[1] - height / 2), width, height), end))
    return candidates


def place_labels(
    labels: Iterable[Label], occupied: Iterable[Area], canvas: Canvas
) -> list[tuple[Label, Area, Floats]]:
    """Each label, the most important first, with its area and the end of its line, shape (2,),
    [px].

    Areas keep clear of those that are taken; labels without room are left out. A pure function of
    one frame, so that frames may be drawn in any order.
    """
    s = canvas.scale
    labels = list(labels)
    full = list(occupied)
    full.append((0.0, canvas.height - _FOOT * s, float(canvas.width), _FOOT * s))
    half_marker = _MARKER * s
    markers = [
        (
            float(m.at[0]) - half_marker,
            float(m.at[1]) - half_marker,
            2 * half_marker,
            2 * half_marker,
        )
        for m in labels
    ]
    positions = []
    for label in labels:
        width, height = canvas.extent(label.words, -_LABEL_SIZE)
        width = width + 2 * _LABEL_GAP * s
        height = height + 2 * _LABEL_GAP * s
        for area, end in _places(label, width, height, s):
            left, top = area[:2]
            right = left + width
            bottom = top + height
            others = [*full, *markers]
            fits = left >= 0 and top >= 0 and right <= canvas.width and bottom <= canvas.height
            if fits and all(
                left >= x + w or x >= right or top >= y + h or y >= bottom for x, y, w, h in others
            ):
                full.append(area)
                positions.append((label, area, end))
                break
    return positions


def draw_plates(canvas: Canvas, texts: Sequence[tuple[str, Colour, float, float]]) -> None:
    """Draw texts, each with its colour and the left and upper edge [px] of its dark ground."""
    gap = _LABEL_GAP * canvas.scale
    extents = [canvas.extent(words, -_LABEL_SIZE) for words, *_ in texts]
    canvas.shapes(
        [
            Polygon(corners((left, top, width + 2 * gap, height + 2 * gap)), _LABEL_GROUND)
            for (_, _, left, top), (width, height) in zip(texts, extents, strict=True)
        ]
    )
    for (words, colour, left, top), (_, height) in zip(texts, extents, strict=True):
        canvas.text((left + gap, top + gap + height / 2), words, colour, -_LABEL_SIZE, "lm")


def draw_labels(labels: Iterable[Label], occupied: Iterable[Area], canvas: Canvas) -> None:
    """Put labels on the canvas, each at the end of a line from its point."""
    positions = place_labels(labels, occupied, canvas)
    starts = [
        label.at + canvas.scale * np.array([4.0, 7.5]) * np.sign(end - label.at)
        for label, _, end in positions
    ]
    canvas.strokes(
        [
            Stroke(np.array([start, end]), (*label.colour[:3], 0.8), 1.2)
            for start, (label, _, end) in zip(starts, positions, strict=True)
        ]
    )
    draw_plates(
        canvas, [(label.words, label.colour, area[0], area[1]) for label, area, _ in positions]
    )
