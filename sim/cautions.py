"""Cautions before a flight: true errors that a scenario sets and its navigator does not assume.

Each rule names keys, what is set by them, the assumption that a navigator would need, and what the
error does. A new key of `[sensors]`, `[acoustics]` or `[leader]` gets a rule here.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.navigators import find
from laisn.plugins import is_plugin_name
from laisn.settings import Settings
from sim.scenario.point_motion import plan
from sim.scenario.settings import Follower, Scenario
from sim.scenario.vehicle_routes import route_of
from sim.water.assembly import floor_of

_NOTICEABLE_M = 0.1  # errors of positions and ranges below this need no caution
_NOTICEABLE_SLOT_M = 0.003  # the random error of a good range
_LOOKS = 200  # instants at which distances are looked at


@dataclass(frozen=True, kw_only=True)
class Rule:
    """An error that a scenario may set, and the assumption without which it is not estimated."""

    keys: tuple[str, ...]
    assumption: str
    """Key of `navigation` that would take it into account; "" if no navigator can."""
    is_assumed: Callable[[Settings, Scenario], bool]
    effect: Callable[[Scenario, Settings], str]
    """What the error does, as a sentence without its end; "" if it is not set, or too small."""
    needs: str
    """What a navigator assumes that does not have the assumption."""


def estimates(state: str) -> Callable[[Settings, Scenario], bool]:
    """Whether a navigator has a state for something."""
    return lambda settings, _: state in settings.estimated


def has(*fields: str) -> Callable[[Settings, Scenario], bool]:
    """Whether settings of a navigator set one of these fields, which it need not have."""
    return lambda settings, _: any(bool(getattr(settings, field, False)) for field in fields)


def _expects_common_echoes(settings: Settings, scenario: Scenario) -> bool:
    """Whether the paths by surface and floor are computed from depths."""
    return hasattr(settings, "floor_depth") and find(scenario.navigation.variant).compare_with_crlb


def distances(scenario: Scenario, follower: Follower) -> Floats:
    """Planned horizontal distances of a follower from its leader over the mission, shape (n,),
    [m].
    """
    if follower.station is not None:
        return np.array([math.hypot(follower.station.behind_m, follower.station.port_m)])
    time = np.linspace(0.0, scenario.duration_s, _LOOKS)
    leader, other = (
        plan(route_of(vehicle, name)).at(time)
        for vehicle, name in ((scenario.leader, "leader"), (follower, follower.name))
    )
    return np.hypot(leader.east - other.east, leader.north - other.north)


def _planned(scenario: Scenario) -> Floats:
    return np.concatenate([distances(scenario, follower) for follower in scenario.followers])


def _current(scenario: Scenario, _: Settings) -> str:
    # the paper's point motion is not carried along
    there_is = scenario.motion == "physics" and scenario.ocean.moves
    return "there is a current" if there_is else ""


def clock_error_s(scenario: Scenario) -> float:
    """Largest difference of the clocks during the mission [s]."""
    sound = scenario.acoustics
    end = sound.clock_offset_s + 1e-6 * sound.clock_drift_ppm * scenario.duration_s
    return max(abs(sound.clock_offset_s), abs(end))


def _clock(scenario: Scenario, _: Settings) -> str:
    error_s = clock_error_s(scenario)
    metres = error_s * scenario.acoustics.sound_speed_m_s
    if metres < _NOTICEABLE_M:
        return ""
    return (
        f"the clocks differ by up to {1e3 * error_s:.3g} ms, which changes every range by up to "
        f"{metres:.3g} m"
    )


def closing_speed(scenario: Scenario) -> float:
    """Largest planned speed at which a follower and its leader move to each other [m/s]."""
    speeds = [0.0]
    spacing = scenario.duration_s / (_LOOKS - 1)
    for follower in scenario.followers:
        if follower.station is None:
            rates = np.abs(np.diff(distances(scenario, follower))) / spacing
            speeds.append(float(rates.max()))
    return max(speeds)


def _slots(scenario: Scenario, settings: Settings) -> str:
    way = scenario.acoustics.ping_slot_s * closing_speed(scenario)
    if way < _NOTICEABLE_SLOT_M:
        return ""
    return (
        f"ranges change by up to {way:.2g} m from one transmitter's ping to the next's, of a "
        f"baseline of {settings.baseline:g} m"
    )


def _leader_compass(scenario: Scenario, _: Settings) -> str:
    bias = math.radians(abs(scenario.sensors.leader_heading_bias_deg))
    aside = 2.0 * math.sin(bias / 2.0) * float(_planned(scenario).max()) if bias else 0.0
    if aside < _NOTICEABLE_M:
        return ""
    return (
        f"the leader's compass is off by {math.degrees(bias):.3g}°, which turns fixes about the "
        f"leader, by up to {aside:.2g} m"
    )


def echo_delay_m(scenario: Scenario) -> float:
    """Largest excess of an echo's path over the direct path between planned places [m]."""
    sound = scenario.acoustics
    down = scenario.leader.layer_m
    floor = floor_of(scenario).deepest
    largest = 0.0
    for follower in scenario.followers:
        level = float(distances(scenario, follower).min())
        direct = math.hypot(level, down - follower.layer_m)
        paths = []
        if sound.surface_echo_probability:
            paths.append(math.hypot(level, down + follower.layer_m))
        if sound.bottom_echo_probability:
            paths.append(math.hypot(level, 2.0 * floor - down - follower.layer_m))
        largest = max([largest, *(path - direct for path in paths)])
    return largest


