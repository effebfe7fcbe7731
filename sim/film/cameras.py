"""Cameras of the film: where they stand and what they look at, as pure functions of time."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats
from sim import attitude
from sim.film.film_data import FilmData, FilmFrame
from sim.scenario.parts import SeaSettings
from sim.water.assembly import floor_of

_SMOOTHING_S = 0.8  # standard deviation of the smoothing of a camera's swing, in seconds of film
_STEADY_S = 3.0
"""Standard deviation of the smoothing for a camera that stays put while waves move its subject,
in mission seconds.
"""
_NEAR_M = 0.15  # what is nearer to a camera is not drawn
_CLEARANCE_M = 1.2  # a camera stays so far from surface and floor
# left, right and upper edge of what the panels leave free, as shares of the frame
_FREE = (0.26, 0.79, 0.04)
_SIGHT_DOWN_M = 42.0  # how far below the vehicles the view from above reaches
_ORBIT_FILM_S = 40.0  # time in which the camera `orbit` goes around, in seconds of film
_NORTH_UP = np.array([0.0, 1.0, 0.0])
_PROFILE_TURN = np.radians(152.0)
"""From the bearing of the follower to that of the camera `profile`, seen from the leader: a camera
so far around sees the leader at one side of the frame's middle and a far follower some 27° from it,
at the other."""
_PROFILE_LEADER = np.radians(6.5)
"""How far from the middle the leader appears there, so that neither hides behind a panel."""


@dataclass(frozen=True, kw_only=True)
class View:
    """A camera without roll, unless `up` is given. Raises ValueError if it stands on its target."""

    position: Floats
    target: Floats  # shape (3,), as `position`, [m]
    up: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    fovy_deg: float = 45.0  # vertical field of view
    plane_m: float | None = None
    """How far ahead the vehicles lie if all lie about as far, so that one scale holds for them
    [m].
    """

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.target - self.position) > 0:
            raise ValueError(f"a camera at {self.position} cannot look at itself")

    @cached_property
    def axes(self) -> Floats:
        """Unit vectors right, up and forward in the world, shape (3, 3), by rows."""
        forward = self.target - self.position
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(right, forward), forward])

    def focal(self, height: int) -> float:
        """Focal length in a frame with this number of rows [px]."""
        return float(height / 2 / np.tan(np.radians(self.fovy_deg) / 2))

    def project(self, points: Floats, width: int, height: int) -> tuple[Floats, Floats]:
        """Project points of shape (n, 3): pixels from the top left, shape (n, 2), and distance
        ahead, shape (n,), [m].

        Points beside or behind the camera get a distance below `_NEAR_M` and pixels without
        meaning.
        """
        local = (np.atleast_2d(points) - self.position) @ self.axes.T
        ahead = local[:, 2]
        scale = self.focal(height) / np.maximum(ahead, 1e-9)
        return np.stack(
            [width / 2 + scale * local[:, 0], height / 2 - scale * local[:, 1]], axis=1
        ), ahead

    def sees(self, points: Floats, reach: Floats, aspect: float) -> Bools:
        """Whether anything of balls about points, shape (n, 3), of radii, shape (n,), may lie in a
        frame, `aspect` times as wide as high, shape (n,).
        """
        right, up, ahead = ((points - self.position) @ self.axes.T).T
        slope = np.tan(np.radians(self.fovy_deg) / 2)
        visible = ahead > -reach
        for aside, tangent in ((right, slope * aspect), (up, slope)):
            visible &= np.abs(aside) < ahead * tangent + reach * np.hypot(1.0, tangent)
        return np.asarray(visible)

    def line(self, points: Floats, width: int, height: int) -> list[tuple[Floats, Floats]]:
        """A polyline of shape (n, 3) as the stretches of it before the camera, cut at the lens.

        Each has pixels, shape (m, 2), and places along the line, shape (m,), in [0, 1].
        """
        depth = (points - self.position) @ self.axes[2]
        in_front = depth >= _NEAR_M
        last = len(points) - 1
        rows = np.column_stack([points, np.linspace(0.0, 1.0, last + 1)])

        def cut(first: int) -> Floats:
            """Where the line crosses the lens after a point."""
            share = (_NEAR_M - depth[first]) / (depth[first + 1] - depth[first])
            return np.asarray(
                rows[first : first + 1] + share * np.diff(rows[first : first + 2], axis=0)
            )

        ends = [-1, *np.flatnonzero(in_front[1:] != in_front[:-1]).tolist(), last]
        stretches = []
        for before, end in pairwise(ends):
            if in_front[end]:
                parts = [cut(before)] if before >= 0 else []
                parts.append(rows[before + 1 : end + 1])
                parts += [cut(end)] if end < last else []
                stretch = np.concatenate(parts)
                if len(stretch) > 1:
                    pixels, _ = self.project(stretch[:, :3], width, height)
                    stretches.append((pixels, stretch[:, 3]))
        return stretches

    def lines(self, lines: Floats, width: int, height: int) -> Iterator[tuple[int, Floats, Floats]]:
        """Polylines of shape (n, p, 3) in their order as by `line`: number, pixels and places of
        each stretch.
        """
        count, length, _ = lines.shape
        pixels, ahead = self.project(lines.reshape(-1, 3), width, height)
        pixels = pixels.reshape(count, length, 2)
        in_front = ahead.reshape(count, length) >= _NEAR_M
        is_whole = in_front.all(axis=1) & (length > 1)
        places = np.linspace(0.0, 1.0, length)
        for number in np.flatnonzero(in_front.any(axis=1)).tolist():
            if is_whole[number]:
                yield number, pixels[number], places
            else:
                for stretch in self.line(lines[number], width, height):
                    yield number, *stretch


class Shot(NamedTuple):
    """One frame's cameras and how far they see."""

    view: View
    # pictures in the picture: camera, and the vehicle that it shows
    insets: tuple[tuple[View, int], ...]
    fog: tuple[float, float]  # where fog begins and where it hides everything [m]
    surface: bool  # whether the sea's surface is drawn; seen from above, it would hide everything
    # whether insets begin at the left edge: the vehicles keep to the right
    insets_left: bool = False


