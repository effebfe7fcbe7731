"""What the reproduction of the paper consists of: cells, flights, figures, and the record of all that came out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.campaign import campaign
from experiments.campaign.plans import CellPlan
from experiments.campaign.store import Record, Steps, Store
from experiments.flight.library import ROUTES
from experiments.reproduction import stages
from experiments.reproduction.claims import Claim
from experiments.reproduction.stages import Key, Motion, Setting
from experiments.reproduction.verdict import Judgement
from laisn.arrays import Floats
from laisn.settings import Variant
from sim.scenario.settings import Follower
from sim.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class ErrorFigure:
    """A figure of the paper: errors over time on some missions."""

    number: int
    setting: str
    variant: Variant
    missions: tuple[str, ...]


FIGURES = (
    ErrorFigure(number=3, setting="base", variant="laisn-2", missions=("T2", "T5", "T6", "T7", "T8", "T9")),
    ErrorFigure(number=4, setting="5s", variant="laisn-2", missions=("T2", "T5", "T6", "T7", "T8", "T9")),
    ErrorFigure(number=5, setting="10s", variant="laisn-2", missions=("T5", "T6")),
    ErrorFigure(number=6, setting="10s-slow", variant="laisn-2", missions=("T2", "T3", "T4", "T5")),
    ErrorFigure(number=7, setting="asymmetric", variant="laisn-2", missions=("T2", "T5")),
    ErrorFigure(number=8, setting="asymmetric", variant="laisn-3-2", missions=("T2", "T5")),
    ErrorFigure(number=9, setting="heading5", variant="laisn-3-2", missions=("T3", "T4")),
)
"""Figures 3 to 9. The text names only some of their missions; the others are chosen like those."""


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """Everything that came out."""

    motion: Motion
    runs: int
    seed: int
    settings: tuple[Setting, ...]
    plans: Mapping[Key, CellPlan]
    rows: Mapping[Key, Record]
    steps: Mapping[Key, Steps]
    published: Mapping[Key, dict[str, float]]
    judgements: Sequence[tuple[Claim, Judgement, Judgement]]
    """Each claim with its judgement on our figures and on the published ones."""
    folder: Path


def followers_of_the_paper() -> dict[str, Follower]:
    """The eight missions by name."""
    return {route: Follower(route=route) for route in ROUTES}


def _kept(key: Key) -> bool:
    setting, mission, variant = key
    if (setting, variant) == ("base", "laisn-2"):
        return True
    return any((f.setting, f.variant) == (setting, variant) and mission in f.missions for f in FIGURES)


def plan_cells(
    settings: Sequence[Setting], followers: Mapping[str, Follower], *, motion: Motion, runs: int, seed: int
) -> dict[Key, CellPlan]:  # fmt: skip
    """The cells of some settings on some missions."""
    return {
        (setting.name, name, variant): CellPlan(
            scenario=stages.scenario(setting, follower, name, variant=variant, motion=motion, seed=seed),
            runs=runs,
            keep_steps=_kept((setting.name, name, variant)),
        )
        for setting in settings
        for name, follower in followers.items()
        for variant in setting.variants
    }


def fly_once(plans: Mapping[Key, CellPlan], store: Store) -> dict[str, Trajectory]:
    """The flight of each mission by its name."""
    first: dict[str, CellPlan] = {}
    for (_, name, _), plan in plans.items():
        first.setdefault(name, plan)
    return {name: campaign.mission(plan.scenario, store) for name, plan in first.items()}


def ratios(
    rows: Mapping[Key, Record], published: Mapping[Key, Mapping[str, float]], setting: Setting, variant: Variant,
    metric: str,
) -> Floats:  # fmt: skip
    """Our figure over the published one on each mission that has both; an alternative is held against its like."""
    printed = setting.like or setting.name
    return np.array(
        [
            row[metric] / published[printed, mission, flown][metric]
            for (name, mission, flown), row in rows.items()
            if (name, flown) == (setting.name, variant) and (printed, mission, flown) in published
        ]
    )
