"""Logs read back: the flight to the bit, or the measurements alone, of the simulator or of a real vehicle."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
from mcap.well_known import MessageEncoding

from laisn.arrays import Ints
from laisn.estimates import Estimates
from laisn.messages import Measurements
from laisn.tight.estimates import TightEstimates
from sim.flight import Flight, Outcome
from sim.log.clock import Clock
from sim.log.contents import Contents, Messages, contents, require
from sim.log.file import SCENARIO, VEHICLES, LogError, faults
from sim.log.schema import (
    ANGULAR_VELOCITY,
    COVARIANCE,
    FIX,
    HYPOTHESIS,
    HYPOTHESIS_COVARIANCE,
    INNOVATION,
    INNOVATION_COVARIANCE,
    LEADER_MESSAGE,
    MIXTURE,
    OWN_MOTION,
    RANGES,
    RECEPTION,
    STATE_NAMES,
    STATE_SIGMAS,
    STATES,
    VELOCITY,
    WATER_VELOCITY,
    WEIGHTS,
    thrust_fields,
)
from sim.log.vehicle_log import LONGEST_GAP_S, Recording, channels_of, optional_columns, recording
from sim.scenario import file as scenario_file
from sim.scenario.settings import CONTROL_STEP_S
from sim.trajectory import Trajectory

CORE = ("/pose", "/state", "/motion", "/reception", "/filter", "/innovation")
"""How the topics end that make up a flight; everything else in its log is drawn from them."""
MIXTURE_TOPIC = "/mixture"
"""How the topic ends that is there too if the tightly coupled navigator ran."""
_POSES = {
    "position": tuple(f"pose.position.{axis}" for axis in "xyz"),
    "quaternion": tuple(f"pose.orientation.{axis}" for axis in "wxyz"),
}
"""Fields of a pose that an array of the trajectory is made of."""
_STATES = {
    "time": ("time",),
    "velocity": VELOCITY,
    "angular_velocity": ANGULAR_VELOCITY,
    "water_velocity": WATER_VELOCITY,
}
"""Fields of a state, likewise."""


_EMPTY = {"/reception": RECEPTION, "/innovation": FIX}
"""Channels of a flight that may have no message."""


def _add_empty_channels(log: Contents) -> None:
    """Add the channels of a flight that are not in its file, as they have no message."""
    facts = log.metadata.get("laisn")
    if facts is not None:
        types = _EMPTY | ({MIXTURE_TOPIC: MIXTURE} if facts.get("mixture") == "True" else {})
        for follower in [topic.removesuffix("/motion") for topic in log.topics if topic.endswith("/motion")]:
            for suffix, type_ in types.items():
                log.topics.setdefault(f"{follower}{suffix}", Messages(type_.schema, MessageEncoding.Protobuf))


def _steps(path: Path, topic: str, messages: Messages, steps_ns: Ints) -> Ints:
    """Filter step at which each message is available: the first at or after its time."""
    step = np.searchsorted(steps_ns, messages.time_ns).astype(np.int64) + 1
    if step.size and step[-1] > steps_ns.size:
        raise LogError(f"{path}: {topic} goes on after the last filter step")
    return step


def _measurements(path: Path, log: Contents, follower: str) -> tuple[Measurements, Ints]:
    """Measurements of a follower in a flight, and the times of the filter steps, shape (n,), [ns]."""
    motion, reception = channels_of(path, log, follower)
    time_ns = motion.time_ns
    speed, heading, depth = motion.columns(OWN_MOTION.fields)
    measurements = Measurements(
        dt=float(log.metadata["laisn"]["filter_step_s"]),
        speed=np.asarray(speed),
        heading=np.asarray(heading),
        depth=np.asarray(depth),
        message_step=_steps(path, f"/{follower}/reception", reception, time_ns),
        message=optional_columns(reception, LEADER_MESSAGE),
        ranges=optional_columns(reception, RANGES),
    )
    return measurements, time_ns


def read_recording(path: Path | str, follower: str = "follower", longest_gap_s: float = LONGEST_GAP_S) -> Recording:
    """What one follower received and sensed, from any log with the channels `/NAME/motion` and `/NAME/reception`.

    Args:
        path: the log, of a flight or of a real vehicle.
        follower: its name.
        longest_gap_s: between own measurements [s].

    Returns:
        Measurements as of `sim.log.vehicle_log.recording`, and remarks on what was left out or bridged, or could not be
        checked.

    Raises:
        LogError: the log is damaged, lacks a channel or a field, or has too long a gap.
    """
    path = Path(path)
    log = contents(path, lambda topic, _: topic.endswith(("/motion", "/reception")))
    _add_empty_channels(log)
    found = recording(path, log, follower, longest_gap_s)
    bare = tuple(f"{what} have no checksum: damage cannot be noticed" for what in log.unverified if "chunks" in what)
    return found._replace(remarks=(*found.remarks, *bare))


def read_measurements(path: Path | str, follower: str = "follower") -> Measurements:
    """The measurements that `read_recording` finds, without its remarks."""
    return read_recording(path, follower).measurements


def _integers(messages: Messages, name: str) -> Ints:
    (values,) = messages.columns([name])
    return np.asarray(values, dtype=np.int64)


def _estimates(path: Path, log: Contents, follower: str, steps_ns: Ints) -> Estimates:
    filtered = require(path, log, f"/{follower}/filter", (*STATE_NAMES, *COVARIANCE))
    topic = f"/{follower}/innovation"
    fixed = require(path, log, topic, ("x", "y", "sigma", *INNOVATION, *INNOVATION_COVARIANCE, "kind"))
    with faults(path):
        if not np.array_equal(filtered.time_ns, steps_ns):
            raise LogError(f"{path}: /{follower}/filter and /{follower}/motion are not at the same times")
        fixes = fixed.table(("x", "y", "sigma", *INNOVATION, *INNOVATION_COVARIANCE))
        estimates = Estimates(
            state=filtered.table(STATE_NAMES),
            covariance=filtered.table(COVARIANCE).reshape(-1, 4, 4),
            fix_step=_steps(path, topic, fixed, steps_ns),
            fix_position=fixes[:, :2].copy(),
            fix_sigma=fixes[:, 2].copy(),
            fix_kind=_integers(fixed, "kind"),
            innovation=fixes[:, 3:5].copy(),
            innovation_covariance=fixes[:, 5:].reshape(-1, 2, 2).copy(),
        )
        mixture = f"/{follower}{MIXTURE_TOPIC}"
        return _tight(path, log, mixture, estimates) if mixture in log.topics else estimates


def _tight(path: Path, log: Contents, topic: str, estimates: Estimates) -> TightEstimates:
    """Estimates with the mixture that they are based on."""
    found = require(path, log, topic, (*MIXTURE.fields, *MIXTURE.integers))
    if not np.array_equal(found.time_ns, log.topics[topic.replace(MIXTURE_TOPIC, "/innovation")].time_ns):
        raise LogError(f"{path}: {topic} is not at the times of the fixes")
    nis, full_state, full_sigma, weight, where, spread = (
        found.table(names) for names in (("nis",), STATES, STATE_SIGMAS, WEIGHTS, HYPOTHESIS, HYPOTHESIS_COVARIANCE)
    )
    m, h = weight.shape
    return TightEstimates(
        **{f.name: getattr(estimates, f.name) for f in fields(Estimates)},
        used=_integers(found, "used"),
        nis=nis[:, 0],
        full_state=full_state,
        full_sigma=full_sigma,
        weight=weight,
        hypothesis=where.reshape(m, h, 2),
        hypothesis_covariance=spread.reshape(m, h, 3)[:, :, [0, 1, 1, 2]].reshape(m, h, 2, 2),
    )


def _trajectory(path: Path, log: Contents) -> Trajectory:
    table = json.loads(log.attachments[VEHICLES])
    names = tuple(table["names"])
    effectors = table["effectors"]
    at = require(path, log, f"/{names[0]}/pose", ()).time_ns
    found = {name: np.empty((at.size, len(names), len(group))) for name, group in (_POSES | _STATES).items()}
    most = max((len(own) for own in effectors), default=0)
    found["thrust"], force = np.zeros((at.size, len(names), most)), np.zeros((len(names), most, 3))
    for i, vehicle in enumerate(names):
        own = effectors[i] if effectors else []
        thrust = thrust_fields([effector["name"] for effector in own])
        force[i, : len(own)] = np.reshape([effector["force"] for effector in own], (-1, 3))
        for topic, groups in ((f"/{vehicle}/pose", _POSES), (f"/{vehicle}/state", _STATES | {"thrust": thrust})):
            messages = require(path, log, topic, [field for group in groups.values() for field in group])
            if not np.array_equal(messages.time_ns, at):
                raise LogError(f"{path}: the channels of {vehicle} are not at the times of the leader's")
            for name, group in groups.items():
                if group:
                    found[name][:, i, : len(group)] = messages.table(group)
    for array in found.values():
        array.flags.writeable = False
    return Trajectory(
        names=names,
        time=found.pop("time")[:, 0, 0].copy(),
        site_names=tuple(site["name"] for site in table["sites"]),
        site_vehicle=np.array([site["vehicle"] for site in table["sites"]], dtype=np.int64),
        site_offset=np.array([site["offset"] for site in table["sites"]], dtype=np.float64).reshape(-1, 3),
        effector_names=tuple(tuple(effector["name"] for effector in own) for own in effectors),
        effector_force=force,
        **found,
    )


def _check_facts(path: Path, flight: Flight, facts: Mapping[str, str]) -> None:
    """The metadata must be of the scenario."""
    scenario = flight.scenario
    expected = {
        "filter_step_s": repr(scenario.timing.filter_step_s),
        "seed": str(scenario.seed),
        "run": str(scenario.run),
    }
    for name, value in expected.items():
        if facts.get(name) != value:
            raise LogError(f"{path}: metadata laisn says {name} = {facts.get(name)}, its scenario {value}")
    vehicles = ("leader", *(follower.name for follower in scenario.followers))
    if flight.trajectory.names != vehicles:
        raise LogError(f"{path}: it holds {', '.join(flight.trajectory.names)}; its scenario has {', '.join(vehicles)}")


def _check_times(path: Path, flight: Flight, times: Sequence[Ints]) -> None:
    """The flight must begin where the mission does, have no gap, and end where its outcome says.

    Args:
        path: for messages.
        flight: as read.
        times: log times of the truth, then of every follower's filter steps [ns].
    """
    scenario, truth = flight.scenario, flight.trajectory
    clock, points = Clock(scenario.epoch), truth.time.size
    grid = clock.ns(CONTROL_STEP_S * np.arange(points))
    if not (np.array_equal(times[0], grid) and np.array_equal(clock.ns(truth.time), grid)):
        raise LogError(f"{path}: the truth does not come every {CONTROL_STEP_S:g} s from the start of the mission")
    n = (points - 1) // flight.stride
    if flight.outcome is Outcome.COMPLETED and n != scenario.filter_steps:
        raise LogError(
            f"{path}: a completed mission of {scenario.duration_s:g} s has {scenario.filter_steps} filter steps, "
            f"this log has {n}"
        )
    for name, steps_ns, m, e in zip(truth.names[1:], times[1:], flight.measurements, flight.estimates, strict=True):
        if not np.array_equal(steps_ns, clock.ns(m.dt * np.arange(1, n + 1))):
            raise LogError(f"{path}: the filter steps of {name} are not those of a flight of {n * m.dt:g} s")
        if not np.array_equal(np.unique(e.fix_step), m.message_step):
            raise LogError(f"{path}: {name} has receptions without a fix, or fixes without a reception")


def read(path: Path | str) -> Flight:
    """The flight that `sim.log.writer.write` wrote, equal to the bit.

    Raises:
        LogError: the log is damaged, or was not written by the simulator; the text names what is missing.
    """
    path = Path(path)
    log = contents(path, lambda topic, _: topic.endswith((*CORE, MIXTURE_TOPIC)))
    _add_empty_channels(log)
    missing = [f"attachment {name}" for name in (SCENARIO, VEHICLES) if name not in log.attachments]
    missing += [] if "laisn" in log.metadata else ["metadata laisn"]
    missing += [f"channel /NAME{suffix}" for suffix in CORE if not any(t.endswith(suffix) for t in log.topics)]
    if missing:
        raise LogError(
            f"{path}: holds no flight: it lacks {', '.join(missing)}; available: "
            f"{', '.join(sorted(log.topics)) or 'none of these channels'}. Navigation alone needs /FOLLOWER/motion and "
            "/FOLLOWER/reception: laisn replay LOG --scenario FILE"
        )
    with faults(path):
        text = log.attachments[SCENARIO].decode()
        scenario = scenario_file.validate(scenario_file.parse(text, SCENARIO), f"{path}, {SCENARIO}")
        trajectory = _trajectory(path, log)
        measured = [_measurements(path, log, name) for name in trajectory.names[1:]]
        estimates = [
            _estimates(path, log, name, steps_ns)
            for name, (_, steps_ns) in zip(trajectory.names[1:], measured, strict=True)
        ]
        flight = Flight(
            scenario=scenario,
            trajectory=trajectory,
            measurements=tuple(measurements for measurements, _ in measured),
            estimates=tuple(estimates),
            outcome=Outcome[log.metadata["laisn"]["outcome"]],
        )
        times = log.topics[f"/{trajectory.names[0]}/pose"].time_ns, *(steps_ns for _, steps_ns in measured)
        _check_times(path, flight, times)
        _check_facts(path, flight, log.metadata["laisn"])
        return flight
