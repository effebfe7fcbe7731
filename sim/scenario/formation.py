"""Formation: shapes, stations in the leader's trail, how followers keep them, and how they give
way to each other.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sim.scenario.section import (
    CONTROL_STEP_S,
    Idle,
    NonNegative,
    Positive,
    Section,
    Speed,
    is_multiple,
)

MAX_FOLLOWERS = 200
"""Followers of a mission. Each is checked beside all others, and its log and report hold them."""

Metres = Annotated[float, Field(ge=-1000, le=1000)]

MIN_SEPARATION_M = 3.0
"""Stations are refused that come nearer than this to each other, or to the leader: 2 m to keep
clear of each other, and three standard deviations of the difference of two followers that are 0.25
m off each [m]."""
# layers that are farther apart than this keep followers apart wherever they are [m]
MIN_LAYER_SPACING_M = 1.0


class Station(Section):
    """Station in the leader's trail."""

    behind_m: Metres = Field(..., description="distance behind the leader, along its trail")
    port_m: Metres = Field(0.0, description="offset to port of the trail")
    depth_m: NonNegative


class Proximity(Section):
    """Short-range sensing and avoidance of other vehicles by followers on stations; off without
    this section.
    """

    range_m: float = Field(
        5.0, gt=0, le=100, description="between vehicle centres; avoidance starts here"
    )
    range_sigma_m: NonNegative = 0.1
    bearing_sigma_deg: Annotated[float, Field(ge=0, le=180)] = 3.0
    period_s: Annotated[float, Field(ge=0.1, le=60)] = Field(0.5, description="multiple of 0.1 s")
    aperture_deg: float = Field(
        20.0, gt=0, le=180, description="vertical opening angle, about the horizontal"
    )
    full_avoidance_range_m: NonNegative = Field(3.0, description="range of maximum avoidance speed")
    max_avoidance_speed_m_s: Speed = Field(0.8, description="added to the guidance velocity")


class ShapeTable(Section):
    """Generates the followers, in place of `[[followers]]`."""

    kind: Literal["line", "v", "column", "grid", "ring"] = Field(
        ..., description="line abreast, V of wings, column, grid four wide, or ring"
    )
    count: Annotated[int, Field(ge=1, le=MAX_FOLLOWERS)]
    spacing_m: Annotated[float, Field(ge=3, le=200)] = 10.0
    behind_m: Annotated[float, Field(ge=0, le=500)] = Field(
        10.0, description="from the leader to the formation"
    )
    depth_m: NonNegative = Field(10.0, description="depth of the first follower")
    layer_m: Annotated[float, Field(ge=0, le=20)] = Field(
        1.0, description="depth increment per follower"
    )
    layers: Annotated[int, Field(ge=1, le=MAX_FOLLOWERS)] | None = Field(
        None, description="number of depths, given to followers in turn; default: count"
    )
    model: str | None = Field(None, description="model of the followers, as of `[[followers]]`")


