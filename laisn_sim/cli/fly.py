"""Simulate one scenario and write log, film, report and numbers."""

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from rich.console import Console

from experiments.campaign.progress import Update, phases, print_line, show_table
from experiments.flight.fly import MissionToFly, Stopwatch, fly
from experiments.flight.folder import (
    BAG,
    FILM,
    LAYOUT,
    LOG,
    REPORT,
    SCENARIO,
    SUMMARY,
    TIMING,
    one_flight,
    require_safe,
)
from laisn.errors import LaisnError
from laisn.spilled import released_regularly
from reports.bound import flight_bounds
from reports.summary import flight_events, safety_warnings, summarise
from sim.feasibility import cautions
from sim.flight import FlightRecord, Termination, navigate, position_and_bearing_errors
from sim.log.contents import LogError
from sim.log.writer import Event
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.simulation import DivergedError
from sim.system import background_process, return_large_blocks
from sim.trial import track_deviations

if TYPE_CHECKING:
    from laisn_sim.live import LiveView
    from sim.log.writer import FlightLog


_LONG_S = 7200.0  # of longer missions memory is given back while they are written
_STRETCH_S = 10.0  # of a live mission between two steps of its progress bar
_MOST_OF_A_KIND = 10  # warnings of one kind that are printed
_PATIENCE_S = 30.0  # for the page of a live mission
_LEGEND = """E_P, E_B: errors of position and bearing; track, depth: RMS off the route;
NEES: 2 on average for a consistent filter; × bound: RMS of E_P over the bound;
–: there is no estimate or no bound, or the covariance is singular"""


def _cell(value: float | None, unit: str) -> str:
    return "–" if value is None else f"{value:.2f}{unit}"


def _show_stations(console: Console, flight: FlightRecord, summary: dict[str, Any]) -> None:
    """Print station errors, and the closest approaches of two vehicles: of all, and of those in
    one depth layer.
    """
    rows = []
    for name, row in summary["followers"].items():
        if "station_rms_m" in row:
            distances = (
                f"{row[f'station_{statistic}_m']:.2f} m" for statistic in ("rms", "p95", "max")
            )
            joined = "never" if row["joined_s"] is None else f"{row['joined_s']:.0f} s"
            rows.append(
                [
                    name,
                    *distances,
                    _cell(row["e_p_mean_m"], " m"),
                    joined,
                    "lost" if row["lost"] else "",
                ]
            )
    heads = ("follower", "station error: RMS", "95 %", "max", "E_P: mean", "joined at", "")
    show_table(console, heads, rows)
    truth = flight.trajectory
    pair = summary["closest_approach_pair"]
    positions = truth.position[np.argmin(np.abs(truth.time - summary["closest_approach_s"]))]
    first, other = (positions[truth.names.index(name), :2] for name in pair)
    level = float(np.hypot(*(first - other)))
    text = (
        f"{' and '.join(pair)}, {summary['closest_approach_m']:.1f} m ({level:.1f} m horizontally)"
    )
    print_line(console, f"{text} at {summary['closest_approach_s']:.0f} s", "closest approach:", "")
    if summary["closest_in_layer_m"] is not None:
        text = (
            f"{' and '.join(summary['closest_in_layer_pair'])}, "
            f"{summary['closest_in_layer_m']:.1f} m horizontally"
        )
        text += f" at {summary['closest_in_layer_s']:.0f} s"
        print_line(console, text, "closest approach in one depth layer:", "")


def show(console: Console, flight: FlightRecord, summary: dict[str, Any]) -> None:
    """Print a table of errors, and the outcome if the mission was not completed."""
    followers = summary["followers"]
    on_routes = {name: row for name, row in followers.items() if "station_rms_m" not in row}
    if len(on_routes) < len(followers):
        _show_stations(console, flight, summary)
    if on_routes:
        _show_errors(console, on_routes)
    _show_avoidance(console, summary)
    _show_navigators(console, summary)
    _show_leader(console, summary)
    if summary["verdict"]["lost"]:
        print_line(console, summary["verdict"]["sentence"], "lost:", "red")
    elif flight.without_estimate:
        print_line(console, summary["verdict"]["sentence"], "warning:")
    if flight.outcome is not Termination.COMPLETED:
        colour = "yellow" if flight.outcome is Termination.CONTACT else "red"
        print_line(console, f"(at {summary['flown_s']:g} s)", flight.outcome.value, colour)


