"""Logs read back: the flight to the bit, or the measurements alone, of the simulator or of a real vehicle."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from laisn.arrays import Ints
from laisn.estimates import Estimates
from laisn.messages import Measurements
from sim.flight import Flight, Outcome
from sim.log.clock import Clock
from sim.log.contents import Contents
from sim.log.file import FLIGHT, SCENARIO, VEHICLES, LogError, faults
from sim.log.schema import (
    DERIVED,
    DETAILS,
    FILTER_STATE,
    FIX,
    OWN_MOTION,
    POSE,
    RECEPTION,
    RecordType,
    vehicle_state,
)
from sim.log.vehicle_log import LONGEST_GAP_S, Recording, recording
from sim.scenario import file as scenario_file
from sim.scenario.settings import CONTROL_STEP_S
from sim.trajectory import Trajectory

CORE = (POSE, vehicle_state(()), OWN_MOTION, RECEPTION, FILTER_STATE, FIX)
"""Channels that make up a flight, with the details of its navigator; all others are drawn from them."""
_DETAIL_TYPES = tuple(type_ for _, type_ in DETAILS.values())


def _read(log: Contents, name: str, type_: RecordType) -> tuple[Ints, dict[str, Any]]:
    """Times of a vehicle's messages, shape (n,), [ns], and arrays; channels without messages are not in a file."""
    topic = f"/{name}/{type_.topic}"
    if type_ in (RECEPTION, FIX, *_DETAIL_TYPES):
        log.add_empty(topic, type_)
    messages = log.require(topic, type_.fields)
    return messages.time_ns, type_.arrays(messages.table)


def _steps(path: Path, topic: str, time_ns: Ints, steps_ns: Ints) -> Ints:
    """Filter step at which each message is available: the first at or after its time."""
    step = np.searchsorted(steps_ns, time_ns).astype(np.int64) + 1
    if step.size and step[-1] > steps_ns.size:
        raise LogError(f"{path}: {topic} goes on after the last filter step")
    return step


def _own_and_received(path: Path, log: Contents, name: str, dt: float) -> tuple[Measurements, Ints]:
    """Measurements of a follower in a flight, and the times of its filter steps, shape (n,), [ns]."""
    steps_ns, motion = _read(log, name, OWN_MOTION)
    heard_ns, received = _read(log, name, RECEPTION)
    step = _steps(path, f"/{name}/reception", heard_ns, steps_ns)
    return Measurements(dt=dt, message_step=step, **motion, **received), steps_ns


def _estimates(path: Path, log: Contents, name: str, steps_ns: Ints, facts: dict[str, str]) -> Estimates:
    filter_ns, filtered = _read(log, name, FILTER_STATE)
    fix_ns, fixes = _read(log, name, FIX)
    if not np.array_equal(filter_ns, steps_ns):
        raise LogError(f"{path}: /{name}/filter and /{name}/motion are not at the same times")
    found = {**filtered, **fixes, "fix_step": _steps(path, f"/{name}/innovation", fix_ns, steps_ns)}
    for topic, (kind, type_) in DETAILS.items():
        if facts.get(topic) == "True":
            details_ns, details = _read(log, name, type_)
            if not np.array_equal(details_ns, fix_ns):
                raise LogError(f"{path}: /{name}/{topic} is not at the times of the fixes")
            return kind(**found, **details)
    return Estimates(**found)


def _trajectory(path: Path, log: Contents) -> tuple[Trajectory, Ints]:
    """The truth and its times, shape (n,), [ns]."""
    table = json.loads(log.attachments[VEHICLES])
    names, sites, effectors = tuple(table["names"]), table["sites"], table["effectors"] or [[] for _ in table["names"]]
    most = max(len(own) for own in effectors)
    found, grid = dict[str, list[Any]](), np.empty(0, dtype=np.int64)
    force = np.zeros((len(names), most, 3))
    for v, (name, own) in enumerate(zip(names, effectors, strict=True)):
        force[v, : len(own)] = np.reshape([effector["force"] for effector in own], (-1, 3))
        pose_ns, arrays = _read(log, name, POSE)
        state_ns, state = _read(log, name, vehicle_state(tuple(effector["name"] for effector in own)))
        grid = grid if v else pose_ns
        if not (np.array_equal(pose_ns, grid) and np.array_equal(state_ns, grid)):
            raise LogError(f"{path}: the channels of {name} are not at the times of the leader's")
        state["thrust"] = np.pad(state["thrust"], ((0, 0), (0, most - len(own))))
        for attribute, array in (arrays | state).items():
            found.setdefault(attribute, []).append(array)
    for group in DERIVED:
        del found[group.attribute]
    truth = Trajectory(
        names=names,
        time=found.pop("time")[0],
        site_names=tuple(site["name"] for site in sites),
        site_vehicle=np.array([site["vehicle"] for site in sites], dtype=np.int64),
        site_offset=np.array([site["offset"] for site in sites], dtype=np.float64).reshape(-1, 3),
        effector_names=tuple(tuple(effector["name"] for effector in own) for own in table["effectors"]),
        effector_force=force,
        **{attribute: np.stack(arrays, axis=1) for attribute, arrays in found.items()},
    )
    return truth, grid


