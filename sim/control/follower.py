"""Station keeping: from readings, messages and estimates to heading, speed and depth
(docs/formation.md).

Laws that bring a follower to its moving station (`approach`); along its path all three close up
alike:

    constant bearing   v = v_st − U p̃ / √(p̃ᵀp̃ + Δ²), less the estimated current (Breivik and
                       Fossen 2007)
    ILOS               line of sight with an integral of the cross-track error in place of the
                       current (Børhaug, Pavlov and Pettersen 2008)
    ALOS               line of sight with an adaptive crab angle (Fossen 2023)

It gives way to vehicles nearby: v = v_wanted − Σ w(d) r̂, w(d) = W min(max((R − d) / (R − F), 0),
1), with R the sensor's range and F that of full speed W. Where it may be at either of two places,
it steers by the likelier one, so that ranges soon show whether it was the right one.

Functions take `formation` and `proximity`, records of these sections, of STATION, and of
`laisn.swarm.READING` and `ESTIMATE`; `trail` and `count` as of `sim.control.station`; and `memory`,
of FOLLOWER_MEMORY, which they bring forward.
"""

from typing import Annotated, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Record, RecordFields, Records, row_dtype
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control import station as stations
from sim.control.allocation import clip
from sim.control.autopilot import HullMotion
from sim.control.guidance import MIN_COMMANDED_SPEED, PLANNED_TURN_SHARE, Reference
from sim.scenario.point_motion import ACCELERATION, TURN_RATE

CONSTANT_BEARING, ILOS, ALOS = range(3)  # values of `formation.law`


@compiled
def _line_of_sight(
    formation: Record, t: stations.Target, offset: tuple[float, float], dt: float, integral: float
) -> tuple[float, float, float]:
    """Velocity through the water, east and north [m/s], and the integral brought forward.

    `offset` is the place less that of the station, east and north [m]; `integral` that of
    FollowerMemory. `formation.integral_gain` is its gain: σ of ILOS, γ Δ² of ALOS [m/s].
    """
    lookahead = formation.lookahead
    speed = np.hypot(t.velocity_east, t.velocity_north)
    course = (
        np.arctan2(t.velocity_east, t.velocity_north)
        if speed > 0.0
        else np.arctan2(t.way_east, t.way_north)
    )
    sine, cosine = np.sin(course), np.cos(course)
    along_track = offset[0] * sine + offset[1] * cosine
    across = offset[0] * cosine - offset[1] * sine
    # U = V − V_a s / √(s² + Δ²), with s along the track and Δ the lookahead
    along_track_speed = speed - formation.approach_speed * along_track / np.sqrt(
        along_track * along_track + lookahead * lookahead
    )
    if formation.law == ILOS:
        # ψ = χ − atan((y + σ z) / Δ), ż = Δ y / (Δ² + (y + σ z)²), with y across the track
        across_with_integral = across + formation.integral_gain * integral
        squared = lookahead * lookahead + across_with_integral * across_with_integral
        integral += dt * lookahead * across / squared
        heading = course - np.arctan(across_with_integral / lookahead)
    else:
        # the crab angle itself is what is integrated
        gain = formation.integral_gain / (lookahead * lookahead)
        rate = gain * lookahead * across / np.sqrt(lookahead * lookahead + across * across)
        integral = clip(integral + dt * rate, -0.8, 0.8)
        heading = course - integral - np.arctan(across / lookahead)
    return along_track_speed * np.sin(heading), along_track_speed * np.cos(heading), integral


