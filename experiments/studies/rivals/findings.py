"""Findings of the study of rival methods, functions of its rows, and the time of a filter step
of each method.
"""

import json
import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from itertools import product
from time import process_time
from typing import Any

import numpy as np

from experiments.flight.library import load_scenario
from experiments.study.run import Cells, StudyResults
from laisn.navigators import find
from reports.findings import Finding, interval_finding, median_finding, plain_finding, share_finding
from reports.intervals import mean_over_missions
from sim.flight import navigation_settings
from sim.scenario.parts import SensingSettings
from sim.sensing.observation import measure, observe, start_of
from sim.sensing.sensors import navigated_errors_of
from sim.simulation import simulate_motion

_ROUTES, _SHARED, _CLOSED, _MAP, _TWO = (
    tomllib.loads(
        (resources.files(__package__) / f"study-{study}.toml").read_text(encoding="utf-8")
    )
    for study in ("routes", "shared", "closed", "map", "two")
)


def _titles(groups: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    return {group["name"]: group["title"] for group in groups}


NAVIGATORS = _titles(_CLOSED["arm"])
CONDITIONS = _titles(_ROUTES["case"])
"""Titles of navigators, by the names of their arms, and of what is simulated, by the names of
cases."""
TWO = "two"
"""Condition with two transmitters."""
IN_WATER = (*CONDITIONS, TWO)
"""All conditions, that with two transmitters last."""
WITH_TWO = _titles(_TWO["arm"])  # titles of the navigators that are flown with two transmitters
STEADY = "tight-steady"
"""The tightly coupled navigator with the speed through the water as a state."""
OURS = ("laisn-2", "laisn-3-1", "laisn-3-2", "tight", STEADY)
SLOW = "factor-graph"  # simulated in fewer runs
MESSAGE_INTERVAL = "timing.message_interval_s"  # key of the time between messages
INTERVALS, SHARED_INTERVALS = (
    tuple(study["vary"][MESSAGE_INTERVAL]) for study in (_ROUTES, _SHARED)
)
"""Of messages, and of those on channels that many share [s]."""
USUAL_INTERVAL_S = 5.0  # message interval of most tables
SHARING = tuple(_titles(_SHARED["arm"]))  # navigators on such channels
MAPPED = tuple(_titles(_MAP["arm"]))  # navigators of the map
RANGES_M = tuple(_titles(_MAP["case"]))  # names of the map's cases: ranges in metres, as text
# factors of the map of LAISN-3(2) and inverted USBL
BIASES_DEG, BASELINES_M = _MAP["vary"].values()
# factors of the map of a channel that vehicles share
VEHICLES = (1, 2, 5, 10, 20, 50)
REACHES_M = (50.0, 150.0, 500.0)
PING_S = 0.1
SOUND_M_S = 1500.0
# A run whose error, or whose distance from its place at the end, is beyond this is called lost [m]
LOST_FROM_M = 50.0


def case_name(navigator: str, condition: str, interval: float) -> str:
    """Name of a navigator's case on the routes."""
    return f"{navigator} {condition} {interval:g}"


def key_of_error(name: str) -> str:
    """Key of a navigator's mean error in calm water, messages every 5 s."""
    return f"error {case_name(name, 'calm', USUAL_INTERVAL_S)}"


def navigators_in(findings: Mapping[str, Finding]) -> dict[str, str]:
    """Titles of the navigators that were flown, by name: some need a package of their own."""
    return {name: title for name, title in NAVIGATORS.items() if key_of_error(name) in findings}


def shared_interval_s(vehicles: int, reach_m: float) -> float:
    """Interval at which each of n vehicles gets its range when they interrogate in turn: n (ping
    + 2 r / c) [s].
    """
    return vehicles * (PING_S + 2.0 * reach_m / SOUND_M_S)


def step_times_us(duration_s: float = 120.0, repeats: int = 3) -> dict[str, float]:
    """Processor time of a filter step of each navigator, T5 with messages every second, the
    least of some runs [µs].
    """
    times = {}
    mission = ["motion=kinematic", f"duration_s={duration_s}"]
    for arm in _CLOSED["arm"]:
        name = arm["name"]
        navigation = {key: value for key, value in arm.items() if key.startswith("navigation.")}
        navigator = find(navigation["navigation.variant"])
        if navigator.missing:
            continue
        overrides = [f"{key}={json.dumps(value)}" for key, value in navigation.items()]
        scenario = load_scenario("T5", mission + overrides)
        motion = simulate_motion(scenario)
        sensing = SensingSettings.of(scenario)
        settings = navigation_settings(scenario, motion.sites, 0)
        start = start_of(motion)
        measured = measure(
            observe(motion, sensing), navigated_errors_of(sensing, 0), seed=scenario.seed, run=0
        )
        seconds = []
        # the first one compiles
        for _ in range(repeats + 1):
            begin = process_time()
            navigator.fly(settings, measured, start)
            seconds.append(process_time() - begin)
        times[name] = 1e6 * min(seconds[1:]) / measured.speed.size
    return times


def arm_findings(name: str, routes: Cells) -> Iterator[tuple[str, Finding]]:
    """Mean error, 95th percentile, NEES, mirror-locked and lost shares of an arm on the routes."""
    yield (
        f"error {name}",
        interval_finding(
            mean_over_missions([*routes.values_by_run("e_p_mean_m").T]),
            "mean E_P over routes, 95 %",
            "m",
        ),
    )
    high, nees = (routes.values_by_run(metric)[0] for metric in ("e_p_p95_m", "nees"))
    yield (
        f"high {name}",
        plain_finding(float(high.mean()), "95th percentile of E_P, mean over routes", "m"),
    )
    yield (
        f"nees {name}",
        median_finding(nees, "NEES, median of routes; 2 if the covariance is right"),
    )
    yield (
        f"locked {name}",
        share_finding(
            routes.values_by_run("mirror_locked"),
            "share of missions locked on the mirror image, 95 %",
        ),
    )
    meaning = f"share of missions with an error beyond {LOST_FROM_M:g} m, 95 %"
    yield f"lost {name}", share_finding(routes.values_by_run("e_p_max_m") > LOST_FROM_M, meaning)


def worst_routes(cells: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """Mean error of each arm on its worst route."""
    for name, routes in cells.items():
        errors = routes.values_by_run("e_p_mean_m").mean(axis=0)
        yield (
            f"worst {name}",
            plain_finding(float(errors.max()), "mean E_P on the worst route", "m"),
        )


def difference(first: Cells, second: Cells, description: str) -> Finding:
    """Paired difference of mean errors of two arms, over the runs that both have."""
    errors = [cells.values_by_run("e_p_mean_m") for cells in (first, second)]
    n = min(map(len, errors))
    mean = mean_over_missions([*(errors[0][:n] - errors[1][:n]).T])
    return interval_finding(mean, f"paired difference of mean E_P: {description}, 95 %", "m")


def compared(cells: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """Differences of every rival from LAISN-3(2) and from the tightly coupled navigator, and how
    often it is better.
    """
    rivals = [name for name in NAVIGATORS if name not in OURS]
    for ours, rival in product(("laisn-3-2", "tight"), rivals):
        better = total = 0
        for condition, interval in product(IN_WATER, INTERVALS):
            name_of_rival, other = (case_name(name, condition, interval) for name in (rival, ours))
            if name_of_rival not in cells or other not in cells:
                continue
            finding = difference(cells[name_of_rival], cells[other], f"{rival} less {ours}")
            yield f"less {ours} {name_of_rival}", finding
            total += 1
            better += finding.high is not None and finding.high < 0.0
        if not total:
            continue
        yield (
            f"better-than {ours} {rival}",
            plain_finding(better, "cases with a smaller mean E_P, the whole interval below 0"),
        )
        yield (
            f"cases {ours} {rival}",
            plain_finding(total, "cases of condition and message interval"),
        )


def with_speed_as_state(cells: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """Differences of the tightly coupled navigator that has the speed as a state from the one
    that has not, over all routes and on the routes where it gains and loses most.
    """
    for condition, interval in product(IN_WATER, INTERVALS):
        name, other = (case_name(arm, condition, interval) for arm in (STEADY, "tight"))
        if name not in cells or other not in cells:
            continue
        yield f"less tight {name}", difference(cells[name], cells[other], f"{STEADY} less tight")
        error, other_error = (cells[n].values_by_run("e_p_mean_m") for n in (name, other))
        by_route = error - other_error
        for end, route in (
            ("least", int(by_route.mean(axis=0).argmin())),
            ("most", int(by_route.mean(axis=0).argmax())),
        ):
            yield (
                f"{end} tight {name}",
                interval_finding(
                    mean_over_missions([by_route[:, route]]), f"the {end} of all routes, 95 %", "m"
                ),
            )


def steered(cells: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """How followers that steer by their estimates keep their routes, messages every 5 s."""
    for name, condition in product(NAVIGATORS, CONDITIONS):
        case = f"{name} {condition}"
        if case not in cells:
            continue
        routes = cells[case]
        error = mean_over_missions([*routes.values_by_run("e_p_mean_m").T])
        yield f"closed-error {case}", interval_finding(error, "mean E_P, 95 %", "m")
        track_error = routes.values_by_run("track_error_rms_m")
        yield (
            f"closed-off {case}",
            median_finding(track_error, "RMS off its place, median of missions", "m"),
        )
        meaning = f"share of missions that end more than {LOST_FROM_M:g} m off their place, 95 %"
        yield (
            f"closed-lost {case}",
            share_finding(routes.values_by_run("track_error_end_m") > LOST_FROM_M, meaning),
        )


def mapped(cells: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """Mean errors over range, compass bias and baseline, and where the inverted USBL is better
    than LAISN-3(2).
    """
    better = total = 0
    for distance, bias, baseline in product(RANGES_M, BIASES_DEG, BASELINES_M):
        names = [f"map {name} {distance} {bias:g} {baseline:g}" for name in MAPPED]
        laisn, usbl = (cells[name].values_by_run("e_p_mean_m")[:, :1].T for name in names)
        for name, errors in zip(names, (laisn, usbl), strict=True):
            yield name, interval_finding(mean_over_missions([*errors]), "mean E_P, 95 %", "m")
        difference = interval_finding(
            mean_over_missions([*(usbl - laisn)]), "paired difference of mean E_P, 95 %", "m"
        )
        yield f"map-less {distance} {bias:g} {baseline:g}", difference
        better = better + int(difference.high is not None and difference.high < 0.0)
        total = total + 1
    yield (
        "map-better",
        plain_finding(better, "points where the inverted USBL's mean E_P is smaller"),
    )
    yield "map-points", plain_finding(total, "points of the map")


def shared(cells: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """Errors of vehicles that interrogate in turn, interpolated over the interval, on
    logarithmic scales.
    """
    simulated = sorted({*INTERVALS, *SHARED_INTERVALS})
    for name in SHARING:
        arms = [cells[case_name(name, "calm", interval)] for interval in simulated]
        errors = [float(routes.values_by_run("e_p_mean_m").mean()) for routes in arms]
        for interval, error in zip(simulated, errors, strict=True):
            yield f"interval {name} {interval:g}", plain_finding(error, "mean E_P over routes", "m")
        for vehicles, distance in product(VEHICLES, REACHES_M):
            interval = shared_interval_s(vehicles, distance)
            error = math.exp(np.interp(math.log(interval), np.log(simulated), np.log(errors)))
            yield (
                f"shared {name} {vehicles} {distance:g}",
                plain_finding(error, "mean E_P where vehicles ask in turn", "m"),
            )
    for vehicles, distance in product(VEHICLES, REACHES_M):
        interval = shared_interval_s(vehicles, distance)
        yield (
            f"turn {vehicles} {distance:g}",
            plain_finding(interval, "interval of ranges of one vehicle", "s"),
        )


def findings_of_rows(
    routes: Mapping[str, Cells],
    closed: Mapping[str, Cells],
    points: Mapping[str, Cells],
    step_us: Mapping[str, float],
) -> dict[str, Finding]:
    """All findings, from records in open loop, in closed loop and of the map, and times of
    filter steps [µs].
    """
    findings = {
        name: finding for arm, runs in routes.items() for name, finding in arm_findings(arm, runs)
    }
    for part in (
        compared(routes),
        with_speed_as_state(routes),
        steered(closed),
        mapped(points),
        shared(routes),
    ):
        findings |= dict(part)
    calm = {name: findings[key_of_error(name)] for name in navigators_in(findings)}
    best = min((name for name in calm if name not in OURS), key=lambda name: calm[name].number)
    findings["best-rival"] = plain_finding(
        best, "rival of least mean E_P in calm water, messages every 5 s"
    )
    for ours in ("laisn-3-2", "tight"):
        wins = [
            finding.number
            for name, finding in findings.items()
            if name.startswith(f"better-than {ours} ")
        ]
        findings[f"better-than {ours}"] = plain_finding(
            int(sum(wins)), "the same of all rivals together"
        )
    findings |= {
        f"step {name}": plain_finding(time, "processor time of a filter step", "µs")
        for name, time in step_us.items()
    }
    findings |= dict(worst_routes(routes))
    slow = case_name(SLOW, "calm", USUAL_INTERVAL_S)
    if slow in routes:
        number = len(routes[slow].values_by_run("run"))
        findings["slow-runs"] = plain_finding(number, "of the factor graph")
    return findings | {
        "runs": plain_finding(
            len(next(iter(routes.values())).values_by_run("run")), "runs of each mission"
        ),
        "closed-runs": plain_finding(
            len(next(iter(closed.values())).values_by_run("run")), "in closed loop"
        ),
    }


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """All findings from the outcomes of the study's parts; the times of filter steps are
    measured here.
    """

    cells = {study_part: part_results.cells for study_part, part_results in outcomes.items()}
    routes: dict[str, Cells] = {}
    for study_part in ("routes", "shared", "slow", "two"):
        if study_part in cells:
            routes |= cells[study_part].by("arm", "case", MESSAGE_INTERVAL)
    grid = cells["map"].by("arm", "case", "sensors.heading_bias_deg", "leader.baseline_m")
    points = {f"map {name}": part_results for name, part_results in grid.items()}
    return findings_of_rows(routes, cells["closed"].by("arm", "case"), points, step_times_us())
