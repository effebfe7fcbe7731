"""Navigation on the measurements of a log, and the contents of a log."""

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Column, Table

from experiments.campaign.progress import literal, tell
from laisn.arrays import Floats
from laisn.failure import LaisnError
from sim.scenario.file import values_of


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
    from experiments.command.smoothing import show_smoothing, smoothing_factory
    from experiments.flight.fly import navigate_again
    from experiments.flight.summary import position_and_bearing_errors, summarise
    from sim.log import reader, writer

    require_own_file(out, ".mcap", path)
    smoothing = smoothing_factory(smooth_s)
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
    """Navigate on the log of a real vehicle, without a true path, and print the last estimates.

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
    from experiments.command.smoothing import smoothing_factory
    from experiments.flight.library import load_flyable
    from laisn.estimates import FixKind
    from laisn.navigators import new_navigator
    from laisn.settings import NavigationSettings
    from sim.flight import navigation_settings
    from sim.log import reader
    from sim.motion import simulate_motion
    from sim.sensing.observation import start_of

    require_own_file(out, ".csv", path)
    scenario = load_flyable(source, assignments)
    make = smoothing_factory(smooth_s) or new_navigator
    # two steps are enough for the starts of the routes
    short = {"motion": "kinematic", "duration_s": 2 * scenario.timing.filter_step_s}
    begin = simulate_motion(scenario.model_copy(update=short))
    single = scenario.navigation.use_single_range or "use_single_range" not in scenario.navigation.model_fields_set
    heads = ("follower", "steps", "Δt [s]", "fixes", "x [m]", "y [m]")
    table = Table(*(Column(literal(head)) for head in heads), box=None, pad_edge=False)
    states: list[tuple[str, Floats, Floats]] = []
    remarks: list[str] = []
    for i, name in enumerate(begin.names[1:]):
        measured, found = reader.read_recording(path, name, longest_gap_s)
        remarks += found
        settings = replace(navigation_settings(scenario, begin, i), dt=measured.dt)
        if isinstance(settings, NavigationSettings):
            settings = replace(settings, use_single_range=single)
        estimates = make(settings, start_of(begin, i)).run(measured)
        kinds = Counter(estimates.fix_kind.tolist())
        counts = ", ".join(f"{kinds[kind]} {kind.name.lower().replace('_', ' ')}" for kind in FixKind if kinds[kind])
        x, y = estimates.state[-1, :2]
        steps = str(len(estimates.state))
        table.add_row(literal(name), steps, f"{measured.dt:g}", counts or "none", f"{x:.2f}", f"{y:.2f}")
        states.append((name, measured.time, estimates.state))
    console = Console()
    console.print(table)
    for remark in dict.fromkeys(remarks):
        tell(console, remark, "note:")
    if out is not None:
        write_states(out, states)
        tell(console, out)


def show_info(path: Path) -> None:
    """Print what a log holds; LogError if it cannot be read."""
    from sim.log.info import info

    found = info(path)
    console = Console()
    tell(console, f"{path}: {found.size / 1e6:.2f} MB, {found.duration_s:g} s from {found.start.isoformat()}")
    table = Table("channel", "schema", "messages", box=None, pad_edge=False)
    for channel in found.channels:
        table.add_row(literal(channel.topic), literal(channel.schema), str(channel.messages))
    console.print(table)
    for name, size in found.attachments.items():
        tell(console, f"attachment {name}: {size} bytes")
    for name, record in found.metadata.items():
        tell(console, f"metadata {name}: {', '.join(f'{k}={v}' for k, v in record.items())}")
    for what in found.unverified:
        tell(console, f"{what}: no checksum, damage cannot be noticed", "note:")
