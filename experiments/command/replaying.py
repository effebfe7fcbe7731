"""Navigation on measurements of logs and data sets, fixed-lag smoothing, and the contents of a log."""

import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

from rich.console import Console

from experiments.campaign.bound import flight_bound
from experiments.campaign.progress import literal, show_table, tell
from experiments.flight.summary import consistency, position_and_bearing_errors, summarise
from experiments.pages.replay_page import Replayed, write_replay_page
from laisn.arrays import Floats
from laisn.estimates import FixKind
from laisn.failure import LaisnError
from laisn.navigators import NAVIGATORS, NavigatorFactory, find
from laisn.settings import NavigationSettings
from sim.flight import Flight, navigation_settings, settings_as
from sim.scenario.file import values_of

_LARGE = 1e5
"""Errors beyond this are printed by their order of magnitude [m]."""


def require_own_file(out: Path | None, suffix: str, source: Path) -> None:
    """LaisnError if an output file has the wrong suffix or is the log that is read."""
    if out is None:
        return
    if out.suffix != suffix:
        raise LaisnError(f"--out {out}: should end in {suffix}")
    if out.exists() and source.exists() and out.samefile(source):
        raise LaisnError(f"--out {out}: is the log that is read; give the new one another name")


def write_states(out: Path, states: Iterable[tuple[str, Floats, Floats]]) -> None:
    """Write estimates as CSV: of each follower its name, times, shape (n,), and states [x, y, vx, vy], shape (n, 4)."""
    from experiments.campaign.store import write_csv

    columns = ("x_m", "y_m", "vx_m_s", "vy_m_s")
    rows = [
        {"follower": name, "time_s": time_s, **dict(zip(columns, values, strict=True))}
        for name, times, state in states
        for time_s, values in zip(times.tolist(), state.tolist(), strict=True)
    ]
    write_csv(out, rows)


def replay(
    path: Path, variant: str, assignments: Iterable[str], out: Path | None, smooth_s: float | None = None
) -> None:
    """Navigate on the measurements of a flight's log and print errors beside those of the log.

    Args:
        path: log of a flight.
        variant: name of the navigator.
        assignments: overrides of the scenario's navigation, `navigation.key=value`.
        out: log for the new estimates, smoothed if they are; None: none.
        smooth_s: smooth with messages of up to this much later [s], and print the effect; None: no smoothing.

    Raises:
        LaisnError: the log cannot be read, an argument is invalid, or the variant cannot be smoothed.
    """
    from experiments.command.fly import show
    from experiments.flight.fly import navigate_again
    from sim.log import reader, writer

    require_own_file(out, ".mcap", path)
    smoothing = smoothing_factory(variant, smooth_s)
    flown = reader.read(path)
    changes = values_of([f"navigation.variant={variant}", *assignments])
    again = navigate_again(flown, changes)
    smoothed = again if smoothing is None else navigate_again(flown, changes, smoothing)
    console = Console()
    for title, flight in ((f"as flown, {flown.scenario.navigation.variant}", flown), (f"replayed, {variant}", again)):
        console.print(literal(title, "bold"))
        show(console, flight, summarise(flight, position_and_bearing_errors(flight)))
    if smooth_s is not None:
        show_smoothing(console, again, smoothed, smooth_s)
    if out is not None:
        errors = position_and_bearing_errors(smoothed)
        writer.write(smoothed, out, summary=json.dumps(summarise(smoothed, errors), indent=2) + "\n", errors=errors)
        tell(console, f"log in {out}")


def replay_measurements(
    path: Path, source: str, assignments: Iterable[str], out: Path | None, longest_gap_s: float, smooth_s: float | None
) -> None:
    """Navigate on the log of a real vehicle, without a true path; print the last estimates and write a page.

    A single range of a message is used, unless the scenario sets `use_single_range = false`.

    Args:
        path: log with `/NAME/motion` and `/NAME/reception` of every follower of the scenario.
        source: scenario, of which followers' names and starts, the leader's baseline and the navigation are used; the
            filter steps are the log's.
        assignments: overrides of the scenario.
        out: CSV file for the estimates after each step; None: none.
        longest_gap_s: longest gap between own measurements that is bridged [s].
        smooth_s: as of `replay`.

    Raises:
        LaisnError: as of `replay`; the scenario is invalid, or the log has too long a gap or lacks a channel.
    """
    from experiments.flight.library import load_flyable
    from sim.log import reader
    from sim.motion import simulate_motion
    from sim.sensing.observation import start_of

    require_own_file(out, ".csv", path)
    scenario = load_flyable(source, assignments)
    navigation = scenario.navigation
    make = smoothing_factory(navigation.variant, smooth_s) or find(navigation.variant).make
    if "use_single_range" not in navigation.model_fields_set:
        single = navigation.model_copy(update={"use_single_range": True})
        scenario = scenario.model_copy(update={"navigation": single})
    # two steps are enough for the starts of the routes
    short = {"motion": "kinematic", "duration_s": 2 * scenario.timing.filter_step_s}
    begin = simulate_motion(scenario.model_copy(update=short))
    heads = ("follower", "steps", "Δt [s]", "fixes", "x [m]", "y [m]")
    rows: list[list[str]] = []
    states: list[tuple[str, Floats, Floats]] = []
    remarks: list[str] = []
    replayed: list[Replayed] = []
    for i, name in enumerate(begin.names[1:]):
        measured, found = reader.read_recording(path, name, longest_gap_s)
        remarks += found
        settings = replace(navigation_settings(scenario, begin, i), dt=measured.dt)
        estimates = make(settings, start_of(begin, i)).run(measured)
        kinds = Counter(estimates.fix_kind.tolist())
        counts = ", ".join(f"{kinds[kind]} {kind.name.lower().replace('_', ' ')}" for kind in FixKind if kinds[kind])
        x, y = estimates.state[-1, :2]
        rows.append([name, f"{len(estimates.state)}", f"{measured.dt:g}", counts or "none", f"{x:.2f}", f"{y:.2f}"])
        states.append((name, measured.time, estimates.state))
        baseline = scenario.leader.baseline_m or math.nan
        replayed.append(Replayed(name=name, measured=measured, estimates=estimates, baseline=baseline))
    console = Console()
    show_table(console, heads, rows)
    for remark in dict.fromkeys(remarks):
        tell(console, remark, "note:")
    if out is not None:
        write_states(out, states)
        tell(console, out)
    _write_page(console, replayed, path, navigation.variant, list(dict.fromkeys(remarks)))


