"""Followers that steer by their own estimates: one tick of all vehicles but for navigation and physics.

What such a follower measures depends on where its estimates have led it, so that sensing and navigation are part of
the flight. A tick is `sense`, at filter steps the followers' navigators, `guide`, physics, `record_state`.
The navigators belong to `laisn`, of which this package knows no more than its words; a `Swarm` of them is given to
whoever puts the tick together (`experiments.flight.swarm`), all in compiled code. Noise is addressed by step, so that
navigating on the finished mission gives the estimates that steered it.

A follower keeps a station or a route. On either, guidance and autopilot have nothing but readings, messages and
estimates: position, heading, speed, depth and current are those that the follower measures or estimates itself.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled, copy_values
from sim.control.approach import LAWS, Approach
from sim.control.autopilot import control, vehicle_state
from sim.control.avoidance import Avoidance
from sim.control.follower import (
    ESTIMATED_CURRENT_EAST,
    ESTIMATED_CURRENT_NORTH,
    ESTIMATED_EAST,
    ESTIMATED_NORTH,
    ESTIMATES,
    FOLLOWER_MEMORY,
    READINGS,
    VELOCITY_EAST,
    VELOCITY_NORTH,
    Law,
    Silence,
    extend_trail,
    init_memory,
    keep_station,
    measured_motion,
    update_avoidance,
)
from sim.control.guidance import (
    CURRENT_EAST,
    CURRENT_NORTH,
    EAST,
    NORTH,
    begin,
    integrate_offset,
    steer,
    track_current,
)
from sim.control.station import Frame
from sim.control.trail import TRAIL
from sim.fleet import QUATERNION, TICK, VELOCITY, WATER, Steering, steer_along_route
from sim.scenario.formation import Formation, Proximity
from sim.scenario.settings import Scenario
from sim.sensing.ahrs import follow_tilt
from sim.sensing.instant import Senses, forward_speed, read_own, senses_of
from sim.sensing.listening import HEARD, SILENT, Inbox, hear, is_under_way, new_inbox
from sim.sensing.pings import site
from sim.sensing.proximity import SEEN, Lookout, look, lookout_of
from sim.vehicle.plant import Plant

POSE, TWIST = slice(0, 7), slice(7, 13)
ROUTE, ROUTE_BY_ESTIMATE, STATION_BY_TRUTH, STATION = range(4)
"""What a follower keeps to, and what it steers by."""
_SILENT = ("go-on", "circle", "surface")


class ClosedLoopState(NamedTuple):
    """All that a tick works on beside the truth; f followers."""

    law: Law
    senses: Senses
    lookout: Lookout
    kinds: Ints
    """ROUTE … STATION of each follower, shape (f,)."""
    estimates_current: bool
    """Whether the navigators estimate a current."""
    stations: Floats
    """Columns BEHIND, PORT, STATION_DEPTH, shape (f, 3), [m]."""
    sites: tuple[Floats, Floats, Floats]
    """Offsets of the transmitters, shape (3, 3), of hydrophones and of pressure sensors, shape (f, 3), [m]."""
    steering: Steering
    """Steering of vehicles along their routes."""
    readings: Floats
    """Readings of each follower's sensors, shape (f, READINGS)."""
    inbox: Inbox
    """What each follower has heard."""
    arrived: Bools
    """Whether a message is in at this filter step, shape (f,)."""
    tilts: Floats
    """What accelerations add to the leader's measured pitch and roll at each instant, shape (n + 1, 2), [rad]."""
    seen: Floats
    """What each follower's last look around showed, shape (f, v, SEEN)."""
    estimates: Floats
    """What each navigator concludes, shape (f, ESTIMATES)."""
    trails: Floats
    """Trail of the leader as each follower has heard it, shape (f, room, TRAIL)."""
    counts: Ints
    """Points of the trails, shape (f, 1)."""
    memory: Floats
    """Memory of each follower, shape (f, FOLLOWER_MEMORY)."""
    reference: Floats
    """Reference of the autopilot of one follower at a time, shape (8,)."""
    history: Floats
    """Estimates at each instant, shape (n + 1, f, ESTIMATES)."""


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
        then=_SILENT.index(formation.when_silent),
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


