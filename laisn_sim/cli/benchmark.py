"""Subcommands of LAISN-Bench: `laisn bench-data` and `laisn score`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from laisn_sim.cli import studies

if TYPE_CHECKING:
    from experiments.benchmark.score import MissionScore, RunScore

DATA = Path("out") / "laisn-bench"
MissionOption = Annotated[
    list[str] | None,
    typer.Option("--mission", metavar="NAME", help="of these missions alone; may be repeated"),
]


def bench_data(
    out: Annotated[Path, typer.Argument(metavar="[FOLDER]", help="for the data")] = DATA,
    mission: MissionOption = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, max=1000, help="seeds 1 … N of each mission (default: 20)")
    ] = None,
    format_: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="mcap|ros2|pyfg",
            help="measurements as logs, bags or factor graphs, beside CSV; may be repeated",
        ),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(min=10.0, help="write the first seconds of each mission alone")
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=1024, help="processes (default: one for each core)"),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="compare the files there with the manifest, and stop")
    ] = False,
) -> None:
    """Write the data of LAISN-Bench: measurements of 22 missions with 20 seeds, and the truth.

    The same version gives the same numbers anywhere. See docs/benchmark.md.
    """
    import os

    from rich.console import Console

    from experiments.benchmark import data
    from experiments.benchmark.catalogue import SEEDS, VERSION, chosen_missions
    from experiments.campaign.progress import print_line
    from laisn.errors import LaisnError

    console = Console()
    if check:
        damaged = data.damaged_files(out)
        if damaged:
            raise LaisnError(
                f"{out}: {len(damaged)} files are missing or differ from {data.MANIFEST}, first "
                f"{damaged[0]}"
            )
        number = len(data.read_manifest(out)["files"])
        print_line(console, f"{out}: {number} files are as {data.MANIFEST} says")
        return
    missions = chosen_missions(mission or ())
    manifest = data.generate(
        out,
        missions,
        range(1, (seeds or SEEDS) + 1),
        format_ or (),
        seconds=seconds,
        workers=workers or len(os.sched_getaffinity(0)),
    )
    size = sum((out / name).stat().st_size for name in manifest["files"])
    print_line(
        console,
        f"LAISN-Bench {VERSION}: {len(missions)} missions × {len(manifest['seeds'])} seeds, "
        f"{len(manifest['files'])} files, {size / 1e6:.1f} MB in {out}",
    )
    print_line(console, f"score estimates: laisn score ESTIMATES --data {out}")


def _text(value: float, digits: str = ".2f") -> str:
    return "–" if math.isnan(value) else format(value, digits)


def _mean_text(score: "MissionScore") -> str:
    mean = score.mean_m
    if math.isnan(mean.low):
        return _text(mean.value)
    return f"{mean.value:.2f} ({mean.low:.2f} … {mean.high:.2f})"


def _row(score: "MissionScore") -> list[str]:
    complete = score.runs - score.incomplete
    return [
        score.mission,
        f"{complete} of {score.runs}" if score.incomplete else str(score.runs),
        _mean_text(score),
        _text(score.largest_m, ".1f"),
        _text(score.times_bound),
        _text(score.nees, ".2g"),
        _text(score.relative_m[1]),
    ]


def _show(scores: Sequence["RunScore"]) -> None:
    from rich.console import Console

    from experiments.benchmark.score import SEGMENTS_M, by_mission, counted, overall_score
    from experiments.campaign.progress import print_line, show_table

    heads = (
        *("mission", "runs", "mean E_P [m]", "max [m]", "× bound", "NEES"),
        f"RPE {SEGMENTS_M[1]:g} m",
    )
    missions = by_mission(scores)
    console = Console()
    show_table(console, heads, map(_row, missions))
    scored = counted(missions)
    others = [score.mission for score in missions if score not in scored]
    incomplete = sum(score.incomplete for score in scored)
    if incomplete:
        print_line(
            console,
            f"{incomplete} of {sum(score.runs for score in scored)} runs lack estimates for more "
            "than 1 % of their time: there is no score",
            "note:",
        )
    else:
        number = f"{len(scored)} mission{'s' if len(scored) > 1 else ''}"
        mean = f"{overall_score(missions):.3f} × bound, geometric mean of {number}"
        left_out = f"; without {', '.join(others)}" if others else ""
        print_line(console, f"{mean}{left_out}", "score:")
    steps = [score.step_us for score in missions if not math.isnan(score.step_us)]
    if steps:
        print_line(console, f"{max(steps):.3g} µs of processor time a filter step", "cost:")


def score(
    estimates: Annotated[
        Path | None,
        typer.Argument(
            help="a CSV file of estimates, or a folder of MISSION/SEED/FOLLOWER.csv",
            show_default=False,
        ),
    ] = None,
    data: Annotated[Path, typer.Option(help="folder that bench-data wrote")] = DATA,
    navigator: Annotated[
        str | None,
        typer.Option(help="score this navigator in place of a file: tight, … or module:Class"),
    ] = None,
    set_: studies.SetOption = None,
    _plugin: studies.PluginOption = None,
    mission: MissionOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="write the scores of all runs")
    ] = None,
) -> None:
    """Score estimates, or a navigator, on the data of LAISN-Bench.

    Prints errors, their ratio to the Cramér–Rao bound, NEES and relative errors of each mission.
    """
    from rich.console import Console

    from experiments.benchmark.catalogue import chosen_missions
    from experiments.benchmark.score import navigate, read_estimates, runs_of, score_all
    from experiments.campaign.progress import compiling_shown, print_line
    from experiments.campaign.store import write_csv
    from laisn.errors import LaisnError
    from laisn_sim.cli.outputs import optional_output

    if (estimates is None) == (navigator is None):
        raise LaisnError("expected a file of estimates, or --navigator NAME")
    if set_ and navigator is None:
        raise LaisnError("--set: expected with --navigator; estimates of a file are finished")
    output = optional_output(out, [".csv"], [] if estimates is None else [estimates])
    names = {mission_of_choice.name for mission_of_choice in chosen_missions(mission or ())}
    runs = [run for run in runs_of(data) if run.mission in names]
    if not runs:
        raise LaisnError(f"{data}: holds no run of {', '.join(sorted(names))}")
    if navigator is not None:
        with compiling_shown():
            scores = score_all(data, navigate(data, runs, navigator, set_ or ()), runs)
    else:
        assert estimates is not None
        # those of a mission that does not exist are refused by name
        left_out = {one.name for one in chosen_missions(())} - names
        tracks = (item for item in read_estimates(estimates) if item[0].mission not in left_out)
        scores = score_all(data, tracks, runs)
    _show(scores)
    if output is not None:
        write_csv(output.path, [item.record() for item in scores])
        print_line(Console(), f"scores in {output}")
