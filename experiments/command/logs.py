"""`laisn log`: inspect, export, repair and import logs."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.command.errors import report_errors
from experiments.command.options import folder_option, say

log_app = typer.Typer(help="Inspect, export, repair and import logs.", no_args_is_help=True)


LogArgument = Annotated[Path, typer.Argument(help="an MCAP log")]


@log_app.command("info")
@report_errors
def log_info(log: LogArgument) -> None:
    """Print the contents of a log."""
    from experiments.command import replaying

    replaying.show_info(log)


@log_app.command("export")
@report_errors
def log_export(
    log: LogArgument,
    out: Annotated[Path, typer.Argument(parser=folder_option, metavar="OUT", help="folder for the tables")],
    format_: Annotated[str, typer.Option("--format", help="parquet or csv")] = "parquet",
    rerun: Annotated[bool, typer.Option("--rerun", help="write one Rerun recording in place of tables")] = False,
) -> None:
    """Export every numeric channel as a table, or a flight as a recording for Rerun."""
    from sim.log.export import export

    if rerun:
        from sim.log.reader import read
        from sim.log.recording import write_recording

        out.mkdir(parents=True, exist_ok=True)
        say(write_recording(read(log), out / f"{log.stem}.rrd"))
        return
    for file in export(log, out, format_):  # type: ignore[arg-type]  # export names the formats
        say(file)


@log_app.command("import")
@report_errors
def log_import(
    source: Annotated[Path, typer.Argument(metavar="FILE", help="a factor graph (.pyfg), or NAME.mat or NAME_DR.txt")],
    out: Annotated[Path, typer.Option(help="the log to write (.mcap)")],
    beacons: Annotated[
        str | None, typer.Option(metavar="NAME,NAME", help="keep the ranges to these beacons (default: to all)")
    ] = None,
) -> None:
    """Import a data set of odometry and ranges to beacons as a log, on which `laisn replay` navigates."""
    from experiments.command import datasets

    datasets.import_data_set(source, out, beacons)


@log_app.command("recover")
@report_errors
def log_recover(log: LogArgument) -> None:
    """Recover a log that a crash, a full disk or Ctrl-C left unfinished."""
    from sim.log.recovery import recover

    say(recover(log, lambda remark: say(f"note: {remark}")))