def _show_errors(console: Console, followers: dict[str, dict[str, Any]]) -> None:
    """Print errors of the estimates, and of track and depth, by rows of the summary."""
    heads = ["follower", "E_P: max", "mean", "E_B: max", "mean", "NEES", "× bound"]
    heads += ["track", "depth"]
    rows = []
    for name, row in followers.items():
        cells = [name]
        cells += [_cell(row[f"e_p_{statistic}_m"], " m") for statistic in ("max", "mean")]
        cells += [_cell(row[f"e_b_{statistic}_deg"], "°") for statistic in ("max", "mean")]
        for key in ("nees", "rms_over_bound"):
            cells.append("–" if row[key] is None else f"{row[key]:.3g}")
        cells += [f"{row[f'{quantity}_error_rms_m']:.2f} m" for quantity in ("track", "depth")]
        rows.append(cells)
    show_table(console, heads, rows)
    console.print(_LEGEND, style="dim", highlight=False)


def _show_navigators(console: Console, summary: dict[str, Any]) -> None:
    """Print who navigates by what, where followers have different navigators."""
    names: dict[str, list[str]] = {}
    for name, row in summary["followers"].items():
        if "variant" in row:
            names.setdefault(row["variant"], []).append(name)
    if names:
        parts = [f"{variant} ({', '.join(names[variant])})" for variant in names]
        print_line(console, ", ".join(parts), "navigators:", "")


def _show_leader(console: Console, summary: dict[str, Any]) -> None:
    """Print errors of the leader's own estimate, if it has a navigator."""
    row = summary.get("leader")
    if row is None or row["e_p_max_m"] is None:
        return
    nees = "–" if row["nees"] is None else f"{row['nees']:.3g}"
    text = (
        f"its own estimate, by {row['variant']}, is {row['e_p_max_m']:.2f} m off at most, "
        f"{row['e_p_mean_m']:.2f} m on average, with a NEES of {nees}"
    )
    print_line(console, text, "leader:")


def _show_avoidance(console: Console, summary: dict[str, Any]) -> None:
    """Print how many followers gave way, and which of them for the longest time."""
    followers = summary["followers"]
    gave_way = {name: row["gave_way_s"] for name, row in followers.items() if row.get("gave_way_s")}
    if gave_way:
        longest = max(gave_way, key=gave_way.__getitem__)
        text = (
            f"{len(gave_way)} of {len(followers)} followers gave way, {longest} longest "
            f"({gave_way[longest]:.0f} s)"
        )
        print_line(console, text, "avoidance:", "")


def show_warnings(console: Console, warnings: Sequence[Event], names: Sequence[str]) -> None:
    """Print warnings of a flight of vehicles of these names; of very many of one kind, which large
    formations have, the first ones and how many more there are.

    Texts that differ in names of vehicles and in numbers alone are of one kind.
    """

    def general(word: re.Match[str]) -> str:
        return "…" if word[0] in names or word[0][0].isdigit() else word[0]

    counts = Counter[str]()
    for event in warnings:
        kind = re.sub(r"[^\s,]+", general, event.text)
        counts[kind] += 1
        if counts[kind] <= _MOST_OF_A_KIND:
            print_line(console, f"at {event.time_s:g} s {event.text}", "warning:")
    for kind, count in counts.items():
        if count > _MOST_OF_A_KIND:
            more = count - _MOST_OF_A_KIND
            print_line(console, f"{more} more like these are in {LOG}: {kind}", "warning:")


def _draw_report(*arguments: Any) -> float:
    """Draw a report; the processor time that it took in this process [s]."""
    from reports.flight_report import flight_report

    start_s = process_time()
    flight_report(*arguments)
    return process_time() - start_s


def _film(
    flight: FlightRecord, path: Path, update: Update, write_log: Callable[..., None]
) -> Exception | None:
    """Film a flight, and write its frames into the log if the scenario asks for it; returns what
    prevented it, without which the other results are complete.
    """
    from sim.film.render import FilmJob, render

    video = flight.scenario.video
    try:
        frames = render(FilmJob(flight=flight, video=video), path, progress=update)
    except OSError:
        raise
    except Exception as error:
        return error
    if video.in_log:
        write_log(video=frames)
    return None


