"""The data of LAISN-Bench: missions flown with several seeds, as files with a manifest.

manifest.json                          what is there, and the SHA-256 of each file
tasks/MISSION.toml                     what a navigator may know, a scenario for `laisn replay`
measurements/MISSION/SEED/FOLLOWER.csv what a follower measured, at every filter step
truth/MISSION/SEED/FOLLOWER.csv        where its hydrophone was
"""

import hashlib
import json
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from experiments.benchmark.catalogue import VERSION, BenchmarkMission
from experiments.benchmark.tables import as_written, write_measurements, write_truth
from experiments.campaign.pool import Pool
from experiments.campaign.progress import progress
from experiments.flight.fly import fly
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.settings import TightSettings
from reports.bound import flight_bound
from reports.version import code_version
from sim.datasets.factor_graph import write_factor_graph
from sim.flight import FlightRecord, excerpt, settings_as
from sim.log.contents import CLOCK, START
from sim.log.ros2 import write_measurement_bag
from sim.log.schema import MEASURED, Clock
from sim.log.writer import further_readings, numeric, write_channels
from sim.scenario.settings import Acoustics
from sim.sensing.observation import start_of
from sim.system import atomic_write, remove_unfinished

MANIFEST = "manifest.json"
TASKS = "tasks"
MEASUREMENTS = "measurements"
TRUTH = "truth"
FORMATS = ("mcap", "ros2", "pyfg")
"""Further formats of the measurements: a log for `laisn replay`, a ROS 2 bag, and factor graphs."""
_AHEAD_S = 1000.0  # the routes in a task go straight on for so long: they give starts alone


def flown(mission: BenchmarkMission, seed: int, seconds: float | None = None) -> FlightRecord:
    """A mission, or its first seconds, with the measurements that its files hold."""
    flight, _ = fly(mission.scenario(seed))
    if seconds is not None and seconds < flight.trajectory.time[-1]:
        flight = excerpt(flight, 0.0, seconds)
    rounded = tuple(as_written(m, mission.transmitters) for m in flight.measurements)
    return replace(flight, measurements=rounded)


def truth_rows(flight: FlightRecord, follower: int) -> Floats:
    """Rows of a follower's truth table, shape (n, 8), as of `tables.TRUTH_COLUMNS`."""
    steps = flight.step_index()
    trajectory = flight.trajectory
    east, north, up = flight.hydrophone(follower).T
    leader = trajectory.position[steps, 0, :2]
    heading = np.degrees(trajectory.heading[steps, follower + 1])
    bound = flight_bound(_with_tight(flight), follower)
    return np.column_stack([trajectory.time[steps], east, north, -up, heading, leader, bound])


def _known_profile(acoustics: Acoustics) -> dict[str, Any]:
    """The profile of the speed of sound by which rays bend, where they do."""
    if acoustics.rays == "straight":
        return {}
    points = acoustics.sound_speed_profile or ()
    return {
        "rays": acoustics.rays,
        "sound_speed_profile": [list(map(float, point)) for point in points],
    }


def task_table(mission: BenchmarkMission, flight: FlightRecord) -> dict[str, Any]:
    """What a navigator may know of a mission, as the table of a scenario: starts, geometry of the
    transmitters, times, and what is assumed of errors.
    """
    scenario = flight.scenario
    trajectory = flight.trajectory

    def route_of(vehicle: int) -> dict[str, Any]:
        east, north, up = (round(float(value), 4) for value in trajectory.position[0, vehicle])
        velocity = trajectory.velocity[0, vehicle, :2].astype(np.float64)
        way_east, way_north = (round(float(v) * _AHEAD_S, 4) for v in velocity)
        return {
            "waypoints": [[0.0, east, north], [_AHEAD_S, east + way_east, north + way_north]],
            "depth_m": -up,
        }

    sound = scenario.acoustics
    sensors = [{"sensor": table.sensor} for table in scenario.sensors.custom]
    return {
        "name": mission.name,
        **({"sensors": {"custom": sensors}} if sensors else {}),
        "timing": {
            "filter_step_s": scenario.timing.filter_step_s,
            "message_interval_s": scenario.timing.message_interval_s,
        },
        "ocean": {"floor_depth_m": scenario.ocean.floor_depth_m},
        "leader": {
            **route_of(0),
            "baseline_m": scenario.leader.baseline_m,
            "middle_offset_m": scenario.leader.middle_offset_m,
            "broadcast_attitude": scenario.navigation.use_attitude,
        },
        "followers": [
            {"name": name, **route_of(i)} for i, name in enumerate(trajectory.names[1:], start=1)
        ],
        "acoustics": {
            "travel_time": sound.travel_time,
            "ping_slot_s": sound.ping_slot_s,
            "sound_speed_m_s": sound.sound_speed_m_s + sound.sound_speed_bias_m_s,
            **_known_profile(sound),
        },
        "navigation": {
            "variant": "tight",
            "use_attitude": scenario.navigation.use_attitude,
            "assume": mission.assume,
        },
    }


