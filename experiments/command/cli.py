"""The `laisn` command. Heavy imports stay inside the commands, so that `--help` answers at once."""

import gc
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from experiments.command import studying
from experiments.command.endings import run
from experiments.command.errors import report_errors
from experiments.command.logs import log_app
from experiments.command.options import OutOption, SetOption, say

app = typer.Typer(
    name="laisn",
    help="Simulate a leader and its followers under water, navigated by acoustic ranges (LAISN).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"laisn-sim {version('laisn-sim')}")
        raise typer.Exit


@app.callback()
def every_command(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="show the version and exit")
    ] = False,
) -> None:
    """Options of the command itself."""


app.add_typer(log_app, name="log")

ScenarioArgument = Annotated[str, typer.Argument(help="T2 … T9, another built-in name, or a TOML file")]


@app.command()
@report_errors
def fly(
    scenario: ScenarioArgument,
    set_: SetOption = None,
    seed: Annotated[int | None, typer.Option(help="key of all random numbers")] = None,
    run: Annotated[int | None, typer.Option(help="fly with the noise of this run of a campaign")] = None,
    out: OutOption = None,
    video: Annotated[bool, typer.Option("--video/--no-video", help="render the film")] = True,
) -> None:
    """Fly one mission; write log, film, report and numbers."""
    from experiments.command import fly as flying
    from experiments.flight.library import load_flyable, name_of

    extra = [f"{key}={value}" for key, value in (("seed", seed), ("run", run)) if value is not None]
    checked = load_flyable(scenario, [*(set_ or []), *extra])
    source = Path(scenario)
    # a file keeps its own folder, whatever name it was copied with
    name = name_of(source) if source.suffix == ".toml" else checked.name
    flying.fly_and_write(checked, out or Path("out") / name, with_video=video, source=source)


@app.command()
@report_errors
def scenarios(
    name: Annotated[str | None, typer.Argument(help="print this one as TOML, a start for your own")] = None,
) -> None:
    """List the built-in scenarios, or print one."""
    from experiments.flight import library

    if name is None:
        library.show()
    else:
        from sim.scenario.file import dumps

        sys.stdout.write(dumps(library.load(name, ())))


@app.command()
@report_errors
def check(scenario: ScenarioArgument, set_: SetOption = None) -> None:
    """Validate a scenario without flying it."""
    from experiments.flight import library

    checked = library.load_flyable(scenario, set_ or ())
    say(f"{scenario}: fine ({checked.duration_s:g} s, {len(checked.followers)} follower(s))")


@app.command()
@report_errors
def doctor() -> None:
    """Say what this machine can do, and what to install for the rest."""
    from experiments.command.doctor import examine

    raise typer.Exit(examine())


@app.command()
@report_errors
def render(
    source: Annotated[str, typer.Argument(help="a scenario, or a log (.mcap)")],
    set_: SetOption = None,
    camera: Annotated[
        str | None, typer.Option(help="chase, pip, top, side, follower, leader, profile or orbit")
    ] = None,
    size: Annotated[str | None, typer.Option(metavar="WIDTHxHEIGHT", help="such as 1920x1080")] = None,
    speed_up: Annotated[float | None, typer.Option(help="seconds of mission in a second of film")] = None,
    follower: Annotated[int, typer.Option(help="index of the follower to keep to")] = 0,
    still: Annotated[float | None, typer.Option(metavar="T", help="one picture at mission time T [s]")] = None,
    out: Annotated[Path | None, typer.Option(help="file (default NAME.mp4 or NAME.png)")] = None,
) -> None:
    """Film a scenario or a log, or take a picture of it."""
    from experiments.command import filming

    filming.film(source, set_ or (), filming.FilmOptions(camera, size, speed_up, follower, still, out))


@app.command()
@report_errors
def replay(
    log: Annotated[Path, typer.Argument(help="a log (.mcap) of a flight, or of a real vehicle with its channels")],
    variant: Annotated[
        str | None,
        typer.Option(help="laisn-2 (default), laisn-3-1, laisn-3-2, tight or another; any other word lists them"),
    ] = None,
    set_: SetOption = None,
    scenario: Annotated[
        str | None,
        typer.Option(metavar="SCENARIO", help="for a log of measurements alone: start, baseline, navigation"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="write the flight with the new estimates as a log; with --scenario a CSV file")
    ] = None,
    longest_gap: Annotated[
        float,
        typer.Option(min=0.0, help="with --scenario: bridge gaps between own measurements of up to so many seconds"),
    ] = 10.0,
    smooth: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="SECONDS", help="tight: use messages of up to so many seconds later, too"),
    ] = None,
) -> None:
    """Navigate once more on the measurements of a log, with another variant or other settings."""
    from experiments.command import datasets, replaying
    from sim.datasets.log import is_data_set

    if scenario is None and is_data_set(log):
        if smooth is not None:
            from laisn.failure import LaisnError

            raise LaisnError(f"--smooth with {log}: a data set's navigator among beacons cannot be smoothed")
        datasets.replay_data_set(log, variant or "laisn-2", set_ or (), out, longest_gap)
    elif scenario is None:
        replaying.replay(log, variant or "laisn-2", set_ or (), out, smooth)
    else:
        chosen = [f"navigation.variant={variant}"] if variant else []
        replaying.replay_measurements(log, scenario, [*chosen, *(set_ or ())], out, longest_gap, smooth)


@app.command("anatomy", hidden=True)
@app.command("range-budget")
@report_errors
def range_budget(
    source: Annotated[str, typer.Argument(help="a scenario, or a log (.mcap)")],
    set_: SetOption = None,
    out: Annotated[Path | None, typer.Option(help="write every share of every ping to this .csv or .parquet")] = None,
) -> None:
    """Print the error budget of the ranges: pitch, motion, echoes, sound, clocks, noise, depth."""
    from experiments.command.range_budget import show_range_budget

    show_range_budget(source, set_ or (), out)


app.command()(report_errors(studying.reproduce))
app.command()(report_errors(studying.asymmetry))
app.command()(report_errors(studying.estimators))
app.command()(report_errors(studying.formation))


@app.command()
@report_errors
def bound(
    scenario: ScenarioArgument,
    set_: SetOption = None,
    runs: Annotated[int, typer.Option(min=0, max=1_000_000, help="fly so many runs beside it")] = 0,
    out: Annotated[Path | None, typer.Option(help="write the bound over time to this .csv")] = None,
) -> None:
    """Say how good an estimate of a mission could be: its Cramér–Rao bound."""
    from experiments.command.bound import show_bound

    show_bound(scenario, set_ or (), runs, out)


app.command()(report_errors(studying.study))
app.command()(report_errors(studying.compare))


def main() -> None:
    """Entry point of the console script."""
    # Films are rendered by child processes, which choose their own; here a library that is missing must break nothing.
    os.environ["MUJOCO_GL"] = "disable"
    # What modules define lives to the end; to look through it for garbage costs each mission a quarter of a second.
    gc.set_threshold(100_000, 50, 50)
    run(app)


if __name__ == "__main__":
    main()