@compiled
def approach(
    formation: Record,
    t: stations.Target,
    position: tuple[float, float],
    current: tuple[float, float],
    dt: float,
    integral: float,
) -> tuple[float, float, float]:
    """Velocity through the water that leads to a station, its size within the limits, east and
    north [m/s].

    Takes the record of `[formation]`, the station, estimates of place [m] and current [m/s], the
    time since the last call [s] and the integral of the cross-track error, which it also gives,
    brought forward.
    """
    x, y = position[0] - t.east, position[1] - t.north
    if formation.law == CONSTANT_BEARING:
        scale = formation.approach_speed / np.sqrt(
            x * x + y * y + formation.lookahead * formation.lookahead
        )
        east = t.velocity_east - scale * x - current[0]
        north = t.velocity_north - scale * y - current[1]
    else:
        east, north, integral = _line_of_sight(formation, t, (x, y), dt, integral)
    # a hull without way cannot be steered, nor one that goes astern
    way_east = t.way_east - current[0]
    way_north = t.way_north - current[1]
    water_speed = np.hypot(way_east, way_north)
    if water_speed > 0.0:
        way_east = way_east / water_speed
        way_north = way_north / water_speed
        speed_deficit = max(
            formation.min_along_track_speed - (east * way_east + north * way_north), 0.0
        )
        east, north = east + speed_deficit * way_east, north + speed_deficit * way_north
    size = np.hypot(east, north)
    if size > 0.0:
        scale = clip(size, formation.min_speed, formation.max_speed) / size
        east, north = east * scale, north * scale
    return east, north, integral


@compiled
def repulsion_velocity(
    proximity: Record, sightings: Records, heading: float
) -> tuple[float, float]:
    """Velocity away from vehicles in sight, east and north, up to the full speed [m/s].

    `sightings` are records of `sim.sensing.proximity.SIGHTING`, shape (v,), with bearings from the
    bow, `heading` is the own one [rad].
    """
    east, north = 0.0, 0.0
    for j in range(sightings.shape[0]):
        # NaN: this vehicle is not in sight
        if sightings[j].range == sightings[j].range:
            share = (proximity.range - sightings[j].range) / (
                proximity.range - proximity.full_avoidance_range
            )
            speed = proximity.max_avoidance_speed * clip(share, 0.0, 1.0)
            towards = heading + sightings[j].bearing
            east, north = east - speed * np.sin(towards), north - speed * np.cos(towards)
    size = np.hypot(east, north)
    max_speed = proximity.max_avoidance_speed
    if size > max_speed:
        east, north = east * max_speed / size, north * max_speed / size
    return east, north


@compiled
def give_way(
    formation: Record, heading_and_speed: tuple[float, float], push: tuple[float, float]
) -> tuple[float, float]:
    """Heading [rad] and speed through the water [m/s] with the velocity `push`, east and north
    [m/s], added, as a hull can do it.
    """
    heading, speed = heading_and_speed
    sine, cosine = np.sin(heading), np.cos(heading)
    along_track = max(speed + push[0] * sine + push[1] * cosine, formation.min_along_track_speed)
    across = push[0] * cosine - push[1] * sine
    heading += np.arctan2(across, along_track)
    return heading, min(np.hypot(along_track, across), formation.max_speed)


class FollowerMemory(RecordFields):
    """Memory of one follower, from one control step to the next."""

    frame: stations.StationFrame  # of its station
    kept_frame: stations.StationFrame  # as it was at the last message
    # of the approach: z of ILOS [s], the crab angle of ALOS [rad]
    integral: float
    heading_wanted: float  # [rad]
    speed_wanted: float  # [m/s]
    depth_wanted: float  # [m]
    log: float  # readings of the speed log, low-passed [m/s]; NaN before the first one
    compass: float  # those of the compass, low-passed [rad]
    # whether vertical thrusters alone hold its depth: it sinks otherwise than it points
    by_thrust: bool
    depth: float  # smoothed, as `_followed_sinking` tracks it [m]
    sinking: float  # rate of the smoothed depth [m/s]
    # velocity away from vehicles that are sensed nearby, east and north [m/s]
    push: Annotated[Floats, (2,)]
    last_received: float  # time of the last message [s]
    # points of the trail with that message; later ones are planned
    received_points: int
    # from the station to the path that a hull of a least radius is to take, east and north [m]
    detour: Annotated[Floats, (2,)]


FOLLOWER_MEMORY = row_dtype(FollowerMemory)


