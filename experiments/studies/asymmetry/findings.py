"""What the pitch study found, number by number: its record, `results.json`."""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from experiments.campaign.store import Record
from experiments.findings import Finding, Findings, of, plain, record
from experiments.intervals import CONFIDENCE, proportion
from experiments.studies.asymmetry.comparison import (
    OF_RUNS,
    QUESTIONS,
    Missions,
    Verdict,
    mean_error,
    paired,
    removed_in_all,
    select,
)
from experiments.studies.asymmetry.design import ARMS, BROADCASTS, CAUSES, LEVEL, REAL, REMEDIES, Arm, Plan
from experiments.studies.asymmetry.paper import Curve, equivalents

MODULES = tuple(f"experiments.studies.asymmetry.{name}" for name in ("findings", "missions", "paper"))
SETTLING_RUNS = 100_000
"""Open questions are distinguished by whether this number of runs would settle them."""
STAGE_4_TAU_M = (0.03, 0.06)


def _errors(missions: Missions, plan: Plan) -> dict[str, Finding]:
    """Mean error over the routes at the largest depth offset, behind the level and the real leader, by condition."""
    found, offset = {}, plan.offsets_m[-1]
    for condition, variant in product(dict.fromkeys(m.real["condition"] for m in missions), plan.variants):
        chosen = select(missions, condition=condition, depth_offset_m=offset, variant=variant)
        for arm in (LEVEL, REAL) if chosen else ():
            name = f"error {condition} {offset:g} {variant} {arm.key}"
            found[name] = of(mean_error(chosen, arm), "mean E_P over the routes, 95 % over runs", "m")
    return found


def _on_routes(missions: Missions, plan: Plan, cause: str) -> dict[str, Finding]:
    """The least and the largest share that attitude broadcasts remove on any route, with limits for all together."""
    found = {}
    together = 1.0 - (1.0 - CONFIDENCE) / (len(plan.routes) * len(CAUSES))
    by_route = [select(missions, variant="laisn-2", cause=cause, route=route) for route in plan.routes]
    for arm in BROADCASTS:
        flown = [chosen for chosen in by_route if chosen and arm.key in chosen[0].arms]
        shares = [removed_in_all(chosen, arm, confidence=together) for chosen in flown]
        for name, share in (("least", min(shares)), ("largest", max(shares))) if shares else ():
            what = f"{name} share removed of what pitch adds on a route, limits that hold for all routes and causes"
            found[f"{name} {arm.key} {cause}"] = of(share, what)
    return found


def _verdicts(chosen: Missions, arm: Arm, name: str, looks: Sequence[int]) -> dict[str, Finding]:
    """Number of missions on which a remedy comes to each verdict, and of those that stay open for long."""
    found = {}
    for question in QUESTIONS:
        given = [m.arms[arm.key][f"{question}_verdict"] for m in chosen]
        for verdict in (Verdict.MET, Verdict.OPEN, Verdict.MISSED):
            what = f"missions, of {len(given)} judged, with this verdict on {question}s"
            found[f"{question} {verdict} {name}"] = plain(given.count(verdict), what)
        undecided = [m for m, verdict in zip(chosen, given, strict=True) if verdict == Verdict.OPEN]
        beyond = sum(m.judge(question, arm, looks).needed > SETTLING_RUNS for m in undecided)
        what = f"of the open ones, missions that would take more than {SETTLING_RUNS:,} runs to settle"
        found[f"{question} beyond {name}"] = plain(beyond, what)
        harmed = len(given) - given.count(Verdict.NO_HARM)
        found[f"{question} harmed {name}"] = plain(harmed, f"missions, of {len(given)} judged, on which harm is shown")
    return found


def _remedies(missions: Missions, plan: Plan, variant: str, cause: str | None) -> dict[str, Finding]:
    """What each arm does on the missions of a variant, of one cause or of all."""
    group = f"{variant} {cause or 'all'}"
    everywhere = select(missions, variant=variant, cause=cause)
    chosen = select(everywhere, judged=True)
    found = {f"judged {group}": plain(len(chosen), "missions on which remedies are judged")}
    for arm in (a for a in ARMS if everywhere and a.key in everywhere[0].arms):
        rows, name = [m.arms[arm.key] for m in everywhere], f"{arm.key} {group}"
        locked = proportion(sum(row["mirror_locked_runs"] for row in rows), sum(row["runs"] for row in rows))
        found[f"mirror-locked {name}"] = of(locked, "probability of a mirror lock, missions of any kind")
        if arm in REMEDIES and chosen:
            what = "share removed of what pitch adds to errors, judged missions, 95 %"
            found[f"removed {name}"] = of(removed_in_all(chosen, arm), what)
            what = "share removed of the mirror locks that pitch adds, 95 %"
            found[f"mirror-locks-removed {name}"] = of(removed_in_all(everywhere, arm, "mirror_lock"), what)
            found |= _verdicts(chosen, arm, name, plan.looks)
    return found


def _stage_4(curves: Sequence[Curve], offsets: Sequence[float]) -> dict[str, Finding]:
    """Pitch that raises the mean error as the paper's τ does, over the routes."""
    found = {}
    for tau, offset in product(STAGE_4_TAU_M, offsets):
        pitch = [v.value for v in equivalents(curves, tau, offset).values() if not math.isnan(v.value)]
        if pitch:
            value, low, high = (round(float(f(pitch)), 2) for f in (np.median, min, max))
            what = "pitch that does what τ_rear does: median, least and largest of the routes"
            found[f"stage-4 {tau:g} {offset:g}"] = Finding(value=value, low=low, high=high, unit="°", what=what)
    return found


def findings_of(plan: Plan, rows: Sequence[Record], curves: Sequence[Curve], command: str) -> Findings:
    """The record of a study: all that documents may quote."""
    missions = paired(rows)
    found = {
        "missions": plain(len({(r["condition"], r["route"], r["depth_offset_m"]) for r in rows}), "missions flown"),
        "cells": plain(len(rows), "missions, arms and variants"),
        "first-runs": plain(plan.runs, "runs of every cell"),
        "most-runs": plain(plan.looks[-1], "runs of cells whose verdict was open"),
        "runs": plain(sum(len(r[OF_RUNS["error"]]) for r in rows), "runs flown"),
    }
    found |= _errors(missions, plan)
    for cause in CAUSES:
        found |= _on_routes(missions, plan, cause)
    for variant, cause_or_all in product(plan.variants, (*CAUSES, None)):
        found |= _remedies(missions, plan, variant, cause_or_all)
    found |= _stage_4(curves, [o for o in plan.offsets_m if o > 0])
    return record("asymmetry", command, MODULES, found)
