"""Drawings of the pitch study: one message to scale, the map around the leader, errors over pitch;
and its film.

The film shows the leader that pitches, rays in the colour of their errors, and two estimates.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

from experiments.campaign.progress import compiling_shown
from experiments.campaign.store import columns_of
from experiments.flight.library import fly_line, table_of
from experiments.studies.asymmetry import findings, fix_map
from experiments.studies.asymmetry.findings import (
    AHRS,
    CAUSES,
    LEVEL,
    REAL,
    Curve,
    Missions,
    paired,
    select,
)
from experiments.studies.asymmetry.fix_map import MAP_GRID, Chart
from experiments.study.plan import StudyPlan
from experiments.study.run import StudyResults
from laisn.arrays import Bools, Floats
from laisn.settings import NavigationSettings
from reports.figures import Line, Panel, error_bands, panel
from reports.findings import Finding, Findings, interval_finding
from reports.flight_report import asymmetry_over_time, legend_of, share_table
from reports.intervals import Interval
from reports.page import Code, Figures, TableCell, share_of
from reports.range_budget import Cause, RangeErrorBudget, range_error_budget
from reports.style import ERROR_LEVELS_M, FULL, INK, MUTED, SERIES, Colour
from sim.film.film_data import Annotations, OtherEstimate, RayErrors
from sim.film.render import FilmJob, render
from sim.flight import FlightRecord, excerpt, navigate
from sim.scenario.file import assigned, validate
from sim.scenario.settings import Scenario, Video
from sim.sensing.acoustics import TRANSMITTERS
from sim.simulation import simulate_motion
from sim.trajectory import Trajectory

LEVEL_COLOUR = SERIES[2]
REAL_COLOUR = SERIES[1]
AWARE_COLOUR = SERIES[0]
LEGEND = (
    (LEVEL_COLOUR, "level leader"),
    (REAL_COLOUR, "real leader"),
    (AWARE_COLOUR, "AHRS broadcast"),
)
CAUSE_COLOURS = {"trim": SERIES[0], "dive": SERIES[2], "waves": SERIES[1]}
EXAMPLE = "waves-1m-following-2m"
ROUTE = "T6"
OFFSET_M = 10.0
"""Case, route and depth of the follower below the leader, of the mission of the film and of the
range error budget: close by on the quarter and far below, where pitch does much and is easy to
see."""
EVERYTHING: Mapping[str, float] = {
    "acoustics.travel_time": True,
    "acoustics.ping_slot_s": 0.1,
    "acoustics.sound_speed_bias_m_s": 3.0,
    "acoustics.clock_offset_s": 1e-4,
    "sensors.depth_sigma_m": 0.05,
    "sensors.leader_depth_sigma_m": 0.05,
}
"""All causes of range errors at work at once, in the budget alone; 0.1 ms is 15 cm."""
_SHOWN_CAUSES = (Cause.LEVER_ARM, Cause.RANDOM, Cause.MOTION)
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 181)


class Message(NamedTuple):
    """One message in the leader's own axes: forward, port and up of the level hull, from its
    origin, [m].
    """

    pitch: float  # of the leader, nose up [rad]
    hydrophone: Floats  # of the follower, shape (3,)
    transmitters: Floats  # rear and front where they are on the pitched hull, shape (2, 3)
    assumed_transmitters: Floats  # where the follower assumes them, on a level hull, shape (2, 3)

    @classmethod
    def of(cls, trajectory: Trajectory, step: int) -> Self:
        """Recorded point `step` of a trajectory, and its first follower."""
        pitch = float(trajectory.pitch[step, 0])
        heading = float(trajectory.heading[step, 0])
        hydrophone = trajectory.site_position[
            step, trajectory.site(f"{trajectory.names[1]}/hydrophone")
        ]
        east, north, up = hydrophone - trajectory.position[step, 0]
        follower = (
            np.sin(heading) * east + np.cos(heading) * north,
            np.sin(heading) * north - np.cos(heading) * east,
            up,
        )
        # rear and front are on the hull's axis
        level = trajectory.site_offset[[trajectory.site(name) for name in TRANSMITTERS[:2]]]
        tilted = level[:, :1] * np.array([np.cos(pitch), 0.0, np.sin(pitch)])
        return cls(pitch, np.array(follower), tilted, level)

    @property
    def horizontal_ranges(self) -> Floats:
        """Horizontal ranges that a noiseless follower computes, shape (2,), [m]."""
        slant = np.linalg.norm(self.transmitters - self.hydrophone, axis=1)
        return np.asarray(np.sqrt(np.maximum(slant**2 - self.hydrophone[2] ** 2, 0.0)))

    @property
    def fix(self) -> Floats:
        """Point where the circles about the assumed rear and front transmitter meet, (forward,
        port), [m].
        """
        rear, front = self.assumed_transmitters[:, 0]
        ranges = self.horizontal_ranges
        forward = float((ranges[0] ** 2 - ranges[1] ** 2) / (2 * (front - rear)))
        sideways = np.sqrt(max(ranges[0] ** 2 - (forward - rear) ** 2, 0.0))
        return np.array([forward, np.copysign(sideways, self.hydrophone[1])])


def _path(
    points: Floats,
    colour: Colour,
    dash: str = "-",
    marker: str = "",
    *,
    text: str = "",
    text_position: str = "middle right",
) -> Line:
    """A line through points of shape (n, 2), or marks there, perhaps with words beside the last."""
    return Line(
        x=points[:, 0],
        y=points[:, 1],
        colour=colour,
        dash=dash,
        marker=marker,
        size=5.0,
        text=text,
        text_position=text_position,
    )


def _scene(lines: Sequence[Line], low: Floats, high: Floats, y_label: str, title: str) -> Panel:
    return panel(
        lines,
        x_label="forward of the leader [m]",
        y_label=y_label,
        title=title,
        height=3.4,
        equal_scales=True,
        x_limits=(low[0], high[0]),
        y_limits=(low[1], high[1]),
    )


def message_hull(message: Message) -> Panel:
    """The hull's axis from the side, with rays: where stern and bow are, and where the follower
    assumes them.
    """
    lines = []
    for sites, colour, dash in (
        (message.assumed_transmitters, LEVEL_COLOUR, "--"),
        (message.transmitters, REAL_COLOUR, "-"),
    ):
        lines.append(_path(sites[:, [0, 2]], colour, dash))
        for name, site in zip(("stern", "bow"), sites, strict=True):
            side = f"{'top' if site[2] > 0 else 'bottom'} {'right' if site[0] > 0 else 'left'}"
            text = f"{name} {100 * site[2]:+.0f} cm" if colour is REAL_COLOUR else ""
            lines.append(_path(np.stack([site, message.hydrophone])[:, [0, 2]], colour, dash))
            lines.append(
                _path(site[None, [0, 2]], colour, marker="o", text=text, text_position=side)
            )
    return _scene(
        lines, np.array([-2.1, -0.9]), np.array([2.1, 0.9]), "up [m]", "Bow and stern from the side"
    )


def message_top(message: Message) -> Panel:
    """View from above, to scale: the circles that the follower draws, and where they meet."""
    truth = message.hydrophone[:2]
    fix = message.fix
    distance = float(np.hypot(*truth))
    error = float(np.hypot(*(fix - truth)))
    circle = np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
    centres = message.assumed_transmitters[:, :2]
    circles = zip(centres, message.horizontal_ranges, strict=True)
    lines = [_path(centre + radius * circle, REAL_COLOUR) for centre, radius in circles]
    lines += [_path(distance * circle, INK, ":"), _path(centres, INK)]
    # labels away from each other, across the ray
    sides = (
        ("middle left", "middle right") if fix[0] < truth[0] else ("middle right", "middle left")
    )
    for text, position, side, colour, mark in (
        (f"fix, {error:.2f} m off", fix, sides[0], REAL_COLOUR, "X"),
        ("truth", truth, sides[1], LEVEL_COLOUR, "s"),
    ):
        lines += [
            _path(np.stack([np.zeros(2), position]), colour, "--"),
            _path(position[None], colour, "", mark, text=text, text_position=side),
        ]
    points = np.array([truth, fix, (-1.5, 0.0), (1.5, 0.0)])
    pad = distance * np.array([0.3, 0.12])
    return _scene(
        lines,
        points.min(axis=0) - pad,
        points.max(axis=0) + pad,
        "port [m]",
        "From above, to scale",
    )


def around_leader(chart: Chart, depth_offset: float) -> Panel:
    """Errors of LAISN-2 around a leader pitched by 5°, over bearing and range, from the map."""
    rows = points_at(chart, pitch_deg=5.0, depth_offset_m=depth_offset)
    range_m = np.unique(chart["range_m"][rows])
    bearing_deg = np.unique(chart["bearing_deg"][rows])
    error = chart["error_laisn-2_m"][rows].reshape(range_m.size, bearing_deg.size)
    angles_deg = np.append(bearing_deg, bearing_deg[0] + 360.0)
    closed = np.concatenate([error, error[:, :1]], axis=1)
    hover = "%{x}°, %{y} m: %{customdata:.2f} m"
    contours = error_bands(angles_deg, range_m, closed, ERROR_LEVELS_M, hover)
    return panel(
        [],
        x_label="bearing B of the follower [°]",
        y_label="range [m]",
        width=FULL / 2,
        height=3.4,
        title=f"LAISN-2, pitch 5°, follower {depth_offset:g} m below",
        traces=[contours],
        x_limits=(0.0, 360.0),
        x_ticks=range(0, 361, 45),
        y_log=True,
        y_ticks=(5, 10, 20, 50, 100),
        y_limits=(float(range_m[0]), float(range_m[-1])),
    )


def points_at(chart: Chart, **fixed: float) -> Bools:
    """Which points of the map have these values in its columns."""
    return np.all([np.isclose(chart[name], value) for name, value in fixed.items()], axis=0)  # type: ignore[no-any-return]


def excess_over_lever(missions: Missions) -> Panel:
    """What pitch adds to the mean error of missions over Δz sin φ, both root mean square, and
    the line of equality.
    """
    top = max(m.lever for m in missions)
    equal = np.array([0.005, 1.1 * top])
    lines = [Line(x=equal, y=equal, colour=MUTED, dash="--")]
    for cause, colour in CAUSE_COLOURS.items():
        cause_missions = select(missions, cause=cause)
        points = np.array([(m.lever, max(m.added, 1e-3)) for m in cause_missions]).reshape(-1, 2)
        lines.append(
            Line(
                x=points[:, 0],
                y=points[:, 1],
                colour=colour,
                marker="o",
                size=4.0,
                name=CAUSES[cause],
            )
        )
    return panel(
        lines,
        x_label="Δz sin φ of the mission, rms [m]",
        y_label="added to mean E_P [m]",
        title="All missions, LAISN-2",
        height=2.8,
        x_log=True,
        y_log=True,
        x_limits=(0.005, 1.2 * top),
        y_limits=(9e-4, None),
    )


def over_offset(missions: Missions) -> list[Panel]:
    """Mean position error of the median mission over the depth offset, by leader and with an
    AHRS, for each cause.
    """
    lines_of: dict[str, list[Line]] = {}
    for cause, title in CAUSES.items():
        cause_missions = select(missions, cause=cause)
        offsets = sorted({m.real["depth_offset_m"] for m in cause_missions})
        for arm, (colour, name), dash in zip(
            (LEVEL, REAL, AHRS), LEGEND, ("-", "-", "--"), strict=True
        ):
            error = [
                np.median(
                    [m.arms[arm]["e_p_mean_m"] for m in select(cause_missions, depth_offset_m=o)]
                )
                for o in offsets
            ]
            line = Line(x=np.array(offsets), y=np.array(error), colour=colour, width=1.4, dash=dash)
            lines_of.setdefault(title, []).extend((line, replace(line, marker="o", name=name)))
    top = 1.05 * max(float(line.y.max()) for lines in lines_of.values() for line in lines)
    x_label, y_label = "depth of the follower below the leader [m]", "mean position error [m]"
    return [
        panel(lines, x_label=x_label, y_label=y_label, title=title, y_limits=(0.0, top))
        for title, lines in lines_of.items()
    ]


_BEFORE_S = 40.0  # how long before the message of the example the film begins
_AFTER_S = 20.0  # and how long after it the film ends
VIDEO = Video(camera="profile", speed_up=4.0, frame_rate_hz=24)
_AWARE_COLOUR = (0.30, 1.0, 0.60)  # of the second estimate in the film: red, green, blue, 0 … 1


@dataclass(frozen=True, kw_only=True)
class Example:
    """A flight with the paper's acoustics, and the range errors of the same motion with every
    cause at work.
    """

    title: str  # of the condition
    command: str
    flight: FlightRecord
    aware: Scenario  # with the broadcast attitude of an AHRS
    budget: RangeErrorBudget
    step: int  # recorded point of a message with a large pitch at a short range


def fly_example(plan: StudyPlan) -> Example:
    """Simulate the example of a plan of the study, and take its range errors apart."""
    points = [
        i for i, p in enumerate(plan.points) if (p["case"], p["offset_m"]) == (EXAMPLE, OFFSET_M)
    ]
    settings = plan.by_design_key[points[0], f"{REAL} laisn-2", 0].settings_at(0)
    changes: tuple[Mapping[str, Any], ...] = (
        {},
        EVERYTHING,
        plan.study.arm(f"{AHRS} laisn-2").settings,
    )
    example, all_causes, aware = (
        validate(assigned(table_of(ROUTE), {**settings, **changed}), EXAMPLE) for changed in changes
    )
    trajectory = simulate_motion(example)
    flight = navigate(example, trajectory)
    separation = trajectory.position[:, 1, :2] - trajectory.position[:, 0, :2]
    pings = flight.measurements[0].message_step * flight.stride
    step = int(
        pings[np.argmax(np.abs(trajectory.pitch[pings, 0]) / np.hypot(*separation[pings].T))]
    )
    return Example(
        title=plan.study.title("case", EXAMPLE),
        command=fly_line(ROUTE, settings, 0),
        flight=flight,
        aware=aware,
        budget=range_error_budget(navigate(all_causes, trajectory)),
        step=step,
    )


def pitch_errors(flight: FlightRecord) -> Floats:
    """What pitch and roll of the leader alone add to the horizontal ranges of each message,
    shape (m, 3), [m].
    """
    budget = range_error_budget(flight)
    received = flight.measurements[0].message_step
    errors = np.full((received.size, 3), np.nan)
    indices = np.searchsorted(flight.trajectory.time[received * flight.stride], budget.time)
    errors[indices] = budget.share[..., Cause.FORESHORTENING] + budget.share[..., Cause.LEVER_ARM]
    return errors


def scene(example: Example) -> tuple[FlightRecord, Annotations]:
    """What the film shows: the stretch about the message of the example, and an estimate by the
    broadcast pitch.
    """
    flight = example.flight
    time = example.flight.trajectory.time
    # truth and all other noise are the same: random numbers belong to their sensor
    aware_flight = navigate(example.aware, flight.trajectory)
    message = float(time[example.step])
    start = max(float(time[0]), message - _BEFORE_S)
    end = min(float(time[-1]), message + _AFTER_S)
    section = excerpt(flight, start, end)
    section = replace(section, scenario=flight.scenario.model_copy(update={"name": EXAMPLE}))
    received = time[flight.measurements[0].message_step * flight.stride]
    errors = pitch_errors(flight)[
        (received > section.trajectory.time[0]) & (received <= section.trajectory.time[-1])
    ]
    largest = float(np.nanmax(np.abs(errors), initial=1e-3))
    digit = 10.0 ** np.floor(np.log10(largest))
    position = excerpt(aware_flight, start, end).estimates[0].state[:, :2]
    return section, Annotations(
        caption=f"The leader pitches: estimates of a follower {OFFSET_M:g} m below",
        label="level leader assumed",
        others=(
            OtherEstimate(
                label="leader's pitch broadcast", colour=_AWARE_COLOUR, position=position
            ),
        ),
        rays=RayErrors(
            label="range error from pitch",
            value=errors,
            limit=float(np.ceil(largest / digit) * digit),
        ),
    )


def film(values: Mapping[str, Any], folder: Path, video: Video = VIDEO) -> Path:
    """Render the film of the example among the page's values as `film.mp4`; RendererDiedError if
    that fails.
    """
    flight, annotations = scene(values["example"])
    path = folder / "film.mp4"
    render(FilmJob(flight=flight, video=video, annotations=annotations), path)
    return path


def message_values(example: Example) -> dict[str, Any]:
    """Values of the page on the ranges of one message and of the minutes around it."""
    budget = example.budget
    message = Message.of(example.flight.trajectory, example.step)
    first = budget.time <= 200.0
    shares = {cause: budget.asymmetry[first, cause] for cause in _SHOWN_CAUSES}
    difference = asymmetry_over_time(
        budget.time[first], shares, "Difference of the bow's and stern's range errors"
    )
    pictures = message_hull(message), message_top(message)
    return {
        "geometry": Figures(panels=pictures, legend=LEGEND[:2]),
        "example": example,
        "pitch_deg": np.rad2deg(message.pitch),
        "fix_error_m": np.hypot(*(message.fix - message.hydrophone[:2])),
        "first_minutes": Figures(panels=[difference], legend=legend_of(_SHOWN_CAUSES)),
        "shares": share_table(budget),
        "everything": EVERYTHING,
        "one_mission": Code(text=example.command, title="Run it, with film and report:"),
    }


def map_values(chart: fix_map.Chart) -> dict[str, Any]:
    """Values of the page on the map: where around the leader its pitch matters."""
    maps = [around_leader(chart, offset) for offset in (0.0, 5.0)]
    closed_form = chart["error_closed_form_m"]
    laisn_2_error = chart["error_laisn-2_m"]
    is_known = closed_form > 0.0
    return {
        "maps": Figures(panels=maps),
        "abeam": laisn_2_error[
            points_at(chart, pitch_deg=5.0, depth_offset_m=10.0, bearing_deg=90.0)
        ],
        "points": laisn_2_error.size,
        "closed_form_m": np.abs(laisn_2_error - closed_form)[is_known].max(),
        # what the third transmitter changes: median and 95th percentile over the map
        "third_m": np.quantile(
            np.abs(chart["error_laisn-3-2_m"] - laisn_2_error)[is_known], (0.5, 0.95)
        ),
    }


def against(finding: Finding | Interval, aim: float) -> TableCell:
    """A share with its interval, green if the whole of it is beyond its aim, red if it is short
    of it.
    """
    interval = interval_finding(finding, "") if isinstance(finding, Interval) else finding
    tone = "yes" if interval.low is not None and interval.low >= aim else ""
    return replace(
        share_of(interval), tone="no" if interval.high is not None and interval.high < aim else tone
    )


def missions_values(
    missions: Missions,
    curves: Sequence[Curve],
    titles: Mapping[str, str],
    looks: Sequence[int] = findings.LOOKS,
) -> dict[str, Any]:
    """Values and functions of the page on missions: what pitch adds, and what remains of it with
    each remedy.

    `titles` are the words for conditions and arms by their names, `looks` the numbers of runs after
    which verdicts on remedies are computed.
    """
    laisn_2_missions = select(missions, variant="laisn-2")
    # missions on which pitch moves a noiseless fix far enough for remedies to be judged
    judged = select(laisn_2_missions, judged=True)
    # on the broadcast of an attitude with an error of 0.5° in each message, held against a level
    # leader that broadcasts its own with the same error
    same_sensor_verdicts = [
        m.judge("error", findings.READINGS, looks, findings.LEVEL_BROADCAST).verdict for m in judged
    ]
    return {
        "offsets": Figures(panels=over_offset(laisn_2_missions), legend=LEGEND),
        "worst": max(judged, key=lambda m: m.added, default=None),
        "excess": Figures(
            panels=[excess_over_lever(laisn_2_missions)],
            legend=[(colour, CAUSES[cause]) for cause, colour in CAUSE_COLOURS.items()],
        ),
        "missed_same_sensor": same_sensor_verdicts.count(findings.RemedyVerdict.MISSED),
        "open_same_sensor": same_sensor_verdicts.count(findings.RemedyVerdict.OPEN),
        "missions": missions,
        "conditions": list(dict.fromkeys(m.real["condition"] for m in missions)),
        "offsets_m": sorted({m.real["depth_offset_m"] for m in missions}),
        "routes": list(dict.fromkeys(m.real["route"] for m in missions)),
        "variants": [v for v in findings.VARIANTS if select(missions, variant=v)],
        "titles": titles,
        "study": findings,
        "curves": curves,
        "deepest": fix_map.deepest_offset,
        "radians": np.deg2rad,
        # scales τ of the random range error of the rear transmitter in the paper's Stage 4 [m]
        "stage_4_taus": findings.STAGE_4_TAU_M,
        "names": {"laisn-2": "LAISN-2", "laisn-3-2": "LAISN-3(2)"},
        "shown": lambda interval, spec: format(interval_finding(interval, ""), spec).replace(
            " (– to –)", ""
        ),
        "against": against,
    }


def values(record: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name; and tables that are written beside
    those of the parts.
    """
    plan = outcomes["missions"].plan
    rows = findings.judged_rows(outcomes)
    curves = findings.all_curves(outcomes)
    arms = {name.rpartition(" ")[0]: arm.title for name, arm in plan.study.arms.items()}
    titles = arms | {name: case.title for name, case in plan.study.cases.items()}
    with compiling_shown():
        chart = fix_map.measure_map(MAP_GRID, NavigationSettings(side_rule="predicted"))
    run_columns = findings.RUN_COLUMNS.values()
    tables = {
        "missions": columns_of(
            [{name: row[name] for name in row if name not in run_columns} for row in rows]
        ),
        # errors over pitch and over τ, in which equal errors make a pitch and a τ equivalent
        "equivalents": columns_of([asdict(curve) for curve in curves]),
        "map": {name: column.astype(np.float32) for name, column in chart.items()},
    }
    findings_of_page = (
        message_values(fly_example(plan))
        | map_values(chart)
        | missions_values(paired(rows), curves, titles)
    )
    return findings_of_page | {"tables": tables}
