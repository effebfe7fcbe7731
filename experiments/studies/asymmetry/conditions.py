"""The design of the pitch study: what makes the leader pitch, the arms, and how much is flown.

Each mission can be flown alone with `laisn fly`. A broadcast attitude is only as good as its sensor. Three kinds of
error of the same size are compared: one that each message has anew, one that is constant, and what gyros leave of an
inclinometer that is 0.5° off in each reading and takes the accelerations of waves for tilt (an AHRS).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from experiments.flight.library import ROUTES, fly_line, table_of
from laisn.settings import Variant
from sim.scenario.file import assigned, validate
from sim.scenario.settings import Scenario

OFFSETS_M = (0.0, 2.0, 5.0, 10.0)
"""Depth of the follower below the leader's mean depth."""
SEED = 1
_ROOM = 10_000
"""Runs that a mission may have: with as many numbers each, no two missions share noise."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One physical cause of pitch."""

    key: str
    label: str
    cause: str
    """trim, dive or waves."""
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """What the cause changes in a scenario."""
    leader_depth_m: float = 8.0

    def first_run(self, route: str, offset: float) -> int:
        """Number of a mission's run 0: the seed is the study's, so that all see one sea, but the noise is its own."""
        place = [c.key for c in (CALM, *CONDITIONS)].index(self.key) * len(ROUTES) + ROUTES.index(route)
        return _ROOM * (len(OFFSETS_M) * place + OFFSETS_M.index(offset))

    def _settings(self, offset: float) -> dict[str, Any]:
        """What differs from the built-in scenario of a route."""
        return {
            "leader.depth_m": self.leader_depth_m,
            **self.settings,
            "followers.0.depth_m": self.leader_depth_m + offset,
            "leader.broadcast_attitude": True,
            # 2 mm from the motion at finer steps in the roughest sea
            "timing.physics_step_s": 0.05,
            "seed": SEED,
        }

    def scenario(
        self, route: str, offset: float, duration: float = 1000.0, settings: Mapping[str, Any] | None = None
    ) -> Scenario:
        """One follower on a route, `offset` metres below the leader; `settings` are those of an arm."""
        changed = {**self._settings(offset), "duration_s": duration, **(settings or {})}
        return validate(assigned(table_of(route), changed), f"{self.key} on {route}")

    def fleet(self, routes: tuple[str, ...], offset: float, duration: float) -> Scenario:
        """A follower on each route, at one depth offset, behind one leader."""
        alone = {f"{route}-{offset:g}m": self.scenario(route, offset, duration) for route in routes}
        followers = tuple(one.followers[0].model_copy(update={"name": name}) for name, one in alone.items())
        return Scenario.model_validate({**dict(next(iter(alone.values()))), "name": self.key, "followers": followers})

    def command(self, route: str, offset: float, run: int = 0, variant: str = "laisn-2") -> str:
        """The command that flies a mission alone, with the noise of its run 0, 1, …"""
        chosen = {} if variant == "laisn-2" else {"navigation.variant": variant}
        return fly_line(route, self._settings(offset) | chosen, self.first_run(route, offset) + run)


def _trim(force: float) -> Condition:
    label, settings = f"{force:g} N of excess buoyancy", {"leader.excess_buoyancy_n": force}
    return Condition(key=f"trim-{force:g}N", label=label, cause="trim", settings=settings)


def _dive(amplitude: float) -> Condition:
    settings = {"leader.saw_tooth_amplitude_m": amplitude, "leader.saw_tooth_period_s": 120.0}
    label = f"saw-tooth of ±{amplitude:g} m in 120 s"
    return Condition(key=f"dive-{amplitude:g}m", label=label, cause="dive", settings=settings)


SEAS_DEG = {"head": 270.0, "beam": 0.0, "following": 90.0}
"""Where waves run to, named for the leader's first leg, eastwards; on its second leg, northwards, head and following
seas come from abeam, and a beam sea follows."""