def fly_live(scenario: Scenario, view: "LiveView", progress: Update) -> FlightRecord:
    """Fly a scenario at the speed, and with the pauses, that its live page asks for; the flight is
    that of `laisn_sim.fly`.

    LaisnError if its vehicles move as points.
    """
    from laisn_sim.simulation import Simulation

    simulation = Simulation(scenario, live=view)
    while not simulation.done:
        try:
            simulation.step(_STRETCH_S)
        except DivergedError:
            simulation.finish_live(simulation.flight())
        progress(simulation.time / scenario.duration_s)
    flight = simulation.flight()
    if scenario.keys_needing_closed_loop():
        return flight
    # by the reference code, as of all missions whose followers do not steer by estimates
    return navigate(scenario, flight.trajectory, outcome=flight.outcome)


@contextmanager
def ended_log(mission: MissionToFly | None, log: "FlightLog") -> Iterator[None]:
    """If the block fails or is interrupted, the log has all that was flown until then."""
    try:
        yield
    except BaseException as error:
        try:
            if mission is not None:
                mission.end_log(log)
        except LogError as reason:
            error.add_note(str(reason))
        raise


def _memory_kept_low(duration_s: float) -> AbstractContextManager[None]:
    """While a block goes through a long mission, which is in files, its memory is given back."""
    return released_regularly() if duration_s > _LONG_S else nullcontext()


class FlownFlight(NamedTuple):
    """A flight whose files are written."""

    flight: FlightRecord
    summary: dict[str, Any]
    warnings: list[Event]
    """Its `safety_warnings`."""
    film_error: Exception | None
    """A `LaisnError` or a bug that prevented a requested film."""


def _simulate_and_navigate(
    mission: MissionToFly,
    log: "FlightLog",
    show_phase: Callable[[str], AbstractContextManager[Update]],
) -> FlightRecord:
    """Simulate a mission into its log and navigate, with both phases shown."""
    with show_phase("simulate") as update:
        trajectory, outcome = mission.simulate(update, log)
    with show_phase("navigate"):
        flight = mission.flight(trajectory, outcome)
    return flight  # noqa: RET504 - within the block mypy misses a return after it


def _write_timing(path: Path, watch: Stopwatch, flown_s: float) -> None:
    """Write the times of phases, and how many times faster than the mission it was simulated."""
    factors = {
        "real_time_factor": flown_s / watch["simulate_s"],
        "real_time_factor_processor": flown_s / max(watch["simulate_processor_s"], 1e-6),
    }
    path.write_text(json.dumps(watch | factors, indent=2) + "\n", encoding="utf-8")


