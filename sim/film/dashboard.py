"""The panels of a film, where they lie, and what of them stays as it is from frame to frame."""

from collections.abc import Sequence

import numpy as np

from laisn.arrays import Floats
from sim.film.annotations import Annotations
from sim.film.canvas import Canvas, Colour, Layer
from sim.film.curve import Curve
from sim.film.footage import Footage, Moment
from sim.film.formation.marks import STATION
from sim.film.numbers import HEIGHT, SHORT_HEIGHT, Numbers
from sim.film.panels import LEADER, TRUTH, Map, Place, caption, colour_bar
from sim.film.scene import ESTIMATE

_SHORT = 576
"""Frames of fewer rows have the short panel of numbers and one curve: words that can be read leave no room for more."""


class Dashboard:
    """Numbers and curves at the left edge, map and colour bar at the right, a caption between them.

    Args:
        footage: what is filmed.
        follower: index of the follower whose numbers are shown.
        canvas: of the frames.
        annotations: what a study adds.
        off_station: distance of the follower from its station at filter steps, shape (n,), [m]; None: it has none.
    """

    def __init__(
        self,
        footage: Footage,
        follower: int,
        canvas: Canvas,
        annotations: Annotations,
        off_station: Floats | None = None,
    ) -> None:
        self._footage, self._follower, self._added = footage, follower, annotations
        self._off_station = off_station
        s, t = canvas.scale, canvas.text_scale
        short = canvas.height < _SHORT
        left, top, width, gap, side = 16 * s, 16 * s, 292 * s, 6 * s, 232 * s
        self._numbers = Numbers(
            footage, follower, (left, top, width, (SHORT_HEIGHT if short else HEIGHT) * t), short=short
        )
        first, height = top + self._numbers.place[3] + gap, 92 * t
        self._curves = self._made([(left, first + n * (height + gap), width, height) for n in range(1 if short else 2)])
        corner = canvas.width - side - left
        self._map = Map(footage, follower, (corner, top, side, side), annotations.others)
        self._bar = (corner, top + side + gap, side, 72 * t)
        beside = left + width + gap
        self._caption = (beside, top, corner - gap - beside, 60 * s)
        self.scale: Place = (left, canvas.height - 26 * s - 32 * t, 240 * s, 36 * t)
        """Where the scale of the picture stands."""
        bar, words = ([self._bar] if annotations.rays else []), ([self._caption] if annotations.caption else [])
        lefts = [self._numbers.place, *(curve.place for curve in self._curves)]
        self.places: list[Place] = [*lefts, self._map.place, *bar, *words]
        """Places of all panels."""
        lower_left, lower_right = (max(y + h for _, y, _, h in column) for column in (lefts, [self._map.place, *bar]))
        self.covered: list[Place] = [
            (0.0, 0.0, left + width, lower_left),
            (corner, 0.0, canvas.width - corner, lower_right),
            *words,
        ]
        """Where no lines are drawn, for between panels snippets of them would remain."""
        self._layers = self._ground(canvas)

    def _made(self, places: Sequence[Place]) -> list[Curve]:
        """Curves over the mission: the position error, and where there is room another."""
        footage, added, follower = self._footage, self._added, self._follower
        dt, start, truth = footage.flight.measurements[0].dt, footage.start, footage.flight.hydrophone(follower)[:, :2]
        errors: list[tuple[Colour, Floats]] = [
            *((o.colour, np.linalg.norm(o.position - truth, axis=1)) for o in added.others),
            (ESTIMATE, footage.position_error[follower]),
        ]
        if added.level_axis:
            pitch = np.degrees(footage.flight.trajectory.pitch[footage.flight.step_index(), 0])
            second: tuple[str, list[tuple[Colour, Floats]]] = ("leader's pitch [°]", [(LEADER, pitch)])
        elif self._off_station is not None:
            second = ("off its station [m]", [(STATION, self._off_station)])
        else:
            bearing = np.degrees(np.abs(footage.bearing_error[follower]))
            second = ("bearing error E_B [°]", [(ESTIMATE, bearing)])
        # pitch is the cause of what the errors show, and stands above them
        order = reversed(places) if added.level_axis else places
        return [
            Curve(label, dt, values, place, start=start)
            for (label, values), place in zip((("position error E_P [m]", errors), second), order, strict=False)
        ]

    def _ground(self, canvas: Canvas) -> list[Layer]:
        """Panels before anything moves on them."""
        moving: tuple[Numbers | Curve | Map, ...] = (self._numbers, *self._curves, self._map)
        layers = [canvas.layer(panel.place, panel.ground) for panel in moving]
        added = self._added
        if rays := added.rays:
            layers.append(canvas.layer(self._bar, lambda other: colour_bar(other, rays, self._bar)))
        if added.caption:
            others = [("◆", o.colour, o.label) for o in added.others]
            legend = [("●", TRUTH, "truth"), ("◆", ESTIMATE, added.label), *others]
            layers.append(
                canvas.layer(self._caption, lambda other: caption(other, added.caption, legend, self._caption))
            )
        return layers

    def draw(self, canvas: Canvas, moment: Moment, rays: Sequence[Colour], others: Sequence[Floats]) -> None:
        """All panels.

        Args:
            canvas: the frame.
            moment: what it shows.
            rays: colours of the follower's rays.
            others: positions of the other estimates, each of shape (3,), [m].
        """
        for layer in self._layers:
            canvas.lay(layer)
        self._numbers.draw(canvas, moment, rays)
        for curve in self._curves:
            curve.draw(canvas, moment.time - self._footage.start)
        self._map.draw(canvas, moment, others)
