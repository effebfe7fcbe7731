"""The record of the pitch study: every number comes from the rows that it names."""

import numpy as np
import pytest

from experiments.campaign.store import Record
from experiments.studies.asymmetry.findings import (
    AHRS,
    Curve,
    equivalents,
    findings_of_rows,
    paired,
    removed_in_all,
)
from tests.experiments.studies.asymmetry.test_findings_comparison import row

WOBBLE = 0.01 * np.cos(np.arange(64.0))


def rows() -> list[Record]:
    """Three missions: pitch adds 1 m on T3, 3 m on T4, of which an AHRS leaves a tenth and a fifth,
    and nothing on T3 without depth offset.
    """
    all_rows = []
    for route, real, ahrs in (("T3", 1.2, 0.3), ("T4", 3.2, 0.8)):
        labels = {"route": route, "depth_offset_m": 10.0, "condition": "trim-12N"}
        mirror_locked = np.arange(64) < (16 if route == "T4" else 0)
        verdicts = {"error_verdict": "met", "mirror_lock_verdict": "open"}
        all_rows += [
            row("level", 0.2 + WOBBLE, **labels),
            row("real", real - WOBBLE, mirror_locked, **labels),
            row(
                "ahrs-0.5",
                ahrs + WOBBLE,
                mirror_locked & (np.arange(64) < 4),
                **verdicts,
                **labels,
            ),
        ]
    # pitch moves no fix here, and yet half the runs are mirror-locked: the mission is not judged,
    # but its mirror locks count; the level leader has 96 runs in place of 64
    labels = {
        "route": "T3",
        "depth_offset_m": 0.0,
        "condition": "trim-12N",
        "pitch_fix_error_m": 0.0,
    }
    half = np.arange(64) < 32
    return [
        *all_rows,
        row("level", 0.2, flown=96, **labels),
        row("real", 0.2, half, **labels),
        row("ahrs-0.5", 0.2, half, **labels),
    ]


CURVES = [
    *(
        Curve(route=r, interval_s=5.0, depth_offset_m=None, value=(0.01, 0.03, 0.06),
              e_p_mean_m=(0.2, 0.4, e), excess_half_m=(0.0, 0.1, 0.2))
        for r, e in (("T3", 0.6), ("T4", 1.0), ("T5", 0.7))
    ),
    *(
        Curve(route=r, interval_s=5.0, depth_offset_m=10.0, value=(0.0, -5.0, -10.0),
              e_p_mean_m=(0.2, 0.7, 1.2), excess_half_m=(0.0, 0.1, 0.1)) for r in ("T3", "T4", "T5")
    ),
]  # fmt: skip


def test_the_record_is_that_of_the_rows() -> None:
    actual = findings_of_rows(rows(), CURVES)
    assert (actual["missions"].value, actual["cells"].value, actual["runs"].value) == (
        3,
        9,
        9 * 64 + 32,
    )
    assert (actual["first-runs"].value, actual["most-runs"].value) == (64, 5120)
    assert actual["error trim-12N 10 laisn-2 level"].value == pytest.approx(0.2, abs=1e-3)
    assert actual["error trim-12N 10 laisn-2 real"].value == pytest.approx(2.2, abs=1e-3)
    for group in ("trim", "all"):
        removed = actual[f"removed ahrs-0.5 laisn-2 {group}"]
        assert removed.value == pytest.approx(1 - 0.7 / 4.0, abs=1e-3)
        assert removed.low < removed.value < removed.high  # type: ignore[operator]
        assert actual[f"mirror-locked real laisn-2 {group}"].value == pytest.approx(48 / 192)
        assert actual[f"mirror-locks-removed ahrs-0.5 laisn-2 {group}"].value == pytest.approx(
            1 - 36 / 48  # 4 locks on T4 and 32 without depth offset, of 16 and 32
        )
        assert actual[f"judged laisn-2 {group}"].value == 2
        counts = [
            actual[f"error {verdict} ahrs-0.5 laisn-2 {group}"].value
            for verdict in ("met", "open", "missed", "harmed")
        ]
        assert counts == [2, 0, 0, 2]
        assert actual[f"mirror_lock open ahrs-0.5 laisn-2 {group}"].value == 2
    # on T4 the AHRS removes 2.4 of 3 m, on T3 0.9 of 1 m
    assert actual["least ahrs-0.5 trim"].value == pytest.approx(0.8, abs=1e-3)
    assert actual["largest ahrs-0.5 trim"].value == pytest.approx(0.9, abs=1e-3)
    # limits that hold for two routes and three causes at once leave a sixth of the chance to each
    # (Bonferroni)
    on_t4 = [mission for mission in paired(rows()) if mission.real["route"] == "T4"]
    removed_on_t4 = removed_in_all(on_t4, AHRS, confidence=1.0 - 0.05 / 6)
    assert (actual["least ahrs-0.5 trim"].low, actual["least ahrs-0.5 trim"].high) == pytest.approx(
        removed_on_t4[1:], rel=1e-5
    )
    stage = actual["stage-4 0.06 10"]
    assert (stage.value, stage.low, stage.high) == (5.0, 4.0, 8.0)


def test_the_pitch_that_adds_as_much_as_a_tau_is_read_off_the_curves() -> None:
    # τ = 0.03 m adds 0.2 ± 0.1 m, and pitch 0.1 m a degree
    assert equivalents(CURVES, 0.03, 10.0) == {
        route: pytest.approx((2.0, 1.0, 3.0)) for route in ("T3", "T4", "T5")
    }
    assert [pitch.value for pitch in equivalents(CURVES, 0.06, 10.0).values()] == pytest.approx(
        [4.0, 8.0, 5.0]
    )
    assert equivalents(CURVES, 0.06, 5.0) == {}
