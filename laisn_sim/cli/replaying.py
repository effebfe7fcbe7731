"""Navigation on measurements of logs and data sets, fixed-lag smoothing, and the contents of a
log.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
from rich.console import Console

from experiments.campaign.progress import literal, print_line, show_table
from experiments.campaign.store import write_csv
from experiments.flight.fly import navigate_again
from experiments.flight.folder import title_of
from experiments.flight.library import load_scenario
from experiments.flight.results import log_flight
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.navigators import NAVIGATORS, NavigatorFactory, find
from laisn.settings import NavigationSettings, TightSettings
from laisn_sim.cli.fly import show
from laisn_sim.cli.outputs import OutputFile, optional_output, output_file
from reports.bound import flight_bound
from reports.replay_page import Replayed, write_replay_page
from reports.summary import consistency, summarise
from sim.datasets.factor_graph import write_factor_graph
from sim.datasets.log import VEHICLE, read_data_set_log
from sim.flight import FlightRecord, navigation_settings, settings_as
from sim.log.contents import Contents
from sim.log.reader import Pings, read, read_recording
from sim.scenario.file import values_of
from sim.scenario.parts import MotionSettings
from sim.sensing.observation import start_of
from sim.simulation import simulate_motion, starts_of

_LARGE = 1e5  # errors beyond this are printed by their order of magnitude [m]


def _number_text(error: float) -> str:
    if math.isnan(error):
        return "–"
    return f"{error:.2f}" if error < _LARGE else f"{error:.0e}"


def replay(
    path: Path,
    variant: str,
    assignments: Iterable[str],
    out: Path | None,
    smooth_s: float | None = None,
) -> None:
    """Navigate on the measurements of a flight's log and print errors beside those of the log.

    `out` is a log for the new estimates, which are smoothed with messages of up to `smooth_s`
    later.
    """
    output = optional_output(out, [".mcap"], [path])
    smoothing = _smoother(variant, smooth_s)
    flown = read(path)
    changes = values_of([f"navigation.variant={variant}", *assignments])
    replayed = navigate_again(flown, changes)
    smoothed = replayed if smoothing is None else navigate_again(flown, changes, smoothing)
    console = Console()
    for title, flight in (
        (f"as flown, {flown.scenario.variants}", flown),
        (f"replayed, {variant}", replayed),
    ):
        console.print(literal(title, "bold"))
        show(console, flight, summarise(flight))
    if smooth_s is not None:
        _show_smoothing(console, replayed, smoothed, smooth_s)
    if output is not None:
        log_flight(smoothed, output.path)
        print_line(console, f"log in {output}")


def replay_measurements(
    path: Path,
    source: str,
    assignments: Iterable[str],
    out: Path | None,
    longest_gap_s: float,
    smooth_s: float | None,
) -> None:
    """Navigate on the log of a real vehicle, without a true path; print the last estimates and
    write a page.

    The log has `/NAME/motion` and `/NAME/reception` of every follower of the scenario `source`. Of
    the scenario, names and starts of the followers, the leader's baseline and the navigation are
    used; the filter steps are those of the log. A single range of a message is used, unless the
    scenario sets `use_single_range = false`. LogError if two own measurements are further apart
    than `longest_gap_s`.
    """
    output = optional_output(out, [".csv"], [path])
    scenario = load_scenario(source, assignments, flyable=True)
    navigations = [scenario.navigation, *(f.navigation for f in scenario.followers)]
    if all(n is None or "use_single_range" not in n.model_fields_set for n in navigations):
        scenario = scenario.with_navigation(use_single_range=True)
    sound = scenario.acoustics
    pings = Pings(sound.ping_slot_s, sound.sound_speed_m_s)
    motion = starts_of(MotionSettings.of(scenario), scenario.leader)
    heads = ("follower", "steps", "Δt [s]", "fixes", "x [m]", "y [m]")
    rows = list[list[str]]()
    remarks = list[str]()
    vehicles = list[Replayed]()
    for i, name in enumerate(motion.names[1:]):
        variant = scenario.navigation_of(i).variant
        factory = _smoother(variant, smooth_s) or find(variant).make
        measurements, file_remarks, time_s = read_recording(path, name, longest_gap_s, pings)
        remarks += file_remarks
        settings = replace(navigation_settings(scenario, motion.sites, i), dt=measurements.dt)
        try:
            estimates = factory(settings, start_of(motion, i)).run(measurements)
        except ArithmeticError as error:
            raise LaisnError(f"{path}: {name}: the navigator diverged: {error}") from error
        except LaisnError as error:
            when = _time_of_step(str(error), time_s)
            raise LaisnError(f"{path}: {name}: {when}{error}") from error
        baseline = scenario.leader.baseline_m or math.nan
        vehicle = Replayed(
            name=name,
            measurements=measurements,
            estimates=estimates,
            time=time_s,
            baseline=baseline,
        )
        x, y = estimates.state[-1, :2]
        rows.append(
            [
                name,
                f"{len(estimates.state)}",
                f"{measurements.dt:g}",
                vehicle.fixes,
                f"{x:.2f}",
                f"{y:.2f}",
            ]
        )
        vehicles.append(vehicle)
    show_table(Console(), heads, rows)
    _write_replay(vehicles, path, scenario.variants, list(dict.fromkeys(remarks)), output)


def _time_of_step(text: str, times: Floats) -> str:
    """When the step is that an error of a navigator begins with, for a message; "" if it names
    none. Times are those at which the steps end, by the log, shape (n,), [s].
    """
    step = re.match(r"step (\d+):", text)
    if step is None or not 1 <= int(step[1]) <= times.size:
        return ""
    return f"at {times[int(step[1]) - 1]:.10g} s, "


def _write_replay(
    vehicles: Sequence[Replayed],
    log: Path,
    navigator: str,
    remarks: Sequence[str],
    output: OutputFile | None,
) -> None:
    """Print the remarks on a log, and write the estimates into a CSV file and the page into
    out/replay; times are those of the log.
    """
    console = Console()
    columns = ("follower", "time_s", "x_m", "y_m", "vx_m_s", "vy_m_s", "xx_m2", "xy_m2", "yy_m2")
    for remark in remarks:
        print_line(console, remark, "note:")
    if output is not None:
        write_csv(
            output.path,
            [
                dict(zip(columns, (vehicle.name, time_s, *state, *variances), strict=True))
                for vehicle in vehicles
                for time_s, state, variances in zip(
                    vehicle.time.tolist(),
                    vehicle.estimates.state.tolist(),
                    vehicle.estimates.covariance[:, [0, 0, 1], [0, 1, 1]].tolist(),
                    strict=True,
                )
            ],
        )
        print_line(console, output)
    page = output_file(Path("out") / "replay" / f"{title_of(log)}.html", [".html"])
    write_replay_page(vehicles, log, navigator, remarks, page.path)
    print_line(console, f"report in {page}")


def export_factor_graphs(path: Path, out: Path) -> list[Path]:
    """Write what each follower of a flight measured as `out`/FOLLOWER.pyfg, with its true path;
    gives the files.
    """
    flight = read(path)
    tight = flight.scenario.with_navigation(variant="tight")
    out.mkdir(parents=True, exist_ok=True)
    steps = np.append(0, flight.step_index())
    files = []
    for i, name in enumerate(flight.trajectory.names[1:]):
        positions = flight.trajectory.site_path(f"{name}/hydrophone", steps)
        # time [s], east and north [m], heading [rad]
        truth = np.column_stack(
            [
                flight.trajectory.time[steps],
                positions[:, :2],
                flight.trajectory.heading[steps, i + 1],
            ]
        )
        settings = settings_as(TightSettings, tight, flight.trajectory.sites, i)
        start = start_of(flight.trajectory, i)
        files.append(
            write_factor_graph(flight.measurements[i], settings, start, truth, out / f"{name}.pyfg")
        )
    return files


def show_info(path: Path) -> None:
    """Print what a log holds; LogError if it cannot be read."""
    # no message is kept, only their times
    log = Contents(path, lambda topic, _: False)
    console = Console()
    times = [time for messages in log.topics.values() for time in messages.times]
    begin = min(times, default=0)
    end = max(times, default=0)
    start = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=begin // 1000)
    print_line(
        console,
        f"{path}: {path.stat().st_size / 1e6:.2f} MB, {(end - begin) / 1e9:g} s from "
        f"{start.isoformat()}",
    )
    topics = sorted(log.topics.items())
    rows = [
        (topic, messages.schema.name if messages.schema else "", str(len(messages.times)))
        for topic, messages in topics
    ]
    show_table(console, ("channel", "schema", "messages"), rows)
    for name, data in log.attachments.items():
        print_line(console, f"attachment {name}: {len(data)} bytes")
    for name, record in log.metadata.items():
        print_line(console, f"metadata {name}: {', '.join(f'{k}={v}' for k, v in record.items())}")
    for content in log.unverified:
        print_line(console, f"{content}: no checksum, damage is not detected", "note:")


def _smoother(variant: str, lag_s: float | None) -> NavigatorFactory | None:
    """Factory of navigators that smooth with messages of up to `lag_s` later, None for None;
    LaisnError if invalid.
    """
    if lag_s is None:
        return None
    if not math.isfinite(lag_s):
        raise LaisnError(f"--smooth {lag_s}: expected a finite time in seconds")
    smoother = find(variant).smoother
    if not smoother:
        names = " or ".join(
            f"--variant {name}" for name, spec in NAVIGATORS.items() if spec.smoother
        )
        raise LaisnError(f"--smooth: {variant} has no smoother; add {names}")
    return partial(resolve_name(smoother), lag=lag_s)


def _show_smoothing(
    console: Console, filtered: FlightRecord, smoothed: FlightRecord, lag_s: float
) -> None:
    """Print RMS errors of every follower, their bounds, and NEES, filtered and smoothed."""
    rows = list[list[str]]()
    for i, name in enumerate(filtered.trajectory.names[1:]):
        row = [name]
        for flight, lag in ((filtered, 0.0), (smoothed, lag_s)):
            values = consistency(flight, i, flight_bound(filtered, i, lag))
            bound = values["bound_rms_m"]
            ratio = values["rms_over_bound"]
            # RMS error = its ratio to the bound × the bound
            rms = ratio * bound if ratio and bound else None
            cells = (rms, bound, values["nees"])
            row += ["–" if value is None else f"{value:.3f}" for value in cells]
        rows.append(row)
    heads = (
        "follower",
        *("RMS E_P [m]", "bound [m]", "NEES"),
        *("smoothed: RMS [m]", "bound [m]", "NEES"),
    )
    show_table(console, heads, rows, f"smoothed with messages of up to {lag_s:g} s later")


def replay_data_set(
    path: Path, variant: str, assignments: Sequence[str], out: Path | None, longest_gap_s: float
) -> None:
    """Navigate on the log of a data set; print errors beside those of dead reckoning and write a
    page. LogError if two own measurements are further apart than `longest_gap_s`.
    """
    # filters that take half a second to load, and that no other command of logs needs
    from experiments.beacon_replay import (
        beacon_settings,
        dead_reckoning,
        navigate_among_beacons,
        navigate_by_laisn,
        score,
    )

    output = optional_output(out, [".csv"], [path])
    takes_beacons = find(variant).beacons
    values = values_of(assignments)
    log = read_data_set_log(path, longest_gap_s)
    section = "beacons." if takes_beacons else "navigation."
    for key in values:
        if not key.startswith(section):
            raise LaisnError(
                f"--set: expected {section}… for the variant {variant} in a data set (given: {key})"
            )
    if takes_beacons:
        keys = {key.removeprefix(section): value for key, value in values.items()}
        # air or water, through which the ranges were measured
        estimates, medium = navigate_among_beacons(log, beacon_settings(keys))
        title = f"{variant}, in {medium}"
    else:
        # of this scenario only the settings of navigation are used
        changes = [
            f"navigation.variant={variant}",
            "navigation.use_single_range=true",
            *assignments,
        ]
        scenario = load_scenario("T5", [*changes, "motion=kinematic", "duration_s=2"], flyable=True)
        motion = simulate_motion(scenario)
        navigation = settings_as(NavigationSettings, scenario, motion.sites, 0)
        estimates = navigate_by_laisn(log, navigation)
        title = variant
    measurements = log.measurements
    heads = ("", "mean error [m]", "RMS [m]", "95 % [m]", "NEES", "ends at x, y [m]")
    results = {"dead reckoning": dead_reckoning(log), title: estimates}
    scores = {name: score(result, measurements, log.truth) for name, result in results.items()}
    rows = []
    for name, result in results.items():
        x, y = result.state[-1, :2]
        rows.append([name, *map(_number_text, scores[name]), f"{x:.2f}, {y:.2f}"])
    show_table(Console(), heads, rows)
    begin_s = log.time_s[0] - measurements.time[0]
    vehicle = Replayed(
        name=VEHICLE,
        measurements=measurements,
        estimates=estimates,
        time=log.time_s,
        path=log.truth + np.array([begin_s, 0.0, 0.0]),
        mean_error=scores[title].mean,
    )
    _write_replay([vehicle], path, title, log.remarks, output)
