"""What followers hear of the leader at one instant, in compiled code: for followers that steer by it.

Formulas and noise are those of `observation` and `sensor_errors`, which make the measurements of a finished mission.
Both give the same bits, but where sound takes its time or gyros steady the leader's attitude: there they round
otherwise.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from sim.geometry.attitude import heading_of, pitch_of, roll_of
from sim.sensing import gauss_markov
from sim.sensing.echo import path_taken
from sim.sensing.instant import Senses, drawn_normals, drawn_uniforms, forward_speed
from sim.sensing.loss import is_bad, is_lost
from sim.sensing.noise import STREAMS, Stream
from sim.sensing.pings import Known, follow
from sim.sensing.sensor_errors import (
    attitude_reading,
    heading_reading,
    longest,
    longest_used,
    plain_reading,
    range_reading,
    speed_reading,
)

# compiled code holds numbers, not the members of an enum
_RANGE_UNIFORM, _RANGE_SCALE, _ECHO, _LOSS = (
    int(s) for s in (Stream.RANGE_UNIFORM, Stream.RANGE_SCALE, Stream.ECHO, Stream.LOSS)
)
_LEADER_MOTION, _LEADER_DEPTH, _LEADER_ATTITUDE = (
    int(s) for s in (Stream.LEADER_MOTION, Stream.LEADER_DEPTH, Stream.LEADER_ATTITUDE)
)
MESSAGE = 8
"""Columns of a message: those of `LeaderMessage` from timestamp to roll."""

SILENT, DEAF, HEARD = range(3)
"""What became of a message at a filter step: none is in; one is, of which no ping was received; one was heard."""


class Inbox(NamedTuple):
    """What followers have heard of the leader, f of them; brought forward by `hear`."""

    message: Floats
    """Last message of each, shape (f, MESSAGE)."""
    ranges: Floats
    """Its ranges to rear, front and middle transmitter, shape (f, 3), [m]; NaN where nothing was received."""
    over: Ints
    """How many messages each waits for no more, shape (f,)."""
    kept: Ints
    """Filter step at which the last message was sent, shape (f,); 0: there is none."""
    bad: Floats
    """Whether each channel is in its bad state, shape (f,)."""
    wander: Floats
    """Wandering errors of pitch and roll in the last message, of unit variance, shape (f, 2)."""
    outcome: Ints
    """SILENT, DEAF or HEARD at this filter step, shape (f,)."""


def new_inbox(followers: int) -> Inbox:
    """Nothing heard yet."""
    f = followers
    counts = (np.zeros(f, dtype=np.int64) for _ in range(3))
    return Inbox(np.zeros((f, MESSAGE)), np.full((f, 3), np.nan), next(counts), next(counts), np.zeros(f),
                 np.zeros((f, 2)), next(counts))  # fmt: skip


@compiled
def broadcast(
    s: Senses, k: int, body: tuple[Floats, Floats, Floats], tilt: Floats, wander: Floats, message: Floats
) -> None:
    """What the leader sends at filter step k.

    Args:
        s: errors.
        k: step, from 1.
        body: pose, twist and water velocity of the leader.
        tilt: what accelerations add to measured pitch and roll, shape (2,), [rad].
        wander: wandering errors of pitch and roll, of unit variance, shape (2,).
        message: out: columns of `LeaderMessage` from timestamp to roll, shape (MESSAGE,).
    """
    pose, twist, water = body
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    first, second = drawn_normals(s, _LEADER_MOTION, k)
    deep, _ = drawn_normals(s, _LEADER_DEPTH, k)
    message[0] = k * s.dt
    message[1] = pose[0] + s.leader_drift[0] * message[0]
    message[2] = pose[1] + s.leader_drift[1] * message[0]
    message[3] = heading_reading(heading_of(w, x, y, z), s.leader_heading[0], s.leader_heading[1], second)
    message[4] = speed_reading(forward_speed(pose, twist, water), s.leader_speed[0], s.leader_speed[1], first)
    message[5] = plain_reading(-pose[2], s.leader_depth_sigma, deep)
    message[6] = message[7] = np.nan
    if s.broadcast_attitude:
        offsets = drawn_normals(s, _LEADER_ATTITUDE, 0)
        offset_sigma, pitch_sigma, roll_sigma = s.leader_attitude
        message[6] = attitude_reading(pitch_of(w, x, y, z) + tilt[0], offset_sigma, offsets[0], pitch_sigma, wander[0])
        message[7] = attitude_reading(roll_of(w, x, y, z) + tilt[1], offset_sigma, offsets[1], roll_sigma, wander[1])


@compiled
def _wander(s: Senses, k: int, since: int, wander: Floats) -> None:
    """Bring errors of pitch and roll forward to filter step k from the message before, so many steps ago (0: none)."""
    kept = 0.0
    if since > 0 and s.leader_attitude_time > 0.0:
        kept = np.exp(-since * (s.dt / s.leader_attitude_time))
    fresh, drawn = np.sqrt(1.0 - kept * kept), drawn_normals(s, _LEADER_ATTITUDE, k)
    wander[0] = gauss_markov.advanced(wander[0], kept, fresh, drawn[0])
    wander[1] = gauss_markov.advanced(wander[1], kept, fresh, drawn[1])


@compiled
def read_ranges(s: Senses, k: int, sent: int, follower: int, true: Floats, inbox: Inbox) -> int:
    """Read the ranges of a message that is in.

    Args:
        s: errors.
        k: filter step.
        sent: filter step at which it was sent.
        follower: index.
        true: range of each ping by each path, shape (3, 3), [m]; NaN for pings that are not received.
        inbox: ranges and state of the channel are brought forward.

    Returns:
        DEAF or HEARD.
    """
    streams, ranges = STREAMS * follower, inbox.ranges[follower]
    taken = drawn_uniforms(s, streams + _ECHO, sent)
    for i in range(3):
        ranges[i] = true[i, path_taken(taken[0 if s.common_echoes else i], s.echo_chance[0], s.echo_chance[1])]
    rear, front, middle = ranges[0], ranges[1], ranges[2]
    far, farthest = longest_used(rear, front, middle, s.transmitters), longest(rear, front, middle)
    drawn = drawn_uniforms(s, streams + _RANGE_UNIFORM, k)
    psi = plain_reading(s.range_scale[0], s.range_scale[1], drawn_normals(s, streams + _RANGE_SCALE, k)[0])
    ranges[0] = range_reading(rear, far, s.range_tau[0], drawn[0] - s.range_centre, psi)
    ranges[1] = range_reading(front, far, s.range_tau[1], drawn[1] - s.range_centre, psi)
    ranges[2] = range_reading(middle, farthest, s.range_tau[2], drawn[2] - s.range_centre, psi)
    if s.loses:
        fate = drawn_uniforms(s, streams + _LOSS, sent)
        in_burst = is_bad(inbox.bad[follower] > 0.0, fate[0], s.channel)
        inbox.bad[follower] = 1.0 if in_burst else 0.0
        if is_lost(in_burst, fate[1], s.channel):
            ranges[:] = np.nan
    return HEARD if ranges[0] == ranges[0] or ranges[1] == ranges[1] or ranges[2] == ranges[2] else DEAF


@compiled
def _take_up(
    s: Senses, k: int, sent: int, follower: int, known: Known, tilts: Floats, true: Floats, inbox: Inbox
) -> None:
    """Read the message of filter step `sent`, and its ranges."""
    truth, at = known[0], sent * s.stride
    _wander(s, sent, sent - inbox.kept[follower] if inbox.kept[follower] > 0 else 0, inbox.wander[follower])
    inbox.kept[follower] = sent
    body = truth.pose[at, 0], truth.twist[at, 0], truth.water[at, 0]
    broadcast(s, sent, body, tilts[at], inbox.wander[follower], inbox.message[follower])
    inbox.outcome[follower] = read_ranges(s, k, sent, follower, true, inbox)


@compiled
def is_under_way(k: int, follower: int, message_every: int, inbox: Inbox) -> bool:
    """Whether a message may come in at filter step k: one is sent that the follower still waits for."""
    return bool((inbox.over[follower] + 1) * message_every <= k)


@compiled
def hear(
    s: Senses, k: int, follower: int, sites: tuple[Floats, Floats], known: Known, tilts: Floats, inbox: Inbox
) -> None:
    """Take up the message that is in at filter step k, if there is one.

    Args:
        s: errors.
        k: filter step, from 1; steps must come one by one.
        follower: index; its vehicle is the one after.
        sites: offsets of the transmitters, shape (3, 3), and of the followers' hydrophones, shape (f, 3), [m].
        known: the motion until now.
        tilts: what accelerations add to the leader's measured pitch and roll at each instant, shape (n, 2), [rad].
        inbox: brought forward.
    """
    inbox.outcome[follower] = SILENT
    true, arrivals = np.empty((3, 3)), np.empty((3, 3))
    while is_under_way(k, follower, s.message_every, inbox):
        sent = (inbox.over[follower] + 1) * s.message_every
        complete = follow(s.sound, known, sites, follower, sent * s.dt, s.transmitters, true, arrivals)
        step = int(np.ceil(complete / s.dt - 1e-6))
        if step > k:
            return
        inbox.over[follower] += 1
        # of two messages within one filter step the follower keeps the first
        if inbox.outcome[follower] == SILENT:
            for i in range(3):
                for path in range(3):
                    # it hears no more of a message once it has taken it up
                    if not arrivals[i, path] <= (step + 1e-6) * s.dt:
                        true[i, path] = np.nan
            _take_up(s, k, sent, follower, known, tilts, true, inbox)
