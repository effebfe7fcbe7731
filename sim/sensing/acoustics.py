"""How sound gets from the transmitters to a hydrophone, and what range a receiver without noise would give.

A ping leaves its transmitter at t_e, where that site then is, and arrives at t_a, where the hydrophone then is:

    t_a − t_e = |H(t_a) − P(t_e)| s,    s = mean of 1/c along the path,

solved for t_a itself, whatever the time step. The follower knows t_e from the message, reads t_a on its own clock and
believes in a constant speed of sound c_b: R = c_b (t_a + clock error − t_e). Echoes do the same from the transmitter's
mirror image (`sim.sensing.echo`). All of this is the same in every run; random errors, echoes and losses come on top.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.records import own_arrays
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing.echo import Path, image, mean_slowness
from sim.sensing.hearing import Hearing
from sim.trajectory import Trajectory
from sim.water.sound import SoundSpeed

TRANSMITTERS = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")
"""Sites of P1, P2 and P3."""

_ITERATIONS = 6
"""Iterations for the arrival time: each gains a factor of c / speed of the hydrophone, some 500; six leave nothing."""


@dataclass(frozen=True, kw_only=True)
class Propagation:
    """Sound of m messages on its three paths; arrays over transmitters hold rear, front, middle.

    Arrays over paths are ordered as `sim.sensing.echo.Path`; paths without a chance to be taken hold NaN.
    """

    emission_step: Ints
    """Filter step at which a message is sent, shape (m,)."""
    message_step: Ints
    """First filter step by which all pings that the follower listens to are in, echoes that may be taken for them
    included, shape (m,)."""
    emission_time: Floats
    """Time at which each ping leaves, shape (m, 3), [s]."""
    arrival_time: Floats
    """Time at which each ping arrives by each path, shape (m, 3 transmitters, 3 paths), [s]."""
    transmitter: Floats
    """Where each ping left, shape (m, 3, 3), the last axis in the world, [m]."""
    hydrophone: Floats
    """Where the direct sound of each ping arrived, shape (m, 3, 3), the last axis in the world, [m]."""
    length: Floats
    """Length of each path, shape (m, 3 transmitters, 3 paths), [m]."""
    slowness_ratio: Floats
    """Range that the follower believes for a metre of path, c_b s, shape (m, 3 transmitters, 3 paths)."""
    clock_range: Floats
    """What the clocks add to a range, shape (m, 3 transmitters, 3 paths), [m]."""

    def __post_init__(self) -> None:
        own_arrays(self)

    @property
    def range(self) -> Floats:
        """Slant range before random errors, shape (m, 3 transmitters, 3 paths), [m]; not cut off at any distance."""
        return self.length * self.slowness_ratio + self.clock_range


def sound_speed(hearing: Hearing) -> SoundSpeed:
    """The true speed of sound."""
    if hearing.sound_speed_profile:
        return SoundSpeed.through(hearing.sound_speed_profile)
    return SoundSpeed.constant(hearing.sound_speed_m_s)


def _ratio(hearing: Hearing, source: Floats, receiver: Floats, path: Path) -> Floats:
    """c_b s of a path; exactly 1 where the follower believes the true constant, so that nothing is rounded."""
    believed = hearing.sound_speed_m_s + hearing.sound_speed_bias_m_s
    if not hearing.sound_speed_profile:
        return np.full(source.shape[:-1], believed / hearing.sound_speed_m_s)
    return believed * mean_slowness(sound_speed(hearing), source, receiver, path, hearing.floor_depth_m)


def _reader(trajectory: Trajectory, site: str, *, on_grid: bool) -> Callable[[Floats], Floats]:
    """Position of a site over time, shape (m,) to (m, 3): recorded points where the instants are such, else between."""
    if not on_grid:
        return lambda time: trajectory.site_at(site, np.minimum(time, trajectory.time[-1]))
    recorded = trajectory.site_path(site)
    return lambda time: recorded[np.rint((time - trajectory.time[0]) / trajectory.dt).astype(np.int64)]


def _arrivals(
    source: Floats, sent: Floats, hydrophone: Callable[[Floats], Floats], slowness: Callable[[Floats], Floats]
) -> tuple[Floats, Floats]:
    """Arrival times, shape (m,), [s], and where the hydrophone then is, shape (m, 3), [m].

    Args:
        source: where the sound seems to come from, shape (m, 3), [m].
        sent: when, shape (m,), [s].
        hydrophone: its position over time.
        slowness: mean of 1/c along the path, given the hydrophone's position, [s/m].
    """
    arrival = sent
    for _ in range(_ITERATIONS):
        receiver = hydrophone(arrival)
        arrival = sent + np.linalg.norm(receiver - source, axis=1) * slowness(receiver)
    return arrival, hydrophone(arrival)


def propagate(trajectory: Trajectory, hearing: Hearing, follower: int = 0) -> Propagation:
    """Follow the sound of all messages of a mission to one follower.

    Messages that are not in by the last filter step are left out.

    Args:
        trajectory: of a mission, or a stretch of it that begins at a filter step; messages sent after that are
            followed.
        hearing: of its scenario.
        follower: its index, 0 for the first.
    """
    floor, dt, every = hearing.floor_depth_m, hearing.filter_step_s, hearing.message_every
    first = round(float(trajectory.time[0]) / dt)
    last = first + (trajectory.time.size - 1) // round(dt / CONTROL_STEP_S)
    moving = hearing.travel_time
    on_grid = not moving and hearing.ping_slot_s == 0
    # integers count messages: an accumulated time would drop some
    steps = np.arange(first // every + 1, last // every + 1) * every
    hydrophone = _reader(trajectory, f"{trajectory.names[follower + 1]}/hydrophone", on_grid=on_grid)
    sound = sound_speed(hearing)

    m, paths, ping = steps.size, len(Path), len(TRANSMITTERS)
    sent = steps[:, None] * dt + hearing.ping_slot_s * np.arange(ping)
    transmitter, receiver = np.empty((m, ping, 3)), np.empty((m, ping, 3))
    arrival, length, ratio = (np.full((m, ping, paths), np.nan) for _ in range(3))
    for i, site in enumerate(TRANSMITTERS):
        transmitter[:, i] = _reader(trajectory, site, on_grid=on_grid)(sent[:, i])
        for path in hearing.paths:
            source = image(transmitter[:, i], path, floor)
            at = hydrophone(sent[:, i])
            if moving:

                def slowness(there: Floats, i: int = i, path: Path = path) -> Floats:
                    return mean_slowness(sound, transmitter[:, i], there, path, floor)

                arrival[:, i, path], at = _arrivals(source, sent[:, i], hydrophone, slowness)
            else:
                arrival[:, i, path] = sent[:, i]
            length[:, i, path] = np.linalg.norm(source - at, axis=1)
            ratio[:, i, path] = _ratio(hearing, transmitter[:, i], at, path)
            if path is Path.DIRECT:
                receiver[:, i] = at

    complete = np.nanmax(arrival[:, : hearing.transmitters], axis=(1, 2))
    message_step = np.ceil(complete / dt - 1e-6).astype(np.int64)
    # Two messages within one filter step: the follower keeps the first.
    heard = (message_step <= last) & (np.diff(message_step, prepend=0) > 0)
    believed = hearing.sound_speed_m_s + hearing.sound_speed_bias_m_s
    clock = hearing.clock_offset_s + 1e-6 * hearing.clock_drift_ppm * arrival
    return Propagation(
        emission_step=steps[heard],
        message_step=message_step[heard],
        emission_time=sent[heard],
        arrival_time=arrival[heard],
        transmitter=transmitter[heard],
        hydrophone=receiver[heard],
        length=length[heard],
        slowness_ratio=ratio[heard],
        clock_range=believed * clock[heard],
    )
