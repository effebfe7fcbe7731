"""What the study found: errors of flights, and of fixes without noise, which need no flight."""

import math
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from experiments.study.run import Cells, StudyResults
from laisn.arrays import Floats
from laisn.fix import CHOOSE_PAIR, Pair, circles, pair_fix
from laisn.geometry import Arms, Point, SinCos
from laisn.messages import Ranges
from laisn.settings import NavigationSettings, Tuning, Variant
from reports.findings import Finding, interval_finding, plain_finding
from reports.intervals import mean_interval
from sim.water.floors import LevelFloor
from sim.water.rays import Path
from sim.water.refraction import RefractedRays, traced_rays

SEASONS = {"mixed": "none", "weak": "weak", "moderate": "moderate", "strong": "strong"}
"""Thermoclines, in words, by the names of the scenario files that have them."""
BENDING_SEASONS = ("weak", "moderate", "strong")
NAVIGATORS = {"laisn-2": "LAISN-2", "laisn-3-2": "LAISN-3(2)", "tight": "tightly coupled"}
FIX_NAVIGATORS: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
"""Navigators that make fixes of single messages."""
SIZES = {"near": "within 43 m", "wide": "within 107 m"}
"""Cases of the formation."""
DEPTH_PAIRS_M = ((8.0, 20.0), (16.0, 16.0), (20.0, 20.0))  # depths of leader and follower
RANGES_M = (50.0, 100.0, 200.0)
BASELINES_M = (1.0, 2.0)
SPOILT_SHIFT_M = 0.5
"""A fix that bending alone shifts by more than this is spoilt [m]."""
_MAX_RANGE_M = 400.0
_MIDDLE_M = NavigationSettings().middle_offset  # of the middle transmitter to port of the axis [m]