_LOG_TIME = 1.0  # time constant of the log's low-pass [s]
# the compass's readings are followed with this time constant, a gyro's at once [s]
_COMPASS_TIME = 2.0
# both time constants of the rate of depth [s]; well below that of depth by thrust, 2 / ω
_SINKING_TIME = 0.5
_DIVE_RATE = 0.2  # a new depth is taken up at this rate [m/s]
_SURFACE_DEPTH = 0.2  # depth at which a follower lies at the surface [m]
_CIRCLE_RATE = float(np.deg2rad(4.0))  # rate at which a follower circles that has given up [rad/s]

CONTINUE, CIRCLE, SURFACE = range(3)  # values of `formation.timeout_action`


@compiled
def extend_trail(
    formation: Record,
    station: stations.StationGeometry,
    message: Record,
    trail: Records,
    count: Ints,
    clock: tuple[float, float],
    memory: FollowerMemory,
) -> None:
    """Take a message with at least one range: the trail grows, and the frame is turned along it.

    Since the last message the frame was turned along the extrapolated trail; now the way there is
    known.

    Args:
        message: of `laisn.swarm.MESSAGE`.
        clock: time now, no earlier than that of the message, and time step of the frame [s].
    """
    current_time, dt = clock
    time = message.timestamp
    last_received = memory.last_received
    received = memory.received_points
    stations.correct_planned(trail, count, received, (message.east, message.north, time))
    stations.extend(
        trail, count, message.east, message.north, time, (message.speed, message.heading)
    )
    memory.last_received = time
    memory.received_points = count[0]
    memory.frame.heading, memory.frame.rate = memory.kept_frame.heading, memory.kept_frame.rate
    stations.turn_frame(
        formation, station, (trail, count[0]), (last_received, time), dt, memory.frame
    )
    memory.kept_frame.heading, memory.kept_frame.rate = memory.frame.heading, memory.frame.rate
    # a message that was long under way; `keep_station` makes the last step
    stations.turn_frame(
        formation,
        station,
        (trail, count[0]),
        (time, max(current_time - dt, time)),
        dt,
        memory.frame,
    )


@compiled
def init_memory(leader: Record, trail: Records, count: Ints, memory: FollowerMemory) -> None:
    """Set up the memory of a follower at its start, by the place of the leader, a message of
    `laisn.swarm.MESSAGE`.
    """
    memory.frame.heading = memory.kept_frame.heading = leader.heading
    stations.extend(
        trail, count, leader.east, leader.north, leader.timestamp, (leader.speed, leader.heading)
    )
    memory.log = np.nan
    memory.compass = np.nan
    memory.last_received = leader.timestamp
    memory.received_points = count[0]


@compiled
def update_avoidance(
    proximity: Record, sightings: Records, estimate: Record, memory: FollowerMemory
) -> None:
    """Take a look around by the proximity sensor: from now on the follower gives way to what is
    nearby.
    """
    heading = memory.compass - estimate.compass_bias
    memory.push[0], memory.push[1] = repulsion_velocity(proximity, sightings, heading)


@compiled
def _followed_sinking(depth: float, dt: float, memory: FollowerMemory) -> float:
    """Rate of depth by the pressure sensor [m/s]: critically damped tracking with fading memory
    (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001).
    """
    fading = np.exp(-dt / _SINKING_TIME)
    memory.depth += memory.sinking * dt
    depth_error = depth - memory.depth
    memory.depth += (1.0 - fading * fading) * depth_error
    memory.sinking += (1.0 - fading) ** 2 * depth_error / dt
    return float(memory.sinking)


