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

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Record
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.allocation import clip
from sim.control.anticipation import rate_limited_velocity
from sim.control.approach import CONSTANT_BEARING, LAWS, Approach, approach
from sim.control.autopilot import VehicleState
from sim.control.avoidance import Avoidance, away, give_way
from sim.control.guidance import DEPTH, SINKING, SPEED_LEAST
from sim.control.leader_plan import SPACING, LeaderPlan, correct_planned, extend_as_planned
from sim.control.station import FRAME_STATE, STATION_DEPTH, Frame, Target, station_at, turn_frame
from sim.control.trail import extend
from sim.scenario.formation import Formation, Proximity
from sim.scenario.point_motion import ACCELERATION, TURN_RATE

LOG, COMPASS, PRESSURE, INCLINE, TURNING, PITCHING = range(6)
"""Columns of readings: speed log [m/s], compass [rad], pressure as depth [m], pitch [rad], rates of turn [rad/s]."""
READINGS = 6
HEARD_TIME, HEARD_EAST, HEARD_NORTH, HEARD_HEADING, HEARD_SPEED = range(5)
"""Columns of a message that the controller reads, as of `laisn.messages.LeaderMessage`."""
FOLLOWER_MEMORY = np.dtype(
    [
        ("frame", FRAME_STATE),
        ("kept_frame", FRAME_STATE),  # as it was at the last message
        ("integral", np.float64),  # of the approach
        ("heading_wanted", np.float64),  # [rad]
        ("speed_wanted", np.float64),  # [m/s]
        ("depth_wanted", np.float64),  # [m]
        ("log", np.float64),  # low-passed [m/s]; NaN before the first reading
        ("compass", np.float64),  # low-passed [rad]
        ("push", np.float64, (2,)),  # velocity away from vehicles that are sensed nearby, east and north [m/s]
        ("last_heard", np.float64),  # time of the last message [s]
        ("heard_points", np.int64),  # points of the trail with that message; later ones are planned
    ]
)
"""Memory of one follower, from one control step to the next."""

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
    memory: Record,
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
        memory: record of FOLLOWER_MEMORY; brought forward.
    """
    (now, dt), time = clock, message[HEARD_TIME]
    before, heard = memory.last_heard, memory.heard_points
    said = message[HEARD_SPEED], message[HEARD_HEADING]
    correct_planned(trail, count, heard, (message[HEARD_EAST], message[HEARD_NORTH], time))
    extend(trail, count, message[HEARD_EAST], message[HEARD_NORTH], time, said)
    memory.last_heard, memory.heard_points = time, count[0]
    memory.frame.heading, memory.frame.rate = memory.kept_frame.heading, memory.kept_frame.rate
    turn_frame(frame, station, (trail, count[0]), (before, time), dt, memory.frame)
    memory.kept_frame.heading, memory.kept_frame.rate = memory.frame.heading, memory.frame.rate
    # a message that was long under way; `keep_station` makes the last step
    turn_frame(frame, station, (trail, count[0]), (time, max(now - dt, time)), dt, memory.frame)


@compiled
def init_memory(leader: Floats, trail: Floats, count: Ints, memory: Record) -> None:
    """Set up what a follower remembers at its start; of its own motion its first readings tell it.

    Args:
        leader: where the leader starts, columns of a message.
        trail: of the leader, empty; begun.
        count: points of it, shape (1,).
        memory: record of FOLLOWER_MEMORY; brought forward.
    """
    memory.frame.heading = memory.kept_frame.heading = leader[HEARD_HEADING]
    said = leader[HEARD_SPEED], leader[HEARD_HEADING]
    extend(trail, count, leader[HEARD_EAST], leader[HEARD_NORTH], leader[HEARD_TIME], said)
    memory.log, memory.compass = np.nan, np.nan
    memory.last_heard, memory.heard_points = leader[HEARD_TIME], count[0]


@compiled
def extend_silent_trail(plan: LeaderPlan, trail: Floats, count: Ints, clock: tuple[int, float], memory: Record) -> None:
    """Let the trail go on as the leader planned, while no message is in; nothing without a plan.

    Args:
        plan: of the leader, as its messages carry it.
        trail: columns of `sim.control.trail`, shape (room, TRAIL).
        count: points of it, shape (1,); brought forward.
        clock: control step, and its length [s].
        memory: record of FOLLOWER_MEMORY; `last_heard` and `heard_points` are read.
    """
    k, dt = clock
    if plan.until.size > 0 and k % round(SPACING / dt) == 0 and k * dt - memory.last_heard > 0.5 * SPACING:
        extend_as_planned(plan, trail, count, (memory.last_heard, memory.heard_points), clock)


@compiled
def update_avoidance(avoidance: Avoidance, seen: Floats, estimate: Record, memory: Record) -> None:
    """Take a look around by the proximity sensor: from now on the follower gives way to what is nearby.

    Args:
        avoidance: how to give way.
        seen: columns of `sim.control.avoidance` for each vehicle, shape (v, 2).
        estimate: record of `laisn.swarm.ESTIMATE`.
        memory: record of FOLLOWER_MEMORY; `push` is brought forward, the heading is as measured last.
    """
    heading = memory.compass - estimate.compass_bias
    memory.push[0], memory.push[1] = away(avoidance, seen, heading)


@compiled
def measured_motion(reading: Floats, estimate: Record, dt: float, memory: Record) -> VehicleState:
    """Own motion by smoothed readings, less their estimated biases.

    Args:
        reading: columns LOG … PITCHING.
        estimate: record of `laisn.swarm.ESTIMATE`.
        dt: since the last call [s].
        memory: record of FOLLOWER_MEMORY; `log` and `compass` are brought forward.
    """
    if memory.log != memory.log:
        memory.log, memory.compass = reading[LOG], reading[COMPASS]
    memory.log += (reading[LOG] - memory.log) * dt / _LOG_TIME
    memory.compass -= reading[TURNING] * dt
    memory.compass += wrap_angle(reading[COMPASS] - memory.compass) * dt / _COMPASS_TIME
    surge, pitch = memory.log - estimate.log_bias, reading[INCLINE]
    heading = memory.compass - estimate.compass_bias
    # nothing measures how it slips; it sinks the way it points
    sinking = -surge * np.sin(pitch)
    return VehicleState(surge, 0.0, heading, reading[TURNING], pitch, reading[PITCHING], reading[PRESSURE], sinking)


@compiled
def _current(law: Law, estimate: Record) -> tuple[float, float]:
    """Current that the law takes off [m/s]; those with an integral have that instead."""
    if law.approach.law != CONSTANT_BEARING:
        return 0.0, 0.0
    return estimate.current[0], estimate.current[1]


@compiled
def _foreseen(
    law: Law, station: Floats, known: tuple[Floats, int], now: float, estimate: Record, memory: Record
) -> Target:
    """The station, and the velocity that takes a hull along with it."""
    t = station_at(law.frame, station, known, now, memory.frame)
    east, north = rate_limited_velocity(law.frame, station, known, now, _current(law, estimate), memory.frame)
    return Target(t.east, t.north, east, north, t.way_east, t.way_north)


@compiled
def _uncertainty(quiet: Silence, estimate: Record, age: float) -> float:
    """Standard deviation of the follower's place in the trail, by the age of the last message [s], [m]."""
    return float(np.hypot(estimate.spread, quiet.velocity_sigma * max(age, 0.0)))


