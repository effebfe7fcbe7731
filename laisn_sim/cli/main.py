"""The `laisn` command. Heavy imports stay inside the commands, so that `--help` is quick."""

import gc
import os
import re
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Literal

import typer

from laisn.errors import LaisnError
from laisn_sim.cli import analyses, benchmark, studies, viewing
from laisn_sim.cli.errors import MISSION_FAILED, Commands, echo, run

app = typer.Typer(
    name="laisn",
    cls=Commands,
    help="Simulate a leader and its followers under water, navigated by acoustic ranges (LAISN).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _version(is_set: bool) -> None:
    if is_set:
        from importlib.metadata import version

        typer.echo(f"laisn-sim {version('laisn-sim')}")
        raise typer.Exit


@app.callback()
def every_command(
    _: Annotated[
        bool,
        typer.Option(
            "--version", callback=_version, is_eager=True, help="show the version and exit"
        ),
    ] = False,
) -> None:
    """Options of the command itself."""


log_app = typer.Typer(help="Inspect, export, repair and import logs.", no_args_is_help=True)
app.add_typer(log_app, name="log")


def _log(text: str) -> Path:
    # what it needs is loaded for the commands that read logs
    from experiments.flight.folder import log_in

    try:
        return log_in(Path(text))
    except LaisnError as error:
        raise typer.BadParameter(str(error)) from None


LogArgument = Annotated[
    Path,
    typer.Argument(
        parser=_log, metavar="LOG", help="an MCAP log, or the folder of a flight, which has one"
    ),
]


@app.command()
def fly(  # noqa: PLR0913 - an argument for each option of the command
    scenario: studies.ScenarioArgument,
    set_: studies.SetOption = None,
    _plugin: studies.PluginOption = None,
    seed: Annotated[int | None, typer.Option(help="key of all random numbers")] = None,
    run: Annotated[
        int | None, typer.Option(help="number of the Monte Carlo run whose noise is used")
    ] = None,
    out: studies.OutOption = None,
    video: Annotated[bool, typer.Option("--video/--no-video", help="render the film")] = True,
    ros2: Annotated[bool, typer.Option("--ros2", help="write a ROS 2 bag, too")] = False,
    live: Annotated[
        bool, typer.Option("--live", help="show the mission while it is flown, with pause")
    ] = False,
    foxglove: Annotated[
        bool,
        typer.Option("--foxglove", help="as --live, and stream the log's channels to Foxglove"),
    ] = False,
) -> None:
    """Simulate one mission; write log, film, report and numbers.

    The exit code is 3 if a vehicle went below the floor or left its route, which ends the mission,
    or if the simulation left finite numbers. What was flown until then is written.
    """
    from experiments.flight.library import load_scenario, name_of
    from laisn_sim.cli.fly import fly_and_write

    extra = [f"{key}={value}" for key, value in (("seed", seed), ("run", run)) if value is not None]
    checked = load_scenario(scenario, [*(set_ or []), *extra], flyable=True)
    source = Path(scenario)
    # a copied file keeps the name in it, so the folder is named after the file
    name = name_of(source) if source.suffix == ".toml" else checked.name
    outcome = fly_and_write(
        checked,
        out or Path("out") / name,
        with_video=video,
        with_bag=ros2,
        source=source,
        live=live,
        foxglove=foxglove,
    )
    if outcome.name not in ("COMPLETED", "CONTACT"):
        raise typer.Exit(MISSION_FAILED)


@app.command()
def scenarios(
    name: Annotated[
        str | None, typer.Argument(help="print this scenario as TOML, a template for your own")
    ] = None,
) -> None:
    """List the built-in scenarios, or print one."""
    from rich.console import Console

    from experiments.campaign.progress import show_table
    from experiments.flight import library

    if name is None:
        show_table(
            Console(), ("scenario", "what happens"), library.descriptions().items(), numbers=False
        )
    else:
        sys.stdout.write(library.load_scenario(name, ()).toml())


@app.command()
def vehicles() -> None:
    """List the vehicles with size, mass, effectors and their limits."""
    from rich.console import Console

    from experiments.campaign.progress import show_table
    from experiments.flight import library

    heads = "vehicle", "size of what is seen", "mass", "effectors and limits"
    show_table(Console(), heads, library.vehicle_rows(), numbers=False)


@app.command()
def check(
    scenario: studies.ScenarioArgument,
    set_: studies.SetOption = None,
    _plugin: studies.PluginOption = None,
) -> None:
    """Validate a scenario; of other hulls than the project's own, try how they keep to it."""
    from rich.console import Console

    from experiments.campaign.progress import phases
    from experiments.flight.library import load_scenario
    from sim.feasibility import cautions
    from sim.scenario.parts import MotionSettings, SoundSettings
    from sim.sea import sea_report
    from sim.trial import needs_trial, trial

    checked = load_scenario(scenario, set_ or (), flyable=True)
    warnings = cautions(checked)
    if needs_trial(MotionSettings.of(checked)):
        with phases(Console(stderr=True)) as phase, phase("trial"):
            warnings += trial(checked)
    for warning in warnings:
        echo(f"warning: {warning}")
    for line in sea_report(SoundSettings.of(checked)):
        echo(line)
    number = len(checked.followers)
    echo(
        f"{scenario}: valid: {checked.duration_s:g} s, {number} follower{'s' if number > 1 else ''}"
    )


@app.command()
def sea(
    scenario: studies.ScenarioArgument,
    set_: studies.SetOption = None,
    _plugin: studies.PluginOption = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="the page (default: out/sea/NAME.html)")
    ] = None,
) -> None:
    """Draw a scenario's sea as a page: current, floor and speed of sound, about the routes."""
    from experiments.flight.library import load_scenario, name_of
    from laisn_sim.cli.outputs import output_file
    from reports.sea_page import write_sea_page

    source = Path(scenario)
    checked = load_scenario(scenario, set_ or (), flyable=True)
    name = name_of(source) if source.suffix == ".toml" else checked.name
    page = output_file(out or Path("out") / "sea" / f"{name}.html", [".html"])
    write_sea_page(checked, page.path)
    echo(f"page in {page}")


