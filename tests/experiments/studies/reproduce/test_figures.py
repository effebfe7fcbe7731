"""The paper's tables beside ours: which figure stands in which cell."""

from collections.abc import Mapping, Sequence
from typing import Any

import pytest

from experiments.studies.reproduce.figures import page_values
from experiments.studies.reproduce.findings import (
    METRICS,
    Claim,
    ClaimJudgement,
    Key,
    findings_of_rows,
)
from reports.findings import Findings
from reports.page import Figures, Page, TableCell, Text, page_of, ratio_tone
from tests.experiments.studies.reproduce.cells import SETTINGS, Setting
from tests.golden import require_golden

# five settings of the paper with LAISN-2 alone
BASE, GATE, SLOW, ASYMMETRIC, TEXT = (
    next(s for s in SETTINGS if s.name == name)._replace(variants=("laisn-2",))
    for name in ("base", "measured-gate", "10s", "asymmetric", "muD0.3")
)
# mean errors of two missions, here and in the paper [m]
OURS = {"T2": 3.0, "T3": 1.0}
THEIRS = {"T2": 1.0, "T3": 1.25}


def figures(mean: float, **changes: Any) -> dict[str, Any]:
    """A row whose six figures are 1, 2, 3 … times `mean`, in the paper's order."""
    return (
        {metric: (i + 1) * mean for i, metric in enumerate(METRICS)}
        | {
            "runs": 60,
            "mirror_locked_runs": 0,
            "e_p_mean_unlocked_m": None,
            "version": "v",
            "e_p_p50_m": 0.11,
            "e_p_p95_m": 0.22,
            "e_b_p95_deg": 0.33,
            "nees": 4000.0,
            "nis": 2.5,
            "fixes_gated": 7,
            "worst_run": 42,
        }
        | changes
    )


def page_with(
    settings: Sequence[Setting],
    rows: Mapping[Key, Any],
    published: Mapping[Key, Mapping[str, float]],
    judgements: Sequence[tuple[Claim, ClaimJudgement, ClaimJudgement]] = (),
) -> Page:
    """The page of these figures."""
    labels = {
        setting.name: {"stage": setting.stage, "table": setting.table, "like": setting.like}
        for setting in settings
    }
    rows = {key: row | labels[key[0]] for key, row in rows.items()}
    values = page_values(
        {setting.name: setting.title for setting in settings}, rows, published, judgements
    )
    values |= {
        "motion": "",
        "quick": False,
        "errors": [],
        "agreement": Figures(panels=[]),
        "routes": Figures(panels=[]),
    }
    actual = findings_of_rows(rows, published, judgements)
    record = Findings(study="reproduce", command="", modules=(), version="", findings=actual)
    return page_of("experiments.studies.reproduce", [], values, record)


def page_of_settings(*settings_and_rows: tuple[Setting, dict[str, dict[str, Any]]]) -> Page:
    """The page of settings, mission by mission; the paper has `THEIRS` of some."""
    flown: dict[Key, Any] = {
        (setting.name, mission, "laisn-2"): row
        for setting, rows in settings_and_rows
        for mission, row in rows.items()
    }
    published: dict[Key, dict[str, float]] = {
        (name, mission, "laisn-2"): {metric: figures(mean)[metric] for metric in METRICS}
        for name in ("base", "10s", "10s-slow", "asymmetric")
        for mission, mean in THEIRS.items()
    }
    return page_with([setting for setting, _ in settings_and_rows], flown, published)


OUR_ROWS = {mission: figures(mean) for mission, mean in OURS.items()}


def test_the_page_is_the_golden_one() -> None:
    """A row's six figures are 1, 2, … 6 times its mean, the paper's of a mission all 1, 2, … 6
    times 1 or 1.25 m.

    Of T2 all are farther off than twice as much, with causes that are known or not; of T3 one by
    1.99, which is not far off.
    """
    locked = figures(3.0, mirror_locked_runs=6, e_p_mean_unlocked_m=1.5)
    slower = SLOW._replace(name="10s-slow")
    page = page_of_settings(
        (BASE, {"T2": locked, "T3": figures(1.99 * 1.25)}),
        (GATE, OUR_ROWS),
        (SLOW, {"T2": figures(9.0), "T3": figures(1.25)}),
        (slower, {mission: figures(2 * mean) for mission, mean in OURS.items()}),
        (ASYMMETRIC, {"T2": figures(1.0), "T3": figures(0.5 * 1.25)}),
        (TEXT, {"T2": figures(99.0), "T3": figures(99.0)}),
    )
    require_golden(page, "reproduce")


def test_without_rows_far_off_none_is_listed() -> None:
    block = page_of_settings((BASE, {"T3": figures(1.0)})).sections[2].blocks[1]
    assert block == Text(text="0 of 1 rows differ by more than a factor of 2 in mean E_P.")


@pytest.mark.parametrize(
    ("ratio", "tone"),
    [
        (1.0, "ratio-even"),
        (1.19, "ratio-even"),
        (0.84, "ratio-even"),
        (1.21, "ratio-high1"),
        (0.82, "ratio-low1"),
        (1.49, "ratio-high1"),
        (1.51, "ratio-high2"),
        (0.51, "ratio-low2"),
        (2.01, "ratio-high3"),
        (0.49, "ratio-low3"),
        (float("nan"), ""),
    ],
)
def test_a_ratio_and_its_inverse_have_colours_of_the_same_strength(ratio: float, tone: str) -> None:
    assert ratio_tone(ratio) == tone
    assert TableCell(text="", tone=ratio_tone(ratio)).style.strip() == f"short {tone}".strip()
