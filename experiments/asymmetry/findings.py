"""What the pitch study found, for `results.json`: errors, what remedies remove of them, captures, verdicts, Stage 4."""

from collections.abc import Sequence

import numpy as np

from experiments.asymmetry.added_error import (
    QUESTIONS,
    SETTLING_RUNS,
    ComparedMission,
    Mission,
    captures_in_all,
    captures_removed,
    judged,
    of_cause,
    open_questions,
    paired,
    removed_in_all,
)
from experiments.asymmetry.missions import Plan, Row
from experiments.asymmetry.remedies import ARM, ARMS, EXACT, LEVEL, READINGS, REAL, REMEDIES, STEADIED
from experiments.asymmetry.tau import Curves, equivalents
from experiments.asymmetry.verdict import Verdict
from experiments.findings import Finding, Findings, of, plain, record
from experiments.intervals import CONFIDENCE, mean_over_missions

MODULES = tuple(f"experiments.asymmetry.{name}" for name in ("findings", "flying", "tau"))
CAUSES = ("trim", "dive", "waves")


def _errors(missions: dict[Mission, ComparedMission], variants: Sequence[str], offset: float) -> dict[str, Finding]:
    """Mean error of each condition over the routes at a depth offset, behind the level and the real leader."""
    found = {}
    for condition in dict.fromkeys(key[0] for key in missions):
        for variant in variants:
            chosen = [e for (c, _, o, v), e in missions.items() if (c, o, v) == (condition, offset, variant)]
            for arm in (LEVEL, REAL):
                if chosen:
                    mean = mean_over_missions([e.errors(arm) for e in chosen])
                    name = f"error {condition} {offset:g} {variant} {arm.key}"
                    found[name] = of(mean, "mean E_P over the routes, 95 % over runs", "m")
    return found


def _on_routes(missions: dict[Mission, ComparedMission], routes: Sequence[str], cause: str) -> dict[str, Finding]:
    """The least and the largest share that attitude broadcasts remove on any route, with limits for all together."""
    found = {}
    together = 1.0 - (1.0 - CONFIDENCE) / (len(routes) * len(CAUSES))
    for arm in (EXACT, STEADIED, READINGS):
        shares = []
        for route in routes:
            chosen = of_cause(missions, "laisn-2", cause, route)
            if chosen and arm.key in chosen[0].arms:
                shares.append(removed_in_all(chosen, arm, together))
        if shares:
            for name, chosen_share in (("least", min(shares)), ("largest", max(shares))):
                what = f"{name} share removed of what pitch adds on a route, limits that hold for all routes and causes"
                found[f"{name} {arm.key} {cause}"] = of(chosen_share, what)
    return found


def _verdicts(chosen: Sequence[ComparedMission], arm: str, name: str, looks: Sequence[int]) -> dict[str, Finding]:
    """Number of missions on which a remedy comes to each verdict, and of those that stay open for long."""
    found = {}
    for question in QUESTIONS:
        given = [getattr(e.arms[arm], f"{question}_verdict") for e in chosen]
        for verdict in (Verdict.MET, Verdict.OPEN, Verdict.MISSED):
            what = f"missions, of {len(given)} judged, with this verdict on {question}s"
            found[f"{question} {verdict.value} {name}"] = plain(given.count(verdict.value), what)
        needed = [runs for _, runs in open_questions(chosen, ARM[arm], looks, question)]
        beyond = sum(runs > SETTLING_RUNS[-1] for runs in needed)
        what = f"of the open ones, missions that would take more than {SETTLING_RUNS[-1]:,} runs to settle"
        found[f"{question} beyond {name}"] = plain(beyond, what)
        harmed = sum(v != Verdict.NO_HARM.value for v in given)
        found[f"{question} harmed {name}"] = plain(harmed, f"missions, of {len(given)} judged, on which harm is shown")
    return found


def _remedies(missions: dict[Mission, ComparedMission], plan: Plan) -> dict[str, Finding]:
    found: dict[str, Finding] = {}
    for variant in plan.variants:
        for cause in (*CAUSES, None):
            group = f"{variant} {cause or 'all'}"
            everywhere, chosen = of_cause(missions, variant, cause), judged(missions, variant, cause)
            found[f"judged {group}"] = plain(len(chosen), "missions on which remedies are judged")
            for arm in (a for a in ARMS if everywhere and a.key in everywhere[0].arms):
                name = f"{arm.key} {group}"
                found[f"captured {name}"] = of(
                    captures_in_all(everywhere, arm), "chance of capture, missions of any kind"
                )
                if arm in REMEDIES and chosen:
                    found[f"removed {name}"] = of(
                        removed_in_all(chosen, arm), "share removed of what pitch adds to errors, judged missions, 95 %"
                    )
                    found[f"captures-removed {name}"] = of(
                        captures_removed(everywhere, arm), "share removed of the captures that pitch adds, 95 %"
                    )
                    found |= _verdicts(chosen, arm.key, name, plan.looks)
    return found


def _stage_4(curves: Curves, offsets: Sequence[float]) -> dict[str, Finding]:
    """Pitch that does what the paper's τ does, over the routes."""
    found = {}
    for tau in (0.03, 0.06):
        for offset in offsets:
            pitch = [v for v in equivalents(curves, tau, offset) if not np.isnan(v)]
            if pitch:
                found[f"stage-4 {tau:g} {offset:g}"] = Finding(
                    value=round(float(np.median(pitch)), 2), low=round(min(pitch), 2), high=round(max(pitch), 2),
                    unit="°", what="pitch that does what τ_rear does: median, least and largest of the routes",
                )  # fmt: skip
    return found


def findings_of(plan: Plan, rows: Sequence[Row], curves: Curves, command: str) -> Findings:
    """The record of a study: all that documents may quote."""
    missions = paired(rows)
    found = {
        "missions": plain(len({(r.condition, r.route, r.depth_offset_m) for r in rows}), "missions flown"),
        "cells": plain(len(rows), "missions, arms and variants"),
        "first-runs": plain(plan.runs, "runs of every cell"),
        "most-runs": plain(plan.looks[-1], "runs of cells whose verdict was open"),
        "runs": plain(sum(len(r.e_p_run_mean_m) for r in rows), "runs flown"),
    }
    found |= _errors(missions, plan.variants, plan.offsets_m[-1])
    for cause in CAUSES:
        found |= _on_routes(missions, plan.routes, cause)
    found |= _remedies(missions, plan)
    found |= _stage_4(curves, [o for o in plan.offsets_m if o > 0])
    return record("asymmetry", command, MODULES, found)
