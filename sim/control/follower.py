"""How a follower keeps its station on what it hears and feels: from readings and estimates to heading, speed and depth.

Nothing here is the truth. A follower has its log, compass, gyros, inclinometer and pressure sensor, the leader's
messages, and what its navigator makes of them: its place, the biases of log and compass, the current.

Where messages stay away it goes on along the extrapolated trail by dead reckoning. The uncertainty of its place in that
trail grows with the age a of the last message,

    σ² = σ_place² + (σ_v a)²,

σ_place being the navigator's and σ_v that of the leader's mean velocity since then about its last one. Up to `unsure`
it makes for its station; from there on it goes parallel to the leader's way, and slows down in proportion until σ is
twice that. After a long silence it circles or surfaces, until it hears again.

Where it may be at either of two places, as with two transmitters on either side of the leader's axis, it steers by the
likelier one. By their mean it would not steer at all, and both would stay as likely as they are; when it makes for the
station from one of them, ranges soon tell whether that was the right one.
"""

from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.allocation import clip
from sim.control.anticipation import rate_limited_velocity
from sim.control.approach import CONSTANT_BEARING, LAWS, Approach, approach
from sim.control.autopilot import VehicleState
from sim.control.avoidance import Avoidance, away, give_way
from sim.control.guidance import DEPTH, SINKING, SPEED_LEAST
from sim.control.leader_plan import SPACING, LeaderPlan, correct_planned, extend_as_planned
from sim.control.station import FRAME, FRAME_MEMORY, FRAME_RATE, STATION_DEPTH, Frame, Target, station_at, turn_frame
from sim.control.trail import extend
from sim.scenario.formation import Formation, Proximity
from sim.scenario.point_motion import ACCELERATION, TURN_RATE

LOG, COMPASS, PRESSURE, INCLINE, TURNING, PITCHING = range(6)
"""Columns of readings: speed log [m/s], compass [rad], pressure as depth [m], pitch [rad], rates of turn [rad/s]."""
READINGS = 6
HEARD_TIME, HEARD_EAST, HEARD_NORTH, HEARD_HEADING, HEARD_SPEED = range(5)
"""Columns of a message that the controller reads, as of `laisn.messages.LeaderMessage`."""
KEPT_FRAME, KEPT_RATE, INTEGRAL, HEADING_WANTED, SPEED_WANTED, LOG_PASSED, COMPASS_PASSED, DEPTH_WANTED = range(
    FRAME_MEMORY, FRAME_MEMORY + 8
)
"""Columns of what a follower remembers, after those of its frame: first the frame as it was at the last message."""
PUSH_EAST, PUSH_NORTH = range(FRAME_MEMORY + 8, FRAME_MEMORY + 10)
"""… then the velocity away from vehicles that it has sensed nearby [m/s] …"""
LAST_HEARD, HEARD_POINTS = range(FRAME_MEMORY + 10, FRAME_MEMORY + 12)
"""… and last the time of the last message [s], and how many points the trail had with it; later ones are planned."""
FOLLOWER_MEMORY = FRAME_MEMORY + 12

_LOG_TIME = 1.0
"""Time constant of the log's low-pass [s]."""
_COMPASS_TIME = 2.0
"""The compass's readings are followed with this time constant, a gyro's at once [s]."""
_DIVE_RATE = 0.2
"""A new depth is taken up at this rate [m/s]."""
_SURFACE = 0.2
"""Depth at which a follower lies at the surface [m]."""
_CIRCLE = float(np.deg2rad(4.0))
"""Rate at which a follower circles that has given up [rad/s]."""

HOLD, CIRCLE, RISE = range(3)
"""What a follower does that hears nothing for long: goes on slowly, circles, surfaces."""
_WHEN_SILENT = ("go-on", "circle", "surface")
"""The same, by their names in a scenario."""


class Silence(NamedTuple):
    """What to do where messages stay away, of `[formation]`."""

    velocity_sigma: float
    """Standard deviation of the leader's mean velocity since its last message about the one that it had [m/s]."""
    limit: float
    """Time for which the follower goes on [s]."""
    then: int
    """What it does after that: HOLD, CIRCLE or RISE."""
    speed: float
    """Through the water, when it goes slowly [m/s]."""


