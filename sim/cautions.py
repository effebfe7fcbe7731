"""Cautions before a flight: true errors that a scenario sets and its navigator does not assume.

Each rule names keys, what is set by them, the assumption that a navigator would need, and what the
error does. A new key of `[sensors]`, `[acoustics]` or `[leader]` gets a rule here. Errors of
messages are those of who sends on the link that is navigated on: the leader, another vehicle, or
beacons, which have none.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from laisn.arrays import Floats
from laisn.navigators import find
from laisn.plugins import is_plugin_name
from laisn.settings import BeaconSettings, Settings
from sim.scenario.parts import MissionPlan, SensingSettings
from sim.scenario.sensors import Sensors
from sim.scenario.settings import Navigation, Scenario
from sim.sensing.links import AT_REST, Link, named_link, navigated_link
from sim.sensing.sensors import SensorErrors, errors_of
from sim.water.assembly import floor_of, planned_places, sound_points
from sim.water.rays import SoundProfile, mean_slowness

_NOTICEABLE_M = 0.1  # errors of positions and ranges below this need no caution
# smaller changes of a range between the pings of a message need no caution: they are below the
# random error of a good range
_NOTICEABLE_SLOT_M = 0.003


@dataclass(frozen=True, kw_only=True)
class Navigated:
    """Followers of a scenario that navigate alike."""

    scenario: Scenario  # in which all followers navigate as these
    followers: tuple[int, ...]  # their indices

    @classmethod
    def of(cls, scenario: Scenario, followers: Sequence[int]) -> Self:
        """Followers of a scenario by their indices, which navigate as the first of them does."""
        return cls(scenario=scenario.navigated_as(followers[0]), followers=tuple(followers))

    @cached_property
    def navigation(self) -> Navigation:
        """How they navigate."""
        return self.scenario.navigation

    @cached_property
    def settings(self) -> Settings:
        """Settings of their navigator."""
        return self.navigation.settings()

    @cached_property
    def sensing(self) -> SensingSettings:
        """What they sense."""
        return SensingSettings.of(self.scenario)

    @cached_property
    def plan(self) -> MissionPlan:
        """Where all vehicles are to go."""
        return self.sensing.sound.sea.plan

    @cached_property
    def link(self) -> Link | None:
        """The link on which they navigate; None: the leader's broadcast."""
        return navigated_link(self.sensing.links)

    @property
    def is_among_beacons(self) -> bool:
        """Whether those who send are at rest."""
        return self.link is not None and self.link.sender == AT_REST

    @property
    def sender(self) -> str:
        """Who sends, in words."""
        if self.link is None or self.link.sender == 0:
            return "the leader"
        return "the beacons" if self.is_among_beacons else self.plan.names[self.link.sender]

    @cached_property
    def receivers(self) -> tuple[int, ...]:
        """Indices of those that receive the link."""
        link = self.link
        return tuple(i for i in self.followers if link is None or link.hears(i))

    @cached_property
    def errors(self) -> list[SensorErrors]:
        """Errors of each receiver, and of who sends."""
        return [errors_of(self.sensing, i, self.link) for i in self.receivers]

    @property
    def assumed_sound_speed(self) -> float:
        """Speed of sound by which they compute ranges, unless they know the profile [m/s]."""
        sound = self.sensing.acoustics
        return sound.sound_speed_m_s + sound.sound_speed_bias_m_s

    @property
    def sends_estimates(self) -> bool:
        """Whether messages hold what the navigator of who sends believes."""
        if self.link is not None:
            return self.link.by_estimate
        return self.scenario.leader.broadcast_position == "estimate"

    @property
    def compass_bias(self) -> float:
        """Size of the bias of the headings that messages hold [rad]."""
        if self.link is not None and self.link.by_estimate and self.link.sender > 0:
            # messages hold what its own compass reads
            of_sender = self.sensing.sensors_of(self.link.sender - 1)
            return math.radians(abs(of_sender.heading_bias_deg))
        return max((abs(errors.leader_heading_bias) for errors in self.errors), default=0.0)

    @cached_property
    def sources(self) -> list[Floats]:
        """Where pings are planned to leave, of each vehicle or beacon that sends; shapes (n, 3) or
        (1, 3), east, north and depth [m].
        """
        if self.is_among_beacons:
            assert self.link is not None
            assert self.link.places is not None
            return [place[None] for place in self.link.places[: self.link.transmitters]]
        return [planned_places(self.plan)[0 if self.link is None else self.link.sender]]

    @cached_property
    def offsets(self) -> list[Floats]:
        """From each source to each receiver as planned, shapes (n, 3), [m]."""
        places = planned_places(self.plan)
        return [places[i + 1] - source for i in self.receivers for source in self.sources]

    @property
    def distances(self) -> Floats:
        """Planned horizontal distances of all pairs, one after the other, shape (n,), [m]."""
        return np.concatenate([np.hypot(*offset[:, :2].T) for offset in self.offsets])

    @property
    def slant_ranges(self) -> Floats:
        """The same of the ranges."""
        return np.concatenate([np.linalg.norm(offset, axis=1) for offset in self.offsets])


