"""Subcommands that compute and print: the Cramér–Rao bound, the range error budget, a hull from
its dimensions.
"""

import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from laisn.errors import COLUMNS, ROWS, LaisnError, printable, shortened
from laisn_sim.cli.outputs import optional_output
from laisn_sim.cli.studies import PluginOption, ScenarioArgument, SetOption, SourceArgument

if TYPE_CHECKING:
    from experiments.campaign.store import Record
    from sim.flight import FlightRecord

LARGEST_SDF = 10_000_000
_QUARTERS = 4


def bound(
    scenario: ScenarioArgument,
    set_: SetOption = None,
    _plugin: PluginOption = None,
    runs: Annotated[
        int, typer.Option(min=0, max=1_000_000, help="also run the navigator this many times")
    ] = 0,
    out: Annotated[Path | None, typer.Option(help="write the bound over time to this .csv")] = None,
) -> None:
    """Compute the Cramér–Rao bound of a mission's position errors."""
    import numpy as np
    from rich.console import Console

    from experiments.campaign.montecarlo import Cell, CellSettings, mission_of, simulate
    from experiments.campaign.progress import compiling_shown, print_line, show_table
    from experiments.campaign.store import write_csv
    from experiments.flight.library import load_scenario
    from reports.bound import mission_bound

    output = optional_output(out, [".csv"])
    checked_scenario = load_scenario(scenario, set_ or (), flyable=True)
    heads = ["follower", *(f"{i + 1}. quarter" for i in range(_QUARTERS)), "whole"]
    heads += [f"{checked_scenario.variants}, {runs} runs", "× bound", "NEES"] if runs else []
    lines: list[list[str]] = []
    rows: list[Record] = []
    has_bounds = True
    with compiling_shown():
        mission = mission_of(checked_scenario)
        for i, follower in enumerate(checked_scenario.followers):
            settings = CellSettings.of(checked_scenario.navigated_as(i))
            trajectory, _ = mission.motion_and_measurements(settings, i)
            bound = mission_bound(trajectory, settings.sensing, settings.navigation, i)
            has_bounds = has_bounds and bool(np.isfinite(bound).all())
            bounds = [
                float(np.sqrt(np.mean(quarter**2)))
                for quarter in (*np.array_split(bound, _QUARTERS), bound)
            ]
            cells = [f"{value:.3f}" if np.isfinite(value) else "–" for value in bounds]
            if runs:
                flight = simulate(
                    Cell.of(checked_scenario, i, runs, mission=mission),
                    threads=len(os.sched_getaffinity(0)),
                ).row
                rms = float(np.hypot(flight["e_p_mean_m"], flight["e_p_std_m"]))
                ratio = f"{rms / bounds[-1]:.2f}" if bounds[-1] > 0.0 else "–"
                nees = f"{flight['nees']:.3g}" if np.isfinite(flight["nees"]) else "–"
                cells += [f"{rms:.3f}", ratio, nees]
            lines.append([follower.name, *cells])
            time = checked_scenario.timing.filter_step_s * np.arange(1, bound.size + 1)
            rows += [
                {"follower": follower.name, "time_s": t, "bound_m": value}
                for t, value in zip(time.tolist(), bound.tolist(), strict=True)
            ]
    caption = (
        "" if has_bounds else "–: no bound of ranges without random errors, or of several links"
    )
    show_table(Console(), heads, lines, "least RMS position error [m]", caption)
    if output is not None:
        write_csv(output.path, rows)
        print_line(Console(), output)


def records(flight: "FlightRecord") -> "Iterator[Record]":
    """The error budget of each received ping of a flight, a record each."""
    import numpy as np

    from laisn.messages import Ranges
    from reports.range_budget import Cause, range_error_budget

    for i, name in enumerate(flight.trajectory.names[1:]):
        budget = range_error_budget(flight, i)
        for m, t in np.argwhere(np.isfinite(budget.used_range)).tolist():
            yield {
                "follower": name,
                "time_s": float(budget.time[m]),
                "transmitter": Ranges._fields[t],
                "level_range_m": float(budget.level_range[m, t]),
                "used_range_m": float(budget.used_range[m, t]),
                **{f"{cause.name.lower()}_m": float(budget.share[m, t, cause]) for cause in Cause},
            }


def range_budget(
    source: SourceArgument,
    set_: SetOption = None,
    _plugin: PluginOption = None,
    out: Annotated[
        Path | None, typer.Option(help="write all shares of every ping to this .csv or .parquet")
    ] = None,
) -> None:
    """Print the error budget of the ranges: pitch, motion, echoes, sound, clocks, noise, depth."""
    import numpy as np
    from rich.console import Console

    from experiments.campaign.progress import print_line, show_table
    from experiments.campaign.store import columns_of, write_csv, write_table
    from experiments.flight.results import flight_of
    from laisn.messages import Ranges
    from reports.flight_report import share_table
    from reports.range_budget import NO_BUDGET, range_error_budget

    output = optional_output(out, [".csv", ".parquet"], [Path(source)])
    flight = flight_of(source, set_ or ())
    console = Console()
    heads = ("cause", *Ranges._fields, "front − rear, rms", "largest")
    for i, name in enumerate(flight.trajectory.names[1:]):
        budget = range_error_budget(flight, i)
        if not np.isfinite(budget.error).any():
            print_line(console, f"{name} {NO_BUDGET}", "note:")
            continue
        shares = share_table(budget)
        lines = [[cell.text for cell in row] for row in shares.rows]
        show_table(
            console, heads, lines, f"{name}: rms shares of the range errors [cm]", shares.caption
        )
    if output is not None:
        rows = list(records(flight))
        if output.path.suffix == ".csv":
            write_csv(output.path, rows)
        else:
            write_table(output.path, columns_of(rows))
        print_line(console, output)


