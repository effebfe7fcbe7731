"""Routes: where a vehicle is to be, and when. The leader's L, the followers' T2 … T9, or a
user's waypoints.
"""

import json
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import resources
from typing import Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, freeze_arrays
from laisn.errors import LaisnError

START_SPEED = 1.0  # speed at which the paper's missions begin [m/s] (Section 3.1)
SPEED_MAX = 3.0  # top speed of a follower [m/s] (paper, Section 3)
LEADER_L = ((0.0, 0.0), (500.0, 0.0), (500.0, 500.0))  # east and north [m] (paper, Section 3)
LEADER_DEPTH = 8.0
FOLLOWER_DEPTH = 10.0  # default depths [m]: the follower deeper, so that a pitching leader shows


@dataclass(frozen=True, kw_only=True)
class DepthProfile:
    """Depth over time, linear between points; before the first and after the last point it is
    held.
    """

    time: Floats  # time of each point, from 0, shape (n,), [s]
    depth: Floats  # depth at each point, shape (n,), positive down, [m]
    period: float | None = None  # the profile repeats after this time [s]; None: it does not

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @classmethod
    def constant(cls, depth: float) -> Self:
        """One depth [m]."""
        return cls(time=np.zeros(1), depth=np.array([float(depth)]))

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[time, depth], …], shape (n, 2), [s] and [m]."""
        time, depth = np.array(points, dtype=np.float64).T.copy()
        return cls(time=time, depth=depth)

    @classmethod
    def saw_tooth(cls, mean: float, amplitude: float, period: float) -> Self:
        """A depth profile: from the mean down by `amplitude`, up by twice that and back,
        repeatedly; [m], [m], [s].
        """
        return cls(
            time=np.array([0.0, 0.25, 0.75, 1.0]) * period,
            depth=mean + amplitude * np.array([0.0, 1.0, -1.0, 0.0]),
            period=period,
        )

    def depth_at(self, time: Floats) -> Floats:
        """Depth at instants of any shape, [s], [m]."""
        return np.interp(time if self.period is None else time % self.period, self.time, self.depth)

    def at(self, time: Floats) -> tuple[Floats, Floats]:
        """Depth [m] and its rate [m/s], positive down, at instants of shape (n,), [s]."""
        period_time = time if self.period is None else time % self.period
        slope = np.concatenate([[0.0], np.diff(self.depth) / np.diff(self.time), [0.0]])
        return self.depth_at(time), slope[np.searchsorted(self.time, period_time, side="right")]


def _profile(depth: float | DepthProfile) -> DepthProfile:
    return depth if isinstance(depth, DepthProfile) else DepthProfile.constant(depth)


@dataclass(frozen=True, kw_only=True, eq=False)
class Route:
    """Waypoints, each with the time at which the vehicle is to be there; straight legs between
    them. A route equals itself alone.

    At a place that is given twice in succession the vehicle stops until the second time; after the
    last waypoint it goes straight on, or stays where it stopped. A vehicle whose waypoints are all
    one place hovers there, heading east.
    """

    name: str
    time: Floats  # arrival at the waypoints, shape (n,), n ≥ 2, from 0, [s]
    waypoint: Floats  # east and north, shape (n, 2), [m]
    depth: DepthProfile
    # compass heading at the first waypoint [rad]; None: along the first leg
    start_heading: float | None = None
    # speed at the first waypoint [m/s]; nothing where the route begins with a stop
    start_speed: float = START_SPEED

    def __post_init__(self) -> None:
        freeze_arrays(self)

    @classmethod
    def timed(
        cls,
        name: str,
        points: npt.ArrayLike,
        depth: float | DepthProfile,
        start_heading: float | None = None,
        start_speed: float | None = START_SPEED,
    ) -> Self:
        """Waypoints [[time, east, north], …], shape (n, 3), [s], [m], [m].

        `start_speed` is that at the first waypoint [m/s], None: the mean speed of the first leg. A
        vehicle whose route begins with a stop starts at rest.
        """
        table = np.array(points, dtype=np.float64)
        first_leg = table[1] - table[0]
        length = float(np.hypot(first_leg[1], first_leg[2]))
        if length == 0.0:
            start_speed = 0.0
        elif start_speed is None:
            start_speed = min(length / float(first_leg[0]), SPEED_MAX)
        return cls(
            name=name,
            time=table[:, 0].copy(),
            waypoint=table[:, 1:].copy(),
            depth=_profile(depth),
            start_heading=start_heading,
            start_speed=start_speed,
        )

    @classmethod
    def at_speed(
        cls, name: str, points: npt.ArrayLike, speed: float, depth: float | DepthProfile
    ) -> Self:
        """Waypoints [[east, north], …], shape (n, 2), [m], reached at one speed [m/s] measured
        along the legs.
        """
        table = np.array(points, dtype=np.float64)
        time = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(table, axis=0).T))]) / speed
        return cls(name=name, time=time, waypoint=table, depth=_profile(depth), start_speed=speed)

    @cached_property
    def leg_length(self) -> Floats:
        """Length of each leg, shape (n − 1,), [m]."""
        return np.asarray(np.hypot(*np.diff(self.waypoint, axis=0).T))

    @property
    def initial_direction(self) -> Floats:
        """Direction in which the vehicle points at the first waypoint, a vector east and north
        of any length.
        """
        if self.start_heading is not None:
            return np.array([np.sin(self.start_heading), np.cos(self.start_heading)])
        moving = np.flatnonzero(self.leg_length)
        if moving.size == 0:
            return np.array([1.0, 0.0])
        first = int(moving[0])
        return np.asarray(self.waypoint[first + 1] - self.waypoint[first])

    @property
    def initial_heading(self) -> float:
        """Heading at the first waypoint [rad]."""
        return (
            float(np.arctan2(*self.initial_direction))
            if self.start_heading is None
            else self.start_heading
        )

    @property
    def leg_speed(self) -> Floats:
        """Mean speed that each leg requires, shape (n − 1,), [m/s]."""
        # infinite where hardly any time is given
        with np.errstate(over="ignore"):
            return self.leg_length / np.diff(self.time)


@cache
def _follower_routes() -> dict[str, list[list[float]]]:
    text = (resources.files("sim.scenario") / "data" / "followers_T2_T9.json").read_text(
        encoding="utf-8"
    )
    return {name: entry["waypoints_t_east_north"] for name, entry in json.loads(text).items()}


def names() -> tuple[str, ...]:
    """All routes of the library."""
    return (*_follower_routes(), "L")


def library_route(name: str, depth: float | DepthProfile | None = None) -> Route:
    """A route of the library: "L" of the leader, "T2" … "T9" of the followers, at a depth [m] or
    profile.

    The published follower routes are pictures; these fit them in distance, bearing and speed
    (`sim/scenario/data`), and start heading east at 1 m/s. The depth is 8 m for the leader and 10 m
    for followers, unless it is given. LaisnError if there is no such route.
    """
    if name == "L":
        return Route.at_speed("L", LEADER_L, START_SPEED, LEADER_DEPTH if depth is None else depth)
    if name not in _follower_routes():
        first, *_, last = _follower_routes()
        raise LaisnError(f"unknown route {name!r}; available: {first} … {last}, L")
    points = _follower_routes()[name]
    return Route.timed(
        name, points, FOLLOWER_DEPTH if depth is None else depth, start_heading=np.pi / 2
    )
