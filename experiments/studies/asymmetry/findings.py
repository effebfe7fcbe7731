"""What the pitch study found: its record, `results.json`, and the further numbers of its page, all by name."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from experiments.findings import Finding, Findings, of, plain, record
from experiments.intervals import CONFIDENCE, Interval, mean_over_missions, proportion
from experiments.studies.asymmetry.comparison import (
    QUESTIONS,
    Missions,
    Row,
    Verdict,
    added,
    mean_added,
    paired,
    removed_in_all,
    select,
)
from experiments.studies.asymmetry.conditions import ARMS, BROADCASTS, CAUSES, LEVEL, REAL, REMEDIES, Arm, Plan
from experiments.studies.asymmetry.fix_map import deepest_offset
from experiments.studies.asymmetry.paper import Curve, GateRow, curves_of, equivalent, equivalents

MODULES = tuple(f"experiments.studies.asymmetry.{name}" for name in ("findings", "missions", "paper"))
SETTLING_RUNS = 100_000
"""Open questions are distinguished by whether so many runs would settle them."""


def _errors(missions: Missions, plan: Plan, offset: float) -> dict[str, Finding]:
    """Mean error of each condition over the routes at a depth offset, behind the level and the real leader."""
    found = {}
    for condition in dict.fromkeys(m.real.condition for m in missions):
        for variant in plan.variants:
            chosen = select(missions, condition=condition, depth_offset_m=offset, variant=variant)
            for arm in (LEVEL, REAL) if chosen else ():
                mean = mean_over_missions([m.first_runs(arm) for m in chosen])
                name = f"error {condition} {offset:g} {variant} {arm.key}"
                found[name] = of(mean, "mean E_P over the routes, 95 % over runs", "m")
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
        given = [getattr(m.arms[arm.key], f"{question}_verdict") for m in chosen]
        for verdict in (Verdict.MET, Verdict.OPEN, Verdict.MISSED):
            what = f"missions, of {len(given)} judged, with this verdict on {question}s"
            found[f"{question} {verdict.value} {name}"] = plain(given.count(verdict.value), what)
        undecided = [m for m, verdict in zip(chosen, given, strict=True) if verdict == Verdict.OPEN.value]
        beyond = sum(m.judge(question, arm, looks).needed > SETTLING_RUNS for m in undecided)
        what = f"of the open ones, missions that would take more than {SETTLING_RUNS:,} runs to settle"
        found[f"{question} beyond {name}"] = plain(beyond, what)
        harmed = sum(v != Verdict.NO_HARM.value for v in given)
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
        locked = proportion(sum(row.mirror_locked for row in rows), sum(row.runs for row in rows))
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
    for tau in (0.03, 0.06):
        for offset in offsets:
            pitch = [v.value for v in equivalents(curves, tau, offset).values() if not np.isnan(v.value)]
            if pitch:
                found[f"stage-4 {tau:g} {offset:g}"] = Finding(
                    value=round(float(np.median(pitch)), 2), low=round(min(pitch), 2), high=round(max(pitch), 2),
                    unit="°", what="pitch that does what τ_rear does: median, least and largest of the routes",
                )  # fmt: skip
    return found


def findings_of(plan: Plan, rows: Sequence[Row], curves: Sequence[Curve], command: str) -> Findings:
    """The record of a study: all that documents may quote."""
    missions = paired(rows)
    found = {
        "missions": plain(len({(r.condition, r.route, r.depth_offset_m) for r in rows}), "missions flown"),
        "cells": plain(len(rows), "missions, arms and variants"),
        "first-runs": plain(plan.runs, "runs of every cell"),
        "most-runs": plain(plan.looks[-1], "runs of cells whose verdict was open"),
        "runs": plain(sum(len(r.e_p_run_mean_m) for r in rows), "runs flown"),
    }
    found |= _errors(missions, plan, plan.offsets_m[-1])
    for cause in CAUSES:
        found |= _on_routes(missions, plan, cause)
    for variant in plan.variants:
        for cause_or_all in (*CAUSES, None):
            found |= _remedies(missions, plan, variant, cause_or_all)
    found |= _stage_4(curves, [o for o in plan.offsets_m if o > 0])
    return record("asymmetry", command, MODULES, found)


PITCH_DEG = (1.0, 2.0, 5.0, 10.0, 15.0)
OFF_AXIS_DEG = (90.0, 60.0, 45.0, 30.0, 20.0)
"""Of the planner's table: angle between the leader's axis and the direction to the follower, 90 abeam."""
REACHES_M, BOUNDS_M = (40.0, 100.0), (0.5, 1.0)
"""Of the planner's table: greatest range, and largest error that pitch may add to a fix."""