def _kind(on_station: bool, by_estimate: bool) -> int:
    if on_station:
        return STATION if by_estimate else STATION_BY_TRUTH
    return ROUTE_BY_ESTIMATE if by_estimate else ROUTE


def init_closed_loop(scenario: Scenario, plant: Plant, steering: Steering) -> ClosedLoopState:
    """Everything at its start.

    Args:
        scenario: whose followers sense and navigate while they swim.
        plant: at its start.
        steering: of the routes.
    """
    f, n = len(scenario.followers), steering[0].shape[0]
    offset = {name: plant.site_offset[i] for i, name in enumerate(plant.site_names)}
    names = [follower.name for follower in scenario.followers]
    memory, navigation = np.zeros((f, FOLLOWER_MEMORY)), scenario.navigation
    kinds, stations = np.zeros(f, dtype=np.int64), np.zeros((f, 3))
    trails = np.zeros((f, n // scenario.message_every + 2, TRAIL))
    counts = np.zeros((f, 1), dtype=np.int64)
    leader = vehicle_state(plant.pose[0], plant.twist[0], plant.water_velocity()[0])
    start = np.array([0.0, *plant.pose[0, :2], leader.heading, leader.surge])
    for i, follower in enumerate(scenario.followers):
        kinds[i] = _kind(follower.station is not None, follower.believes)
        if follower.station:
            place = follower.station
            stations[i] = place.behind_m, place.port_m, place.depth_m
        init_memory(start, trails[i], counts[i], memory[i])
    return ClosedLoopState(
        law=law_of(scenario.formation),
        senses=senses_of(scenario),
        lookout=lookout_of(scenario),
        kinds=kinds,
        estimates_current=navigation.variant == "tight" and navigation.assume.current,
        stations=stations,
        sites=(
            np.array([offset[f"leader/tx_{which}"] for which in ("rear", "front", "middle")]),
            np.array([offset[f"{name}/hydrophone"] for name in names]),
            np.array([offset[f"{name}/depth_sensor"] for name in names]),
        ),
        steering=steering,
        readings=np.zeros((f, READINGS)),
        inbox=new_inbox(f),
        arrived=np.zeros(f, dtype=np.bool_),
        tilts=np.zeros((n, 2)),
        seen=np.full((f, f + 1, SEEN), np.nan),
        estimates=np.zeros((f, ESTIMATES)),
        trails=trails,
        counts=counts,
        memory=memory,
        reference=np.zeros(8),
        history=np.full((n, f, ESTIMATES), np.nan),
    )


@compiled
def _lean(k: int, record: Floats, a: ClosedLoopState) -> None:
    """What accelerations make of the leader's pitch and roll; the first instant has those of the second."""
    for i in range(k - 1 if k == 1 else k, k + 1):
        change = record[k, 0, VELOCITY] - record[k - 1, 0, VELOCITY]
        follow_tilt(a.senses.tilt_share, record[i, 0, QUATERNION], change, a.tilts[max(i - 1, 0)], a.tilts[i])


@compiled
def sense(k: int, record: Floats, a: ClosedLoopState) -> bool:
    """All sensors at instant k, and messages that are in; whether it is a filter step, at which navigators are due.

    Between filter steps followers dead-reckon.

    Args:
        k: instant.
        record: truth, shape (n + 1, v, COLUMNS + m), known until then.
        a: readings, inbox, arrivals, trails and estimated positions are brought forward.
    """
    row, stride = record[k], a.senses.stride
    if k > 0 and a.senses.feels_acceleration:
        _lean(k, record, a)
    if k % stride != 0:
        for i in range(a.kinds.size):
            a.estimates[i, ESTIMATED_EAST] += TICK * a.estimates[i, VELOCITY_EAST]
            a.estimates[i, ESTIMATED_NORTH] += TICK * a.estimates[i, VELOCITY_NORTH]
        return False
    step = k // stride
    for i in range(a.kinds.size):
        body = row[i + 1, POSE], row[i + 1, TWIST], row[i + 1, WATER]
        read_own(a.senses, step, i, body, a.sites[2][i], a.readings[i])
        on_station = a.kinds[i] >= STATION_BY_TRUTH
        if k > 0 and a.lookout.every > 0 and k % a.lookout.every == 0 and on_station:
            look(a.lookout, k, i, row, a.seen[i])
            update_avoidance(a.law.avoidance, a.seen[i], a.estimates[i], a.memory[i])
        a.arrived[i] = False
        # few calls, for what is handed over costs more than the question
        if is_under_way(step, i, a.senses.message_every, a.inbox):
            hear(a.senses, step, i, (a.sites[0], a.sites[1]), (record, k), a.tilts, a.inbox)
            a.arrived[i] = a.inbox.outcome[i] != SILENT
            if a.inbox.outcome[i] == HEARD and on_station:
                clock, message = (k * TICK, TICK), a.inbox.message[i]
                extend_trail(a.law.frame, a.stations[i], message, a.trails[i], a.counts[i], clock, a.memory[i])
    return k > 0


@compiled
def _true_estimate(row: Floats, hydrophone: Floats, guided: Floats, reading: Floats, estimate: Floats) -> None:
    """Replace readings and estimates of a follower that steers by the truth."""
    pose, twist, water = row[POSE], row[TWIST], row[WATER]
    motion = vehicle_state(pose, twist, water)
    reading[0], reading[1], reading[2] = forward_speed(pose, twist, water), motion.heading, motion.depth
    reading[3], reading[4], reading[5] = motion.pitch, motion.turning, motion.pitching
    track_current((water[0], water[1]), TICK, guided)
    estimate[:] = 0.0
    estimate[0], estimate[1], _ = site(pose, hydrophone)
    estimate[4], estimate[5] = guided[CURRENT_EAST], guided[CURRENT_NORTH]


@compiled
def _estimated_position(k: int, f: int, a: ClosedLoopState) -> Floats:
    """Where a follower takes itself to be: as long as it knows of no place, where its route has it."""
    place = a.estimates[f, ESTIMATED_EAST : ESTIMATED_NORTH + 1]
    if k < a.senses.stride or place[0] != place[0]:
        return a.steering[0][k, f + 1, EAST : NORTH + 1]
    return place


@compiled
def _follow_route(k: int, f: int, a: ClosedLoopState) -> None:
    """Find the command of a follower that keeps to its route by its own readings and estimates."""
    wanted, autopilots, memory, command = a.steering
    i, estimate = f + 1, a.estimates[f]
    reference, guided = wanted[k, i], memory[0][i]
    motion = measured_motion(a.readings[f], estimate, TICK, a.memory[f])
    if k == 0:
        begin(reference, motion.heading, motion.surge, (0.0, 0.0), guided)
    place = _estimated_position(k, f, a)
    if a.estimates_current:
        track_current((estimate[ESTIMATED_CURRENT_EAST], estimate[ESTIMATED_CURRENT_NORTH]), TICK, guided)
    else:
        integrate_offset(reference, place, TICK, guided)
    steered = steer(reference, place, TICK, guided)
    control(autopilots[i], steered, reference, motion, TICK, memory[1][i], command[i])


@compiled
def guide(k: int, row: Floats, a: ClosedLoopState) -> None:
    """Find the commands of all vehicles that hold from instant k until k + 1.

    Args:
        k: instant.
        row: recorded truth, shape (v, COLUMNS + m), of which only the leader and who steers by the truth is read.
        a: memories and commands are brought forward; estimates are written down.
    """
    _, autopilots, memory, command = a.steering
    steer_along_route(k, row, 0, a.steering)
    for f in range(a.kinds.size):
        i = f + 1
        copy_values(a.estimates[f], a.history[k, f])
        if a.kinds[f] == ROUTE:
            steer_along_route(k, row, i, a.steering)
            continue
        if a.kinds[f] == ROUTE_BY_ESTIMATE:
            _follow_route(k, f, a)
            continue
        reading, estimate = a.readings[f], a.estimates[f]
        if a.kinds[f] == STATION_BY_TRUTH:
            if k == 0:
                memory[0][i, CURRENT_EAST], memory[0][i, CURRENT_NORTH] = row[i, WATER][0], row[i, WATER][1]
            _true_estimate(row[i], a.sites[1][f], memory[0][i], reading, estimate)
        steering = keep_station(
            a.law,
            a.stations[f],
            (reading, estimate),
            (a.trails[f], a.counts[f, 0]),
            (k * TICK, TICK),
            a.memory[f],
            a.reference,
        )
        control(autopilots[i], steering.wanted, a.reference, steering.motion, TICK, memory[1][i], command[i])