def navigated_alike(scenario: Scenario) -> list[Navigated]:
    """The followers of a scenario by how they navigate, the first ones first."""
    kinds: list[tuple[Navigation, list[int]]] = []
    for i in range(len(scenario.followers)):
        navigation = scenario.navigation_of(i)
        alike = next((members for other, members in kinds if other == navigation), None)
        if alike is None:
            kinds.append((navigation, [i]))
        else:
            alike.append(i)
    return [Navigated.of(scenario, followers) for _, followers in kinds]


@dataclass(frozen=True, kw_only=True)
class Rule:
    """An error that a scenario may set, and the assumption without which it is not estimated."""

    keys: tuple[str, ...]
    assumption: str
    """Key of `navigation` that would take it into account; "" if no navigator can."""
    is_assumed: Callable[[Settings, str], bool]
    """By the settings of a navigator, and its name."""
    effect: Callable[[Navigated], str]
    """What the error does, as a sentence without its end; "" if it is not set, or too small."""
    needs: str
    """What a navigator assumes that does not have the assumption."""


def estimates(state: str) -> Callable[[Settings, str], bool]:
    """Whether a navigator has a state for something."""
    return lambda settings, _: state in settings.estimated


def has(*fields: str) -> Callable[[Settings, str], bool]:
    """Whether settings of a navigator set one of these fields, which it need not have."""
    return lambda settings, _: any(bool(getattr(settings, field, False)) for field in fields)


def _expects_current(settings: Settings, _: str) -> bool:
    """Whether a navigator has a state for the current; that among beacons has one unless its σ is
    0.
    """
    if isinstance(settings, BeaconSettings):
        return settings.current_sigma > 0.0
    return "current" in settings.estimated


def _expects_common_echoes(settings: Settings, variant: str) -> bool:
    """Whether the paths by surface and floor are computed from depths: by the tightly coupled
    navigator.
    """
    return hasattr(settings, "floor_depth") and find(variant).reads_assumptions


def _current(navigated: Navigated) -> str:
    return "there is a current" if navigated.sensing.has_current else ""


def clock_error_s(sensing: SensingSettings) -> float:
    """Largest difference of the clocks during the mission [s]."""
    sound = sensing.acoustics
    end = sound.clock_offset_s + 1e-6 * sound.clock_drift_ppm * sensing.sound.sea.plan.duration_s
    return max(abs(sound.clock_offset_s), abs(end))


def _clock(navigated: Navigated) -> str:
    # the clocks of all followers differ from the leader's alike, and so not among each other
    is_by_follower = navigated.link is not None and navigated.link.sender > 0
    error_s = 0.0 if is_by_follower else clock_error_s(navigated.sensing)
    metres = error_s * navigated.sensing.acoustics.sound_speed_m_s
    if metres < _NOTICEABLE_M:
        return ""
    return (
        f"the clocks differ by up to {1e3 * error_s:.3g} ms, which changes every range by up to "
        f"{metres:.3g} m"
    )


def _range_factors(navigated: Navigated) -> Floats:
    """What planned ranges are, as followers compute them, of the straight paths; in the order of
    `Navigated.slant_ranges`.
    """
    sound = navigated.sensing.acoustics
    assumed = navigated.assumed_sound_speed
    if navigated.sensing.sound_speed != "mean":
        # of the profile's mean, or of the ray, only the bias remains
        return np.full(navigated.slant_ranges.size, assumed / sound.sound_speed_m_s)
    points = sound_points(navigated.sensing.sound)
    constant = np.array([[0.0, sound.sound_speed_m_s]])
    profile = SoundProfile.through(constant if points is None else points)
    sources = [source[:, 2] for _ in navigated.receivers for source in navigated.sources]
    depths = [
        np.column_stack([source + offset[:, 2], np.broadcast_to(source, len(offset))])
        for source, offset in zip(sources, navigated.offsets, strict=True)
    ]
    # vehicles at held depths have few pairs
    pairs, pair_of = np.unique(np.concatenate(depths), axis=0, return_inverse=True)
    slowness = np.array([mean_slowness(profile, *pair) for pair in pairs.tolist()])
    return np.asarray(assumed * slowness[pair_of.ravel()])


