"""The design of the pitch study, of `study.toml`: what makes the leader pitch, the arms, and how much is simulated."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from typing import Any

from pydantic import TypeAdapter

from experiments.flight.library import ROUTES, fly_line, table_of
from laisn.settings import Variant
from sim.scenario.file import assigned, dotted, validate
from sim.scenario.settings import Scenario

_FILE = tomllib.loads((resources.files(__package__) / "study.toml").read_text(encoding="utf-8"))
SEED: int = _FILE["seed"]
OFFSETS_M: tuple[float, ...] = tuple(_FILE["offsets_m"])
MAP: dict[str, list[float]] = _FILE["map"]
"""Grid of the map of noiseless fixes, by columns of its table."""
ROUTE: str = _FILE["example"]["route"]
OFFSET_M: float = _FILE["example"]["offset_m"]
EVERYTHING: dict[str, Any] = dotted(_FILE["example"]["set"])
"""Of the example mission; settings of its range error budget."""
_ROOM = 10_000
"""Runs that a mission may have: with as many numbers each, no two missions share noise."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One physical cause of pitch; `set` is what it changes in a scenario."""

    key: str
    label: str
    cause: str
    set: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def first_run(self, route: str, offset: float) -> int:
        """Number of a mission's run 0: the seed is the study's, so that all see one sea, but the noise is its own."""
        place = [c.key for c in _CONDITIONS].index(self.key) * len(ROUTES) + ROUTES.index(route)
        return _ROOM * (len(OFFSETS_M) * place + OFFSETS_M.index(offset))

    def settings(self, offset: float) -> dict[str, Any]:
        """What differs from the built-in scenario of a route, by dotted key."""
        parts = _FILE["set"], _FILE["cause"][self.cause].get("set", {}), self.set
        changed = {key: value for part in parts for key, value in dotted(part).items()}
        return {**changed, "followers.0.depth_m": changed["leader.depth_m"] + offset, "seed": SEED}

    def scenario(
        self, route: str, offset: float, duration: float = 1000.0, settings: Mapping[str, Any] | None = None
    ) -> Scenario:
        """One follower on a route, `offset` metres below the leader; `settings` are those of an arm."""
        changed = {**self.settings(offset), "duration_s": duration, **dotted(settings or {})}
        return validate(assigned(table_of(route), changed), f"{self.key} on {route}")

    def fleet(self, routes: tuple[str, ...], offset: float, duration: float) -> Scenario:
        """A follower on each route, at one depth offset, behind one leader."""
        alone = {f"{route}-{offset:g}m": self.scenario(route, offset, duration) for route in routes}
        followers = tuple(one.followers[0].model_copy(update={"name": name}) for name, one in alone.items())
        return Scenario.model_validate({**dict(next(iter(alone.values()))), "name": self.key, "followers": followers})

    def command(self, route: str, offset: float, run: int = 0, variant: str = "laisn-2") -> str:
        """The command that simulates a mission alone, with the noise of its run 0, 1, …"""
        chosen = {} if variant == "laisn-2" else {"navigation.variant": variant}
        return fly_line(route, self.settings(offset) | chosen, self.first_run(route, offset) + run)


_CONDITIONS = TypeAdapter(tuple[Condition, ...]).validate_python(_FILE["condition"])
CALM, *_OTHERS = _CONDITIONS
CONDITIONS = tuple(_OTHERS)
QUICK_CONDITIONS = tuple(c for c in CONDITIONS if c.key in _FILE["quick"])
CAUSES: dict[str, str] = {key: cause["title"] for key, cause in _FILE["cause"].items() if key != CALM.cause}


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One way to simulate a condition: behind which leader, and with which remedy."""

    key: str
    label: str
    level: bool = False
    """Behind a leader that has the real one's track and keeps level."""
    set: Mapping[str, Any] = field(default_factory=dict, hash=False)
    wanted: float = 0.0
    """Share of the pitch-driven error that a remedy should remove; 0: it is none."""
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")


ARMS = TypeAdapter(tuple[Arm, ...]).validate_python(_FILE["arm"])
LEVEL, REAL, LEVEL_BROADCAST, EXACT, AHRS, READINGS, ROUGH, CONSTANT, INFLATED = ARMS
BROADCASTS = (EXACT, AHRS, READINGS)
REMEDIES = tuple(arm for arm in ARMS if arm.wanted)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much of the study is simulated."""

    routes: tuple[str, ...] = ROUTES
    offsets_m: tuple[float, ...] = OFFSETS_M
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    looks: tuple[int, ...] = tuple(_FILE["looks"])
    """Numbers of runs after which verdicts are computed: of every cell, then of those whose verdict is open."""
    duration_s: float = 1000.0

    @property
    def runs(self) -> int:
        """Runs of every cell."""
        return self.looks[0]

    @property
    def least(self) -> "Plan":
        """So little that compiling is all that takes time."""
        return replace(self, routes=self.routes[:1], duration_s=2.0, looks=(1,))


QUICK = Plan(routes=("T3", "T8"), offsets_m=(0.0, 5.0, 10.0), variants=("laisn-2",), looks=(64,), duration_s=200.0)