@app.command()
def doctor() -> None:
    """Report what works on this machine, and what to install for the rest."""
    from laisn_sim.cli.doctor import examine

    raise typer.Exit(examine())


def _size(text: str) -> dict[str, int]:
    sides = re.fullmatch(r"(\d{1,9})x(\d{1,9})", text)
    if sides is None:
        raise typer.BadParameter("expected WIDTHxHEIGHT, such as 1280x720")
    return {"width_px": int(sides[1]), "height_px": int(sides[2])}


@app.command()
def render(  # noqa: PLR0913 - an argument for each option of the command
    source: studies.SourceArgument,
    set_: studies.SetOption = None,
    _plugin: studies.PluginOption = None,
    camera: Annotated[
        str | None, typer.Option(help="chase, pip, top, side, follower, leader, profile or orbit")
    ] = None,
    size: Annotated[
        dict[str, int] | None,
        typer.Option(parser=_size, metavar="WIDTHxHEIGHT", help="up to 3840x2160"),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="CAMERA", help='a camera of one\'s own, as "Copy camera" of a page gives it'
        ),
    ] = None,
    plain: Annotated[bool, typer.Option("--plain", help="no panels and no words")] = False,
    background: Annotated[
        Literal["sea", "white", "transparent"], typer.Option(help="behind the hulls")
    ] = "sea",
    speed_up: Annotated[
        float | None, typer.Option(help="seconds of the mission per second of film")
    ] = None,
    follower: Annotated[
        int, typer.Option(help="index of the follower that the camera follows")
    ] = 0,
    still: Annotated[
        float | None, typer.Option(metavar="T", help="one picture at mission time T [s]")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="file (default NAME.mp4 or NAME.png)")] = None,
) -> None:
    """Render a film or a picture of a scenario or a log."""
    from rich.console import Console

    from experiments.campaign.progress import phases
    from experiments.flight import results
    from laisn_sim.cli.outputs import output_file
    from sim.scenario.settings import Video

    settings = {"camera": camera, "speed_up": speed_up, **(size or {})}
    changes = {name: value for name, value in settings.items() if value is not None}
    suffix = ".mp4" if still is None else ".png"
    # before the mission is simulated
    results.video_of(Video(), changes)
    if out is not None:
        output_file(out, [suffix], [Path(source)])

    flight = results.flight_of(
        source,
        set_ or (),
        lambda scenario: results.require_picture(
            [vehicle.name for vehicle in scenario.followers],
            scenario.duration_s,
            results.video_of(scenario.video, changes),
            time_s=still,
            follower=follower,
            view=view,
            background=background,
        ),
    )
    output = output_file(out or Path(f"{flight.scenario.name}{suffix}"), [suffix], [Path(source)])
    with (
        phases(Console(stderr=True)) as phase,
        phase("video") if still is None else nullcontext() as update,
    ):
        results.render(
            flight,
            output.path,
            time_s=still,
            follower=follower,
            progress=update,
            view=view,
            plain=plain,
            background=background,
            **changes,
        )
        echo(output)


