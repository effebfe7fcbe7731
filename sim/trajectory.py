"""Truth on a time grid: how the vehicles moved."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from numba.extending import overload

from laisn.arrays import ArrayRecord, Floats, Ints, freeze_arrays, require_shapes
from laisn.compiled import compiled, jitable
from laisn.held import borrowed_values
from laisn.spilled import spillable_zeros
from sim import attitude


class StateHistory(NamedTuple):
    """Motion of v vehicles at n instants as the simulation records it, one instant after the
    other.
    """

    pose: Floats  # position [m] and quaternion (w, x, y, z), shape (n, v, 7)
    # velocity in the world [m/s] and angular velocity in the body [rad/s], shape (n, v, 6)
    twist: Floats
    water: Floats  # velocity of the water in the world, shape (n, v, 3), [m/s]
    effector_states: Floats  # as of `Trajectory.effector_states`, shape (n, v, m)

    @classmethod
    def empty(cls, instants: int, vehicles: int, effectors: int) -> Self:
        """Room for a number of instants, in files if these are many."""
        return cls(
            *(spillable_zeros((instants, vehicles, columns)) for columns in (7, 6, 3, effectors))
        )


def row(array: Floats, k: int, vehicle: int) -> Any:
    """What an array of shape (n, v, c) holds of a vehicle at instant number k: c numbers, in Python
    plain ones.
    """
    return array[k, vehicle].tolist()


@overload(row, strict=False)
def _row(array: Any, k: Any, vehicle: Any) -> Any:
    return lambda array, k, vehicle: array[k, vehicle]


@jitable
def speed_through_water(
    pose: attitude.Pose, twist: attitude.Twist, water: attitude.Vector | Floats
) -> Any:
    """Speed through the water along the hull, as a speed log measures it [m/s]; numbers or
    arrays.
    """
    east, north, up = attitude.forward_of(pose[3:7])
    return east * (twist[0] - water[0]) + north * (twist[1] - water[1]) + up * (twist[2] - water[2])


@jitable
def pose_between(
    u: float,
    dt: float,
    pose: tuple[attitude.Pose, attitude.Pose],
    velocity: tuple[attitude.Vector | Floats, attitude.Vector | Floats],
) -> tuple[float, float, float, float, float, float, float]:
    """Pose between two instants: position by cubic Hermite, attitude by spherical interpolation.

    `u`, 0 … 1, is how far between them, `dt` the time from one to the other [s]; `pose` and
    `velocity` of the body's origin [m/s] are those at both.
    """
    start, end = pose
    start_velocity, end_velocity = velocity
    # x(u) = a x_0 + b v_0 + c x_1 + d v_1
    u2 = u * u
    u3 = u * u * u
    a = 2.0 * u3 - 3.0 * u2 + 1.0
    b = dt * (u3 - 2.0 * u2 + u)
    c = 3.0 * u2 - 2.0 * u3
    d = dt * (u3 - u2)
    east = a * start[0] + b * start_velocity[0] + c * end[0] + d * end_velocity[0]
    north = a * start[1] + b * start_velocity[1] + c * end[1] + d * end_velocity[1]
    up = a * start[2] + b * start_velocity[2] + c * end[2] + d * end_velocity[2]
    w, x, y, z = attitude.slerp(start[3:7], end[3:7], u)
    return east, north, up, w, x, y, z


@compiled
def _poses_at(grid_place: Floats, dt: float, pose: Floats, twist: Floats) -> Floats:
    """Poses of v vehicles at m places on the time grid, which are times in multiples of its step
    since its start, shape (m, v, 7).
    """
    poses = np.empty((grid_place.size, pose.shape[1], 7))
    for m in range(grid_place.size):
        i = min(int(grid_place[m]), pose.shape[0] - 2)
        for v in range(pose.shape[1]):
            ends = (pose[i, v], pose[i + 1, v])
            velocity = (twist[i, v], twist[i + 1, v])
            for j, value in enumerate(pose_between(grid_place[m] - i, dt, ends, velocity)):
                poses[m, v, j] = value
    return poses


@compiled
def _forward_speeds(pose: Floats, twist: Floats, water: Floats, speed: Floats) -> None:
    """Write the speeds through the water of v vehicles at n instants, shape (n, v)."""
    for k in range(pose.shape[0]):
        for v in range(pose.shape[1]):
            speed[k, v] = speed_through_water(pose[k, v], twist[k, v], water[k, v])


@compiled
def _body_points(pose: Floats, offset: Floats, points: Floats) -> None:
    """Write where a point of a hull is at n poses, shape (n, 7): shape (n, 3)."""
    # to count references to arrays at each instant would take longer than the rest
    poses = borrowed_values(pose)
    place = borrowed_values(offset)
    for k in range(poses.shape[0]):
        points[k, 0], points[k, 1], points[k, 2] = attitude.body_point_in_world(poses[k], place)


# instants of a block: a multiple of what is looked at together, such as windows of `sim.tracking`
_BLOCK = 1 << 16


def blocks(instants: int) -> list[slice]:
    """So many instants in blocks, in order: intermediate values of a day would take much memory."""
    return [slice(first, first + _BLOCK) for first in range(0, instants, _BLOCK)]


OF_VEHICLES = ("pose", "twist", "water_velocity", "effector_states")  # arrays of shape (n, v, …)


@dataclass(frozen=True, kw_only=True, repr=False)
class Trajectory(ArrayRecord):
    """Poses and velocities of v vehicles at n instants on a uniform grid; vehicle 0 is the leader.

    Raises ValueError if shapes disagree or the time grid is not uniform.
    """

    names: tuple[str, ...]  # vehicle names, the leader first, shape (v,)
    time: Floats  # time of each instant, shape (n,), uniform, [s]
    # body origins in the world [m], and quaternions from body to world (w, x, y, z), shape (n, v,
    # 7)
    pose: Floats
    # velocities in the world [m/s] and angular velocities in the body frame [rad/s], shape (n, v,
    # 6)
    twist: Floats
    # velocity of the water at the body origins in the world, shape (n, v, 3), [m/s]
    water_velocity: Floats
    # state of the effectors, shape (n, v, m): thrust [N], of a propeller [1/s], of a fin [rad];
    # else 0
    effector_states: Floats
    # of each vehicle's effectors; empty for point motion
    effector_names: tuple[tuple[str, ...], ...] = ()
    # of a unit of thrust in the body frame, shape (v, m, 3), [-]; 0 for other states
    effector_force: Floats
    site_names: tuple[str, ...]  # sites as "vehicle/site", shape (s,)
    site_vehicle: Ints  # index of the vehicle that carries the site, shape (s,)
    site_offset: Floats  # position of the site in its vehicle's body frame, shape (s, 3), [m]

    def __post_init__(self) -> None:
        n = self.time.size
        v = len(self.names)
        s = len(self.site_names)
        m = self.effector_states.shape[2]
        expected = {
            name: (n, v, size) for name, size in zip(OF_VEHICLES, (7, 6, 3, m), strict=True)
        }
        others = {
            "time": (n,),
            "effector_force": (v, m, 3),
            "site_vehicle": (s,),
            "site_offset": (s, 3),
        }
        require_shapes(self, expected | others)
        freeze_arrays(self)
        steps = np.diff(self.time)
        if n < 2 or steps.min() <= 0 or np.ptp(steps) > 1e-9:
            raise ValueError(
                "Trajectory.time must be a uniform grid of at least two increasing instants"
            )

    @property
    def dt(self) -> float:
        """Spacing of the grid [s]."""
        return float((self.time[-1] - self.time[0]) / (self.time.size - 1))

    @property
    def sites(self) -> dict[str, Floats]:
        """Sites by their names: offsets from the origin of their hull, shape (3,), [m]."""
        return dict(zip(self.site_names, self.site_offset, strict=True))

    def site(self, name: str) -> int:
        """Index of a site "vehicle/site"; ValueError listing the sites if there is none of that
        name.
        """
        if name not in self.site_names:
            raise ValueError(f"unknown site {name!r}; available: {', '.join(self.site_names)}")
        return self.site_names.index(name)

    @property
    def position(self) -> Floats:
        """Body origins in the world, shape (n, v, 3), [m]."""
        return self.pose[..., :3]

    @property
    def quaternion(self) -> Floats:
        """Attitude from body to world, (w, x, y, z), shape (n, v, 4)."""
        return self.pose[..., 3:]

    @property
    def velocity(self) -> Floats:
        """Velocity of the body origins in the world, shape (n, v, 3), [m/s]."""
        return self.twist[..., :3]

    @property
    def angular_velocity(self) -> Floats:
        """Angular velocity in the body frame, shape (n, v, 3), [rad/s]."""
        return self.twist[..., 3:]

    @cached_property
    def heading(self) -> Floats:
        """Compass heading, clockwise from north in [0, 2π), shape (n, v), [rad]."""
        return attitude.heading_angles(self.quaternion)

    @property
    def pitch(self) -> Floats:
        """Positive nose up, shape (n, v), [rad]."""
        return attitude.pitch_angles(self.quaternion)

    @property
    def roll(self) -> Floats:
        """Positive starboard down, shape (n, v), [rad]."""
        return attitude.heading_pitch_roll(self.quaternion)[2]

    @property
    def depth(self) -> Floats:
        """Depth of the body origins, shape (n, v), [m]."""
        return -self.position[..., 2]

    @cached_property
    def forward_speed(self) -> Floats:
        """Speed through the water along the hull, as a speed log measures it, shape (n, v),
        [m/s].
        """
        speed = np.empty(self.position.shape[:2])
        _forward_speeds(self.pose, self.twist, self.water_velocity, speed)
        return speed

    @property
    def site_position(self) -> Floats:
        """All sites in the world, shape (n, s, 3), [m]."""
        return np.stack([self.site_path(name) for name in self.site_names], axis=1)

    def site_path(self, name: str, index: Ints | None = None) -> Floats:
        """One site in the world at instants by their index, shape (m,), or at all of them: shape
        (m, 3), [m].
        """
        s = self.site(name)
        v = self.site_vehicle[s]
        path = np.empty((self.time.size if index is None else len(index), 3))
        for block in blocks(len(path)):
            instants = block if index is None else index[block]
            _body_points(self.pose[instants, v], self.site_offset[s], path[block])
        return path

    def part(self, first: int, last: int) -> Self:
        """Instants number `first` to `last`, both included, two at least."""
        parts = {name: getattr(self, name)[first : last + 1] for name in ("time", *OF_VEHICLES)}
        return replace(self, **parts)

    def at(self, time: npt.ArrayLike) -> tuple[Floats, Floats]:
        """Positions, shape (m, v, 3), [m], and quaternions, shape (m, v, 4), between grid points
        (`pose_between`).

        `time` has shape (m,), [s]; ValueError if an instant lies outside the grid.
        """
        instants = np.atleast_1d(np.asarray(time, dtype=np.float64))
        start = self.time[0]
        end = self.time[-1]
        if instants.size and (instants.min() < start - 1e-9 or instants.max() > end + 1e-9):
            raise ValueError(
                f"time {instants.min():g} … {instants.max():g} s lies outside {start:g} … {end:g} s"
            )
        grid_place = np.clip((instants - start) / self.dt, 0.0, self.time.size - 1)
        poses = _poses_at(grid_place, self.dt, self.pose, self.twist)
        return poses[..., :3], poses[..., 3:]

    def site_at(self, name: str, time: npt.ArrayLike) -> Floats:
        """One site between grid points, shape (m, 3), [m]; `time` as in `at`."""
        s = self.site(name)
        pose = np.concatenate(self.at(time), axis=2)[:, self.site_vehicle[s]]
        return np.column_stack(attitude.body_point_in_world(pose.T, self.site_offset[s]))

    @property
    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All fields as arrays by name, for `of_arrays`."""
        # of hulls with fewer effectors than others, names are filled up with ""
        most = max(map(len, self.effector_names), default=0)
        names = [(*own, *[""] * (most - len(own))) for own in self.effector_names]
        values = {f.name: getattr(self, f.name) for f in fields(self)} | {"effector_names": names}
        return {name: np.asarray(value) for name, value in values.items()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Self:
        """The trajectory with these `arrays`; KeyError if one is missing."""
        values: dict[str, Any] = {f.name: arrays[f.name] for f in fields(cls)}
        for name in ("names", "site_names"):
            values[name] = tuple(values[name].tolist())
        values["effector_names"] = tuple(
            tuple(filter(None, own)) for own in values["effector_names"].tolist()
        )
        return cls(**values)


def history_of(trajectory: Trajectory) -> StateHistory:
    """Its motion as the simulation records it."""
    t = trajectory
    return StateHistory(t.pose, t.twist, t.water_velocity, t.effector_states)


def tilted(trajectory: Trajectory, pitch: npt.ArrayLike, roll: npt.ArrayLike = 0.0) -> Trajectory:
    """The trajectory with the leader's pitch, nose up, and roll, starboard down, replaced: one
    or shape (n,), [rad].
    """
    pose = trajectory.pose.copy()
    pose[:, 0, 3:] = attitude.from_euler(trajectory.heading[:, 0], pitch, roll)
    return replace(trajectory, pose=pose)