@compiled
def measured_motion(
    reading: Record, estimate: Record, dt: float, memory: FollowerMemory
) -> HullMotion:
    """Own motion by smoothed readings, less their estimated biases."""
    if memory.log != memory.log:
        memory.log = reading.speed
        memory.compass = reading.heading
        memory.depth = reading.depth
        memory.sinking = 0.0
    memory.log += (reading.speed - memory.log) * dt / _LOG_TIME
    # turning is positive to port, headings are clockwise
    memory.compass -= reading.turning * dt
    memory.compass += wrap_angle(reading.heading - memory.compass) * dt / _COMPASS_TIME
    surge = memory.log - estimate.log_bias
    pitch = reading.pitch
    heading = memory.compass - estimate.compass_bias
    # nothing measures how it slips; a hull that dives by pitch sinks the way it points
    sinking = -surge * np.sin(pitch)
    if memory.by_thrust:
        sinking = _followed_sinking(reading.depth, dt, memory)
    return HullMotion(
        surge,
        0.0,
        heading,
        reading.turning,
        pitch,
        reading.pitching,
        reading.heel,
        reading.rolling,
        reading.depth,
        sinking,
    )


@compiled
def _to_station(
    formation: Record,
    target: stations.Target,
    estimate: Record,
    sigma: float,
    dt: float,
    memory: FollowerMemory,
) -> tuple[float, float]:
    """Velocity through the water towards the station, east and north [m/s].

    `sigma` is the standard deviation of the follower's place relative to the leader's trail [m]. If
    it is too large, or NaN, the follower keeps its offset across the trail.
    """
    estimated_position = estimate.position
    likelier = estimate.offset_to_likelier
    position = estimated_position[0] + likelier[0], estimated_position[1] + likelier[1]
    current = estimate.current[0], estimate.current[1]
    if position[0] != position[0]:
        # nothing is known of it yet
        position = target.east, target.north
    elif not sigma <= formation.max_trail_sigma:
        # a parallel course: of the way to the station only what lies along the leader's counts
        pace = np.hypot(target.way_east, target.way_north)
        if pace > 0.0:
            ahead_east, ahead_north = target.way_east / pace, target.way_north / pace
            along_track = (position[0] - target.east) * ahead_east + (
                position[1] - target.north
            ) * ahead_north
            position = (
                target.east + along_track * ahead_east,
                target.north + along_track * ahead_north,
            )
    east, north, memory.integral = approach(
        formation, target, position, current, dt, memory.integral
    )
    return east, north


# a detour is left at this share of the leader's speed at most …
_RETURN_SPEED_SHARE = 0.3
# … where the planned heading is nearer than this to that of the station [rad]
_ON_COURSE = 0.05


@compiled
def plan_detour(
    t: stations.Target,
    planned_velocity: tuple[float, float],
    lookahead: float,
    dt: float,
    memory: FollowerMemory,
) -> stations.Target:
    """The target of a hull that cannot follow its station round a corner: the place to which the
    planned velocity over ground brings it [m/s].

    The error of its place is that from this path, or the way back to the station would undo what
    was foreseen.
    """
    turn = np.arctan2(planned_velocity[0], planned_velocity[1]) - np.arctan2(
        t.velocity_east, t.velocity_north
    )
    correction = 0.0
    if abs(wrap_angle(turn)) < _ON_COURSE:
        x, y = memory.detour[0], memory.detour[1]
        pace = np.sqrt(t.way_east * t.way_east + t.way_north * t.way_north)
        correction = _RETURN_SPEED_SHARE * pace / np.sqrt(x * x + y * y + lookahead * lookahead)
    east = planned_velocity[0] - correction * memory.detour[0]
    north = planned_velocity[1] - correction * memory.detour[1]
    memory.detour[0] += dt * (east - t.velocity_east)
    memory.detour[1] += dt * (north - t.velocity_north)
    place_east = t.east + memory.detour[0]
    place_north = t.north + memory.detour[1]
    return stations.Target(place_east, place_north, east, north, t.way_east, t.way_north)


class Senses(NamedTuple):
    """What a vehicle knows of itself at an instant."""

    reading: Record  # of its sensors, of `laisn.swarm.READING`
    estimate: Record  # of its navigator, of `laisn.swarm.ESTIMATE`


