"""Navigation once more on a log, and what a log holds."""

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from experiments.campaign.progress import literal, tell
from laisn.failure import LaisnError
from sim.scenario.file import values_of

STATE_COLUMNS = ("x_m", "y_m", "vx_m_s", "vy_m_s")


def require_own_file(out: Path | None, suffix: str, source: Path) -> None:
    """LaisnError if what is to be written is named as something else, or would replace the log that is read."""
    if out is None:
        return
    if out.suffix != suffix:
        raise LaisnError(f"--out {out}: should end in {suffix}")
    if out.exists() and source.exists() and out.samefile(source):
        raise LaisnError(f"--out {out}: is the log that is read; give the new one another name")


def replay(
    path: Path, variant: str, assignments: Iterable[str], out: Path | None, smooth_s: float | None = None
) -> None:
    """Navigate on the measurements of a log and print errors beside those of the log.

    Args:
        path: log of a flight.
        variant: which LAISN, or "tight".
        assignments: overrides of the scenario's navigation, `navigation.key=value`.
        out: log for the new estimates, smoothed if they are; None: none.
        smooth_s: smooth with messages of up to so much later [s], and print what that changes; None: not.

    Raises:
        LogError: the log cannot be read.
        LaisnError: the new log would replace the one that is read, or its name does not end in .mcap; or the variant
            cannot be smoothed.
        ScenarioError: variant or overrides are at fault, or touch more than navigation.
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
    path: Path,
    source: str,
    assignments: Iterable[str],
    out: Path | None,
    longest_gap_s: float,
    smooth_s: float | None = None,
) -> None:
    """Navigate on the measurements of a real vehicle's log and print where that ends; nothing is known of the truth.

    A range that arrives alone is used, unless the scenario says that it is not.

    Args:
        path: log with `/NAME/motion` and `/NAME/reception` of every follower of the scenario.
        source: scenario; its followers' names and starts, the leader's baseline and the navigation are used. The
            filter steps are the log's.
        assignments: overrides of the scenario.
        out: CSV file for the estimates (x, y, vx, vy after each step); None: none.
        longest_gap_s: between own measurements [s].
        smooth_s: smooth with messages of up to so much later [s]; None: not.

    Raises:
        LogError: the log cannot be read, has too long a gap or lacks a channel.
        ScenarioError: the scenario is at fault.
        LaisnError: the name of the file for the estimates does not end in .csv, or the variant cannot be smoothed.
    """
    from experiments.campaign.store import write_csv
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
    # the starts alone are wanted of the routes
    begin = simulate_motion(
        scenario.model_copy(update={"motion": "kinematic", "duration_s": 2 * scenario.timing.filter_step_s})
    )
    told = scenario.navigation
    single = told.use_single_range or "use_single_range" not in told.model_fields_set
    rows: list[dict[str, str | float]] = []
    remarks: list[str] = []
    table = Table(box=None, pad_edge=False)
    for head in ("follower", "steps", "Δt [s]", "fixes", "x [m]", "y [m]"):
        # a unit in brackets would be read as markup
        table.add_column(literal(head))
    for i, name in enumerate(begin.names[1:]):
        measured, found = reader.read_recording(path, name, longest_gap_s)
        remarks += found
        settings = replace(navigation_settings(scenario, begin, i), dt=measured.dt)
        if isinstance(settings, NavigationSettings):
            settings = replace(settings, use_single_range=single)
        estimates = make(settings, start_of(begin, i)).run(measured)
        kinds = [FixKind(kind) for kind in estimates.fix_kind.tolist()]
        counts = ", ".join(f"{kinds.count(k)} {k.name.lower().replace('_', ' ')}" for k in FixKind if k in kinds)
        last = estimates.state[-1]
        table.add_row(
            literal(name),
            str(len(estimates.state)),
            f"{measured.dt:g}",
            counts or "none",
            f"{last[0]:.2f}",
            f"{last[1]:.2f}",
        )
        for time_s, state in zip(measured.time.tolist(), estimates.state.tolist(), strict=True):
            rows.append({"follower": name, "time_s": time_s, **dict(zip(STATE_COLUMNS, state, strict=True))})
    console = Console()
    console.print(table)
    for remark in dict.fromkeys(remarks):
        tell(console, remark, "note:")
    if out is not None:
        write_csv(out, rows)
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
    for what in found.unprotected:
        tell(console, f"{what} is not protected: it has no checksum", "note:")