def _check(path: Path, flight: Flight, facts: Mapping[str, str], truth_ns: Ints, steps_ns: Sequence[Ints]) -> None:
    """LogError unless metadata, scenario and channels belong together, and the flight has neither gap nor other end."""
    scenario, truth = flight.scenario, flight.trajectory
    clock, points = Clock(scenario.epoch), truth.time.size
    grid, n = clock.ns(CONTROL_STEP_S * np.arange(points)), (points - 1) // flight.stride
    vehicles = ("leader", *(follower.name for follower in scenario.followers))
    expected = {"filter_step_s": scenario.timing.filter_step_s, "seed": scenario.seed, "run": scenario.run}
    checks = [
        (facts.get(name) == repr(value), f"metadata laisn says {name} = {facts.get(name)}, its scenario {value}")
        for name, value in expected.items()
    ]
    checks += [
        (truth.names == vehicles, f"it holds {', '.join(truth.names)}; its scenario has {', '.join(vehicles)}"),
        (
            np.array_equal(truth_ns, grid) and np.array_equal(clock.ns(truth.time), grid),
            f"the truth does not come every {CONTROL_STEP_S:g} s from the start of the mission",
        ),
        (
            flight.outcome is not Outcome.COMPLETED or n == scenario.filter_steps,
            f"a completed mission of {scenario.duration_s:g} s has {scenario.filter_steps} filter steps, "
            f"this log has {n}",
        ),
    ]
    for name, at, m, e in zip(truth.names[1:], steps_ns, flight.measurements, flight.estimates, strict=True):
        own = np.array_equal(at, clock.ns(m.dt * np.arange(1, n + 1)))
        fixed = np.array_equal(np.unique(e.fix_step), m.message_step)
        checks.append((own, f"the filter steps of {name} are not those of a flight of {n * m.dt:g} s"))
        checks.append((fixed, f"{name} has receptions without a fix, or fixes without a reception"))
    for correct, text in checks:
        if not correct:
            raise LogError(f"{path}: {text}")


def read(path: Path | str) -> Flight:
    """The flight that `sim.log.writer.write` wrote, equal to the bit.

    Raises:
        LogError: the log is damaged, or was not written by the simulator; the text names what is missing.
    """
    path = Path(path)
    suffixes = tuple(f"/{type_.topic}" for type_ in CORE)
    log = Contents(path, lambda topic, _: topic.endswith((*suffixes, *(f"/{topic}" for topic in DETAILS))))
    missing = [f"attachment {name}" for name in (SCENARIO, VEHICLES) if name not in log.attachments]
    missing += [] if FLIGHT in log.metadata else [f"metadata {FLIGHT}"]
    if missing:
        raise LogError(
            f"{path}: holds no flight: it lacks {', '.join(missing)}; available: "
            f"{', '.join(sorted(log.topics)) or 'no channels'}. Navigation alone needs /FOLLOWER/motion and "
            "/FOLLOWER/reception: laisn replay LOG --scenario FILE"
        )
    with faults(path):
        facts = log.metadata[FLIGHT]
        scenario = scenario_file.validate(
            scenario_file.parse(log.attachments[SCENARIO].decode(), SCENARIO), f"{path}, {SCENARIO}"
        )
        trajectory, truth_ns = _trajectory(path, log)
        followers = trajectory.names[1:]
        measured = [_own_and_received(path, log, name, float(facts["filter_step_s"])) for name in followers]
        steps_ns = [at for _, at in measured]
        estimates = [_estimates(path, log, name, at, facts) for name, at in zip(followers, steps_ns, strict=True)]
        flight = Flight(
            scenario=scenario,
            trajectory=trajectory,
            measurements=tuple(measurements for measurements, _ in measured),
            estimates=tuple(estimates),
            outcome=Outcome[facts["outcome"]],
        )
        _check(path, flight, facts, truth_ns, steps_ns)
        return flight


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
    log = Contents(Path(path), lambda topic, _: topic in (f"/{follower}/motion", f"/{follower}/reception"))
    if FLIGHT in log.metadata:
        log.add_empty(f"/{follower}/reception", RECEPTION)
    return recording(log, follower, longest_gap_s)


def read_measurements(path: Path | str, follower: str = "follower") -> Measurements:
    """The measurements that `read_recording` finds, without its remarks."""
    return read_recording(path, follower).measurements
