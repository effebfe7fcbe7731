"""Subcommands of studies: `laisn study` for study files, the built-in studies, and `laisn
compare`.
"""

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from laisn_sim.cli.errors import echo

if TYPE_CHECKING:
    from experiments.study.page import Answer

ScenarioArgument = Annotated[
    str, typer.Argument(help="T2 … T9, another built-in name, or a TOML file")
]
SourceArgument = Annotated[
    str, typer.Argument(help="a scenario; or a log (.mcap), or a flight's folder")
]


def _load_plugins(files: list[Path] | None) -> None:
    from laisn.plugins import load_plugin

    for file in files or []:
        load_plugin(file)


PluginOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        callback=_load_plugins,
        is_eager=True,
        metavar="FILE.py",
        help="load own navigators and sensors",
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="change a key, e.g. sensors.speed_bias_m_s=0.1"
    ),
]


def folder_option(text: str) -> Path:
    if not text.strip():
        raise typer.BadParameter("the folder name is empty; '.' is the current folder")
    return Path(text)


OutOption = Annotated[
    Path | None,
    typer.Option(
        parser=folder_option, metavar="FOLDER", help="folder for the results (default: out/NAME)"
    ),
]


def _factors(assignments: list[str]) -> dict[str, Any]:
    """Lists of values by key; a list is TOML, or values separated by commas."""
    from sim.scenario.file import value_of, values_of

    def listed(value: object) -> Any:
        if isinstance(value, str):
            return [value_of(item.strip()) for item in value.split(",")]
        return value if isinstance(value, list | dict) else [value]

    return {key: listed(value) for key, value in values_of(assignments, "--vary").items()}


def study(  # noqa: PLR0913 - an argument for each option of the command
    source: Annotated[
        str,
        typer.Argument(
            metavar="STUDY", help="a study file, a built-in study, or a scenario to vary"
        ),
    ],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary", metavar="KEY=A,B,…", help="a factor: these values of a scenario's key"
        ),
    ] = None,
    draw: Annotated[
        list[str] | None,
        typer.Option(
            "--draw",
            metavar="'KEY={uniform=[A,B]}'",
            help="a random value of this key for each realization",
        ),
    ] = None,
    set_: SetOption = None,
    _plugin: PluginOption = None,
    runs: Annotated[
        int | None, typer.Option(min=1, max=1_000_000, help="runs of noise at each point")
    ] = None,
    realizations: Annotated[
        int | None,
        typer.Option(min=1, max=100_000, help="realizations of waves and draws at each point"),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**62 - 1, help="key of all random numbers")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="print the size of the study and stop")
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="fewer and shorter runs")] = False,
    film: Annotated[
        str,
        typer.Option(metavar="worst|example", help="film the worst run; of asymmetry, its example"),
    ] = "",
    scene: Annotated[
        bool,
        typer.Option("--scene/--no-scene", help="fly the worst run alone, and show it in 3D"),
    ] = True,
    engine: Annotated[
        str | None,
        typer.Option(
            metavar="direct|mujoco",
            help="solver of the motion (default: the one that the scenario names, or direct)",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="local processes (default: one for each core)"),
    ] = None,
    out: OutOption = None,
    force: Annotated[bool, typer.Option("--force", help="compute everything again")] = False,
    cluster: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="compute on this Dask cluster")
    ] = None,
) -> None:
    """Run a study: factors, draws and arms of a file; write tables, intervals and a page."""
    from experiments.study.study import effort_text, run, studies_of
    from sim.film import graphics
    from sim.scenario.file import values_of

    keys: dict[str, Any] = {
        "runs": runs,
        "realizations": realizations,
        "seed": seed,
        "engine": engine,
    }
    keys |= {
        "vary": _factors(vary or []),
        "draw": values_of(draw or (), "--draw"),
        "set": values_of(set_ or ()),
    }
    if dry_run:
        for plan in studies_of(source, keys, quick=quick)[0].values():
            echo(effort_text(plan, workers or len(os.sched_getaffinity(0))))
        return
    if film and graphics.working() is None:
        typer.echo(f"no film: {graphics.MISSING}", err=True)
        film = ""
    execution = {"workers": workers, "cluster": cluster, "force": force}
    results = run(source, keys, out, quick=quick, film=film, scene=scene, **execution)
    _show_answers(results.answers())
    echo(f"report in {results.report()}")


def _show_answers(answers: Sequence["Answer"]) -> None:
    """Print what a study asks and answers, each part as a small table."""
    from rich.console import Console

    from experiments.campaign.progress import literal, show_table

    console = Console()
    for answer in answers:
        console.print(literal(answer.question, "bold"))
        show_table(console, answer.heads, answer.rows, caption=answer.remark)


BUILT_IN = {
    "asymmetry": "Study range errors from a pitching leader, and remedies.",
    "bearing": "Study baseline and H_T for followers astern, on the quarter and abeam.",
    "closed-loop": "Study followers that steer by their own estimates, with each navigator.",
    "depth": "Study followers below a leader out of trim, with and without broadcast attitude.",
    "drawn-routes": "Study position errors on random routes of the paper's eight classes.",
    "estimators": "Compare LAISN-2, the tightly coupled navigator and the Cramér–Rao bound.",
    "formation": "Study ten followers in formation: currents, waves, losses and navigators.",
    "front": "Study a formation that crosses a front of the current.",
    "gate": "Study LAISN-2's gate rules on pings replaced by echoes.",
    "leader-errors": "Study a leader that errs about its position, and pings one after another.",
    "loss": "Study current and lost messages that each variant tolerates.",
    "reproduce": "Run the paper's five stages: tables beside the published ones, figures, and "
    "checks of its claims.",
    "rivals": "Compare all navigators: LAISN, the tightly coupled one, and the rival methods.",
    "thermocline": "Study rays that bend: ranges, fixes and formations by season, depth and range.",
}
"""Built-in studies of files, which `laisn NAME` and `laisn study NAME` run alike, and their
help.
"""


def command_of(name: str) -> Callable[..., None]:
    """The command `laisn NAME` of a built-in study: `laisn study NAME`, with its options."""
    command: Any = partial(study, name)
    command.__annotations__ = study.__annotations__
    command.__name__ = name
    command.__doc__ = BUILT_IN[name]
    return command  # type: ignore[no-any-return]


def compare(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="A B …", help="folders of flights, or of studies; or logs"),
    ],
    out: Annotated[
        Path | None, typer.Option(help="the page (default: out/compare/A-B.html)")
    ] = None,
) -> None:
    """Compare flights or studies on one page: errors, paired differences, settings that differ."""
    from experiments.flight.library import name_of
    from experiments.study.compare import names_of, page_of
    from laisn_sim.cli.outputs import output_file
    from reports.page import write

    page = page_of(sources)
    joined = "-".join(name.removesuffix(".mcap") for name in names_of(sources))
    default_name = f"{name_of(Path(joined.replace('/', '-') + '.html'))}.html"
    output = output_file(out or Path("out") / "compare" / default_name, [".html"])
    write(page, output.path)
    echo(f"page in {output}")