def _task_text(mission: BenchmarkMission, flight: FlightRecord) -> str:
    head = (
        f"# LAISN-Bench {VERSION}, {mission.name}: {mission.title}\n"
        "# Routes are not those of the mission: their first points are the starts.\n"
    )
    return head + tomli_w.dumps(task_table(mission, flight))


def _write_log(path: Path, flight: FlightRecord) -> None:
    """Measurements of all followers as a log for `laisn replay`."""
    clock = Clock(flight.scenario.epoch)
    channels = []
    for name, m in zip(flight.trajectory.names[1:], flight.measurements, strict=True):
        for record_type in MEASURED:
            step = np.arange(1, m.speed.size + 1)
            if record_type.steps:
                # records of messages: they stand at the steps of reception alone
                step = getattr(m, record_type.steps)
            names = [column.attribute for column in record_type.columns]
            arrays = {attribute: getattr(m, attribute) for attribute in names}
            channels.append(numeric(f"/{name}", record_type, clock.ns(m.dt * step), arrays))
        steps = np.arange(1, m.speed.size + 1)
        channels += further_readings(name, m, clock.ns(m.dt * steps))
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as unfinished:
        # its times are those of the mission, from which messages count too
        facts = {START: str(clock.epoch_ns)}
        write_channels(unfinished, channels, lambda mcap: mcap.write_metadata(CLOCK, facts))


def _write_graphs(folder: Path, flight: FlightRecord) -> None:
    """Measurements of each follower as a factor graph, its poses composed of the odometry."""
    for i, (name, m) in enumerate(
        zip(flight.trajectory.names[1:], flight.measurements, strict=True)
    ):
        start = start_of(flight.trajectory, i)
        speed = np.append(m.speed[:1], m.speed)
        heading = np.append(m.heading[:1], m.heading)
        time = np.append(0.0, m.time)
        displacement = (
            speed[1:, None] * m.dt * np.column_stack([np.sin(heading), np.cos(heading)])[1:]
        )
        dead_reckoned = start[:2] + np.vstack([np.zeros(2), np.cumsum(displacement, axis=0)])
        settings = settings_as(
            TightSettings, _with_tight(flight).scenario, flight.trajectory.sites, i
        )
        poses = np.column_stack([time, dead_reckoned, heading])
        write_factor_graph(m, settings, start, poses, folder / f"{name}.pyfg")


def _with_tight(flight: FlightRecord) -> FlightRecord:
    """The flight as if navigated by the tightly coupled navigator, whose settings state what is
    assumed of errors.
    """
    return replace(flight, scenario=flight.scenario.with_navigation(variant="tight"))


def write_run(
    folder: Path,
    mission: BenchmarkMission,
    seed: int,
    formats: Sequence[str],
    seconds: float | None = None,
) -> str:
    """Fly a mission with a seed and write its files, or those of its first seconds; its name,
    MISSION/SEED.
    """
    flight = flown(mission, seed, seconds)
    run = f"{mission.name}/{seed:02d}"
    measurements = folder / MEASUREMENTS / run
    names = flight.trajectory.names[1:]
    for i, (name, readings) in enumerate(zip(names, flight.measurements, strict=True)):
        write_measurements(measurements / f"{name}.csv", readings)
        write_truth(folder / TRUTH / run / f"{name}.csv", truth_rows(flight, i))
    if "mcap" in formats:
        _write_log(measurements / "measurements.mcap", flight)
    if "pyfg" in formats:
        _write_graphs(measurements, flight)
    if "ros2" in formats:
        write_measurement_bag(flight, measurements / "ros2")
    task = folder / TASKS / f"{mission.name}.toml"
    if not task.exists():
        task.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(task) as unfinished:
            unfinished.write_text(_task_text(mission, flight), encoding="utf-8", newline="\n")
    return run