@app.command()
def replay(
    log: Annotated[
        Path,
        typer.Argument(
            parser=_log,
            metavar="LOG",
            help="a log (.mcap) of a flight, or its folder; or of a real vehicle with its channels",
        ),
    ],
    variant: Annotated[
        str | None,
        typer.Option(
            help="laisn-2 (default), laisn-3-1, laisn-3-2, tight or another; unknown names print "
            "the list"
        ),
    ] = None,
    set_: studies.SetOption = None,
    _plugin: studies.PluginOption = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="SCENARIO", help="for a log of measurements only: start, baseline, navigation"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="log of the flight with the new estimates; CSV with --scenario and of data sets"
        ),
    ] = None,
    longest_gap: Annotated[
        float,
        typer.Option(
            min=0.0, help="bridge gaps of up to this many seconds in a vehicle's own measurements"
        ),
    ] = 10.0,
    smooth: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar="SECONDS", help="tight: smooth with messages of up to this much later"
        ),
    ] = None,
) -> None:
    """Navigate on the measurements of a log with another variant or other settings."""
    from laisn_sim.cli import replaying
    from sim.datasets.log import is_data_set

    if scenario is not None:
        assignments = [f"navigation.variant={variant}"] if variant else []
        replaying.replay_measurements(
            log, scenario, [*assignments, *(set_ or ())], out, longest_gap, smooth
        )
    elif not is_data_set(log):
        replaying.replay(log, variant or "laisn-2", set_ or (), out, smooth)
    elif smooth is None:
        replaying.replay_data_set(log, variant or "laisn-2", set_ or (), out, longest_gap)
    else:
        raise LaisnError(f"--smooth: the navigator of a data set ({log}) has no smoother")


@app.command()
def view(
    log: LogArgument,
    _plugin: studies.PluginOption = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.html", help="the page (default: out/view/NAME.html)"),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--open/--no-open", help="open the page in the browser")
    ] = True,
) -> None:
    """Write the page of a flight's log, with the mission in 3D, and open it."""
    from sim.datasets.log import is_data_set

    if is_data_set(log):
        raise LaisnError(
            f"{log}: holds measurements of a data set, and no flight; its page with the scene is "
            f"written by: laisn replay {log}"
        )
    page = viewing.write_page(log, out)
    echo(f"page in {page}")
    if browser:
        viewing.open_page(page.path)


app.command()(viewing.figure)
app.command("range-budget")(analyses.range_budget)
app.command("bench-data")(benchmark.bench_data)
app.command("score")(benchmark.score)
app.command()(analyses.bound)
app.command()(analyses.pitch)
app.command()(analyses.hull)


@log_app.command("info")
def log_info(log: LogArgument) -> None:
    """Print the contents of a log."""
    from laisn_sim.cli import replaying

    replaying.show_info(log)


