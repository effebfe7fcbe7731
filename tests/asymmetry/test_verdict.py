"""Verdicts on remedies: what is met, what is missed, and what a few captured runs leave open."""

import numpy as np
import pytest

from experiments.asymmetry.verdict import FALSE_ALARM, Verdict, counts, verdict

RUNS = 60


def test_a_remedy_is_judged_by_the_mean_of_its_rest() -> None:
    excess = np.linspace(0.1, 0.3, RUNS)
    assert verdict(excess, 0.0999 * excess, 0.9) is Verdict.MET
    assert verdict(excess, -0.5 * excess, 0.9) is Verdict.MET
    assert verdict(excess, 0.1001 * excess, 0.9) is Verdict.MISSED
    assert verdict(excess, 0.05 * excess, 0.99) is Verdict.MISSED


def test_one_captured_run_leaves_a_mission_open() -> None:
    excess, left = np.full(RUNS, 0.1), np.zeros(RUNS)
    left[17] = 5.0
    assert left.mean() > 0.1 * excess.mean()
    assert verdict(excess, left, 0.9) is Verdict.OPEN
    # as many runs more cannot be chance
    left[:20] = 5.0
    assert verdict(excess, left, 0.9) is Verdict.MISSED
    assert verdict(excess[:1], left[:1], 0.9) is Verdict.OPEN


@pytest.mark.parametrize("missions", [1, 5])
def test_false_alarms_are_as_rare_as_said(missions: int) -> None:
    # at the very edge of the aim, of normal rests, one in 100 groups of missions holds a miss
    rng, groups = np.random.default_rng(8), 6000
    excess = np.ones(RUNS)
    missed = [
        any(
            verdict(excess, 0.1 + 0.3 * rng.normal(size=RUNS), 0.9, missions) is Verdict.MISSED
            for _ in range(missions)
        )
        for _ in range(groups // missions)
    ]  # fmt: skip
    spread = np.sqrt(FALSE_ALARM / len(missed))
    assert np.mean(missed) == pytest.approx(FALSE_ALARM, abs=4 * spread)


def test_verdicts_are_counted() -> None:
    assert counts([Verdict.MISSED, Verdict.MET, Verdict.OPEN, Verdict.MET]) == (2, 1, 1)