def _common_echoes(scenario: Scenario, settings: Settings) -> str:
    span = getattr(settings, "outlier_span", math.inf)
    delay = echo_delay_m(scenario) if scenario.acoustics.common_echoes else 0.0
    if delay <= span:
        return ""
    return (
        f"echoes are up to {delay:.2g} m longer than the direct path and common to all ranges of a "
        f"message, beyond the {span:g} m"
    )


def _leader_position(scenario: Scenario, _: Settings) -> str:
    drift = scenario.sensors.leader_position_drift_m_s * scenario.duration_s
    if drift < _NOTICEABLE_M:
        return ""
    return (
        f"the position that the leader broadcasts drifts by {drift:.3g} m, and the followers' "
        "with it"
    )


def _leader_position_scatter(scenario: Scenario, _: Settings) -> str:
    sigma = scenario.sensors.leader_position_sigma_m
    if sigma < _NOTICEABLE_M:
        return ""
    return (
        f"the position that the leader broadcasts scatters by σ = {sigma:.3g} m along each axis "
        "from message to message"
    )


def _leader_position_walk(scenario: Scenario, _: Settings) -> str:
    walk = scenario.sensors.leader_position_walk_m_sqrt_s * math.sqrt(scenario.duration_s)
    if walk < _NOTICEABLE_M:
        return ""
    return (
        "the position that the leader broadcasts walks away along each axis, at the end by "
        f"σ = {walk:.3g} m, and the followers' with it"
    )


RULES = (
    Rule(
        keys=("ocean.current_speed_m_s", "ocean.current_profile"),
        assumption="assume.current",
        is_assumed=estimates("current"),
        effect=_current,
        needs="still water",
    ),
    Rule(
        keys=("acoustics.clock_offset_s", "acoustics.clock_drift_ppm"),
        assumption="assume.clock",
        is_assumed=estimates("clock"),
        effect=_clock,
        needs="equal clocks",
    ),
    Rule(
        keys=("acoustics.ping_slot_s",),
        assumption="",
        is_assumed=has("compensate_motion"),
        effect=_slots,
        needs="pings at one time",
    ),
    Rule(
        keys=("sensors.leader_heading_bias_deg",),
        assumption="assume.exact_leader",
        is_assumed=estimates("leader_heading_bias"),
        effect=_leader_compass,
        needs="an exact compass of the leader",
    ),
    Rule(
        keys=("acoustics.common_echoes",),
        assumption="assume.outlier_span_m",
        is_assumed=_expects_common_echoes,
        effect=_common_echoes,
        needs="echoes within that span",
    ),
    Rule(
        keys=("sensors.leader_position_drift_m_s",),
        assumption="",
        is_assumed=has("leader_position_sigma", "leader_position_walk"),
        effect=_leader_position,
        needs="an exact position of the leader",
    ),
    Rule(
        keys=("sensors.leader_position_sigma_m",),
        assumption="assume.leader_position_sigma_m",
        is_assumed=has("leader_position_sigma"),
        effect=_leader_position_scatter,
        needs="an exact position of the leader",
    ),
    Rule(
        keys=("sensors.leader_position_walk_m_sqrt_s",),
        assumption="assume.leader_position_walk_m_sqrt_s",
        is_assumed=has("leader_position_walk"),
        effect=_leader_position_walk,
        needs="a position of the leader that does not walk away",
    ),
)


def _sentence(rule: Rule, effect: str, scenario: Scenario, settings: Settings) -> str:
    variant = scenario.navigation.variant
    navigator = f"navigator {variant!r}"
    section, _, name = rule.assumption.partition(".")
    # of those that have the assumption, some only share the section with others
    if section and find(variant).compare_with_crlb:
        value = getattr(getattr(scenario.navigation, section), name)
        text = str(value).lower() if isinstance(value, bool) else f"{value:g}"
        navigator = f"navigation.{rule.assumption} = {text}"
    return f"{effect}; {navigator} assumes {rule.needs}"


def assumption_cautions(scenario: Scenario) -> list[str]:
    """A line for each error that a scenario sets and its navigator does not assume.

    Of a navigator of the user's own it is not known what it assumes.
    """
    if is_plugin_name(scenario.navigation.variant):
        return []
    settings = scenario.navigation.settings()
    lines = []
    for rule in RULES:
        effect = rule.effect(scenario, settings)
        if effect and not rule.is_assumed(settings, scenario):
            lines.append(_sentence(rule, effect, scenario, settings))
    return lines
