"""The record of the reproduction: ratios to the published figures, claims and mirror locks."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.campaign.store import Record
from experiments.findings import Finding, Findings, of, plain, record
from experiments.intervals import proportion
from experiments.studies.reproduction.claims import Claim, Judgement, Verdict
from experiments.studies.reproduction.replications import VERDICT_CONFIDENCE
from experiments.studies.reproduction.settings import Key, Motion, Setting
from laisn.arrays import Floats
from laisn.settings import Variant

MODULES = ("experiments.studies.reproduction.findings",)
VERDICTS: tuple[Verdict, ...] = ("holds", "depends", "does not hold", "undecided", "no data")


def listed(numbers: Sequence[int]) -> str:
    """Numbers as part of a sentence."""
    words = [str(number) for number in numbers]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]])) if words else "none"


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


def _of_cells(
    setting: Setting, variant: Variant, rows: Mapping[Key, Record], published: Mapping[Key, Mapping[str, float]]
) -> dict[str, Finding]:
    """Findings of the cells of one setting and variant."""
    found, name = {}, f"{setting.name} {variant}"
    mine = {mission: row for (s, mission, v), row in rows.items() if (s, v) == (setting.name, variant)}
    to_theirs = ratios(rows, published, setting, variant, "e_p_mean_m")
    if to_theirs.size:
        value, low, high = (round(float(f(to_theirs)), 4) for f in (np.median, np.min, np.max))
        what = "mean E_P, ours over the paper's: median, least and largest of the missions"
        found[f"ratio {name}"] = Finding(value=value, low=low, high=high, what=what)
    mirror_locked, flown = (sum(int(row[c]) for row in mine.values()) for c in ("mirror_locked_runs", "runs"))
    found[f"mirror-locked {name}"] = of(
        proportion(mirror_locked, flown), "probability of a mirror lock over all missions, 95 %"
    )
    for mission, row in mine.items() if setting.like else ():
        theirs = published[setting.like, mission, variant]["e_p_mean_m"]
        found[f"error {name} {mission}"] = plain(row["e_p_mean_m"], "mean E_P", "m")
        found[f"printed {name} {mission}"] = plain(theirs, "mean E_P that the paper prints", "m")
        found[f"apart {name} {mission}"] = plain(abs(row["e_p_mean_m"] - theirs), "the difference of the two", "m")
    return found


def findings_of(
    settings: Sequence[Setting], rows: Mapping[Key, Record], published: Mapping[Key, Mapping[str, float]],
    judgements: Sequence[tuple[Claim, Judgement, Judgement]], motion: Motion,
) -> Findings:  # fmt: skip
    """The record of a reproduction: all that documents may quote."""
    runs = next(iter(rows.values()))["runs"]
    found = {"cells": plain(len(rows), "cells flown"), "runs": plain(runs, "runs of each cell")}
    for i, whose in ((1, "our"), (2, "the paper's")):
        for verdict in VERDICTS:
            numbers = [judged[0].number for judged in judgements if judged[i].verdict == verdict]  # type: ignore[union-attr]
            what = f"claims of the paper, judged on {whose} figures: {verdict}"
            found[f"{whose} {verdict} number"] = plain(len(numbers), what)
            found[f"{whose} {verdict}"] = plain(listed(numbers), what)
    for claim, ours, _ in judgements:
        for number, one in enumerate(ours.criteria, start=1):
            what = f"{one.what}, {one.relation} {one.bound:g}: {one.outcome}; {VERDICT_CONFIDENCE:.1%}"
            found[f"criterion {claim.number}.{number}"] = of(one.interval, what)
    for setting in settings:
        for variant in setting.variants:
            found |= _of_cells(setting, variant, rows, published)
    return record(f"reproduce-{motion}", f"laisn reproduce --motion {motion}", MODULES, found)
