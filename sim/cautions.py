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
from sim.scenario.parts import MissionPlan, SensingSettings, SoundSettings
from sim.scenario.point_motion import plan as planned_motion
from sim.scenario.sensors import Sensors
from sim.scenario.settings import Follower, Navigation
from sim.scenario.vehicle_routes import route_of
from sim.water.assembly import floor_of

_NOTICEABLE_M = 0.1  # errors of positions and ranges below this need no caution
# smaller changes of a range between the pings of a message need no caution: they are below the
# random error of a good range
_NOTICEABLE_SLOT_M = 0.003
_INSTANTS = 200  # instants at which distances are looked at


@dataclass(frozen=True, kw_only=True)
class Rule:
    """An error that a scenario may set, and the assumption without which it is not estimated."""

    keys: tuple[str, ...]
    assumption: str
    """Key of `navigation` that would take it into account; "" if no navigator can."""
    is_assumed: Callable[[Settings, str], bool]
    """By the settings of a navigator, and its name."""
    effect: Callable[[SensingSettings, Settings], str]
    """What the error does, as a sentence without its end; "" if it is not set, or too small."""
    needs: str
    """What a navigator assumes that does not have the assumption."""


def estimates(state: str) -> Callable[[Settings, str], bool]:
    """Whether a navigator has a state for something."""
    return lambda settings, _: state in settings.estimated


def has(*fields: str) -> Callable[[Settings, str], bool]:
    """Whether settings of a navigator set one of these fields, which it need not have."""
    return lambda settings, _: any(bool(getattr(settings, field, False)) for field in fields)


def _expects_common_echoes(settings: Settings, variant: str) -> bool:
    """Whether the paths by surface and floor are computed from depths: by the tightly coupled
    navigator.
    """
    return hasattr(settings, "floor_depth") and find(variant).reads_assumptions


def distances(plan: MissionPlan, follower: Follower) -> Floats:
    """Planned horizontal distances of a follower from its leader over the mission, shape (n,),
    [m].
    """
    if follower.station is not None:
        return np.array([math.hypot(follower.station.behind_m, follower.station.port_m)])
    time = np.linspace(0.0, plan.duration_s, _INSTANTS)
    leader, other = (
        planned_motion(route_of(vehicle, name)).at(time)
        for vehicle, name in ((plan.leader, "leader"), (follower, follower.name))
    )
    return np.hypot(leader.east - other.east, leader.north - other.north)


def _planned_distances(plan: MissionPlan) -> Floats:
    """`distances` of all followers, one after the other, shape (n,), [m]."""
    return np.concatenate([distances(plan, follower) for follower in plan.followers])


def _broadcast_errors(sensing: SensingSettings) -> Sensors:
    """`[sensors]` with what the leader's own table sets of the errors of its messages."""
    return sensing.sensors_of(follower=0)


def _current(sensing: SensingSettings, _: Settings) -> str:
    return "there is a current" if sensing.has_current else ""


def clock_error_s(sensing: SensingSettings) -> float:
    """Largest difference of the clocks during the mission [s]."""
    sound = sensing.acoustics
    end = sound.clock_offset_s + 1e-6 * sound.clock_drift_ppm * sensing.sound.sea.plan.duration_s
    return max(abs(sound.clock_offset_s), abs(end))


def _clock(sensing: SensingSettings, _: Settings) -> str:
    error_s = clock_error_s(sensing)
    metres = error_s * sensing.acoustics.sound_speed_m_s
    if metres < _NOTICEABLE_M:
        return ""
    return (
        f"the clocks differ by up to {1e3 * error_s:.3g} ms, which changes every range by up to "
        f"{metres:.3g} m"
    )


def max_range_rate(plan: MissionPlan) -> float:
    """Largest planned rate of the horizontal distance of a follower from its leader, growing or
    shrinking [m/s].
    """
    speeds = [0.0]
    spacing = plan.duration_s / (_INSTANTS - 1)
    for follower in plan.followers:
        if follower.station is None:
            rates = np.abs(np.diff(distances(plan, follower))) / spacing
            speeds.append(float(rates.max()))
    return max(speeds)


def _slots(sensing: SensingSettings, settings: Settings) -> str:
    change = sensing.acoustics.ping_slot_s * max_range_rate(sensing.sound.sea.plan)
    if change < _NOTICEABLE_SLOT_M:
        return ""
    return (
        f"ranges change by up to {change:.2g} m from one transmitter's ping to the next's, of a "
        f"baseline of {settings.baseline:g} m"
    )


def _leader_compass(sensing: SensingSettings, _: Settings) -> str:
    bias = math.radians(abs(_broadcast_errors(sensing).leader_heading_bias_deg))
    error = (
        2.0 * math.sin(bias / 2.0) * float(_planned_distances(sensing.sound.sea.plan).max())
        if bias
        else 0.0
    )
    if error < _NOTICEABLE_M:
        return ""
    return (
        f"the leader's compass is off by {math.degrees(bias):.3g}°, which turns fixes about the "
        f"leader, by up to {error:.2g} m"
    )