class Law(NamedTuple):
    """All that followers are told of how to keep station."""

    frame: Frame
    approach: Approach
    silence: Silence
    unsure: float
    """With a larger standard deviation of its place in the trail a follower does not steer towards its station, and
    from there on slows down [m]."""
    avoidance: Avoidance


def law_of(formation: Formation) -> Law:
    """Settings as compiled code takes them."""
    frame = Frame(
        time=formation.frame_time_s,
        lag=formation.frame_lag_s,
        ahead=formation.frame_ahead_m,
        acceleration=formation.frame_acceleration_m_s2,
        inner=formation.inner_share,
        outer=formation.outer_share,
        slowest=formation.inner_least_m_s,
        fastest=formation.outer_most_m_s,
        preview=formation.preview_s,
    )
    law = Approach(
        law=LAWS.index(formation.law),
        speed=formation.approach_speed_m_s,
        lookahead=formation.lookahead_m,
        integral=formation.integral_m_s,
        least_way=formation.least_way_m_s,
        slowest=formation.slowest_m_s,
        fastest=formation.fastest_m_s,
    )
    silence = Silence(
        velocity_sigma=formation.leader_velocity_sigma_m_s,
        limit=formation.silence_s,
        then=_WHEN_SILENT.index(formation.when_silent),
        speed=formation.silent_speed_m_s,
    )
    near = formation.proximity or Proximity()
    avoidance = Avoidance(
        reach=near.range_m,
        full=near.full_m,
        speed=near.give_way_m_s,
        least_way=formation.least_way_m_s,
        fastest=formation.fastest_m_s,
    )
    return Law(frame, law, silence, formation.unsure_m, avoidance)


class Steering(NamedTuple):
    """What the autopilot is to do."""

    wanted: tuple[float, float, float]
    """Heading [rad], its rate [rad/s], speed through the water [m/s]."""
    motion: VehicleState


@compiled
def extend_trail(
    frame: Frame,
    station: Floats,
    message: Floats,
    trail: Floats,
    count: Ints,
    clock: tuple[float, float],
    memory: Floats,
) -> None:
    """Take a message of which a ping was heard: the trail grows, and the frame is turned along it anew.

    Since the last message the frame was turned by where the leader was taken to be; now its way there is known.

    Args:
        frame: how frames turn.
        station: columns BEHIND and PORT are read [m].
        message: columns HEARD_TIME … HEARD_SPEED.
        trail: columns of `sim.control.trail`, shape (room, TRAIL), begun by `init_memory`.
        count: points of it, shape (1,).
        clock: time, no earlier than that of the message, and step of the frame [s].
        memory: brought forward, shape (FOLLOWER_MEMORY,).
    """
    (now, dt), time = clock, message[HEARD_TIME]
    before, heard = memory[LAST_HEARD], int(memory[HEARD_POINTS])
    said = message[HEARD_SPEED], message[HEARD_HEADING]
    correct_planned(trail, count, heard, (message[HEARD_EAST], message[HEARD_NORTH], time))
    extend(trail, count, message[HEARD_EAST], message[HEARD_NORTH], time, said)
    memory[LAST_HEARD], memory[HEARD_POINTS] = time, count[0]
    memory[FRAME], memory[FRAME_RATE] = memory[KEPT_FRAME], memory[KEPT_RATE]
    turn_frame(frame, station, (trail, count[0]), (before, time), dt, memory)
    memory[KEPT_FRAME], memory[KEPT_RATE] = memory[FRAME], memory[FRAME_RATE]
    # a message that was long under way; `keep_station` makes the last step
    turn_frame(frame, station, (trail, count[0]), (time, max(now - dt, time)), dt, memory)


@compiled
def init_memory(leader: Floats, trail: Floats, count: Ints, memory: Floats) -> None:
    """Set up what a follower remembers at its start; of its own motion its first readings tell it.

    Args:
        leader: where the leader starts, columns of a message.
        trail: of the leader, empty; begun.
        count: points of it, shape (1,).
        memory: brought forward, shape (FOLLOWER_MEMORY,).
    """
    memory[:] = 0.0
    memory[FRAME] = memory[KEPT_FRAME] = leader[HEARD_HEADING]
    said = leader[HEARD_SPEED], leader[HEARD_HEADING]
    extend(trail, count, leader[HEARD_EAST], leader[HEARD_NORTH], leader[HEARD_TIME], said)
    memory[LOG_PASSED], memory[COMPASS_PASSED] = np.nan, np.nan
    memory[LAST_HEARD], memory[HEARD_POINTS] = leader[HEARD_TIME], count[0]


