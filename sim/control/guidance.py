"""Guidance: from where a vehicle should be now, and where it is, to the heading and speed that
bring it there.

The route's point motion (`sim.scenario.point_motion`) is the reference, with turns and changes of
depth rounded off:

    course   line of sight to a point ahead on the path: atan(cross-track error / lookahead)
             (Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021)
    speed    in proportion to the along-track error, within a bound

The velocity over ground that follows, less the current, is that through the water. The current is
the true or the estimated one, low-passed (`track_current`); without an estimate, an integral of the
offset (`integrate_offset`). Where the route stops, the velocity over ground leads back to the
place.

Functions take `reference`, that of this instant; `position`, true or estimated, and currents, east
and north [m], [m/s]; `dt`, the time since the last call [s]; and `memory`, brought forward.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from threading import Lock
from typing import Annotated

import numpy as np

from laisn.arrays import Floats, RecordFields, Records, records, row_dtype
from laisn.compiled import compiled, select
from laisn.errors import LaisnError
from laisn.geometry import wrap_angle
from laisn.simd import all_lanes, any_lane
from laisn.vector_math import arctan, arctan2, sin_cos
from sim.control.allocation import clip
from sim.scenario.point_motion import ACCELERATION, TURN_RATE, Plan, plan
from sim.scenario.routes import Route
from sim.scenario.section import CONTROL_STEP_S


class Reference(RecordFields):
    """State in which a vehicle should be at one instant."""

    east: float  # [m]
    north: float
    course: float  # [rad]
    speed: float  # [m/s]
    turn_acceleration: float  # [rad/s²]
    acceleration: float  # [m/s²]
    depth: float  # [m]
    sinking: float  # [m/s]


REFERENCE = row_dtype(Reference)


class GuidanceMemory(RecordFields):
    """Memory of guidance of one vehicle, from one control step to the next."""

    heading: float  # command [rad]
    speed: float  # command [m/s]
    current: Annotated[Floats, (2,)]  # east and north [m/s]


GUIDANCE_MEMORY = row_dtype(GuidanceMemory)


# a turn sets in and ends over this time, four times the lag of the thrusters [s]
TURN_SMOOTHING = 1.2
# a change of the rate of depth takes this time [s], in which a hull pitches by 20° at leisure
DEPTH_SMOOTHING = 6.0
# the lookahead is the way of this time, the time constant of cross-track errors [s]
LOOKAHEAD_TIME = 4.0
LOOKAHEAD_MIN = 2.0  # the lookahead is at least this long: a hull length [m]
# along-track errors fade with this time constant [s]; slower than the speed loop
ALONG_TRACK_TIME = 8.0
CATCH_UP = 0.3  # the speed correction is at most this share of the reference speed
CURRENT_TIME = 10.0  # time constant of the current's low-pass [s]; longer than a wave's period
# of the integrated current [1/s²]: poles along at 1/40 and 1/10, across at 1/100 and 1/4
OFFSET_GAIN = 1.0 / 400.0
MAX_OFFSET = 2.0  # offset along an axis that is integrated at most [m]
MAX_INTEGRAL = 1.0  # current along an axis that comes of the integral at most [m/s]
# turns are planned with the least radius over this, which leaves some rudder for corrections
PLANNED_TURN_SHARE = 0.9
# least speed through the water on the way; slower, a hull has no heading to keep [m/s]
MIN_COMMANDED_SPEED = 0.1
# greatest speed along an axis that leads back to the place where a route stops [m/s]
HOLD_SPEED = 0.3


def _mean(value: Callable[[Floats], Floats], time: Floats, width: float) -> Floats:
    """Mean of a function over an interval of a width [s] about each instant, by midpoints."""
    first, *others = ((np.arange(12) + 0.5) / 12 - 0.5).tolist()
    total = value(time + first * width)
    # one after the other: all at once they take much memory over a day
    for node in others:
        total += value(time + node * width)
    return total / 12


def _rate(value: Callable[[Floats], Floats], time: Floats, width: float) -> Floats:
    """Rate of that mean, which is the difference over the interval."""
    return (value(time + 0.5 * width) - value(time - 0.5 * width)) / width


def flown_plan(route: Route, least_radius: float) -> Plan:
    """The plan of a route with turns of a least radius [m], 0 for TURN_RATE, or of a smaller one
    where legs are short.

    LaisnError if the route cannot be flown at TURN_RATE either.
    """
    for radius in (least_radius, 0.75 * least_radius, 0.5 * least_radius, 0.25 * least_radius):
        if radius > 0.0:
            with suppress(LaisnError):
                return plan(route, radius)
    return plan(route)


def _write_reference(
    route: Route, time: Floats, lead: float, least_radius: float, out: Records
) -> None:
    plan_of_route = flown_plan(route, least_radius)
    motion = plan_of_route.at(time)

    def planned(values: Floats) -> Callable[[Floats], Floats]:
        return lambda t: np.interp(t, plan_of_route.start, values)

    course = planned(plan_of_route.course)
    speed = planned(plan_of_route.speed)
    turn_rate = partial(_rate, course, width=TURN_SMOOTHING)

    def depth(t: Floats) -> Floats:
        return route.depth.depth_at(np.maximum(t, 0.0))

    out.east = motion.east
    out.north = motion.north
    out.speed = motion.speed
    out.course = _mean(course, time, TURN_SMOOTHING)
    out.turn_acceleration = _rate(turn_rate, time + lead, 0.1)
    out.acceleration = _rate(speed, time + lead, 0.1)
    out.depth = _mean(depth, time, DEPTH_SMOOTHING)
    out.sinking = _rate(depth, time, DEPTH_SMOOTHING)


def reference(
    routes: Sequence[Route],
    time: Floats,
    lead: Sequence[float] | None = None,
    least_radii: Sequence[float] | None = None,
) -> Records:
    """State in which all vehicles should be at instants of shape (n,), [s]: records of REFERENCE,
    shape (n, v).

    Course and depth are smoothed about each instant, the path is not. `lead` is how early each
    vehicle's accelerations are given [s], `least_radii` are of its turns [m], as of `flown_plan`;
    None: 0. LaisnError if a route cannot be flown.
    """
    table = records(REFERENCE, time.size, len(routes))
    write = _write_reference if time.size > _MAX_SHARED_INSTANTS else _write_shared_reference
    for i, route in enumerate(routes):
        write(
            route,
            time,
            lead[i] if lead else 0.0,
            least_radii[i] if least_radii else 0.0,
            table[:, i],
        )
    return table


# references of a vehicle at more instants are kept of no mission: 6 MB each
_MAX_SHARED_INSTANTS = 100_000
# those of missions that were flown last are kept for others with the same routes, up to this memory
_MAX_SHARED_BYTES = 64_000_000

_MissionKey = tuple[tuple[Route, ...], int, tuple[float, ...], tuple[float, ...]]

# routes cannot be written and equal themselves alone, so that they can be keys; the last used last
_shared_missions: dict[_MissionKey, Records] = {}
_changing_shared = Lock()


def mission_reference(
    routes: tuple[Route, ...],
    ticks: int,
    lead: tuple[float, ...],
    least_radii: tuple[float, ...],
) -> Records:
    """`reference` at the instants 0 to `ticks` of a mission, one every CONTROL_STEP_S; read-only,
    for missions along the same routes share it.
    """
    key = (routes, ticks, lead, least_radii)
    with _changing_shared:
        kept = _shared_missions.pop(key, None)
        if kept is not None:
            _shared_missions[key] = kept
            return kept
    time = np.arange(ticks + 1, dtype=np.float64) * CONTROL_STEP_S
    table = reference(routes, time, lead, least_radii)
    table.flags.writeable = False
    if table.nbytes <= _MAX_SHARED_BYTES:
        with _changing_shared:
            _shared_missions[key] = table
            while sum(shared.nbytes for shared in _shared_missions.values()) > _MAX_SHARED_BYTES:
                del _shared_missions[next(iter(_shared_missions))]
    return table


@dataclass(frozen=True, kw_only=True)
class _SharedKey:
    """Key of `_shared_reference`: the numbers that a reference follows from; route and times stand
    beside them and are not compared.
    """

    values: tuple[object, ...]
    route: Route = field(compare=False)
    time: Floats = field(compare=False)


@lru_cache(maxsize=4)
def _shared_reference(key: _SharedKey, lead: float, least_radius: float) -> Records:
    shared = records(REFERENCE, key.time.size)
    _write_reference(key.route, key.time, lead, least_radius, shared)
    return shared


def _write_shared_reference(
    route: Route, time: Floats, lead: float, least_radius: float, out: Records
) -> None:
    arrays = (route.time, route.waypoint, route.depth.time, route.depth.depth, time)
    values = (
        *(array.tobytes() for array in arrays),
        route.depth.period,
        route.start_heading,
        route.start_speed,
    )
    key = _SharedKey(values=values, route=route, time=time)
    out[:] = _shared_reference(key, lead, least_radius)


@compiled
def start_guidance(
    reference: Reference,
    heading: float,
    speed: float,
    current: tuple[float, float],
    memory: GuidanceMemory,
) -> None:
    """Initialise the memory of guidance for a vehicle at its start, by its heading and speed
    through the water.
    """
    memory.heading = reference.course + wrap_angle(heading - reference.course)
    memory.speed = max(speed, MIN_COMMANDED_SPEED)
    memory.current[0], memory.current[1] = current


@compiled
def track_current(current: tuple[float, float], dt: float, memory: GuidanceMemory) -> None:
    """Follow a current, true or estimated, by a low-pass."""
    for i in range(2):
        memory.current[i] += (current[i] - memory.current[i]) * dt / CURRENT_TIME


@compiled
def integrate_offset(
    reference: Reference, position: tuple[float, float], dt: float, memory: GuidanceMemory
) -> None:
    """Treat a persistent offset from the reference as a current: integral action without a
    current state.
    """
    reference_position = reference.east, reference.north
    for i in range(2):
        offset = clip(position[i] - reference_position[i], -MAX_OFFSET, MAX_OFFSET)
        integral = memory.current[i] + OFFSET_GAIN * offset * dt
        memory.current[i] = clip(integral, -MAX_INTEGRAL, MAX_INTEGRAL)


@compiled
def limit_command(
    heading: float, speed: float, dt: float, memory: GuidanceMemory
) -> tuple[float, float, float]:
    """Heading, its rate and speed as of `steer`, brought towards what is wanted within the
    limits.
    """
    last_heading = memory.heading
    turn = wrap_angle(heading - last_heading)
    memory.heading += clip(turn, -TURN_RATE * dt, TURN_RATE * dt)
    memory.speed += clip(speed - memory.speed, -ACCELERATION * dt, ACCELERATION * dt)
    return memory.heading, (memory.heading - last_heading) / dt, memory.speed


@compiled
def steer(
    reference: Reference, position: tuple[float, float], dt: float, memory: GuidanceMemory
) -> tuple[float, float, float]:
    """Heading and speed through the water that lead back to the reference.

    Gives the heading, continuous, turning at 10°/s at most [rad]; its rate, clockwise [rad/s]; and
    the speed, changing at 0.2 m/s² at most, and negative only where the route stops [m/s].
    """
    stops = reference.speed < MIN_COMMANDED_SPEED
    heading = 0.0
    speed = 0.0
    if not all_lanes(stops):
        heading, speed = _way_along(reference, position, memory)
    if any_lane(stops):
        to_place = _way_to_place(reference, position, memory)
        heading = select(stops, to_place[0], heading)
        speed = select(stops, to_place[1], speed)
    return limit_command(heading, speed, dt, memory)


@compiled
def _way_to_place(
    reference: Reference, position: tuple[float, float], memory: GuidanceMemory
) -> tuple[float, float]:
    """Heading and speed of `steer` where the route stops, before limits."""
    sin, cos = sin_cos(reference.course)
    east, north = reference.east - position[0], reference.north - position[1]
    through_water_east = clip(east / ALONG_TRACK_TIME, -HOLD_SPEED, HOLD_SPEED) - memory.current[0]
    through_water_north = (
        clip(north / ALONG_TRACK_TIME, -HOLD_SPEED, HOLD_SPEED) - memory.current[1]
    )
    # the smaller this velocity, the more the heading is that of the course
    heading = arctan2(
        through_water_east + MIN_COMMANDED_SPEED * sin,
        through_water_north + MIN_COMMANDED_SPEED * cos,
    )
    east_ahead, north_ahead = sin_cos(memory.heading)
    return heading, through_water_east * east_ahead + through_water_north * north_ahead


@compiled
def _way_along(
    reference: Reference, position: tuple[float, float], memory: GuidanceMemory
) -> tuple[float, float]:
    """Heading and speed of `steer` on the way, before limits."""
    sin, cos = sin_cos(reference.course)
    east, north = reference.east - position[0], reference.north - position[1]
    along_track = east * sin + north * cos
    across = east * cos - north * sin

    lookahead = max(LOOKAHEAD_MIN, LOOKAHEAD_TIME * reference.speed)
    sin_course, cos_course = sin_cos(reference.course + arctan(across / lookahead))
    bound = CATCH_UP * reference.speed
    speed = reference.speed + clip(along_track / ALONG_TRACK_TIME, -bound, bound)

    through_water_east = speed * sin_course - memory.current[0]
    through_water_north = speed * cos_course - memory.current[1]

    speed_through_water = np.sqrt(
        through_water_east * through_water_east + through_water_north * through_water_north
    )
    heading = arctan2(through_water_east, through_water_north)
    return heading, max(speed_through_water, MIN_COMMANDED_SPEED)
