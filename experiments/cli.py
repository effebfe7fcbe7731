"""The `laisn` command. Heavy imports stay inside the commands, so that `--help` answers at once."""

import os
import sys
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import typer

Command = TypeVar("Command", bound=Callable[..., Any])

app = typer.Typer(
    name="laisn",
    help="Simulate a leader and its followers under water, navigated by acoustic ranges (LAISN).",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
log_app = typer.Typer(help="Look into logs, export and mend them.", no_args_is_help=True)
app.add_typer(log_app, name="log")

ScenarioArgument = Annotated[str, typer.Argument(help="T2 … T9, another built-in name, or a TOML file")]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="change a key, e.g. sensors.speed_bias_m_s=0.1")
]
OutOption = Annotated[Path | None, typer.Option(help="folder for the results (default out/NAME)")]


def _plain_errors(command: Command) -> Command:
    """Show what the user can mend as one message with exit code 2; LAISN_DEBUG=1 shows the traceback."""

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> Any:
        try:
            return command(*args, **kwargs)
        except (ValueError, OSError) as error:
            if os.environ.get("LAISN_DEBUG"):
                raise
            text = str(error)
            if isinstance(error, OSError) and error.strerror:
                text = f"{error.filename or 'output'}: {error.strerror}"
            typer.secho(f"laisn: {text}", fg="red", err=True)
            raise typer.Exit(2) from None

    return cast(Command, wrapped)


@app.command()
@_plain_errors
def fly(
    scenario: ScenarioArgument,
    set_: SetOption = None,
    seed: Annotated[int | None, typer.Option(help="key of all random numbers")] = None,
    run: Annotated[int | None, typer.Option(help="fly with the noise of this run of a campaign")] = None,
    out: OutOption = None,
    video: Annotated[bool, typer.Option("--video/--no-video", help="render the film")] = True,
) -> None:
    """Fly one mission; write log, film, report and numbers."""
    from experiments import fly as flying
    from experiments.library import load

    extra = [f"{key}={value}" for key, value in (("seed", seed), ("run", run)) if value is not None]
    flying.fly_and_write(load(scenario, [*(set_ or []), *extra]), out, with_video=video)


@app.command()
@_plain_errors
def scenarios(
    name: Annotated[str | None, typer.Argument(help="print this one as TOML, a start for your own")] = None,
) -> None:
    """List the built-in scenarios, or print one."""
    from experiments import library

    if name is None:
        library.show()
    else:
        from sim.scenario_file import dumps

        sys.stdout.write(dumps(library.load(name, ())))


@app.command()
@_plain_errors
def check(scenario: ScenarioArgument, set_: SetOption = None) -> None:
    """Validate a scenario without flying it."""
    from experiments import library

    checked = library.load(scenario, set_ or ())
    library.check_routes(checked)
    typer.echo(f"{scenario}: fine ({checked.duration_s:g} s, {len(checked.followers)} follower(s))")


@app.command()
@_plain_errors
def doctor() -> None:
    """Say what this machine can do, and what to install for the rest."""
    from experiments.doctor import examine

    raise typer.Exit(examine())


def main() -> None:
    """Entry point of the console script."""
    app()


if __name__ == "__main__":
    main()