def echo_excess_m(settings: SoundSettings) -> float:
    """Largest excess of an echo's path over the direct path between planned places [m]."""
    sound = settings.acoustics
    plan = settings.sea.plan
    leader_depth = plan.leader.held_depth_m
    floor_depth = floor_of(settings.sea).deepest
    largest = 0.0
    for follower in plan.followers:
        horizontal = float(distances(plan, follower).min())
        direct = math.hypot(horizontal, leader_depth - follower.held_depth_m)
        paths = []
        if sound.surface_echo_probability:
            paths.append(math.hypot(horizontal, leader_depth + follower.held_depth_m))
        if sound.bottom_echo_probability:
            paths.append(
                math.hypot(horizontal, 2.0 * floor_depth - leader_depth - follower.held_depth_m)
            )
        largest = max([largest, *(path - direct for path in paths)])
    return largest


def _common_echoes(sensing: SensingSettings, settings: Settings) -> str:
    span = getattr(settings, "outlier_span", math.inf)
    sound = sensing.sound
    delay = echo_excess_m(sound) if sound.acoustics.common_echoes else 0.0
    if delay <= span:
        return ""
    return (
        f"echoes are up to {delay:.2g} m longer than the direct path and common to all ranges of a "
        f"message, beyond the {span:g} m"
    )


def _leader_position_drift(sensing: SensingSettings, _: Settings) -> str:
    drift = _broadcast_errors(sensing).leader_position_drift_m_s * sensing.sound.sea.plan.duration_s
    if drift < _NOTICEABLE_M:
        return ""
    return (
        f"the position that the leader broadcasts drifts by {drift:.3g} m, and the followers' "
        "with it"
    )


def _leader_position_scatter(sensing: SensingSettings, _: Settings) -> str:
    sigma = _broadcast_errors(sensing).leader_position_sigma_m
    if sigma < _NOTICEABLE_M:
        return ""
    return (
        f"the position that the leader broadcasts scatters by σ = {sigma:.3g} m along each axis "
        "from message to message"
    )


def _leader_position_walk(sensing: SensingSettings, _: Settings) -> str:
    per_root_s = _broadcast_errors(sensing).leader_position_walk_m_sqrt_s
    walk = per_root_s * math.sqrt(sensing.sound.sea.plan.duration_s)
    if walk < _NOTICEABLE_M:
        return ""
    return (
        "the position that the leader broadcasts walks away along each axis, at the end by "
        f"σ = {walk:.3g} m, and the followers' with it"
    )


def _reach(sensing: SensingSettings, _: Settings) -> str:
    reach = sensing.acoustics.max_range_m
    plan = sensing.sound.sea.plan
    slant = [
        np.hypot(distances(plan, follower), plan.leader.held_depth_m - follower.held_depth_m)
        for follower in plan.followers
    ]
    slant_ranges = np.concatenate(slant)
    if reach == 0.0 or slant_ranges.max() <= reach:
        return ""
    return (
        f"messages reach {reach:g} m, and {np.mean(slant_ranges > reach):.0%} of the planned "
        f"distances are longer, up to {slant_ranges.max():.3g} m"
    )


def _drift(sensing: SensingSettings, _: Settings) -> str:
    drifts = {
        "log": (sensing.sensors.speed_drift_m_s, "m/s"),
        "compass": (sensing.sensors.heading_drift_deg, "°"),
    }
    parts = [
        f"the {sensor}'s bias drifts by up to {abs(drift):g}{' ' if unit != '°' else ''}{unit}"
        for sensor, (drift, unit) in drifts.items()
        if drift
    ]
    return " and ".join(parts)


def _follows_drift(settings: Settings, variant: str) -> bool:
    """Whether a navigator that estimates biases, the tightly coupled one, is told that they drift;
    True of one that estimates none.
    """
    assume = getattr(settings, "assume", None)
    return not find(variant).reads_assumptions or bool(getattr(assume, "drift", True))


RULES = (
    Rule(
        keys=("acoustics.max_range_m",),
        assumption="",
        is_assumed=lambda *_: False,
        effect=_reach,
        needs="that messages arrive",
    ),
    Rule(
        keys=("sensors.speed_drift_m_s", "sensors.heading_drift_deg"),
        assumption="assume.drift",
        is_assumed=_follows_drift,
        effect=_drift,
        needs="constant biases",
    ),
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
        effect=_leader_position_drift,
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


def _sentence(rule: Rule, effect: str, navigation: Navigation) -> str:
    variant = navigation.variant
    navigator = f"navigator {variant!r}"
    section, _, name = rule.assumption.partition(".")
    if section and find(variant).reads_assumptions:
        value = getattr(getattr(navigation, section), name)
        text = str(value).lower() if isinstance(value, bool) else f"{value:g}"
        navigator = f"navigation.{rule.assumption} = {text}"
    return f"{effect}; {navigator} assumes {rule.needs}"


def assumption_cautions(sensing: SensingSettings, navigation: Navigation) -> list[str]:
    """A line for each error that there is and a navigator does not assume.

    Of a navigator of the user's own it is not known what it assumes.
    """
    if is_plugin_name(navigation.variant):
        return []
    settings = navigation.settings()
    lines = []
    for rule in RULES:
        effect = rule.effect(sensing, settings)
        if effect and not rule.is_assumed(settings, navigation.variant):
            lines.append(_sentence(rule, effect, navigation))
    return lines
