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
from reports.page import Figures, Page, PageTable, TableCell, Text, page_of, ratio_tone
from tests.experiments.studies.reproduce.cells import SETTINGS, Setting

BASE, GATE, SLOW, ASYMMETRIC, TEXT = (
    next(s for s in SETTINGS if s.name == name)._replace(variants=("laisn-2",))
    for name in ("base", "measured-gate", "10s", "asymmetric", "muD0.3")
)
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
    labels = {s.name: {"stage": s.stage, "table": s.table, "like": s.like} for s in settings}
    rows = {key: row | labels[key[0]] for key, row in rows.items()}
    values = page_values({s.name: s.title for s in settings}, rows, published, judgements)
    values |= {
        "motion": "",
        "quick": False,
        "errors": [],
        "agreement": Figures(panels=[]),
        "routes": Figures(panels=[]),
    }
    found = findings_of_rows(rows, published, judgements)
    record = Findings(study="reproduce", command="", modules=(), version="", findings=found)
    return page_of("experiments.studies.reproduce", [], values, record)


def made(*given: tuple[Setting, dict[str, dict[str, Any]]]) -> Page:
    """The page of settings, mission by mission; the paper has `THEIRS` of some."""
    flown: dict[Key, Any] = {
        (s.name, mission, "laisn-2"): row for s, rows in given for mission, row in rows.items()
    }
    published: dict[Key, dict[str, float]] = {
        (name, mission, "laisn-2"): {metric: figures(mean)[metric] for metric in METRICS}
        for name in ("base", "10s", "10s-slow", "asymmetric")
        for mission, mean in THEIRS.items()
    }
    return page_with([s for s, _ in given], flown, published)


def table_of(page: Page, section: str, number: int = 0) -> PageTable:
    """One of the tables of a section, by the words that its title begins with."""
    (found,) = (s for s in page.sections if s.title.startswith(section))
    return [block for block in found.blocks if isinstance(block, PageTable)][number]


def texts(row: Any) -> list[str]:
    return [cell.text for cell in row]


def both(mission_ratio: float, theirs: float, places: range) -> list[str]:
    """Pairs of cells: the paper's figure and ours, of the figures at these places."""
    return [f"{(i + 1) * value:.2f}" for i in places for value in (theirs, mission_ratio * theirs)]


ALL = {mission: figures(mean) for mission, mean in OURS.items()}


def test_each_figure_stands_beside_the_papers() -> None:
    table = table_of(made((BASE, ALL)), "Stage 1")
    assert texts(table.rows[0])[1:] == both(3.0, 1.0, range(6))
    assert texts(table.rows[1])[1:] == both(0.8, 1.25, range(6))
    assert [name for name, _ in table.groups][1:] == [
        "E_P max [m]",
        "E_B max [°]",
        "E_P mean [m]",
        "E_B mean [°]",
        "σ E_P [m]",
        "σ E_B [°]",
    ]
    assert [cell.tone for cell in table.rows[0]][1:3] == ["theirs", "ratio-high3"]
    assert {cell.tone for cell in table.rows[1][2::2]} == {ratio_tone(0.8)} == {"ratio-low1"}
    assert table.rows[1][4].title == "2 / 2.5 = 0.80"


def test_what_the_paper_only_describes_stands_alone() -> None:
    table = table_of(made((TEXT, ALL)), "Stage 4")
    assert texts(table.rows[0])[1:] == [f"{3.0 * i:.2f}" for i in range(1, 7)]
    assert len(table.heads) == 7


def test_two_figures_of_several_settings_stand_side_by_side() -> None:
    other = SLOW._replace(name="10s-slow")
    page = made((SLOW, ALL), (other, {m: figures(2 * mean) for m, mean in OURS.items()}))
    table = table_of(page, "Stage 2", 1)
    assert texts(table.rows[0])[1:] == both(3.0, 1.0, range(2, 4)) + both(6.0, 1.0, range(2, 4))
    assert table.caption == "Table 3. Mean errors."


def test_alternatives_are_held_against_the_rows_that_they_are_like() -> None:
    (row,) = table_of(made((BASE, ALL), (GATE, ALL)), "Stage 1", 1).rows
    assert texts(row)[1:] == [
        "LAISN\N{NON-BREAKING HYPHEN}2",
        *both(3.0, 1.0, range(2, 3)),
        *both(0.8, 1.25, range(2, 3)),
    ]
    assert [cell.title for cell in row[3::2]] == ["9 / 3 = 3.00", "3 / 3.75 = 0.80"]
    assert row[3].tone == "ratio-high3"


def test_deviating_rows_are_reported_with_known_causes() -> None:
    mirror_locked = figures(3.0, mirror_locked_runs=6, e_p_mean_unlocked_m=1.5)
    # 2.0 times as much is far off, 1.99 times is not
    found = made(
        (BASE, {"T2": mirror_locked, "T3": figures(1.99 * 1.25)}),
        (SLOW, {"T2": figures(9.0), "T3": figures(1.25)}),
        (ASYMMETRIC, {"T2": figures(1.0), "T3": figures(0.5 * 1.25)}),
        (TEXT, {"T2": figures(99.0), "T3": figures(99.0)}),
    )
    text = [block.text for block in found.sections[2].blocks if isinstance(block, Text)]
    assert text[0].startswith(
        "3 of 6 rows differ by more than a factor of 2 in mean E_P. 1 of them have a message"
    )
    assert text[0].endswith("The other 2:")
    table = table_of(found, "Ours over", 1)
    first, second = table.rows
    assert texts(first)[:2] == ["Table 1", "Δt_D = 1 s"]
    assert texts(first)[3:] == [
        "3.00",
        "9.00",
        "3.00",
        "6 of 60 runs were on the mirror side for a while; the others have 1.50 m (0.50 of the "
        "paper's)",
    ]
    assert texts(second)[3:6] == ["3.75", "1.88", "0.50"]
    assert texts(second)[6].startswith("unequal errors act most near astern")
    alone = made((BASE, {"T3": figures(1.0)})).sections[2].blocks[1]
    assert alone == Text(text="0 of 1 rows differ by more than a factor of 2 in mean E_P.")


def test_all_rows_have_percentiles_consistency_and_counts() -> None:
    (row,) = table_of(made((BASE, {"T2": figures(1.0, mirror_locked_runs=3)})), "All rows").rows
    assert texts(row)[2:] == ["0.11", "0.22", "0.33", "4000.0", "2.5", "3", "7", "42"]


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
def test_ratios_are_coloured_alike_either_way(ratio: float, tone: str) -> None:
    assert ratio_tone(ratio) == tone
    assert TableCell(text="", tone=ratio_tone(ratio)).style.strip() == f"short {tone}".strip()
