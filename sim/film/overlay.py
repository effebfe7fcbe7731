"""What lies over the picture: rays, trails, markers and labels in place, and the dashboard
beside it.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats
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

_TRAIL_PIECES = 12  # of a trail, each with an opacity of its own
_HULL_CLEAR_M = 0.45  # least length of the line from a vehicle to its label, in the world
_ELLIPSE_PX = 9.0
"""Half axis from which an ellipse of uncertainty is drawn, at 720 rows: below it would lie under
the marker.
"""
_ELLIPSE = np.column_stack([f(np.linspace(0.0, 2 * np.pi, 49)) for f in (np.cos, np.sin)])
_WIDEST = 8.0
"""Width that no line exceeds, at 720 rows [px]: lines farther from the picture are not drawn."""
_LABELS = 16  # followers beyond these go without a label
_SMALL = (640, 360)  # frames below this size go without panels [px]
_DARK: Colour = (0.0, 0.05, 0.08, 0.9)
_WHITE: Colour = (1.0, 1.0, 1.0, 0.75)
_LABEL_SIZE = 13
_LABEL_GAP = 3.0  # between the words and the edge of their plate, at 720 rows [px]
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
    """Draws over the frames of one film; with `plain` neither panels nor words."""

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
        self._shows_level_axis = video.camera == "profile"
        self._dashboard = None
        if not plain and video.width_px >= _SMALL[0] and video.height_px >= _SMALL[1]:
            self._dashboard = Dashboard(data, self.canvas, self._shows_level_axis)

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
            occupied.append(board.scale_bar_area)
            board.draw(c, state, trails)
            words = "" if shot.view.axes[2][2] < -0.99 else " at mid-distance"
            self._scale_bar(shot.view, self._box, board.scale_bar_area[:2], 0.12, words)
        draw_labels(self._labels(state, shot.view), occupied, c)
        scenario = self._data.flight.scenario
        words = f"LAISN-Sim  ·  {scenario.name}  ·  seed {scenario.seed}, run {scenario.run}"
        if board:
            words += f"  ·  {scenario.variants}  ·  {self._data.speed_up:g}× real time"
        c.text((c.width / 2, c.height - 8 * c.scale), words, (0.85, 0.95, 1.0, 0.85), 12, "ms")

    def _draw_view(self, state: FilmFrame, view: View, box: Box, trails: list[Trail]) -> None:
        """Lines and markers as one camera sees them, inside its box."""
        points = np.array([points for points, _ in trails])
        strokes = [
            Stroke(pixels, (*trails[n][1][:3], 0.75 * fraction**0.8))
            for n, pixels, fraction in self._lines(view, box, points, _TRAIL_PIECES)
        ]
        strokes += [*self._rays(state, view, box), *self._ellipses(state, view, box)]
        lines, markers = self._markers(state, view, box)
        self.canvas.strokes([*strokes, *lines], box)
        self.canvas.shapes(markers, box)

    def _lines(
        self, view: View, box: Box, lines: Floats, pieces: int = 1
    ) -> Iterator[tuple[int, Floats, float]]:
        """Polylines, shape (n, p, 3), each in about this number of pieces: number of the line,
        pixels, and place of the middle along the line, in [0, 1].
        """
        left, top, width, height = box
        margin = _WIDEST * self.canvas.scale
        for number, pixels, fractions in view.lines(lines, width, height):
            low, high = pixels.min(axis=0), pixels.max(axis=0)
            if (high < -margin).any() or (low > (width + margin, height + margin)).any():
                continue
            shifted = np.add(pixels, (left, top))
            places = fractions.tolist()
            step = max(1, -(-(len(pixels) - 1) // pieces))
            for first in range(0, len(pixels) - 1, step):
                last = min(first + step, len(pixels) - 1)
                yield number, shifted[first : last + 1], (places[first] + places[last]) / 2

    def _rays(self, state: FilmFrame, view: View, box: Box) -> Iterator[Stroke]:
        rays = [(f, i) for f, i in np.argwhere(state.ray > 0.03) if i in self._transmitters]
        if not rays:
            return
        ends = np.array([(state.transmitter[i], state.hydrophone[f]) for f, i in rays])
        for n, pixels, _ in self._lines(view, box, ends):
            f, i = rays[n]
            is_filmed = f == self._follower
            colours = (
                self._annotations.ray_colours(state.message[f])
                if is_filmed
                else TRANSMITTER_COLOURS
            )
            opacity = float(state.ray[f, i]) * (0.7 if is_filmed else 0.3)
            yield Stroke(pixels, (*colours[i], 0.16 * opacity), 7.0)
            yield Stroke(pixels, (*colours[i], 0.85 * opacity), 1.8)

    def _trails(self, state: FilmFrame) -> list[Trail]:
        """Trails of all vehicles, of the other estimates and of the filmed follower's own, which
        lies on top.
        """
        trails = self._data.trails(state)
        followers = len(state.estimate)
        colours = [
            LEADER,
            *[TRUTH] * followers,
            *(other.colour for other in self._annotations.others),
            ESTIMATE,
        ]
        return list(
            zip(
                [
                    *trails[: followers + 1],
                    *trails[2 * followers + 1 :],
                    trails[followers + 1 + self._follower],
                ],
                colours,
                strict=True,
            )
        )

    def _ellipses(self, state: FilmFrame, view: View, box: Box) -> Iterator[Stroke]:
        """The filters' uncertainty about their estimates, where it is large enough to be seen."""
        weights, centres, covariances = (
            np.array(values)
            for values in zip(*(h for hs in state.hypotheses for h in hs), strict=True)
        )
        is_finite = np.isfinite(covariances).all(axis=(1, 2))
        variances, axes = np.linalg.eigh(np.where(is_finite[:, None, None], covariances, 0.0))
        radii = SIGMAS * np.sqrt(np.maximum(variances, 0.0))
        smallest = _ELLIPSE_PX * self.canvas.height / box[3] * metres_per_pixel(view, centres)
        visible = np.flatnonzero(is_finite & (radii.max(axis=1) >= smallest))
        flat = (_ELLIPSE * radii[visible, None]) @ axes[visible].transpose(0, 2, 1)
        rings = np.repeat(centres[visible, None], len(_ELLIPSE), axis=1)
        rings[..., :2] += flat
        for n, pixels, _ in self._lines(view, box, rings):
            yield Stroke(pixels, (*ESTIMATE, 0.3 + 0.6 * weights[visible[n]]), 1.5)

    def _markers(
        self, state: FilmFrame, view: View, box: Box
    ) -> tuple[list[Stroke], list[Polygon]]:
        """Transmitters, stations, estimates and hydrophones, and dashed lines between what
        belongs together.
        """
        c = self.canvas
        shapes = list[Polygon]()
        links = [level_axis(state)] if self._shows_level_axis else []
        links += [nearest(state.position)] if self._data.on_stations else []
        colours = self._annotations.ray_colours(state.message[self._follower])
        hydrophone_followed = state.hydrophone[self._follower]
        hydrophones = state.hydrophone
        estimates = [
            (hydrophone_followed, o, other.colour)
            for o, other in zip(state.others, self._annotations.others, strict=True)
        ]
        estimates += [
            (hydrophone, e, ESTIMATE)
            for hydrophone, e in zip(hydrophones, state.estimate, strict=True)
        ]
        # what draws a mark, its point, radius, fill and outline, and the ends of its dashed line
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
                for h, estimate, colour in estimates
            ),
            *((c.disc, hydrophone, 4.5, TRUTH, _DARK, []) for hydrophone in hydrophones),
        ]
        pixels, visible = self._pixels(view, box, np.array([mark[1] for mark in marks]))
        for n in np.flatnonzero(visible):
            make, _, radius, fill, outline, link = marks[n]
            shapes.append(make(pixels[n], radius, fill, outline))
            links += [np.array(link)] if link else []
        lines = self._lines(view, box, np.array(links).reshape(-1, 2, 3))
        return [Stroke(pixels, _WHITE, 1.3, dashed=True) for _, pixels, _ in lines], shapes

    def _pixels(self, view: View, box: Box, points: Floats) -> tuple[Floats, Bools]:
        """Where points, shape (n, 3), appear, shape (n, 2), and which do inside a box; not those
        of NaN.
        """
        left, top, width, height = box
        pixels, ahead = view.project(points, width, height)
        inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
        return np.add(pixels, (left, top)), inside & (ahead > 0.15)

    def _labels(self, state: FilmFrame, view: View) -> list[Label]:
        """Labels of the picture, the most important first."""
        c = self.canvas
        f = self._follower
        names = self._data.flight.trajectory.names
        truth = state.hydrophone[f]
        leader = state.position[0]
        pitch = f", pitch {np.degrees(state.pitch[0]):+z.1f}°" if self._shows_level_axis else ""
        distance_to_leader = float(np.linalg.norm(leader - state.position[f + 1]))

        def off(name: str, position: Floats) -> str:
            return f"{name}, off by {float(np.hypot(*(position - truth)[:2])):.1f} m"

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
        if self._shows_level_axis:
            candidates.append((level_axis(state)[0], "level", (1.0, 1.0, 1.0), 0))
        labels = []
        covered = self._dashboard.covered if self._dashboard else []
        points = np.array([point for point, *_ in candidates])
        pixels, visible = self._pixels(view, self._box, points)
        # the line leads clear of a hull
        clear = np.clip(_HULL_CLEAR_M / metres_per_pixel(view, points), 30.0, 90.0)
        for n in np.flatnonzero(visible):
            _, words, colour, side = candidates[n]
            at = pixels[n]
            if not any(x <= at[0] <= x + w and y <= at[1] <= y + h for x, y, w, h in covered):
                rise = side * float(clear[n]) if side else -20.0
                labels.append(Label(at, words, colour, rise * c.scale))
        return labels

    def _scale_bar(
        self, view: View, box: Box, pixel: tuple[float, float], share: float, words: str = ""
    ) -> None:
        """A bar of a round length, at most a share of the box's width, from a pixel on, where one
        scale holds, that at `View.plane_m` ahead.
        """
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
    """Ends, shape (2, 3), [m], of a line along the leader's axis as it would lie in a level hull,
    1.6 times as long as its transmitters are apart.
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


def metres_per_pixel(view: View, points: Floats) -> Floats:
    """Scale at points of shape (n, 3) in a frame of 720 rows, shape (n,) [m]."""
    _, ahead = view.project(points, 1, 1)
    return np.maximum(ahead, 0.15) / view.focal(720)


def _places(
    label: Label, width: float, height: float, scale: float
) -> Iterator[tuple[Area, tuple[float, float]]]:
    """Places for the words, the most wanted first, with the end of the line that leads there."""
    x, y = label.at.tolist()
    for distance, side, n, direction in product(
        _LABEL_ASIDE, (1, -1), range(_LABEL_ROWS), (1.0, -1.0)
    ):
        rise = side * label.rise
        rise += float(np.sign(rise)) * _LABEL_STEP * scale * n
        end = x + distance * scale * direction, y + rise
        left = end[0] + 2 * scale if direction > 0 else end[0] - 2 * scale - width
        yield (left, end[1] - height / 2, width, height), end


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
    half_marker = _MARKER * s
    full = list(occupied)
    full.append((0.0, canvas.height - _FOOT * s, float(canvas.width), _FOOT * s))
    full += [
        (float(x) - half_marker, float(y) - half_marker, 2 * half_marker, 2 * half_marker)
        for x, y in (m.at for m in labels)
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
            fits = left >= 0 and top >= 0 and right <= canvas.width and bottom <= canvas.height
            if fits and all(
                left >= x + w or x >= right or top >= y + h or y >= bottom for x, y, w, h in full
            ):
                full.append(area)
                positions.append((label, area, np.array(end)))
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