def _offset(kind: str, i: int, count: int) -> tuple[float, float]:
    """Place of follower i behind the formation's front and to port of the trail, in spacings."""
    if kind == "line":
        return 0.0, i - 0.5 * (count - 1)
    if kind == "v":
        rank = i // 2 + 1
        side = 1.0 if i % 2 == 0 else -1.0
        # twice as far aside as behind: at 45° all of a wing would meet where the leader turns by
        # 90°
        return (rank - 1) * math.sqrt(0.2), side * rank * 2.0 * math.sqrt(0.2)
    if kind == "column":
        return float(i), 0.0
    if kind == "grid":
        return float(i // 4), i % 4 - 0.5 * (min(count, 4) - 1)
    radius = 0.5 / math.sin(math.pi / count) if count > 1 else 0.0
    angle = 2.0 * math.pi * i / count
    return radius * (1.0 - math.cos(angle)), radius * math.sin(angle)


def _follower_table(i: int, behind: float, port: float, depth: float) -> dict[str, Any]:
    """Table of follower i, counted from 0, on a station [m]."""
    return {
        "name": f"follower-{i + 1}",
        "station": {"behind_m": behind, "port_m": port, "depth_m": depth},
    }


def followers_of(shape: ShapeTable) -> list[dict[str, Any]]:
    """Tables of the followers of a shape: names and stations, each in its layer."""
    tables = []
    for i in range(shape.count):
        spacings_behind, spacings_port = _offset(shape.kind, i, shape.count)
        depth = shape.depth_m + i % (shape.layers or shape.count) * shape.layer_m
        behind = shape.behind_m + spacings_behind * shape.spacing_m
        port = spacings_port * shape.spacing_m
        hull = {"model": shape.model} if shape.model else {}
        tables.append(_follower_table(i, round(behind, 6), round(port, 6), depth) | hull)
    return tables


class Scatter(Section):
    """Where followers of a drawn formation may have their stations."""

    count: int = Field(..., ge=1, le=MAX_FOLLOWERS, description="number of followers")
    spacing_m: Annotated[float, Field(ge=3, le=200)] = Field(
        6.0, description="least horizontal distance of stations"
    )
    behind_m: Annotated[float, Field(ge=0, le=500)] = Field(
        10.0, description="how far astern the area begins"
    )
    length_m: Annotated[float, Field(ge=0, le=500)] = Field(
        40.0, description="of the area, along the leader's way"
    )
    width_m: Annotated[float, Field(ge=0, le=500)] = Field(
        40.0, description="of the area, across it"
    )
    depth_m: NonNegative = Field(10.0, description="depth of the first follower")
    layer_m: float = Field(
        1.0, ge=0, le=20, description="how much deeper each is than the one before"
    )


_TRIES = 1000  # stations drawn for one follower before the area counts as full


def scattered_followers(area: Scatter, address: Sequence[int]) -> list[dict[str, Any]]:
    """Tables of followers on stations drawn evenly over an area, each again until it keeps its
    distance.

    `address` is the seed of the random numbers. ValueError if the area is too small for so many.
    """
    rng = np.random.default_rng(address)
    places = list[tuple[float, float]]()  # behind the leader, and to port of its trail [m]
    while len(places) < area.count:
        for _ in range(_TRIES):
            behind = round(area.behind_m + area.length_m * float(rng.random()), 2)
            port = round(area.width_m * (float(rng.random()) - 0.5), 2)
            if all(math.hypot(behind - a, port - b) >= area.spacing_m for a, b in places):
                places.append((behind, port))
                break
        else:
            raise ValueError(
                f"{area.count} stations {area.spacing_m:g} m apart do not fit into the area"
            )
    return [
        _follower_table(i, behind, port, area.depth_m + i * area.layer_m)
        for i, (behind, port) in enumerate(places)
    ]


class Formation(Section):
    """Guidance of followers on stations."""

    RECORD_NAMES: ClassVar = {"integral_m_s": "integral_gain"}

    shape: ShapeTable | None = Field(
        None, description="generates the followers, in place of [[followers]]"
    )
    proximity: Proximity | None = Field(None, description="short-range sensor for avoidance")
    law: Literal["constant-bearing", "ilos", "alos"] = Field(
        "constant-bearing",
        description="guidance to the station, with the estimated current or integral action",
    )
    approach_speed_m_s: Speed = Field(1.0, description="U, maximum towards the station")
    lookahead_m: Annotated[float, Field(ge=0.5, le=100)] = Field(
        5.0, description="Δ: below this distance to the station, the approach slows down"
    )
    integral_m_s: Annotated[float, Field(ge=0, le=2), Idle(key="law", at=("constant-bearing",))] = (
        Field(0.2, description="σ of ilos; γ Δ² of alos")
    )
    min_along_track_speed_m_s: Speed = Field(
        0.2, description="through water, along the leader's way"
    )
    min_speed_m_s: Speed = Field(0.2, description="through water")
    max_speed_m_s: Speed = Field(2.5, description="through water")
    frame_time_constant_s: Positive = Field(
        12.0, description="time constant of the formation's heading behind its trail"
    )
    frame_rate_time_constant_s: Positive = Field(4.0, description="time constant of its turn rate")
    frame_lookahead_m: NonNegative = Field(
        0.0, description="lookahead of the trail's course, from a station"
    )
    max_station_acceleration_m_s2: Positive = Field(0.02, description="in a turn")
    inner_slowdown: Annotated[float, Field(gt=0, lt=1)] = Field(
        0.3, description="maximum, of inner stations, as share of the leader's speed"
    )
    outer_speedup: Annotated[float, Field(gt=0, le=2)] = Field(
        0.7, description="maximum, of outer stations, as share of the leader's speed"
    )
    inner_min_speed_m_s: Speed = Field(0.3, description="of a station in a turn")
    outer_max_speed_m_s: Speed = Field(2.0, description="of a station in a turn")
    preview_s: NonNegative = Field(
        0.7, description="lead time of the station, for the lag of hull and thrusters"
    )
    max_trail_sigma_m: Positive = Field(
        5.0,
        description="trail position σ from which a follower keeps a parallel course and slows "
        "down, until twice this σ",
    )
    leader_velocity_sigma_m_s: NonNegative = Field(
        0.015,
        description="σ of the leader's mean velocity since its last message; adds to the trail "
        "position σ",
    )
    timeout_speed_m_s: Speed = Field(
        0.5,
        description="speed through water from twice max_trail_sigma_m on, and after "
        "message_timeout_s",
    )
    message_timeout_s: Positive = Field(
        600.0, description="time without messages before timeout_action"
    )
    timeout_action: Literal["continue", "circle", "surface"] = "circle"

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        lower = "min_speed_m_s", "min_along_track_speed_m_s", "timeout_speed_m_s"
        for low, high in (
            *((key, "max_speed_m_s") for key in lower),
            ("inner_min_speed_m_s", "outer_max_speed_m_s"),
        ):
            if getattr(self, low) > getattr(self, high):
                raise ValueError(
                    f"{low} = {getattr(self, low):g} is more than {high} = {getattr(self, high):g}"
                )
        return self


def station_inconsistencies(
    proximity: Proximity | None, stations: list[tuple[str, Station]]
) -> list[str]:
    """Stations without room for two hulls, and settings with which followers cannot give way to
    each other.
    """
    key = "formation.proximity"
    problems = list[str]()
    expected = f"at least {MIN_SEPARATION_M:g} m"
    for name, a in stations:
        if (leader_distance := math.hypot(a.behind_m, a.port_m)) < MIN_SEPARATION_M:
            problems.append(
                f"{name}.station is {leader_distance:.3g} m from the leader's place; stations are "
                f"{expected} from it"
            )
    for (other, b), (name, a) in combinations(stations, 2):
        distance = math.hypot(a.behind_m - b.behind_m, a.port_m - b.port_m)
        depth_difference = abs(a.depth_m - b.depth_m)
        names = f"{name}.station and {other}.station"
        if distance < MIN_SEPARATION_M and depth_difference < MIN_LAYER_SPACING_M:
            text = f"{names} are {distance:.3g} m apart in layers {depth_difference:.3g} m apart"
            problems.append(f"{text}; {expected} or {MIN_LAYER_SPACING_M:g} m are needed")
        if proximity and distance < proximity.range_m and depth_difference < MIN_LAYER_SPACING_M:
            problems.append(
                f"{names} are {distance:.3g} m apart in one layer, within {key}.range_m = "
                f"{proximity.range_m:g}: their followers would push each other away for ever"
            )
    if proximity is None:
        return problems
    if proximity.full_avoidance_range_m >= proximity.range_m:
        problems.append(
            f"{key}.full_avoidance_range_m = {proximity.full_avoidance_range_m:g} is not less than "
            f"{key}.range_m = {proximity.range_m:g}"
        )
    if not is_multiple(proximity.period_s, CONTROL_STEP_S):
        problems.append(
            f"{key}.period_s = {proximity.period_s:g} is no multiple of {CONTROL_STEP_S:g}"
        )
    return problems