def _sound_speed(navigated: Navigated) -> str:
    if not navigated.offsets:
        return ""
    factors = _range_factors(navigated)
    errors = (factors - 1.0) * navigated.slant_ranges
    worst = float(errors[np.argmax(np.abs(errors))])
    # a navigator that estimates the mean error of ranges expects it within its prior
    expected = 3.0 * getattr(navigated.settings, "range_scale_bias_sigma", 0.0)
    if abs(worst) < max(_NOTICEABLE_M, expected):
        return ""
    assumed = navigated.assumed_sound_speed
    speeds = [f"{assumed / factor:.0f}" for factor in (factors.max(), factors.min())]
    return (
        f"followers assume a speed of sound of {assumed:.5g} m/s, where its mean between them and "
        f"{navigated.sender} is {' to '.join(dict.fromkeys(speeds))} m/s, which makes ranges up to "
        f"{abs(worst):.2g} m too {'long' if worst > 0.0 else 'short'}"
    )


def max_range_rate(navigated: Navigated) -> float:
    """Largest planned rate of the horizontal distance from those who send, growing or shrinking
    [m/s].
    """
    speeds = [0.0]
    for offset in navigated.offsets:
        spacing = navigated.plan.duration_s / (len(offset) - 1)
        speeds.append(float(np.abs(np.diff(np.hypot(*offset[:, :2].T))).max()) / spacing)
    return max(speeds)


def _way_of_receivers(navigated: Navigated, duration: float) -> float:
    """Largest planned horizontal way over ground of those who navigate in a time [s], [m]."""
    places = planned_places(navigated.plan)
    time = np.linspace(0.0, navigated.plan.duration_s, len(places[0]))
    longest = 0.0
    for i in navigated.receivers:
        path = places[i + 1][:, :2]
        before = np.column_stack([np.interp(time - duration, time, axis) for axis in path.T])
        longest = max(longest, float(np.hypot(*(path - before).T).max()))
    return longest


def _slots(navigated: Navigated) -> str:
    change = navigated.sensing.acoustics.ping_slot_s * max_range_rate(navigated)
    # beacons are far apart, so that each range has the error for itself
    if change < (_NOTICEABLE_M if navigated.is_among_beacons else _NOTICEABLE_SLOT_M):
        return ""
    effect = f"ranges change by up to {change:.2g} m from one transmitter's ping to the next's"
    if navigated.is_among_beacons:
        return effect
    return f"{effect}, of a baseline of {navigated.settings.baseline:g} m"


def _late_pings(navigated: Navigated) -> str:
    sound = navigated.sensing.acoustics
    lead = sound.message_length_s if sound.ranging_pulse == "end" else 0.0
    change = lead * max_range_rate(navigated)
    if change < _NOTICEABLE_M:
        return ""
    return (
        f"pings leave {lead:g} s after the time that their message states, until when ranges "
        f"change by up to {change:.2g} m"
    )


def _early_pings(navigated: Navigated) -> str:
    sound = navigated.sensing.acoustics
    early_s = sound.message_length_s if sound.ranging_pulse == "start" else 0.0
    way = _way_of_receivers(navigated, early_s)
    if way < _NOTICEABLE_M:
        return ""
    return (
        f"pings arrive {early_s:g} s before their message is in, and followers move on by up to "
        f"{way:.2g} m meanwhile"
    )


def _leader_compass(navigated: Navigated) -> str:
    bias = navigated.compass_bias
    error = 2.0 * math.sin(bias / 2.0) * float(navigated.distances.max()) if bias else 0.0
    if error < _NOTICEABLE_M:
        return ""
    sender = navigated.sender
    owner = "the leader's compass" if sender == "the leader" else f"the compass of {sender}"
    return (
        f"{owner} is off by {math.degrees(bias):.3g}°, which turns fixes about {sender}, by up to "
        f"{error:.2g} m"
    )


def echo_excess_m(navigated: Navigated) -> float:
    """Largest excess of an echo's path over the direct path between planned places [m]."""
    sound = navigated.sensing.acoustics
    floor_depth = floor_of(navigated.sensing.sound.sea).deepest
    places = planned_places(navigated.plan)
    largest = 0.0
    for i in navigated.receivers:
        depth = places[i + 1][:, 2]
        for source in navigated.sources:
            horizontal = np.hypot(*(places[i + 1] - source)[:, :2].T)
            direct = np.hypot(horizontal, depth - source[:, 2])
            paths = []
            if sound.surface_echo_probability:
                paths.append(np.hypot(horizontal, depth + source[:, 2]))
            if sound.bottom_echo_probability:
                paths.append(np.hypot(horizontal, 2.0 * floor_depth - depth - source[:, 2]))
            largest = max([largest, *(float((path - direct).max()) for path in paths)])
    return largest


def _common_echoes(navigated: Navigated) -> str:
    span = getattr(navigated.settings, "outlier_span", math.inf)
    delay = echo_excess_m(navigated) if navigated.sensing.acoustics.common_echoes else 0.0
    if delay <= span:
        return ""
    return (
        f"echoes are up to {delay:.2g} m longer than the direct path and common to all ranges of a "
        f"message, beyond the {span:g} m"
    )


