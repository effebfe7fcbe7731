"""What makes the leader pitch in the study, and the scenarios that follow: each can be flown alone with `laisn fly`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from experiments.flight.library import ROUTES, fly_line, table_of
from sim.scenario.file import assigned, validate
from sim.scenario.settings import Scenario

OFFSETS_M = (0.0, 2.0, 5.0, 10.0)
"""Depth of the follower below the leader's mean depth."""
SEED = 1
_ROOM = 10_000
"""Runs that a mission may have: with as many numbers each, no two missions share noise."""
PHYSICS_STEP_S = 0.05
"""Step of the study: 2 mm from the motion at finer steps in its roughest sea, and 2.5 times as quick as the default."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One physical cause of pitch."""

    key: str
    label: str
    cause: str
    """trim, dive or waves."""
    leader_depth_m: float = 8.0
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """What the cause changes in a scenario."""


def _trim(force: float) -> Condition:
    return Condition(
        key=f"trim-{force:g}N",
        label=f"{force:g} N of excess buoyancy, held by trim",
        cause="trim",
        settings={"leader.excess_buoyancy_n": force},
    )


def _dive(amplitude: float) -> Condition:
    return Condition(
        key=f"dive-{amplitude:g}m",
        label=f"saw-tooth of ±{amplitude:g} m in 120 s",
        cause="dive",
        settings={"leader.saw_tooth_amplitude_m": amplitude, "leader.saw_tooth_period_s": 120.0},
    )


SEAS_DEG = {"head": 270.0, "beam": 0.0, "following": 90.0}
"""Where waves run to, named for the leader's first leg, eastwards; on its second leg, northwards, head and following
seas come from abeam, and a beam sea follows."""


_COMPONENTS = 16
"""Enough for a sea that does not repeat within a mission; the price of a sea grows with their number."""


def _waves(height: float, sea: str, depth: float) -> Condition:
    # steepness of a young wind sea: 0.5 m at 4 s, 1 m at 5 s
    period = 5.0 if height >= 1.0 else 4.0
    return Condition(
        key=f"waves-{height:g}m-{sea}-{depth:g}m",
        label=f"Hs {height:g} m, {sea} sea, leader at {depth:g} m",
        cause="waves",
        leader_depth_m=depth,
        settings={
            "ocean.waves.kind": "jonswap",
            "ocean.waves.height_m": height,
            "ocean.waves.period_s": period,
            "ocean.waves.direction_deg": SEAS_DEG[sea],
            "ocean.waves.components": _COMPONENTS,
        },
    )


CALM = Condition(key="calm", label="calm sea, neutral leader", cause="none")
CONDITIONS = (
    *(_trim(force) for force in (4.0, 8.0, 12.0)),
    *(_dive(amplitude) for amplitude in (2.0, 4.0)),
    *(_waves(h, sea, depth) for h in (0.3, 0.5, 1.0) for sea in SEAS_DEG for depth in (2.0, 5.0)),
)
QUICK_CONDITIONS = (_trim(12.0), _dive(4.0), _waves(1.0, "following", 2.0))


def first_run(condition: Condition, route: str, offset: float) -> int:
    """Number of a mission's run 0: the seed is the study's, so that all see one sea, but the noise is its own."""
    place = [c.key for c in (CALM, *CONDITIONS)].index(condition.key)
    place = len(ROUTES) * place + ROUTES.index(route)
    return _ROOM * (len(OFFSETS_M) * place + OFFSETS_M.index(offset))


def settings_of(condition: Condition, offset: float) -> dict[str, Any]:
    """What differs from the built-in scenario of a route."""
    return {
        "leader.depth_m": condition.leader_depth_m,
        **condition.settings,
        "followers.0.depth_m": condition.leader_depth_m + offset,
        "leader.broadcast_attitude": True,
        "timing.physics_step_s": PHYSICS_STEP_S,
        "seed": SEED,
    }


def scenario(
    condition: Condition, route: str, offset: float, duration: float = 1000.0,
    settings: Mapping[str, Any] = MappingProxyType({}),
) -> Scenario:  # fmt: skip
    """One follower on a route, `offset` metres below the leader; `settings` are those of an arm."""
    told = {**settings_of(condition, offset), "duration_s": duration, **settings}
    return validate(assigned(table_of(route), told), f"{condition.key} on {route}")


def command_line(condition: Condition, route: str, offset: float, run: int = 0, variant: str = "laisn-2") -> str:
    """The command that flies the same alone, with the noise of the mission's run 0, 1, …, in one line."""
    chosen = {} if variant == "laisn-2" else {"navigation.variant": variant}
    return fly_line(route, settings_of(condition, offset) | chosen, first_run(condition, route, offset) + run)


def command(condition: Condition, route: str, offset: float, run: int = 0, variant: str = "laisn-2") -> str:
    """The command that flies one run of a mission, broken into lines that a page has room for."""
    start, *settings = command_line(condition, route, offset, run, variant).split(" --set ")
    lines = [" ".join(f"--set {setting}" for setting in settings[i : i + 3]) for i in range(0, len(settings), 3)]
    return " \\\n  ".join([start, *lines])


def fleet(
    condition: Condition, routes: tuple[str, ...] = ROUTES, offsets: tuple[float, ...] = OFFSETS_M,
    duration: float = 1000.0,
) -> Scenario:  # fmt: skip
    """All routes at all offsets behind one leader; followers in the order of routes, then offsets."""
    alone = [scenario(condition, route, offset, duration) for route in routes for offset in offsets]
    followers = [
        one.followers[0].model_copy(update={"name": f"{route}-{offset:g}m"})
        for one, (route, offset) in zip(alone, [(r, o) for r in routes for o in offsets], strict=True)
    ]
    return Scenario.model_validate({**dict(alone[0]), "name": condition.key, "followers": tuple(followers)})