def _of_conditions(missions: Missions, curves: Sequence[Curve], plan: Plan) -> dict[str, Finding]:
    """What pitch does in each condition and at each depth offset, over the routes."""
    found: dict[str, Finding] = {}
    for offset, condition in product(plan.offsets_m, dict.fromkeys(m.real.condition for m in missions)):
        where, here = f"{condition} {offset:g}", select(missions, condition=condition, depth_offset_m=offset)
        for variant in plan.variants:
            found[f"added {where} {variant}"] = of(mean_added(select(here, variant=variant), REAL), "", "m")
        two = select(here, variant="laisn-2")
        worst, runs = max(two, key=lambda m: m.added), sum(m.real.runs for m in two)
        locks = mean_over_missions(added(two, REAL, question="mirror_lock"))
        taus = [equivalent(m.added, curve) for m in two for curve in curves_of(curves, 1.0, m.real.route)]
        known = [tau for tau in taus if not np.isnan(tau)]
        found |= {
            f"pitch-rms {where}": plain(worst.real.pitch_rms_deg, "", "°"),
            f"pitch-max {where}": plain(worst.real.pitch_max_deg, "", "°"),
            f"locks {where}": of(Interval(*(runs * share for share in locks)), "runs that pitch adds"),
            f"tau {where}": plain(float(np.mean(known)) if known else float("nan"), "mean over routes", "m"),
            f"worst {where}": of(mean_added([worst], REAL), "", "m"),
            f"worst-route {where}": plain(worst.real.route, "route to which pitch adds most"),
        }
        found |= _errors(here, plan, offset)
    return found


def details_of(missions: Missions, curves: Sequence[Curve], gates: Sequence[GateRow], plan: Plan) -> dict[str, Finding]:
    """All numbers of the page's tables that are not in the record."""
    found = _of_conditions(missions, curves, plan)
    for cause, route in product(CAUSES, plan.routes):
        here = select(missions, variant="laisn-2", cause=cause, route=route)
        found[f"added {route} {cause}"] = of(mean_added(here, REAL), "", "m")
        for arm in BROADCASTS:
            found[f"removed {arm.key} {route} {cause}"] = of(removed_in_all(here, arm), "")
    for tau in (0.03, 0.06):
        for curve in curves_of(curves, 5.0):
            found[f"excess {tau:g} {curve.route}"] = of(curve.excess_at(tau), "", "m")
        for offset in plan.offsets_m:
            for route, pitch in equivalents(curves, tau, offset).items():
                found[f"equivalent {tau:g} {offset:g} {route}"] = of(pitch, "", "°")
    for gate in gates:
        for name in ("detected", "false_alarms", "e_p_mean_m", "e_p_mean_without_echoes_m"):
            found[f"{name} {gate.route} {gate.interval_s:g} {gate.rule}"] = of(getattr(gate, name), "")
    for reach, bound, pitch_deg, off_axis in product(REACHES_M, BOUNDS_M, PITCH_DEG, OFF_AXIS_DEG):
        deepest = deepest_offset(np.deg2rad(pitch_deg), np.deg2rad(off_axis), reach, bound)
        found[f"deepest {reach:g} {bound:g} {pitch_deg:g} {off_axis:g}"] = plain(deepest, "", "m")
    return found