def _file(name: str) -> dict[str, Any]:
    text = (resources.files(__package__) / f"{name}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@cache
def rays_of(season: str) -> RefractedRays:
    """Rays of a season's water."""
    scenario = _file(season)
    floor = LevelFloor(scenario["ocean"]["floor_depth_m"])
    return traced_rays(scenario["acoustics"]["sound_speed_profile"], floor)


def depths_name(depths: tuple[float, float]) -> str:
    """As the cases of the study name depths of leader and follower."""
    return f"{depths[0]:g}-{depths[1]:g}"


def measured_range(
    season: str, source: tuple[float, float, float], receiver: tuple[float, float, float]
) -> float:
    """Range that a receiver computes of the first ray by the mean speed between both depths [m];
    NaN if there is no ray.
    """
    rays = rays_of(season)
    time = rays.ray(int(Path.DIRECT), source, receiver).time
    return time / float(rays.straight_slowness(int(Path.DIRECT), source, receiver))


def range_error(season: str, depths: tuple[float, float], distance: float) -> float:
    """Range by the mean speed, less the true one, at a horizontal distance [m]."""
    source = (0.0, 0.0, -depths[0])
    receiver = (distance, 0.0, -depths[1])
    return measured_range(season, source, receiver) - math.dist(source, receiver)


class QuarterGeometry(NamedTuple):
    """A follower on the quarter of a leader that heads north."""

    depths: tuple[float, float]  # of leader and follower [m]
    distance: float  # horizontal distance [m]
    baseline: float  # [m]

    @property
    def follower(self) -> Point:
        """East and north of the leader [m]."""
        offset = self.distance * math.sqrt(0.5)
        return Point(offset, -offset)


def fix_error(season: str, variant: Variant, geometry: QuarterGeometry) -> float:
    """Error of a fix without noise by ranges of the mean speed [m]."""
    leader, follower = geometry.depths
    half_baseline = 0.5 * geometry.baseline
    receiver = (*geometry.follower, -follower)
    places = (
        (0.0, -half_baseline, -leader),
        (0.0, half_baseline, -leader),
        (-_MIDDLE_M, 0.0, -leader),
    )
    ranges = Ranges(*(measured_range(season, source, receiver) for source in places))
    arms = Arms((0.0, half_baseline, 0.0), (-_MIDDLE_M, 0.0, 0.0))
    rear, front, middle = circles(Point(0.0, 0.0), arms, ranges, follower - leader)
    north = SinCos(0.0, 1.0)
    tuning = Tuning.of(NavigationSettings(variant=variant))
    pairs = (Pair(rear, front, False), Pair(rear, middle, False), Pair(middle, front, True))
    fixes = tuple(pair_fix(pair, north, geometry.follower, tuning) for pair in pairs)
    fix = CHOOSE_PAIR[variant](fixes, geometry.follower)  # type: ignore[arg-type]
    return math.hypot(fix.east - geometry.follower.east, fix.north - geometry.follower.north)


def shortest_spoilt_range(season: str, variant: Variant, baseline: float) -> float | None:
    """Shortest range, over the depths of the study, at which a fix is spoilt [m]; None: there is
    none up to 400 m.
    """

    def worst(distance: float) -> float:
        errors = [
            fix_error(season, variant, QuarterGeometry(depths, distance, baseline))
            for depths in DEPTH_PAIRS_M
        ]
        return max((error for error in errors if not math.isnan(error)), default=0.0)

    last_unspoilt = 0.0
    for distance in range(10, round(_MAX_RANGE_M) + 1, 10):
        if worst(float(distance)) > SPOILT_SHIFT_M:
            low, high = last_unspoilt, float(distance)
            while high - low > 0.5:
                middle = 0.5 * (low + high)
                low, high = (low, middle) if worst(middle) > SPOILT_SHIFT_M else (middle, high)
            return high
        last_unspoilt = float(distance)
    return None


def fix_findings() -> Iterator[tuple[str, Finding]]:
    """Errors of ranges and of fixes without noise."""
    for season, depths, distance in product(BENDING_SEASONS, DEPTH_PAIRS_M, RANGES_M):
        error = range_error(season, depths, distance)
        name = f"{season} {depths_name(depths)} {distance:g}"
        yield (
            f"range {name}",
            plain_finding(error, "range by the mean speed less the true one", "m"),
        )
        for variant, baseline in product(FIX_NAVIGATORS, BASELINES_M):
            shift = fix_error(season, variant, QuarterGeometry(depths, distance, baseline))
            key = f"fix {variant} {name} {baseline:g}"
            yield key, plain_finding(shift, "error of a fix without noise by the mean speed", "m")
    for season, distance in product(BENDING_SEASONS, RANGES_M):
        errors = [range_error(season, depths, distance) for depths in DEPTH_PAIRS_M]
        yield (
            f"range-worst {season} {distance:g}",
            plain_finding(max(map(abs, errors)), "largest error of a range by the mean speed", "m"),
        )
    for season, variant, baseline in product(BENDING_SEASONS, FIX_NAVIGATORS, BASELINES_M):
        yield (
            f"from {variant} {season} {baseline:g}",
            plain_finding(
                shortest_spoilt_range(season, variant, baseline),
                f"range from which bending spoils a fix by {SPOILT_SHIFT_M} m",
                "m",
            ),
        )


class LegArm(NamedTuple):
    """A navigator, and what its receiver knows of the speed of sound."""

    navigator: str
    sound: str  # as `navigation.sound_speed`

    @classmethod
    def named(cls, name: str) -> "LegArm":
        """That of an arm of the study files."""
        return cls(*name.split(" "))


def _receivers(cells: Cells, *columns: str) -> Iterator[tuple[str, Mapping[str, Cells]]]:
    """Cells of the receivers of each navigator and condition, by what they know of sound; values of
    these columns name the condition.
    """
    conditions: dict[str, dict[str, Cells]] = {}
    for arm_name, arm_cells in cells.by("arm").items():
        arm = LegArm.named(arm_name)
        for condition, condition_cells in arm_cells.by(*columns).items():
            name = f"{arm.navigator} {condition.removeprefix('formation-')}".replace(".toml", "")
            conditions.setdefault(name, {})[arm.sound] = condition_cells
    yield from conditions.items()


_KNOWLEDGE = {
    "mean": ("single", "one speed"),
    "straight": ("error", "the mean speed"),
    "profile": ("known", "the profile"),
}
"""Names of findings, and words, by what a receiver knows of sound."""


def leg_findings(cells: Cells) -> Iterator[tuple[str, Finding]]:
    """Mean errors of navigators on a leg, and what bending adds to them, paired by run; a baseline
    is named if it is not the last one.
    """
    longest_baseline = f" {BASELINES_M[-1]:g}"
    for condition, by_sound in _receivers(cells, "scenario", "case", "leader.baseline_m"):
        key = condition.removesuffix(longest_baseline)
        errors = {
            sound: arm_cells.values_by_run("e_p_mean_m")[:, 0]
            for sound, arm_cells in by_sound.items()
        }
        for sound, error in errors.items():
            name, words = _KNOWLEDGE[sound]
            yield (
                f"{name} {key}",
                interval_finding(mean_interval(error), f"mean E_P by {words}, 95 %", "m"),
            )
        added = mean_interval(errors["straight"] - errors["profile"])
        yield (
            f"added {key}",
            interval_finding(added, "what the mean speed adds, paired by run, 95 %", "m"),
        )


def _off_findings(
    name: str, words: str, errors: Mapping[str, Floats]
) -> Iterator[tuple[str, Finding]]:
    """Distances of each run by what the receiver knows, shapes (R,), [m], and their difference."""
    for sound, error in errors.items():
        yield (
            f"{name} {sound}",
            interval_finding(mean_interval(error), f"RMS off {words}, 95 %", "m"),
        )
    added = mean_interval(errors["straight"] - errors["profile"])
    yield (
        f"{name} added",
        interval_finding(added, "what the mean speed adds, paired by run, 95 %", "m"),
    )


def closed_findings(cells: Cells) -> Iterator[tuple[str, Finding]]:
    """Distances from its place of a follower that steers by its estimate; the thermocline is named
    where it is not the strong one.
    """
    for condition, by_sound in _receivers(cells, "scenario"):
        track_errors = {
            s: arm_cells.values_by_run("track_error_rms_m")[:, 0]
            for s, arm_cells in by_sound.items()
        }
        name = f"off {condition}".removesuffix(" strong")
        yield from _off_findings(name, "its place, by its estimate", track_errors)


def formation_findings(cells: Cells) -> Iterator[tuple[str, Finding]]:
    """Distances from their stations of a formation, median of its followers."""
    for condition, by_sound in _receivers(cells, "scenario", "case"):
        station_errors = {
            s: np.median(arm_cells.values_by_run("station_rms_m"), axis=1)
            for s, arm_cells in by_sound.items()
        }
        yield from _off_findings(
            f"station {condition}", "stations, median of followers", station_errors
        )
        lost = int(sum(arm_cells.values_by_run("lost").sum() for arm_cells in by_sound.values()))
        yield f"station {condition} lost", plain_finding(lost, "followers lost in all runs")


def _runs_of(cells: Cells) -> int:
    return max(len(lists["run"]) for lists in cells.lists)


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """All findings."""
    legs, closed, formation = (outcomes[name].cells for name in ("legs", "closed", "formation"))
    return {
        "matters": plain_finding(SPOILT_SHIFT_M, "shift of a fix that spoils it", "m"),
        "runs": plain_finding(_runs_of(legs), "runs of each leg"),
        "closed-runs": plain_finding(_runs_of(closed), "runs of each closed loop"),
        "formation-runs": plain_finding(_runs_of(formation), "runs of each formation"),
        **dict(fix_findings()),
        **dict(leg_findings(legs)),
        **dict(closed_findings(closed)),
        **dict(formation_findings(formation)),
    }