@compiled
def _to_station(
    law: Law, target: Target, estimate: Record, sigma: float, dt: float, memory: Record
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
    east, north, memory.integral = approach(law.approach, target, place, current, dt, memory.integral)
    return east, north


@compiled
def _sink_to(depth: float, dt: float, memory: Record, reference: Floats) -> None:
    """Bring the depth that is wanted nearer to another one."""
    step = clip(depth - memory.depth_wanted, -_DIVE_RATE * dt, _DIVE_RATE * dt)
    memory.depth_wanted += step
    reference[:] = 0.0
    reference[DEPTH], reference[SINKING] = memory.depth_wanted, step / dt


@compiled
def keep_station(
    law: Law,
    station: Floats,
    senses: tuple[Floats, Record],
    known: tuple[Floats, int],
    clock: tuple[float, float],
    memory: Record,
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
        memory: record of FOLLOWER_MEMORY; brought forward.
        reference: out: of the autopilot, columns TURNING … SINKING, shape (8,).
    """
    (reading, estimate), (now, dt) = senses, clock
    starts = memory.log != memory.log
    motion = measured_motion(reading, estimate, dt, memory)
    if starts:
        memory.heading_wanted, memory.speed_wanted, memory.depth_wanted = motion.heading, motion.surge, motion.depth
    quiet, depth = law.silence, station[STATION_DEPTH]
    heading, speed = memory.heading_wanted, memory.speed_wanted
    silent = now - memory.last_heard
    if silent > quiet.limit and quiet.then != HOLD:
        speed = quiet.speed
        if quiet.then == CIRCLE:
            heading += _CIRCLE * dt
        else:
            depth = min(depth, _SURFACE)
    else:
        if silent > 0.5 * dt:
            turn_frame(law.frame, station, known, (now - dt, now), dt, memory.frame)
        target = _foreseen(law, station, known, now, estimate, memory)
        sigma = _uncertainty(quiet, estimate, silent)
        east, north = _to_station(law, target, estimate, sigma, dt, memory)
        heading, speed = np.arctan2(east, north), np.hypot(east, north)
        if silent > 0.5 * dt and speed > quiet.speed:
            # full speed up to the bound, the slow one from twice the bound on
            speed = quiet.speed + clip(2.0 - sigma / law.unsure, 0.0, 1.0) * (speed - quiet.speed)
    push = memory.push[0], memory.push[1]
    if push[0] != 0.0 or push[1] != 0.0:
        heading, speed = give_way(law.avoidance, (heading, speed), push)
    _sink_to(depth, dt, memory, reference)
    turn = clip(wrap_angle(heading - memory.heading_wanted), -TURN_RATE * dt, TURN_RATE * dt)
    memory.heading_wanted += turn
    change = clip(speed - memory.speed_wanted, -ACCELERATION * dt, ACCELERATION * dt)
    memory.speed_wanted = max(memory.speed_wanted + change, SPEED_LEAST)
    return Steering((memory.heading_wanted, turn / dt, memory.speed_wanted), motion)