def _write_page(
    console: Console, replayed: Sequence[Replayed], log: Path, navigator: str, remarks: Sequence[str]
) -> None:
    """Write the page of a replay into out/replay and print its path."""
    page = Path("out") / "replay" / f"{log.stem}.html"
    write_replay_page(replayed, log, navigator, remarks, page)
    tell(console, f"report in {page}")


def show_info(path: Path) -> None:
    """Print what a log holds; LogError if it cannot be read."""
    from sim.log.contents import Contents

    log, console = Contents(path, lambda topic, _: False), Console()
    begin, end = log.span_ns or (0, 0)
    start = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=begin // 1000)
    tell(console, f"{path}: {path.stat().st_size / 1e6:.2f} MB, {(end - begin) / 1e9:g} s from {start.isoformat()}")
    rows = [
        (topic, messages.schema.name if messages.schema else "", str(messages.count))
        for topic, messages in sorted(log.topics.items())
    ]
    show_table(console, ("channel", "schema", "messages"), rows)
    for name, data in log.attachments.items():
        tell(console, f"attachment {name}: {len(data)} bytes")
    for name, record in log.metadata.items():
        tell(console, f"metadata {name}: {', '.join(f'{k}={v}' for k, v in record.items())}")
    for what in log.unverified:
        tell(console, f"{what}: no checksum, damage cannot be noticed", "note:")


def smoothing_factory(variant: str, lag_s: float | None) -> NavigatorFactory | None:
    """A factory of navigators that smooth with messages of up to a lag later [s]; None without a lag.

    Raises LaisnError if the lag is not finite, or the navigator cannot be smoothed.
    """
    if lag_s is None:
        return None
    if not math.isfinite(lag_s):
        raise LaisnError(f"--smooth {lag_s}: expected a finite time in seconds")
    smoother = find(variant).smoother
    if not smoother:
        able = " or ".join(f"--variant {name}" for name, spec in NAVIGATORS.items() if spec.smoother)
        raise LaisnError(f"--smooth: {variant} cannot be smoothed; add {able}")
    return partial(resolve_name(smoother), lag=lag_s)


def show_smoothing(console: Console, filtered: Flight, smoothed: Flight, lag_s: float) -> None:
    """Print RMS errors of every follower, their bounds, and NEES, filtered and smoothed."""
    rows = []
    for i, name in enumerate(filtered.trajectory.names[1:]):
        row = [name]
        for flight, lag in ((filtered, 0.0), (smoothed, lag_s)):
            found = consistency(flight, i, flight_bound(filtered, i, lag))
            bound, over = found["bound_rms_m"], found["rms_over_bound"]
            values = (over * bound if over and bound else None, bound, found["nees"])
            row += ["–" if value is None else f"{value:.3f}" for value in values]
        rows.append(row)
    heads = ("follower", *("RMS E_P [m]", "bound [m]", "NEES"), *("smoothed: RMS [m]", "bound [m]", "NEES"))
    show_table(console, heads, rows, f"smoothed with messages of up to {lag_s:g} s later")


