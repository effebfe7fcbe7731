"""What the study of the estimators flies: one mission after another, each a few seconds of computing."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from experiments.campaign.bound import geometry_of, least_rms, noise_of
from experiments.campaign.missions import mission_of, motion_of
from experiments.campaign.tasks import Task
from experiments.estimators import paired
from experiments.estimators.cases import CASES, WRONG, Case
from experiments.estimators.clock import clock_cost
from experiments.flight.library import ROUTES, load
from laisn.settings import NavigationSettings
from laisn.tight.settings import TightSettings
from sim.flight import settings_as
from sim.sensing.hearing import Hearing
from sim.sensing.observation import errors_of
from sim.sensing.sensor_errors import measure

SEED = 12
"""Seed of all noise: not the one on which the navigator was developed."""
INTERVALS = (1.0, 5.0)
BASELINED = CASES[:2]
"""Cases of which a plain extended Kalman filter has the states: constant biases, exact leader, 3 or 2 transmitters."""
FEW = ("T2", "T5", "T6", "T8")
"""Routes on which settings are varied: two about the leader's axis, and two aside of it."""
ON_AXIS = ("T2", "T5")
"""Routes that spend most of their time within a few degrees of the leader's axis."""
SIGMAS = ("speed_sigma", "speed_bias_sigma", "heading_sigma", "heading_bias_sigma", "range_sigma", "range_scale_sigma",
          "range_scale_bias_sigma")  # fmt: skip
OFFSETS_M = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
"""H_T."""
SEAS = {
    "calm": ("calm water", ()),
    "current": ("a current of 0.4 m/s, estimated",
                ("ocean.current_speed_m_s=0.4", "ocean.current_direction_deg=135", "ocean.current_shear_per_s=0.01",
                 "navigation.assume.current=true")),
    "waves": ("a sea of Hs 0.5 m, leader at 2 m, its attitude broadcast and used",
              ("ocean.waves.kind=jonswap", "ocean.waves.height_m=0.5", "ocean.waves.period_s=4", "leader.depth_m=2",
               "followers.0.depth_m=12", "leader.broadcast_attitude=true", "navigation.use_attitude=true")),
    "waves-level": ("the same sea, the leader taken as level",
                    ("ocean.waves.kind=jonswap", "ocean.waves.height_m=0.5", "ocean.waves.period_s=4",
                     "leader.depth_m=2", "followers.0.depth_m=12")),
}  # fmt: skip
"""Physical missions: words, and what is set."""


@dataclass(frozen=True, kw_only=True)
class Size:
    """How many runs of what."""

    runs: int = 60
    varied: int = 30
    """Where settings are varied."""
    captures: int = 10_000
    routes: tuple[str, ...] = ROUTES
    few: tuple[str, ...] = FEW


QUICK = Size(runs=4, varied=2, captures=64, routes=("T2", "T6"), few=("T2",))
Named = tuple[tuple[Any, ...], Task]
"""Name of a task, its parts from general to special, and what it computes."""


def at_sea(sea: str, route: str, runs: int) -> paired.Paired:
    """Runs of a physical mission by both navigators; the bound is that of its noise."""
    _, assignments = SEAS[sea]
    asked = load(route, ["navigation.variant=tight", f"seed={SEED}", *assignments])
    trajectory, truth = mission_of(motion_of(asked)).seen(asked, 0)
    errors = errors_of(asked)
    measured = [measure(truth, errors, seed=SEED, run=run) for run in range(runs)]
    laisn = asked.model_copy(update={"navigation": asked.navigation.model_copy(update={"variant": "laisn-2"})})
    told = settings_as(TightSettings, asked, trajectory, 0)
    own = settings_as(NavigationSettings, laisn, trajectory, 0)
    found = paired.pair(truth, measured, told, asked.message_every, own)
    least = least_rms(geometry_of(trajectory, Hearing.of(asked)), noise_of(asked))
    interval = asked.timing.message_interval_s
    return paired.paired(route, interval, found, float(np.sqrt(np.mean(least**2))))


def seven(case: Case, route: str, interval: float, runs: int) -> paired.Paired:
    """Runs of one of the seven cases by both navigators, and what smoothing could do."""
    found = paired.compare(case, route, interval, runs=runs, seed=SEED)
    return replace(found, smoothing=paired.smoothing(case, route, interval))


def first_look() -> None:
    """Fly so little that compiling is all that takes time: both navigators on point motion, and on a hull at sea."""
    paired.compare(CASES[0], FEW[0], INTERVALS[-1], runs=1, seed=SEED)
    paired.captures(FEW[0], INTERVALS[-1], 2, range(1), SEED)
    at_sea("calm", FEW[0], 1)


def _scaled(sigma: str, factor: float) -> TightSettings:
    usual = TightSettings()
    return replace(usual, **{sigma: factor * getattr(usual, sigma)})


def tasks(size: Size) -> Iterator[Named]:
    """All tasks, the longest first."""
    compare = partial(paired.compare, seed=SEED)
    plain, two = CASES[0], CASES[1]
    some = min(640, size.captures)
    for transmitters in (3, 2):
        for route in ON_AXIS:
            for first in range(0, size.captures, some):
                runs = range(first, min(first + some, size.captures))
                name = ("captures", transmitters, route, first)
                yield name, partial(paired.captures, route, 5.0, transmitters, runs, SEED)
    for sea in SEAS:
        for route in size.few:
            yield ("sea", sea, route), partial(at_sea, sea, route, size.varied)
    for case in CASES:
        for interval in INTERVALS:
            for route in size.routes:
                yield ("case", case.name, interval, route), partial(seven, case, route, interval, size.runs)
    for route in size.routes:
        yield ("clock", route), partial(clock_cost, route, 5.0, 3, size.varied, SEED)
    for case in BASELINED:
        for interval in INTERVALS:
            for route in size.routes:
                plain_filter = partial(paired.plain_filter, case, route, interval, runs=size.runs, seed=SEED)
                yield ("ekf", case.name, interval, route), plain_filter
    for route in size.few:
        varied = partial(compare, route=route, interval=5.0, runs=size.varied)
        for wrong in WRONG:
            yield ("wrong", wrong.name, route), partial(varied, wrong)
        for sigma in SIGMAS:
            for factor in (0.5, 2.0):
                yield ("sigma", sigma, factor, route), partial(varied, plain, settings=_scaled(sigma, factor))
        for offset in OFFSETS_M:
            yield ("offset", offset, route), partial(varied, plain, middle_offset=offset)
    for route in ON_AXIS:
        for weave in (False, True):
            yield ("weave", weave, route), partial(compare, two, route, 1.0, runs=size.runs, weave=weave)