def _require_free(folder: Path, missions: Sequence[BenchmarkMission], seeds: Sequence[int]) -> None:
    """LaisnError if the folder holds anything that is no data of the benchmark, or data that these
    missions and seeds would not replace.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise LaisnError(f"{folder}: is a file; the data of the benchmark need a folder")
    benchmark_names = (MANIFEST, TASKS, MEASUREMENTS, TRUTH)
    others = sorted(path.name for path in folder.iterdir() if path.name not in benchmark_names)
    lost = list[str]()
    # data of an interrupted command, or of another version, have no manifest to go by
    with suppress(LaisnError):
        manifest = read_manifest(folder)
        files = {path.relative_to(folder).as_posix() for path in _files_in(folder)}
        others += sorted(files - set(manifest["files"]))
        lost += sorted({*manifest["missions"]} - {mission.name for mission in missions})
        lost += [f"seed {seed}" for seed in manifest["seeds"] if seed not in seeds]
    if others:
        raise LaisnError(
            f"{folder}: holds {', '.join(others[:5])}; the data of the benchmark need a folder of "
            "their own"
        )
    if lost:
        raise LaisnError(
            f"{folder}: holds data of {', '.join(lost[:5])}{' …' if len(lost) > 5 else ''}, which "
            "would be removed; write these again, too, or choose another folder"
        )


def _files_in(folder: Path) -> list[Path]:
    """Files of the data in a folder, sorted."""
    return sorted(
        path
        for subfolder in (TASKS, MEASUREMENTS, TRUTH)
        for path in (folder / subfolder).rglob("*")
        if path.is_file()
    )


def _manifest(
    folder: Path, missions: Sequence[BenchmarkMission], seeds: Sequence[int], seconds: float | None
) -> dict[str, Any]:
    return {
        "benchmark": "LAISN-Bench",
        "version": VERSION,
        "code": code_version(),
        "missions": {mission.name: mission.title for mission in missions},
        "seeds": list(seeds),
        "seconds": seconds,  # None: whole missions
        "files": {
            path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in _files_in(folder)
        },
    }


def generate(
    folder: Path,
    missions: Sequence[BenchmarkMission],
    seeds: Sequence[int],
    formats: Sequence[str] = (),
    *,
    seconds: float | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Fly missions with several seeds and write their data, or those of their first seconds; the
    manifest.

    Data of the same missions and seeds that the folder held before are removed first. LaisnError if
    it holds other things.
    """
    unknown = [name for name in formats if name not in FORMATS]
    if unknown:
        raise LaisnError(f"format {unknown[0]!r}: expected {', '.join(FORMATS)}")
    _require_free(folder, missions, seeds)
    (folder / MANIFEST).unlink(missing_ok=True)
    for subfolder in (TASKS, MEASUREMENTS, TRUTH):
        shutil.rmtree(folder / subfolder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    # the first run writes the task of its mission, which no other process may do at the same time
    first, *remaining = [(mission, seed) for seed in seeds for mission in missions]
    try:
        with progress("missions", len(missions) * len(seeds)) as advance, Pool(workers) as pool:
            write_run(folder, *first, formats, seconds)
            advance(1)
            for _ in pool.each(write_run, ((folder, *run, formats, seconds) for run in remaining)):
                advance(1)
    finally:
        # workers are killed if something fails
        remove_unfinished(folder)
    manifest = _manifest(folder, missions, seeds, seconds)
    with atomic_write(folder / MANIFEST) as unfinished:
        unfinished.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")
    return manifest


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder; LaisnError if it holds no data of this version."""
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        version = manifest["version"]
        name = manifest["benchmark"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LaisnError(
            f"{path}: no manifest of LAISN-Bench ({error}); laisn bench-data {folder} writes the "
            "data"
        ) from error
    if (name, version) != ("LAISN-Bench", VERSION):
        raise LaisnError(f"{path}: {name} of version {version}, expected version {VERSION}")
    return dict(manifest)


def damaged_files(folder: Path) -> list[str]:
    """Files that are missing, or have another SHA-256 than the manifest says."""
    damaged = []
    for name, digest in read_manifest(folder)["files"].items():
        path = folder / name
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            damaged.append(name)
    return damaged
