"""What the reproduction found, for `results.json`: ratios to the published figures, claims, captures."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from experiments.campaign.store import Record
from experiments.findings import Finding, Findings, of, plain, record
from experiments.intervals import proportion
from experiments.reproduction.claims import Claim
from experiments.reproduction.record import ratios
from experiments.reproduction.replications import VERDICT_CONFIDENCE
from experiments.reproduction.stages import Key, Motion, Setting
from experiments.reproduction.verdict import Judgement, Verdict

MODULES = ("experiments.reproduction.findings",)
VERDICTS: tuple[Verdict, ...] = ("holds", "depends", "does not hold", "undecided", "no data")


def listed(numbers: Sequence[int]) -> str:
    """Numbers as part of a sentence."""
    words = [str(number) for number in numbers]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]])) if words else "none"


def _judged(judgements: Iterable[tuple[int, Judgement]], whose: str) -> dict[str, Finding]:
    """How many claims, and which, come to each verdict."""
    by_verdict = {verdict: [n for n, j in judgements if j.verdict == verdict] for verdict in VERDICTS}
    return {
        f"{whose} {verdict}{suffix}": plain(value, f"claims of the paper, judged on {whose} figures: {verdict}")
        for verdict, numbers in by_verdict.items()
        for suffix, value in ((" number", len(numbers)), ("", listed(numbers)))
    }


def findings_of(
    settings: Sequence[Setting], rows: Mapping[Key, Record], published: Mapping[Key, Mapping[str, float]],
    judgements: Sequence[tuple[Claim, Judgement, Judgement]], motion: Motion,
) -> Findings:  # fmt: skip
    """The record of a reproduction: all that documents may quote."""
    runs = next(iter(rows.values()))["runs"]
    found: dict[str, Finding] = {
        "cells": plain(len(rows), "cells flown"),
        "runs": plain(runs, "runs of each cell"),
    }
    found |= _judged([(claim.number, ours) for claim, ours, _ in judgements], "our")
    for claim, ours, _ in judgements:
        for number, one in enumerate(ours.criteria, start=1):
            what = f"{one.what}, {one.relation} {one.bound:g}: {one.outcome}; {VERDICT_CONFIDENCE:.1%}"
            found[f"criterion {claim.number}.{number}"] = of(one.interval, what)
    found |= _judged([(claim.number, theirs) for claim, _, theirs in judgements], "the paper's")
    for setting in settings:
        for variant in setting.variants:
            name = f"{setting.name} {variant}"
            mine = {mission: row for (s, mission, v), row in rows.items() if (s, v) == (setting.name, variant)}
            to_theirs = ratios(rows, published, setting, variant, "e_p_mean_m")
            if to_theirs.size:
                found[f"ratio {name}"] = Finding(
                    value=round(float(np.median(to_theirs)), 4), low=round(float(to_theirs.min()), 4),
                    high=round(float(to_theirs.max()), 4),
                    what="mean E_P, ours over the paper's: median, least and largest of the missions",
                )  # fmt: skip
            captured, flown = (sum(int(row[c]) for row in mine.values()) for c in ("captured_runs", "runs"))
            found[f"captured {name}"] = of(proportion(captured, flown), "chance of capture over all missions, 95 %")
            if setting.like:
                for mission, row in mine.items():
                    theirs = published[setting.like, mission, variant]["e_p_mean_m"]
                    found[f"error {name} {mission}"] = plain(row["e_p_mean_m"], "mean E_P", "m")
                    found[f"printed {name} {mission}"] = plain(theirs, "mean E_P that the paper prints", "m")
                    apart = abs(row["e_p_mean_m"] - theirs)
                    found[f"apart {name} {mission}"] = plain(apart, "the difference of the two", "m")
    return record(f"reproduce-{motion}", f"laisn reproduce --motion {motion}", MODULES, found)