@compiled
def extend_silent_trail(plan: LeaderPlan, trail: Floats, count: Ints, clock: tuple[int, float], memory: Floats) -> None:
    """Let the trail go on as the leader planned, while no message is in; nothing without a plan.

    Args:
        plan: of the leader, as its messages carry it.
        trail: columns of `sim.control.trail`, shape (room, TRAIL).
        count: points of it, shape (1,); brought forward.
        clock: control step, and its length [s].
        memory: columns LAST_HEARD and HEARD_POINTS are read.
    """
    k, dt = clock
    if plan.until.size > 0 and k % round(SPACING / dt) == 0 and k * dt - memory[LAST_HEARD] > 0.5 * SPACING:
        extend_as_planned(plan, trail, count, (memory[LAST_HEARD], int(memory[HEARD_POINTS])), clock)


@compiled
def update_avoidance(avoidance: Avoidance, seen: Floats, estimate: Any, memory: Floats) -> None:
    """Take a look around by the proximity sensor: from now on the follower gives way to what is nearby.

    Args:
        avoidance: how to give way.
        seen: columns of `sim.control.avoidance` for each vehicle, shape (v, 2).
        estimate: record of `laisn.swarm.ESTIMATE`.
        memory: columns PUSH_EAST and PUSH_NORTH are brought forward; the heading is as measured last.
    """
    heading = memory[COMPASS_PASSED] - estimate.compass_bias
    memory[PUSH_EAST], memory[PUSH_NORTH] = away(avoidance, seen, heading)


@compiled
def measured_motion(reading: Floats, estimate: Any, dt: float, memory: Floats) -> VehicleState:
    """Own motion by smoothed readings, less their estimated biases.

    Args:
        reading: columns LOG … PITCHING.
        estimate: record of `laisn.swarm.ESTIMATE`.
        dt: since the last call [s].
        memory: columns LOG_PASSED and COMPASS_PASSED are brought forward; NaN before the first reading.
    """
    if memory[LOG_PASSED] != memory[LOG_PASSED]:
        memory[LOG_PASSED], memory[COMPASS_PASSED] = reading[LOG], reading[COMPASS]
    memory[LOG_PASSED] += (reading[LOG] - memory[LOG_PASSED]) * dt / _LOG_TIME
    memory[COMPASS_PASSED] -= reading[TURNING] * dt
    memory[COMPASS_PASSED] += wrap_angle(reading[COMPASS] - memory[COMPASS_PASSED]) * dt / _COMPASS_TIME
    surge, pitch = memory[LOG_PASSED] - estimate.log_bias, reading[INCLINE]
    heading = memory[COMPASS_PASSED] - estimate.compass_bias
    # nothing measures how it slips; it sinks the way it points
    sinking = -surge * np.sin(pitch)
    return VehicleState(surge, 0.0, heading, reading[TURNING], pitch, reading[PITCHING], reading[PRESSURE], sinking)


@compiled
def _current(law: Law, estimate: Any) -> tuple[float, float]:
    """Current that the law takes off [m/s]; those with an integral have that instead."""
    if law.approach.law != CONSTANT_BEARING:
        return 0.0, 0.0
    return estimate.current[0], estimate.current[1]


@compiled
def _foreseen(
    law: Law, station: Floats, known: tuple[Floats, int], now: float, estimate: Any, memory: Floats
) -> Target:
    """The station, and the velocity that takes a hull along with it."""
    t = station_at(law.frame, station, known, now, memory)
    east, north = rate_limited_velocity(law.frame, station, known, now, _current(law, estimate), memory)
    return Target(t.east, t.north, east, north, t.way_east, t.way_north)


@compiled
def _uncertainty(quiet: Silence, estimate: Any, age: float) -> float:
    """Standard deviation of the follower's place in the trail, by the age of the last message [s], [m]."""
    return float(np.hypot(estimate.spread, quiet.velocity_sigma * max(age, 0.0)))