def pitch(
    pitch: Annotated[float, typer.Option(help="of the leader, nose up [°]")] = 5.0,
    baseline: Annotated[float, typer.Option(help="rear to front transmitter [m]")] = 2.0,
    distance: Annotated[float, typer.Option(help="of the follower, horizontal [m]")] = 30.0,
    below: Annotated[float, typer.Option(help="how much deeper the follower is [m]")] = 10.0,
    side_rule: Annotated[
        Literal["behind", "predicted"],
        typer.Option(help="where the rule for the leader's axis puts it"),
    ] = "behind",
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="the page (default in out/pitch)")
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(help="write the errors of the map to this .csv")
    ] = None,
) -> None:
    """Draw what a leader's pitch does to one fix, over bearing and pitch, for a geometry."""
    from rich.console import Console

    from experiments import pitch as fixes
    from experiments.campaign.progress import show_table
    from experiments.campaign.store import write_csv
    from laisn_sim.cli.errors import echo
    from laisn_sim.cli.outputs import output_file

    geometry = fixes.PitchGeometry(
        baseline=baseline, pitch_deg=pitch, distance=distance, below=below, side_rule=side_rule
    )
    name = f"baseline-{baseline:g}-pitch-{pitch:g}-distance-{distance:g}-below-{below:g}"
    page = output_file(out or Path("out") / "pitch" / f"{name}.html", [".html"])
    table = optional_output(csv, [".csv"], option="--csv")
    rows = [
        [
            f"{bearing:.0f}°",
            f"{fix.error:.3f} m",
            "–" if math.isnan(form) else f"{form:.3f} m",
            fix.kind,
        ]
        for bearing, fix, form in fixes.rows_by_bearing(geometry)
    ]
    show_table(Console(), ("off the bow", "error", "closed form", "the fix is"), rows)
    echo(fixes.summary(geometry))
    if table is not None:
        write_csv(table.path, list(geometry.records()))
        echo(table)
    command = (
        f"laisn pitch --baseline {baseline:g} --pitch {pitch:g} --distance {distance:g} "
        f"--below {below:g} --side-rule {side_rule}"
    )
    fixes.write_pitch_page(geometry, page.path, [("Repeat with", command)])
    echo(f"page in {page}")


def hull(
    length: Annotated[float | None, typer.Option(help="length of the hull [m]")] = None,
    diameter: Annotated[float | None, typer.Option(help="diameter of the hull [m]")] = None,
    mass: Annotated[
        float | None, typer.Option(help="mass with all that floods [kg]; the hull is neutral")
    ] = None,
    fins: Annotated[
        Literal["+", "x"], typer.Option(help="'+': rudders and stern planes, 'x': four fins at 45°")
    ] = "+",
    propeller: Annotated[
        float | None, typer.Option(help="diameter of the propeller [m]; default: 0.7 of the hull")
    ] = None,
    sdf: Annotated[
        Path | None,
        typer.Option(
            help="read gz-sim's Hydrodynamics, Thruster and LiftDrag from this SDF file instead"
        ),
    ] = None,
) -> None:
    """Print a first MJCF of an own vehicle, with the formula or source of each number."""
    from sim.gazebo.hull import from_sdf
    from sim.system import read_text
    from sim.vehicle.hull_file import from_dimensions
    from sim.vehicle.own_hull import hull_errors

    if sdf is None:
        if length is None or diameter is None or mass is None:
            raise LaisnError("give --length, --diameter and --mass, or --sdf FILE")
        text = from_dimensions(length, diameter, mass, fins, propeller).xml()
    else:
        if any(value is not None for value in (length, diameter, mass, propeller)):
            raise LaisnError(
                "--sdf: the file has the dimensions; leave --length, --diameter, --mass, "
                "--propeller out"
            )
        try:
            file, remarks = from_sdf(read_text(sdf, LARGEST_SDF), sdf.parent)
        except LaisnError as error:
            raise LaisnError(f"{sdf}: {error}") from None
        text = file.xml()
        for remark in remarks:
            # names in a file may be of any length
            typer.echo(shortened(printable(f"note: {remark}"), COLUMNS * ROWS // 2), err=True)
        if errors := hull_errors(text, "leader"):
            raise LaisnError(
                "\n".join(
                    [f"{sdf}: the hull cannot be simulated:", *(f"  {error}" for error in errors)]
                )
            )
    sys.stdout.write(text)