@dataclass(frozen=True, kw_only=True)
class OwnCamera:
    """A camera of the user's, such as a page of a scene gives: where it stands and what it looks
    at, east, north, up [m].
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    vehicle: int | None = None
    """The vehicle from which both are counted; None: from the world's origin."""
    fovy_deg: float = 46.0  # vertical field of view, of the page's cameras

    def shot(self, state: FilmFrame) -> Shot:
        """What it sees at a state."""
        origin = np.zeros(3) if self.vehicle is None else state.position[self.vehicle]
        view = View(
            position=origin + self.position, target=origin + self.target, fovy_deg=self.fovy_deg
        )
        distance = float(np.linalg.norm(view.target - view.position))
        fog = (max(3.0, 0.25 * distance), max(150.0, 2.3 * distance))
        return Shot(view, (), fog, bool(view.position[2] < 0.0))


class CameraRig:
    """Places a named camera at any instant of the data; `aspect` is width by height of the
    frame.
    """

    def __init__(self, data: FilmData, aspect: float) -> None:
        self._aspect = aspect
        follower = data.follower
        self._vehicle = follower + 1
        truth = data.flight.trajectory
        self._floor = floor_of(SeaSettings.of(data.flight.scenario))
        stride = max(1, round(0.05 * data.speed_up / truth.dt))
        self._time = truth.time[::stride]
        # here, for only the children that render place cameras; this import takes a fifth of a
        # second
        from scipy.ndimage import gaussian_filter1d

        sigma = _SMOOTHING_S * data.speed_up / (truth.dt * stride)

        def smooth(values: Floats, sigma: float = sigma) -> Floats:
            return np.asarray(gaussian_filter1d(values, sigma, axis=0, mode="nearest"))

        position = truth.position[::stride]
        # arrays below hold values at `_time`; this one leads from the follower to the leader
        self._separation = smooth(position[:, 0] - position[:, self._vehicle])
        self._leader = smooth(position[:, 0], _STEADY_S / (truth.dt * stride))
        # middle and half extent, east, north, up, of the box about all vehicles
        low, high = position.min(axis=1), position.max(axis=1)
        self._centre = (low + high) / 2
        self._half_extent = smooth((high - low) / 2)
        heading = np.unwrap(truth.heading[::stride], axis=0)
        self._heading = smooth(heading)
        ahead = np.stack([np.sin(heading[:, 0]), np.cos(heading[:, 0])], axis=1)
        is_starboard = (
            ahead[:, 1] * self._separation[:, 0] - ahead[:, 0] * self._separation[:, 1] < 0
        )
        # 1: the follower is on the leader's starboard side most of the time, −1: to port
        self._side = 1.0 if is_starboard.mean() >= 0.5 else -1.0
        # how far the estimate lies to the right of the follower, seen towards the leader
        errors = (
            data.flight.estimates[follower].state[:, :2] - data.flight.hydrophone(follower)[:, :2]
        )
        values = np.nan_to_num(np.column_stack([data.position_error[follower], errors]))
        error, east, north = data.interpolated(values, self._time).T
        self._error = smooth(error)
        towards = (
            self._separation[:, :2]
            / np.maximum(np.hypot(*self._separation[:, :2].T), 1e-6)[:, None]
        )
        self._aside = smooth(east * towards[:, 1] - north * towards[:, 0])

    def _value_at(self, values: Floats, time: float) -> Floats:
        """Values at `_time` interpolated to a time."""
        index = float(np.interp(time, self._time, np.arange(self._time.size)))
        i = int(index)
        u = index % 1.0
        return np.asarray((1 - u) * values[i] + u * values[min(i + 1, self._time.size - 1)])

    def _in_water(self, position: Floats) -> Floats:
        """A camera's position, kept between surface and floor."""
        floor = -self._floor.depth_at(float(position[0]), float(position[1]))
        return np.append(position[:2], np.clip(position[2], floor + _CLEARANCE_M, -_CLEARANCE_M))

    def _towards_leader(self, time: float) -> Floats:
        """Horizontal unit vector from the follower to the leader, east where there is none."""
        flat = self._value_at(self._separation, time) * [1.0, 1.0, 0.0]
        length = np.linalg.norm(flat)
        return flat / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])

    def _close(self, state: FilmFrame, vehicle: int, distance: float = 3.4) -> View:
        """A vehicle from its starboard quarter at a distance [m], turning with its heading."""
        heading = float(self._value_at(self._heading, state.time)[vehicle])
        side = np.array([np.sin(heading + 2.2), np.cos(heading + 2.2), 0.28])
        position = state.position[vehicle]
        return View(
            position=self._in_water(position + distance * side), target=position, fovy_deg=40.0
        )

    def _profile(self, state: FilmFrame) -> View:
        """The leader from the bow quarter away from the follower; steady, so that waves move the
        hull in the frame.
        """
        leader = self._value_at(self._leader, state.time)
        distance = -self._value_at(self._separation, state.time)
        bearing = np.arctan2(distance[0], distance[1]) + self._side * _PROFILE_TURN
        eye = self._in_water(leader + 6.6 * np.array([np.sin(bearing), np.cos(bearing), 0.0]))
        look = bearing + np.pi + self._side * _PROFILE_LEADER
        # rather more than half-way down to the follower: the leader keeps room to heave, the
        # follower to drift off
        down = 0.58 * np.arctan2(distance[2], np.hypot(distance[0], distance[1]))
        forward = np.array([np.sin(look), np.cos(look), np.tan(down)])
        return View(position=eye, target=eye + forward, fovy_deg=45.0)

    def _beside(
        self,
        target: Floats,
        direction: Floats,
        fovy_deg: float,
        width: float,
        high: float,
        deep: float,
    ) -> View:
        """A view of vehicles between the panels: `width` across, `high` up and `deep` along the
        line of sight [m].
        """
        left, right, _ = _FREE
        slope = np.tan(np.radians(fovy_deg) / 2)
        distance_across = width / ((right - left) * slope * self._aspect)
        distance = max(float(np.hypot(distance_across, deep)), high / (0.25 * slope) + deep, 6.0)
        eye = self._in_water(target + distance * direction)
        # close below the surface, that would end in a line
        eye[2] = min(eye[2], 0.5 * target[2])
        view = View(position=eye, target=target, fovy_deg=fovy_deg)
        frame_width = 2 * float(np.linalg.norm(target - eye)) * slope * self._aspect
        shift = (0.5 - (left + right) / 2) * frame_width * view.axes[0]
        return replace(view, position=eye + shift, target=target + shift)

    def _top(self, state: FilmFrame, bottom: float) -> tuple[View, tuple[float, float]]:
        """View from above, vehicles within the part of the frame that panels leave free, down to
        the share `bottom`.
        """
        left, right, top = _FREE
        centre = self._value_at(self._centre, state.time)
        half_extent = self._value_at(self._half_extent, state.time)
        across = (right - left) * self._aspect
        down = bottom - top
        frame_height = (
            max(1.25 * 2 * half_extent[0] / across, 1.25 * 2 * half_extent[1] / down, 14.0) + 3.0
        )
        shift = np.array([0.5 - (left + right) / 2, (top + bottom) / 2 - 0.5, 0.0])
        target = centre + frame_height * shift * [self._aspect, 1.0, 0.0]
        height = frame_height / 2 / np.tan(np.radians(45.0) / 2)
        view = View(
            position=target + np.array([0.0, 0.0, height]),
            target=target,
            up=_NORTH_UP,
            plane_m=height,
        )
        return view, (height - 5.0, height + _SIGHT_DOWN_M)

    def shot(self, camera: str, state: FilmFrame) -> Shot:
        """The camera `camera` of CAMERAS at a state."""
        follower = self._vehicle
        leader = 0
        close_leader = (self._close(state, leader), leader)
        close_follower = (self._close(state, follower, 2.9), follower)
        near_fog = (3.0, 150.0)
        position = state.position[follower]
        if camera == "chase":
            ahead = self._towards_leader(state.time)
            side = np.array([ahead[1], -ahead[0], 0.0])
            # far enough back to keep the estimate in the picture
            distance_behind = 5.0 + 1.2 * min(float(self._value_at(self._error, state.time)), 12.0)
            # and aside, so that follower and estimate both stand clear of the panels, most of which
            # are at the left
            error = float(np.clip(self._value_at(self._aside, state.time), -10.0, 10.0))
            target = position + (0.5 if error > 0 else 0.9) * error * side
            eye = self._in_water(
                target
                - distance_behind * ahead
                + 0.25 * distance_behind * side
                + [0.0, 0.0, 0.3 * distance_behind]
            )
            view = View(position=eye, target=target + 9.0 * ahead - 0.6 * side + [0, 0, 0.2])
            return Shot(view, (close_leader,), near_fog, True)
        if camera in ("top", "pip"):
            view, fog = self._top(state, 0.66 if camera == "pip" else 0.95)
            return Shot(view, (close_follower, close_leader) if camera == "pip" else (), fog, False)
        if camera == "follower":
            offsets = np.array([[-1.1, 0.0, 0.55], [6.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
            eye, ahead, up = attitude.rotate(state.quaternion[follower][None], offsets)
            view = View(position=position + eye, target=position + ahead, up=up, fovy_deg=55.0)
            return Shot(view, (close_leader,), near_fog, True)
        if camera == "profile":
            # the inset shows the follower and its estimate from above, north up
            hydrophone = state.hydrophone[follower - 1]
            reach = 1.5 + 1.6 * float(np.clip(self._value_at(self._error, state.time), 1.0, 8.0))
            # as the camera `top`, which the surface does not stop: near it, too, the scale holds
            height = float(reach / np.tan(np.radians(60.0) / 2))
            from_above = View(
                position=hydrophone + np.array([0.0, 0.0, height]),
                target=hydrophone,
                up=_NORTH_UP,
                fovy_deg=60.0,
                plane_m=height,
            )
            return Shot(
                self._profile(state),
                ((from_above, follower),),
                near_fog,
                True,
                insets_left=self._side > 0,
            )
        if camera == "leader":
            return Shot(self._close(state, leader, 4.6), (close_follower,), near_fog, True)
        centre = self._value_at(self._centre, state.time)
        half_extent = self._value_at(self._half_extent, state.time)
        # to the ends of the hulls
        radius = float(np.hypot(half_extent[0], half_extent[1])) + 1.0
        high = float(half_extent[2])
        if side_view := camera == "side":
            ahead = self._towards_leader(state.time)
            view = self._beside(
                centre, np.array([ahead[1], -ahead[0], 0.0]), 40.0, radius, high, 0.0
            )
        else:
            angle = 2 * np.pi * state.film_time / _ORBIT_FILM_S
            view = self._beside(
                centre, np.array([np.cos(angle), np.sin(angle), 0.10]), 50.0, radius, high, radius
            )
        distance = float(np.linalg.norm(view.target - view.position))
        view = replace(view, plane_m=distance if side_view else None)
        return Shot(
            view,
            (close_follower,) if side_view else (),
            (0.25 * distance, max(150.0, 2.3 * distance)),
            True,
        )