def _waves(height: float, sea: str, depth: float) -> Condition:
    settings = {
        "ocean.waves.kind": "jonswap",
        "ocean.waves.height_m": height,
        # steepness of a young wind sea: 0.5 m at 4 s, 1 m at 5 s
        "ocean.waves.period_s": 5.0 if height >= 1.0 else 4.0,
        "ocean.waves.direction_deg": SEAS_DEG[sea],
        # enough for a sea that does not repeat within a mission
        "ocean.waves.components": 16,
    }
    key, label = f"waves-{height:g}m-{sea}-{depth:g}m", f"Hs {height:g} m, {sea} sea, leader at {depth:g} m"
    return Condition(key=key, label=label, cause="waves", settings=settings, leader_depth_m=depth)


CALM = Condition(key="calm", label="calm sea, neutral leader", cause="none")
CONDITIONS = (
    *(_trim(force) for force in (4.0, 8.0, 12.0)),
    *(_dive(amplitude) for amplitude in (2.0, 4.0)),
    *(_waves(h, sea, depth) for h in (0.3, 0.5, 1.0) for sea in SEAS_DEG for depth in (2.0, 5.0)),
)
QUICK_CONDITIONS = (_trim(12.0), _dive(4.0), _waves(1.0, "following", 2.0))
CAUSES = {"trim": "trim", "dive": "depth changes", "waves": "waves"}
"""Causes of pitch, and their names on the page."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One way to fly a condition: behind which leader, and with which remedy."""

    key: str
    label: str
    level: bool = False
    """Behind a leader that has the real one's track and keeps level."""
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """What differs from the condition's scenario."""
    wanted: float = 0.9
    """Share of the pitch-driven error that the remedy should remove."""
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    """Flown in this arm."""


def _broadcast(**sensor: Any) -> dict[str, Any]:
    """The follower uses the broadcast attitude, which comes from this sensor."""
    return {"navigation.use_attitude": True} | {f"sensors.leader_{key}": value for key, value in sensor.items()}


_TWO: tuple[Variant, ...] = ("laisn-2",)
_READING = _broadcast(attitude_sigma_deg=0.5)
# gyros of 0.3°/√h, the default, as in small MEMS units
_AHRS = _broadcast(attitude_sigma_deg=0.5, attitude_senses_acceleration=True, gyro_time_constant_s=30.0)
_ROUGH, _CONSTANT = _broadcast(attitude_sigma_deg=2.0), _broadcast(attitude_offset_sigma_deg=0.5)
LEVEL = Arm(key="level", label="level leader", level=True)
REAL = Arm(key="real", label="real leader")
LEVEL_BROADCAST = Arm(
    key="level-0.5", label="level leader, each message 0.5° off", level=True, settings=_READING, variants=_TWO
)
EXACT = Arm(key="attitude-0", label="attitude broadcast, exact", settings=_broadcast(), wanted=0.99)
AHRS = Arm(key="ahrs-0.5", label="AHRS: inclinometer of 0.5°, gyros", settings=_AHRS)
READINGS = Arm(key="attitude-0.5", label="each message 0.5° off", settings=_READING)
ROUGH = Arm(key="attitude-2", label="each message 2° off", settings=_ROUGH, variants=_TWO)
CONSTANT = Arm(key="offset-0.5", label="a constant 0.5° off", settings=_CONSTANT, variants=_TWO)
INFLATED = Arm(key="expected", label="σ_p inflated by the pitch of the mission", variants=_TWO)
BROADCASTS = (EXACT, AHRS, READINGS)
REMEDIES = (EXACT, AHRS, READINGS, ROUGH, CONSTANT, INFLATED)
ARMS = (LEVEL, REAL, LEVEL_BROADCAST, *REMEDIES)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much of the study is flown."""

    routes: tuple[str, ...] = ROUTES
    offsets_m: tuple[float, ...] = OFFSETS_M
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    looks: tuple[int, ...] = (64, 192, 512, 1280, 5120)
    """Numbers of runs after which verdicts are asked for: of every cell, then of those whose verdict is open."""
    duration_s: float = 1000.0

    @property
    def runs(self) -> int:
        """Runs of every cell."""
        return self.looks[0]


QUICK = Plan(routes=("T3", "T8"), offsets_m=(0.0, 5.0, 10.0), variants=_TWO, looks=(64,), duration_s=200.0)