@compiled
def _to_station(
    law: Law, target: Target, estimate: Any, sigma: float, dt: float, memory: Floats
) -> tuple[float, float]:
    """Velocity through the water towards the station, by the standard deviation of the place in the trail [m/s]."""
    at, likelier = estimate.position, estimate.to_likelier
    place = at[0] + likelier[0], at[1] + likelier[1]
    current = estimate.current[0], estimate.current[1]
    if place[0] != place[0]:
        # nothing is known of it yet
        place = target.east, target.north
    elif not sigma <= law.unsure:
        # a parallel course: of the way to the station only what lies along the leader's counts
        way = np.hypot(target.way_east, target.way_north)
        if way > 0.0:
            ahead_east, ahead_north = target.way_east / way, target.way_north / way
            along = (place[0] - target.east) * ahead_east + (place[1] - target.north) * ahead_north
            place = target.east + along * ahead_east, target.north + along * ahead_north
    east, north, memory[INTEGRAL] = approach(law.approach, target, place, current, dt, memory[INTEGRAL])
    return east, north


@compiled
def _sink_to(depth: float, dt: float, memory: Floats, reference: Floats) -> None:
    """Bring the depth that is wanted nearer to another one."""
    step = clip(depth - memory[DEPTH_WANTED], -_DIVE_RATE * dt, _DIVE_RATE * dt)
    memory[DEPTH_WANTED] += step
    reference[:] = 0.0
    reference[DEPTH], reference[SINKING] = memory[DEPTH_WANTED], step / dt


@compiled
def keep_station(
    law: Law,
    station: Floats,
    senses: tuple[Floats, Any],
    known: tuple[Floats, int],
    clock: tuple[float, float],
    memory: Floats,
    reference: Floats,
) -> Steering:
    """Heading, speed and depth that bring a follower to its station, and how it feels itself move.

    Args:
        law: how to keep station.
        station: columns BEHIND, PORT and STATION_DEPTH [m].
        senses: readings, columns LOG … PITCHING, and the estimate, a record of
            `laisn.swarm.ESTIMATE`.
        known: the leader's trail as heard, shape (room, TRAIL), and how many points it has, at least one.
        clock: time, and time since the last call [s].
        memory: brought forward, shape (FOLLOWER_MEMORY,).
        reference: out: of the autopilot, columns TURNING … SINKING, shape (8,).
    """
    (reading, estimate), (now, dt) = senses, clock
    starts = memory[LOG_PASSED] != memory[LOG_PASSED]
    motion = measured_motion(reading, estimate, dt, memory)
    if starts:
        memory[HEADING_WANTED], memory[SPEED_WANTED], memory[DEPTH_WANTED] = motion.heading, motion.surge, motion.depth
    quiet, depth = law.silence, station[STATION_DEPTH]
    heading, speed = memory[HEADING_WANTED], memory[SPEED_WANTED]
    silent = now - memory[LAST_HEARD]
    if silent > quiet.limit and quiet.then != HOLD:
        speed = quiet.speed
        if quiet.then == CIRCLE:
            heading += _CIRCLE * dt
        else:
            depth = min(depth, _SURFACE)
    else:
        if silent > 0.5 * dt:
            turn_frame(law.frame, station, known, (now - dt, now), dt, memory)
        target = _foreseen(law, station, known, now, estimate, memory)
        sigma = _uncertainty(quiet, estimate, silent)
        east, north = _to_station(law, target, estimate, sigma, dt, memory)
        heading, speed = np.arctan2(east, north), np.hypot(east, north)
        if silent > 0.5 * dt and speed > quiet.speed:
            # full speed up to the bound, the slow one from twice the bound on
            speed = quiet.speed + clip(2.0 - sigma / law.unsure, 0.0, 1.0) * (speed - quiet.speed)
    push = memory[PUSH_EAST], memory[PUSH_NORTH]
    if push[0] != 0.0 or push[1] != 0.0:
        heading, speed = give_way(law.avoidance, (heading, speed), push)
    _sink_to(depth, dt, memory, reference)
    turn = clip(wrap_angle(heading - memory[HEADING_WANTED]), -TURN_RATE * dt, TURN_RATE * dt)
    memory[HEADING_WANTED] += turn
    change = clip(speed - memory[SPEED_WANTED], -ACCELERATION * dt, ACCELERATION * dt)
    memory[SPEED_WANTED] = max(memory[SPEED_WANTED] + change, SPEED_LEAST)
    return Steering((memory[HEADING_WANTED], turn / dt, memory[SPEED_WANTED]), motion)