def import_data_set(source: Path, out: Path, beacons: str | None) -> None:
    """Write a data set, or the table of a vehicle's measurements, as a log.

    Args:
        source: factor graph, data set of ranging radios, or table with named columns.
        out: the log.
        beacons: names of those whose ranges are kept, with commas between; None: all.

    Raises:
        LaisnError: the file cannot be read or lacks a beacon, or the log's name is invalid.
    """
    from sim.datasets.log import VEHICLE, read_data_set, write_data_set, write_vehicle_table
    from sim.datasets.vehicle_table import read_vehicle_table

    require_own_file(out, ".mcap", source)
    if source.suffix in (".csv", ".tsv") and not source.stem.endswith("_DR"):
        if beacons is not None:
            raise LaisnError(f"--beacons {beacons}: {source} holds a vehicle's own table, whose ranges have no beacons")
        table = read_vehicle_table(source)
        write_vehicle_table(table, out, "follower")
        for remark in table.remarks:
            tell(Console(), remark)
        tell(Console(), f"log in {out}; navigate on it with: laisn replay {out} --scenario FILE")
        return
    data = read_data_set(source)
    if beacons is not None:
        data = data.among([name.strip() for name in beacons.split(",") if name.strip()])
    write_data_set(data, out)
    console = Console()
    tell(console, f"{VEHICLE}: {len(data.odometry)} steps of odometry in {data.time[-1] - data.time[0]:.1f} s")
    for i, (name, (east, north)) in enumerate(zip(data.beacons, data.places[:, :2], strict=True)):
        ranges = (data.range_beacon == i).sum()
        tell(console, f"beacon {name} at {east:.2f} m east, {north:.2f} m north: {ranges} ranges")
    tell(console, f"path to compare with: {len(data.truth)} places")
    for remark in data.remarks:
        tell(console, remark, "note:")
    tell(console, f"log in {out}")


def _split(assignments: Iterable[str]) -> tuple[list[str], dict[str, object]]:
    """Assignments `navigation.…`, and values of `beacons.…` by key; LaisnError naming any other key."""
    navigation: list[str] = []
    beacons: dict[str, object] = {}
    for assignment in assignments:
        ((key, value),) = values_of([assignment]).items()
        section, _, name = key.partition(".")
        if section == "beacons":
            beacons[name] = value
        elif section == "navigation":
            navigation.append(assignment)
        else:
            raise LaisnError(f"--set {key}: a replay of a data set takes navigation.… (LAISN) and beacons.… (tight)")
    return navigation, beacons


def replay_data_set(
    path: Path, variant: str, assignments: Sequence[str], out: Path | None, longest_gap_s: float
) -> None:
    """Navigate on the log of a data set; print errors beside those of dead reckoning and write a page.

    Args:
        path: log that `import_data_set` wrote.
        variant: name of a LAISN variant, or "tight".
        assignments: overrides, `navigation.key=value` of LAISN or `beacons.key=value` of the navigator among beacons.
        out: CSV file for the estimates; None: none.
        longest_gap_s: longest gap between own measurements that is bridged [s].

    Raises:
        LaisnError: the log cannot be read, or an argument is invalid.
    """
    from experiments.flight.library import load_flyable
    from experiments.real_ranges.navigating import among_beacons, by_laisn, dead_reckoning, score
    from experiments.real_ranges.settings import beacons_of
    from sim.datasets.log import VEHICLE, read_data_set_log
    from sim.motion import simulate_motion

    require_own_file(out, ".csv", path)
    navigation, beacons = _split(assignments)
    settings_of_beacons = beacons_of(beacons)
    recorded = read_data_set_log(path, longest_gap_s)
    if find(variant).beacons:
        if navigation:
            raise LaisnError(f"--set {navigation[0]}: the variant {variant} takes beacons.… in a data set")
        estimates, medium = among_beacons(recorded, settings_of_beacons)
        title = f"{variant}, in {medium}"
    else:
        if beacons:
            able = " or ".join(name for name, spec in NAVIGATORS.items() if spec.beacons)
            raise LaisnError(f"--set beacons.{next(iter(beacons))}: is for the variant {able}")
        # of this scenario only the settings of navigation are used
        changes = [f"navigation.variant={variant}", "navigation.use_single_range=true", *navigation]
        scenario = load_flyable("T5", [*changes, "motion=kinematic", "duration_s=2"])
        settings = settings_as(NavigationSettings, scenario, simulate_motion(scenario), 0)
        estimates, title = by_laisn(recorded, settings), variant
    console, measured = Console(), recorded.measurements
    heads = ("", "mean error [m]", "RMS [m]", "95 % [m]", "NEES", "ends at x, y [m]")
    rows = []
    for name, found in (("dead reckoning", dead_reckoning(recorded)), (title, estimates)):
        errors = score(found, measured, recorded.truth)
        figures = [
            "–" if math.isnan(value) else f"{value:.2f}" if value < _LARGE else f"{value:.0e}" for value in errors
        ]
        x, y = found.state[-1, :2]
        rows.append([name, *figures, f"{x:.2f}, {y:.2f}"])
    show_table(console, heads, rows)
    for remark in recorded.remarks:
        tell(console, remark, "note:")
    if out is not None:
        write_states(out, [(VEHICLE, measured.time, estimates.state)])
        tell(console, out)
    vehicle = Replayed(name=VEHICLE, measured=measured, estimates=estimates, path=recorded.truth)
    _write_page(console, [vehicle], path, title, recorded.remarks)
