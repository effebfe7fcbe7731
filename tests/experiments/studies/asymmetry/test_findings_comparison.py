"""What pitch adds to errors and mirror locks, and what remedies take away: arithmetic on rows
made by hand.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.campaign.store import Record
from experiments.studies.asymmetry.findings import (
    AHRS,
    CONSTANT,
    EXACT,
    LEVEL_BROADCAST,
    QUESTIONS,
    READINGS,
    REAL,
    ComparedMission,
    Question,
    RemedyVerdict,
    added,
    further_runs,
    mean_added,
    paired,
    removed_in_all,
    rows_of,
    select,
    undecided,
    with_verdicts,
)
from experiments.studies.asymmetry.fix_map import closed_form_error
from experiments.study.measure import facts_of
from laisn.geometry import pitch_fix_error
from sim.scenario.parts import MotionSettings
from sim.trajectory import tilted
from tests.synthetic import make_scenario, make_trajectory

LOOKS = (64, 384)


def row(arm: str, errors: Any, mirror_locked: Any = False, **changes: Any) -> Record:
    """A row whose runs have these errors and mirror locks."""
    runs = changes.pop("flown", 64)
    each = np.broadcast_to(np.asarray(errors, dtype=float), runs)
    lost = np.broadcast_to(np.asarray(mirror_locked, dtype=bool), runs)
    return (
        {
            "condition": "c",
            "cause": "trim",
            "route": "T3",
            "depth_offset_m": 5.0,
            "variant": "laisn-2",
            "runs": 64,
            "e_p_mean_m": float(each[:64].mean()),
            "mirror_locked_runs": int(lost[:64].sum()),
            "leader_pitch_rms_deg": 5.0,
            "leader_pitch_max_deg": 6.0,
            "depth_offset_rms_m": 5.0,
            "pitch_fix_error_m": 0.4,
            "e_p_run_mean_m": each,
            "mirror_locked_run": lost,
            "error_verdict": "",
            "mirror_lock_verdict": "",
        }
        | changes
        | {"arm": arm}
    )


def mission(**errors: Any) -> ComparedMission:
    """A mission of the arms level, real and others by their keys."""
    (one,) = paired([row(key.replace("_", "-"), value) for key, value in errors.items()])
    return one


def share(mission: ComparedMission, arm: str, question: Question = "error") -> float:
    """Share that a remedy removes of what pitch adds to runs without mirror lock, or of the
    locks that it adds.
    """
    part, left, free = mission.compared(question, arm)
    counted = free | (question == "mirror_lock")
    return 1.0 - float(left[counted].sum() / part[counted].sum())


def test_share_removed_and_lever() -> None:
    (excess,) = paired([row("level", 0.2), row("real", 0.7), row("attitude-0.5", 0.25)])
    assert excess.added == pytest.approx(0.5)
    assert mean_added([excess], READINGS).value == pytest.approx(0.05)
    assert share(excess, READINGS) == pytest.approx(0.9)
    assert excess.lever == pytest.approx(5.0 * np.sin(np.deg2rad(5.0)))


def test_captured_runs_count_apart() -> None:
    last = np.arange(64) >= 48
    rows = [row("level", 0.2), row("real", np.where(last, 30.0, 0.7), last), row("ahrs-0.5", 0.25)]
    (excess,) = paired(rows)
    assert excess.added == pytest.approx(0.25 * 29.8 + 0.75 * 0.5)
    assert share(excess, AHRS) == pytest.approx(0.9)
    assert np.mean(added([excess], REAL, question="mirror_lock")) == 0.25
    assert removed_in_all([excess], AHRS, "mirror_lock").value == 1.0
    everybody = rows[1] | {"mirror_locked_run": np.full(64, True)}
    (lost,) = paired([rows[0], everybody, rows[2]])
    assert not lost.compared("error", AHRS)[2].any()


def test_sums_weigh_missions_by_what_pitch_adds() -> None:
    jitter = 0.001 * np.cos(np.arange(64.0))
    small = mission(level=0.2, real=0.3 + jitter, attitude_0=0.25)
    large = mission(level=1.0, real=10.0 + jitter, attitude_0=1.9)
    share = removed_in_all([small, large], EXACT)
    assert share.value == pytest.approx(1 - (0.05 + 0.9) / (0.1 + 9.0), rel=1e-3)
    assert share.low < share.value < share.high
    # mirror_locks: pitch adds 16 of 128 runs and the remedy keeps 4 of them
    lost = [
        paired(
            [
                row("level", 0.2),
                row("real", 0.7, np.arange(64) < n),
                row("attitude-0", 0.2, np.arange(64) < k),
            ]
        )
        for n, k in ((16, 4), (0, 0))
    ]
    actual = removed_in_all([m for one in lost for m in one], EXACT, "mirror_lock")
    assert actual.value == pytest.approx(0.75)
    # a level leader has 8 of them too, of the 24 with pitch: pitch adds 16, and the remedy, with
    # 12, keeps 4
    counts = {"level": 8, "real": 24, "attitude-0": 12}
    both = paired([row(arm, 0.2, np.arange(64) < n) for arm, n in counts.items()])
    assert removed_in_all(both, EXACT, "mirror_lock").value == pytest.approx(0.75)


def test_missions_are_chosen_by_the_closed_form_and_not_by_what_came_of_them() -> None:
    def flown(route: str, moved: float, error: float, **changes: Any) -> list[Record]:
        given = {"route": route, "pitch_fix_error_m": moved} | changes
        return [row("level", 0.2, **given), row("real", error, **given)]

    missions = paired(
        flown("T2", 0.11, 0.2)
        + flown("T3", 0.09, 5.0)
        + flown("T4", 0.5, 0.1, cause="waves")
        + flown("T5", 0.5, 0.3, variant="laisn-3-2")
    )

    def routes(**expected: Any) -> list[str]:
        return [e.real["route"] for e in select(missions, **expected)]

    assert routes(variant="laisn-2", judged=True) == ["T2", "T4"]
    assert routes(variant="laisn-2", cause="waves", judged=True) == ["T4"]
    assert routes(variant="laisn-2", cause=None) == ["T2", "T3", "T4"]
    assert routes(variant="laisn-2", route="T3") == ["T3"]
    assert routes(variant="laisn-3-2", cause="trim") == ["T5"]


def test_what_is_open_is_flown_on_and_nothing_else() -> None:
    wobble = 0.05 * np.tile([1.0, -1.0], 192)
    arms = {
        "level": row("level", 0.2),
        "real": row("real", 0.7),
        "level-0.5": row("level-0.5", 0.2),
        "attitude-0": row("attitude-0", 0.2),
        "ahrs-0.5": row("ahrs-0.5", 0.245 + wobble[:64]),
        "offset-0.5": row("offset-0.5", 0.9),
    }
    (open_,) = paired(arms.values())
    assert undecided(open_, LOOKS, 64) == ["level", "real", "ahrs-0.5"]
    # what stopped at 64 runs is not taken up again by others that went on
    assert undecided(open_, LOOKS, 128) == []
    longer = arms | {
        "level": row("level", 0.2, flown=384),
        "real": row("real", 0.7, flown=384),
        "ahrs-0.5": row("ahrs-0.5", 0.235 + wobble, flown=384),
    }
    (settled,) = paired(longer.values())
    assert settled.judge("error", AHRS, LOOKS).verdict is RemedyVerdict.MET
    verdicts = {
        r["arm"]: (r["error_verdict"], r["mirror_lock_verdict"])
        for r in with_verdicts(settled, LOOKS)
    }
    none = "no harm shown"
    assert verdicts == {
        "level": ("", ""),
        "real": ("", ""),
        "level-0.5": ("", ""),
        "attitude-0": ("met", none),
        "ahrs-0.5": ("met", none),
        "offset-0.5": ("missed", none),
    }
    (unjudged,) = paired(r | {"pitch_fix_error_m": 0.0} for r in longer.values())
    assert undecided(unjudged, LOOKS, 64) == []
    assert {r["error_verdict"] for r in with_verdicts(unjudged, LOOKS)} == {""}


def test_a_sensor_is_held_against_a_level_leader_with_the_same() -> None:
    excess = mission(level=0.2, real=0.7, level_0_5=0.2, **{"attitude-0.5": 0.3, "level-0.5": 0.29})
    assert mean_added([excess], READINGS, LEVEL_BROADCAST).value == pytest.approx(0.01)
    assert excess.judge("error", READINGS, LOOKS).verdict is RemedyVerdict.MISSED
    assert excess.judge("error", READINGS, LOOKS, LEVEL_BROADCAST).verdict is RemedyVerdict.MET


def test_remedies_that_free_captured_runs_are_distinguished() -> None:
    some = np.arange(64) % 4 != 0
    rows = [
        row("level", 0.2),
        row("real", 5.0, some),
        row("ahrs-0.5", 0.2),
        row("offset-0.5", 4.0, some),
    ]
    (excess,) = paired(rows)
    assert excess.judge("mirror_lock", AHRS, LOOKS).verdict is RemedyVerdict.MET
    assert excess.judge("mirror_lock", CONSTANT, LOOKS).verdict is RemedyVerdict.MISSED


def test_open_questions_list_the_removed_part_and_the_runs_needed() -> None:
    """Of 40 mirror locks that pitch adds to 64 runs the remedy leaves 5, one more than the aim
    of 90 % allows.
    """
    where = {"pitch_fix_error_m": 0.4}
    arms = [
        row("level", 0.2, **where),
        row("real", 0.7, np.arange(64) < 40, **where),
        row("ahrs-0.5", 0.2, np.arange(64) < 5, **where),
    ]
    (one,) = paired(arms)
    (open_,) = paired(with_verdicts(one, LOOKS))
    assert [open_.arms["ahrs-0.5"][f"{question}_verdict"] for question in QUESTIONS] == [
        "met",
        "open",
    ]
    assert share(open_, AHRS, "mirror_lock") == pytest.approx(1 - 5 / 40)
    assert open_.judge("mirror_lock", AHRS, LOOKS).needed > 384


def test_rows_are_those_of_the_arms_and_open_ones_go_on() -> None:
    """Two missions, of which the second has an arm that is open after the first look."""
    rows, runs = [], []
    for point, left in enumerate((0.2, 0.245)):
        for arm, error in (("level", 0.2), ("real", 0.7), ("ahrs-0.5", left)):
            each = error + (
                0.05 * np.tile([1.0, -1.0], 32)
                if arm == "ahrs-0.5" and point
                else 0.0 * np.ones(64)
            )
            labels = {
                "point": point,
                "case": "trim-4N",
                "scenario": f"T{point + 2}",
                "offset_m": 5.0,
                "arm": f"{arm} laisn-2",
                "realization": 0,
            }
            mission = {
                "pitch_fix_error_m": 0.4,
                "leader_pitch_rms_deg": 5.0,
                "depth_offset_rms_m": 5.0,
            }
            rows.append(labels | mission | {"runs": 64, "e_p_mean_m": error, "variant": "laisn-2"})
            runs.append((labels, {"e_p_mean_m": each, "mirror_locked": np.zeros(64, dtype=bool)}))
    outcomes: Any = SimpleNamespace(rows=rows, runs=runs)
    made = rows_of(outcomes)
    assert [row["arm"] for row in made] == 2 * ["level", "real", "ahrs-0.5"]
    assert {(row["cause"], row["condition"], row["variant"]) for row in made} == {
        ("trim", "trim-4N", "laisn-2")
    }
    assert [row["route"] for row in made] == 3 * ["T2"] + 3 * ["T3"]
    expected = {(1, f"{arm} laisn-2", 0): 384 for arm in ("level", "real", "ahrs-0.5")}
    assert further_runs({"missions": outcomes}, (64, 384)) == {"missions": expected}
    assert further_runs({"missions": outcomes}, (64,)) == {}


def test_the_closed_form_stays_on_the_axis_where_circles_do_not_meet() -> None:
    assert pitch_fix_error(0.05, 5.0, 30.0, 1.0) == closed_form_error(0.05, 5.0, 30.0, 1.0)
    # 3° off the bow at 20 m, turned past the axis: the fix lies on it, 2 D sin(1.5°) off
    assert np.isnan(closed_form_error(-0.2, 10.0, 20.0, np.deg2rad(3.0)))
    assert pitch_fix_error(-0.2, 10.0, 20.0, np.deg2rad(3.0)) == pytest.approx(
        40.0 * np.sin(np.deg2rad(1.5))
    )


def test_facts_of_a_pitched_leader_are_those_of_its_motion() -> None:
    """The leader pitched by a constant angle and level otherwise, a follower that stands off:
    all is known.
    """
    pitch, scenario = np.deg2rad(-5.0), make_scenario(60.0)
    flown = tilted(make_trajectory(scenario), pitch, 0.0)
    (facts,) = facts_of(MotionSettings.of(scenario), flown)
    apart = flown.position[:, 1] - flown.position[:, 0]
    assert facts["leader_pitch_rms_deg"] == pytest.approx(5.0)
    assert facts["leader_pitch_max_deg"] == pytest.approx(5.0)
    assert facts["depth_offset_rms_m"] == pytest.approx(np.sqrt(np.mean(apart[:, 2] ** 2)))
    assert facts["range_mean_m"] == pytest.approx(np.mean(np.hypot(apart[:, 0], apart[:, 1])))
    # a fix each second; bearings from the heading by hand
    sent = np.arange(10, flown.time.size, 10)
    off = np.arctan2(apart[sent, 0], apart[sent, 1]) - flown.heading[sent, 0]
    moved = pitch_fix_error(pitch, -apart[sent, 2], np.hypot(*apart[sent, :2].T), off)
    assert facts["pitch_fix_error_m"] == pytest.approx(moved.mean(), rel=1e-9)