def _sent_position_errors(navigated: Navigated) -> Sequence[SensorErrors]:
    """Errors with which the true position of who sends is broadcast; none if it is not."""
    return () if navigated.sends_estimates else navigated.errors[:1]


def _leader_position_drift(navigated: Navigated) -> str:
    rates = [
        math.hypot(errors.leader_drift_east, errors.leader_drift_north)
        for errors in _sent_position_errors(navigated)
    ]
    drift = max(rates, default=0.0) * navigated.plan.duration_s
    if drift < _NOTICEABLE_M:
        return ""
    return (
        f"the position that {navigated.sender} broadcasts drifts by {drift:.3g} m, and the "
        "followers' with it"
    )


def _leader_position_scatter(navigated: Navigated) -> str:
    sigmas = [errors.leader_position_sigma for errors in _sent_position_errors(navigated)]
    sigma = max(sigmas, default=0.0)
    if sigma < _NOTICEABLE_M:
        return ""
    return (
        f"the position that {navigated.sender} broadcasts scatters by σ = {sigma:.3g} m along each "
        "axis from message to message"
    )


def _leader_position_walk(navigated: Navigated) -> str:
    rates = [errors.leader_position_walk for errors in _sent_position_errors(navigated)]
    walk = max(rates, default=0.0) * math.sqrt(navigated.plan.duration_s)
    if walk < _NOTICEABLE_M:
        return ""
    return (
        f"the position that {navigated.sender} broadcasts walks away along each axis, at the end "
        f"by σ = {walk:.3g} m, and the followers' with it"
    )


def _reach(navigated: Navigated) -> str:
    reach = navigated.sensing.acoustics.max_range_m
    if reach == 0.0 or not navigated.receivers:
        return ""
    slant_ranges = navigated.slant_ranges
    if slant_ranges.max() <= reach:
        return ""
    return (
        f"messages reach {reach:g} m, and {np.mean(slant_ranges > reach):.0%} of the planned "
        f"distances are longer, up to {slant_ranges.max():.3g} m"
    )


def _largest_drift(sensors: Sequence[Sensors], key: str) -> float:
    return max((abs(getattr(each, key)) for each in sensors), default=0.0)


def _drift(navigated: Navigated) -> str:
    sensors = [navigated.sensing.sensors_of(i) for i in navigated.followers]
    drifts = {
        "log": (_largest_drift(sensors, "speed_drift_m_s"), "m/s"),
        "compass": (_largest_drift(sensors, "heading_drift_deg"), "°"),
    }
    parts = [
        f"the {sensor}'s bias drifts by up to {drift:g}{' ' if unit != '°' else ''}{unit}"
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
        keys=(
            "acoustics.sound_speed_bias_m_s",
            "acoustics.sound_speed_profile",
            "ocean.sound_speed",
        ),
        assumption="",
        is_assumed=lambda *_: False,
        effect=_sound_speed,
        needs="the right speed of sound",
    ),
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
        is_assumed=_expects_current,
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
        keys=("acoustics.message_length_s", "acoustics.ranging_pulse"),
        assumption="",
        is_assumed=lambda *_: False,
        effect=_late_pings,
        needs="that pings leave at that time",
    ),
    Rule(
        keys=("acoustics.message_length_s",),
        assumption="",
        is_assumed=has("compensate_motion"),
        effect=_early_pings,
        needs="ranges of where they are",
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


def unheard_links(navigated: Navigated) -> list[str]:
    """A line for each link on which followers navigate that are none of its receivers, and do not
    send on it themselves.
    """
    links = navigated.sensing.links
    names = navigated.plan.names
    lines = []
    for name in links.navigated:
        link = named_link(links, name)
        if link is None:
            continue
        deaf = [
            names[i + 1] for i in navigated.followers if not link.hears(i) and link.sender != i + 1
        ]
        if deaf:
            verbs = ("does", "it navigates") if len(deaf) == 1 else ("do", "they navigate")
            lines.append(
                f"{', '.join(deaf)} {verbs[0]} not receive {name!r}, on which {verbs[1]}: its "
                f"receivers are {', '.join(names[v] for v in link.receivers)}"
            )
    return lines


def assumption_cautions(navigated: Navigated) -> list[str]:
    """A line for each error that there is and the navigator of these followers does not assume.

    Of a navigator of the user's own it is not known what it assumes.
    """
    navigation = navigated.navigation
    if is_plugin_name(navigation.variant):
        return []
    lines = []
    for rule in RULES:
        effect = rule.effect(navigated)
        if effect and not rule.is_assumed(navigated.settings, navigation.variant):
            lines.append(_sentence(rule, effect, navigation))
    return lines