@compiled
def keep_station(
    formation: Record,
    station: stations.StationGeometry,
    senses: Senses,
    trail: tuple[Records, int],
    clock: tuple[float, float],
    memory: FollowerMemory,
    reference: Reference,
    plan: stations.LeaderPlan,
) -> tuple[tuple[float, float, float], HullMotion]:
    """What brings a follower to its station, as of `steer`: heading [rad], its rate, speed; and its
    measured motion.

    Args:
        senses: what the follower knows of itself.
        trail: the leader's trail as received, records of TRAIL, and how many points it has, at
            least one.
        clock: time, and time since the last call [s].
        reference: out: of the autopilot, record of REFERENCE, of which the depth, its rate and
            the accelerations are written.
        plan: the leader's, as far as its messages carry it.
    """
    estimate = senses.estimate
    current_time, dt = clock
    starts = memory.log != memory.log
    motion = measured_motion(senses.reading, estimate, dt, memory)
    if starts:
        memory.heading_wanted = motion.heading
        memory.speed_wanted = motion.surge
        memory.depth_wanted = motion.depth
    depth = station.depth
    heading = memory.heading_wanted
    speed = memory.speed_wanted
    silence_s = current_time - memory.last_received
    if silence_s > formation.message_timeout and formation.timeout_action != CONTINUE:
        speed = formation.timeout_speed
        if formation.timeout_action == CIRCLE:
            heading += _CIRCLE_RATE * dt
        else:
            depth = min(depth, _SURFACE_DEPTH)
    else:
        if silence_s > 0.5 * dt:
            stations.turn_frame(
                formation, station, trail, (current_time - dt, current_time), dt, memory.frame
            )
        t = stations.station_at(station, trail, current_time, memory.frame)
        current = (0.0, 0.0)
        if formation.law == CONSTANT_BEARING:
            # laws with an integral have that in place of the current
            current = estimate.current[0], estimate.current[1]
        planned_velocity = stations.rate_limited_velocity(
            formation,
            station,
            trail,
            current_time,
            current,
            memory.frame,
            (plan, memory.last_received),
        )
        target = stations.Target(
            t.east, t.north, planned_velocity[0], planned_velocity[1], t.way_east, t.way_north
        )
        if station.planned_radius > 0.0:
            target = plan_detour(t, planned_velocity, formation.lookahead, dt, memory)
        sigma = float(
            np.hypot(estimate.position_sigma, formation.leader_velocity_sigma * max(silence_s, 0.0))
        )
        east, north = _to_station(formation, target, estimate, sigma, dt, memory)
        heading = np.arctan2(east, north)
        speed = np.hypot(east, north)
        if silence_s > 0.5 * dt and speed > formation.timeout_speed:
            # full speed up to the bound, the slow one from twice the bound on
            slow = formation.timeout_speed
            speed = slow + clip(2.0 - sigma / formation.max_trail_sigma, 0.0, 1.0) * (speed - slow)
    push = memory.push[0], memory.push[1]
    if push[0] != 0.0 or push[1] != 0.0:
        heading, speed = give_way(formation, (heading, speed), push)
    depth_step = clip(depth - memory.depth_wanted, -_DIVE_RATE * dt, _DIVE_RATE * dt)
    memory.depth_wanted += depth_step
    reference.turn_acceleration = reference.acceleration = 0.0
    reference.depth = memory.depth_wanted
    reference.sinking = depth_step / dt
    turn_rate = TURN_RATE
    if station.planned_radius > 0.0:
        # what planned turns leave of the rudder is for corrections
        turn_rate = min(
            TURN_RATE, memory.speed_wanted / (PLANNED_TURN_SHARE * station.planned_radius)
        )
    heading_step = clip(
        wrap_angle(heading - memory.heading_wanted), -turn_rate * dt, turn_rate * dt
    )
    memory.heading_wanted += heading_step
    speed_step = clip(speed - memory.speed_wanted, -ACCELERATION * dt, ACCELERATION * dt)
    memory.speed_wanted = max(memory.speed_wanted + speed_step, MIN_COMMANDED_SPEED)
    return (memory.heading_wanted, heading_step / dt, memory.speed_wanted), motion