@log_app.command("export")
def log_export(
    log: LogArgument,
    out: Annotated[
        Path | None,
        typer.Argument(
            parser=studies.folder_option,
            metavar="[OUT]",
            help="folder for the tables (default: out/export/NAME)",
        ),
    ] = None,
    format_: Annotated[str, typer.Option("--format", help="parquet or csv")] = "parquet",
    rerun: Annotated[
        bool, typer.Option("--rerun", help="write one Rerun recording instead of tables")
    ] = False,
    pyfg: Annotated[
        bool, typer.Option("--pyfg", help="write a factor graph of each follower instead")
    ] = False,
    ros2: Annotated[
        bool,
        typer.Option("--ros2", help="write a ROS 2 bag instead (default: out/export/NAME-ros2)"),
    ] = False,
    tum: Annotated[
        bool, typer.Option("--tum", help="write true and estimated trajectories for evo instead")
    ] = False,
    gltf: Annotated[
        bool, typer.Option("--gltf", help="write an animated scene for Blender (.glb) instead")
    ] = False,
    _plugin: studies.PluginOption = None,
) -> None:
    """Export every numeric channel as a table, or a flight as a recording for Rerun, as factor
    graphs, as a ROS 2 bag, as trajectories for evo, or as an animated scene.
    """
    from experiments.flight.folder import title_of
    from laisn_sim.cli.outputs import written_files
    from sim.log.export import export, write_recording

    options = {"--rerun": rerun, "--pyfg": pyfg, "--ros2": ros2, "--tum": tum, "--gltf": gltf}
    formats = [name for name, is_set in options.items() if is_set]
    if len(formats) > 1:
        raise LaisnError(f"{' and '.join(formats)}: expected one of them at a time")
    if f"--{format_}" in options:
        raise LaisnError(f"--format {format_}: tables are parquet or csv; write --{format_}")
    name = title_of(log)
    folder = out or Path("out") / "export" / (f"{name}-ros2" if ros2 else name)
    existing = [*folder.glob("*")] if folder.is_dir() else []
    if pyfg:
        from laisn_sim.cli.replaying import export_factor_graphs

        files = export_factor_graphs(log, folder)
    elif tum:
        from sim.log.tum import write_trajectories

        files = write_trajectories(log, folder)
    elif gltf:
        from reports.gltf import write_gltf
        from sim.log.reader import read

        flight = read(log)
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / f"{log.stem}.glb"]
        write_gltf(flight, files[0])
    elif ros2:
        from sim.log.ros2 import remarks_of_left_out, write_bag

        files = write_bag(log, folder)
        for remark in remarks_of_left_out(log):
            echo(f"note: {remark}")
    elif rerun:
        folder.mkdir(parents=True, exist_ok=True)
        files = [write_recording(log, folder / f"{log.stem}.rrd")]
    else:
        files = export(log, folder, format_)
    for file in written_files(files, existing):
        echo(file)


@log_app.command("import")
def log_import(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="a factor graph (.pyfg), NAME.mat or NAME_DR.txt, a table (.csv), or a bag of ROS",
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="the log to write (.mcap)")] = None,
    map_: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="FILE", help="which columns or topics hold what, in a table or a bag"
        ),
    ] = None,
    propose: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="propose a map, write it as this file, import nothing"),
    ] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="whose topics of a bag to propose: those in /NAME/"),
    ] = None,
    beacons: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,NAME", help="keep the ranges to these beacons (default: to all)"
        ),
    ] = None,
) -> None:
    """Import a data set of ranges to beacons, or measurements of a vehicle in a table or a bag of
    ROS, for `laisn replay`.
    """
    from laisn_sim.cli import importing

    if propose is not None:
        importing.propose_map(source, propose, vehicle)
        return
    if out is None:
        raise LaisnError("--out: expected the log to write, or --propose FILE for a map")
    importing.import_recording(source, out, map_, vehicle, beacons)


@log_app.command("recover")
def log_recover(log: LogArgument) -> None:
    """Recover a log that a crash, a full disk or Ctrl-C left unfinished."""
    from laisn_sim.cli.outputs import OutputFile
    from sim.log.contents import recover, recovered_path

    exists = recovered_path(log).exists()
    file = recover(log, lambda remark: echo(f"note: {remark}"))
    echo(OutputFile(path=file, replaces=exists))


for _study in (studies.study, studies.compare):
    app.command()(_study)
for _name in studies.BUILT_IN:
    app.command(_name)(studies.command_of(_name))


def main() -> None:
    # Child processes that render select their own library; a missing one must not break other
    # commands.
    os.environ["MUJOCO_GL"] = "disable"
    # Modules stay loaded to the end; searching them for garbage costs each mission a quarter of a
    # second.
    gc.set_threshold(100_000, 50, 50)
    run(app)


if __name__ == "__main__":
    main()