def write_flight(
    scenario: Scenario,
    folder: Path,
    console: Console,
    *,
    with_video: bool,
    with_bag: bool = False,
    live: "LiveView | None" = None,
) -> FlownFlight:
    """Simulate a scenario and write its files into an empty folder; OSError or LogError if that
    fails.
    """
    from sim.log import writer
    from sim.log.ros2 import write_bag
    from sim.log.scene import layout

    watch = Stopwatch()
    # a report without a film is drawn beside the log, by a process that imports libraries during
    # the simulation; not that of a long mission: the process would need the memory of a second
    # flight
    is_long = scenario.duration_s > _LONG_S
    writes_meanwhile = not (with_video or is_long)
    if is_long:
        return_large_blocks()
    imports = partial(import_module, "reports.flight_report")
    with phases(console) as show_phase, watch.phase("prepare"), show_phase("prepare"):
        # two messages, so that compiling on first use counts neither as simulation nor as
        # navigation, and the other process has the compiled code
        fly(scenario.first_messages)
    with (
        background_process(imports) if writes_meanwhile else nullcontext() as background,
        phases(console) as show_phase,
    ):

        @contextmanager
        def phase(name: str) -> Iterator[Update]:
            with watch.phase(name), show_phase(name) as update:
                yield update

        log = writer.FlightLog(folder / LOG)
        with _memory_kept_low(scenario.duration_s):
            mission = MissionToFly(scenario) if live is None else None
        with ended_log(mission, log), _memory_kept_low(scenario.duration_s):
            if mission is None:
                with phase("simulate") as update:
                    flight = fly_live(scenario, cast("LiveView", live), update)
            else:
                flight = _simulate_and_navigate(mission, log, show_phase)
                watch |= mission.watch
            errors = position_and_bearing_errors(flight)
            warnings = safety_warnings(flight)
            events = flight_events(flight, warnings)
            bounds = flight_bounds(flight)
            summary = summarise(flight, bounds)
            summary_text = json.dumps(summary, indent=2, allow_nan=False) + "\n"
            report = partial(_draw_report, flight, errors, summary, folder / REPORT)
            reference = writer.film_reference(FILM, scenario.video) if with_video else None
            report_task = background.submit(report, None, bounds, events) if background else None
            # the log first, so that it is kept if the film fails
            with phase("log"):
                remaining = flight if mission is None else mission.rest_of(flight)
                log.finish(
                    remaining, flight.outcome, summary=summary_text, events=events, film=reference
                )
        film = folder / FILM
        film_error: Exception | None = None
        if with_video:
            rewrite = partial(
                writer.write,
                flight,
                folder / LOG,
                summary=summary_text,
                events=events,
                film=reference,
            )
            with phase("video") as update:
                film_error = _film(flight, film, update, rewrite)
        has_film = with_video and film_error is None
        with phase("report"), _memory_kept_low(scenario.duration_s):
            if report_task is not None:
                watch.add("report", 0.0, report_task.result())
            else:
                report(film if has_film else None, bounds, events)
        if with_bag:
            with phase("bag"):
                write_bag(folder / LOG, folder / BAG)
    _write_timing(folder / TIMING, watch, float(flight.trajectory.time[-1]))
    camera = has_film and scenario.video.in_log
    texts = {
        SUMMARY: summary_text,
        SCENARIO: scenario.toml(),
        LAYOUT: layout(flight.trajectory.names, camera=camera),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return FlownFlight(flight, summary, warnings, film_error)


def _opened_view(console: Console, motion: str, foxglove: bool, live: bool) -> "LiveView":
    """A live view with its page open, or after a while without one; LaisnError if the mission
    cannot be shown live.
    """
    if motion == "kinematic":
        raise LaisnError(
            f'{"--live" if live else "--foxglove"}: expected motion = "physics" (points, as '
            'motion = "kinematic" has them, are not flown step by step)'
        )
    from laisn_sim.cli.viewing import open_address
    from laisn_sim.live import LiveView
    from sim.log.stream import PORT

    view = LiveView(foxglove_port=PORT if foxglove else None)
    if view.foxglove:
        words = f"{view.foxglove.address} (open connection, Foxglove WebSocket)"
        print_line(console, words, "Foxglove:", "")
    print_line(console, f"{view.address} (this machine alone)", "live:", "")
    open_address(view.address)
    if not view.wait_for_page(_PATIENCE_S):
        print_line(console, "no page was opened; the mission begins", "live:", "")
    return view


def fly_and_write(
    scenario: Scenario,
    folder: Path,
    *,
    with_video: bool,
    with_bag: bool = False,
    source: Path | None = None,
    live: bool = False,
    foxglove: bool = False,
) -> Termination:
    """Simulate a scenario, print a summary, and write every result into a folder; how the mission
    ended. Errors are those of `folder.one_flight`.

    `source` is the file of the scenario, which a changed scenario does not replace. An exception
    that is a bug which prevented the film is raised after all else is written.
    """
    console = Console()
    require_safe(folder, source, scenario.toml)
    if with_bag:
        from sim.log.ros2_encoding import typestore

        typestore()  # an error without the package, before the flight
    for caution in cautions(scenario):
        print_line(console, caution, "warning:")
    replaces = (folder / SUMMARY).exists()
    view = _opened_view(console, scenario.motion, foxglove, live) if live or foxglove else None
    with one_flight(folder) as work:
        flight, summary, warnings, film_error = write_flight(
            scenario,
            work,
            Console(stderr=True),
            with_video=with_video,
            with_bag=with_bag,
            live=view,
        )
    show(console, flight, summary)
    with _memory_kept_low(scenario.duration_s):
        deviations = track_deviations(MotionSettings.of(scenario), flight.trajectory)
    for deviation in deviations:
        print_line(console, deviation, "warning:")
    show_warnings(console, warnings, flight.trajectory.names)
    is_bug = film_error is not None and not isinstance(film_error, LaisnError)
    if film_error:
        print_line(console, "a bug in the program" if is_bug else film_error, "no film:")
    note = " (replaces the earlier flight)" if replaces else ""
    print_line(console, f"results in {folder}{note}")
    if with_bag:
        from sim.log.ros2 import remarks_of_left_out

        for remark in remarks_of_left_out(folder / LOG):
            print_line(console, remark, "note:")
    if film_error and is_bug:
        raise film_error
    return flight.outcome
