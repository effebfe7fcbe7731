"""The page of the pitch study and its numbers, for rows, curves, a message and a map by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from experiments.campaign.store import Record
from experiments.studies.asymmetry import figures, findings
from experiments.studies.asymmetry.findings import Curve, paired
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import plan_of
from reports.findings import record
from reports.page import Page, PageTable, Text, page_of
from tests.experiments.studies.asymmetry.test_findings_comparison import row
from tests.golden import require_golden

RUNS = 64
STUDY = study_of(str(built_in_files("asymmetry")["missions"]), {})
TITLES = {name.rpartition(" ")[0]: arm.title for name, arm in STUDY.arms.items()}
TITLES |= {name: case.title for name, case in STUDY.cases.items()}
WOBBLE = np.tile([1.0, -1.0], RUNS // 2)
"""Errors of standard deviation 1, without Bessel's correction: the 95 % interval of their mean
over 64 runs reaches 1.96 / √63 to either side.
"""
TRIM = "trim-12N"


def half_interval(sigma: float) -> float:
    """Half of the 95 % interval of the mean over two missions of values that wobble by sigma."""
    return float(1.959964 * sigma / np.sqrt(2 * (RUNS - 1)))


def curve(
    route: str, value: tuple[float, ...], interval: float, offset: float | None = None
) -> Curve:
    """A curve whose error grows by 1 m from value to value."""
    means = tuple(0.5 + i for i in range(len(value)))
    halves = tuple(0.0 if i == 0 else 0.5 for i in range(len(value)))
    return Curve(
        route=route,
        interval_s=interval,
        depth_offset_m=offset,
        value=value,
        e_p_mean_m=means,
        excess_half_m=halves,
    )


CURVES = [
    *(
        curve(route, (0.01, 0.03, 0.06, 0.1), interval)
        for route in ("T3", "T4")
        for interval in (1.0, 5.0)
    ),
    *(curve(route, (0.0, -1.0, -3.0, -6.0), 5.0, 10.0) for route in ("T3", "T4")),
]


def rows(condition: str = TRIM, cause: str = "trim", **changes: Any) -> list[Record]:
    """Rows of all arms: on T3 pitch adds 1 m and 4 mirror locks, on T4 3 m and none, of which each
    remedy leaves the fraction that its row has here.
    """
    all_rows = []
    for route, added, locked_runs in (("T3", 1.0, 4), ("T4", 3.0, 0)):
        labels = {
            "route": route,
            "depth_offset_m": 10.0,
            "condition": condition,
            "cause": cause,
            **changes,
        }
        all_rows += [
            row("level", 0.5 + 0.1 * WOBBLE, **labels),
            row("real", 0.5 + added + 0.3 * WOBBLE, np.arange(RUNS) < locked_runs, **labels),
            row("level-0.5", 0.6 + 0.1 * WOBBLE, **labels),
            row("attitude-0", 0.5 + 0.01 * added + 0.1 * WOBBLE, **labels),
            row("ahrs-0.5", 0.5 + 0.05 * added + 0.2 * WOBBLE, **labels),
            row("attitude-0.5", 0.5 + 0.3 * added + 0.1 * WOBBLE, **labels),
            row("attitude-2", 0.5 + 0.6 * added + 0.1 * WOBBLE, **labels),
            row("offset-0.5", 0.5 + 0.4 * added + 0.1 * WOBBLE, **labels),
            row("expected", 0.5 + 1.2 * added + 0.1 * WOBBLE, **labels),
        ]
    return all_rows


def verdicts(error: str, mirror_lock: str) -> list[Record]:
    """The rows of `rows`, with these verdicts on every remedy."""
    return [
        of_arm | {"error_verdict": error, "mirror_lock_verdict": mirror_lock}
        if of_arm["arm"] not in ("level", "real", "level-0.5")
        else of_arm
        for of_arm in rows()
    ]


ALL_CAUSES = [r for cause in ("trim", "dive", "waves") for r in rows(f"{cause}-x", cause)]


def page_with(rows_of_arms: list[Record], **other_values: Any) -> Page:
    """The page of these rows without pictures; the values of the message and of the map, unless
    they are among the others, are blank.
    """
    looks = (RUNS,)
    findings_record = record(
        "asymmetry", "laisn asymmetry", (), findings.findings_of_rows(rows_of_arms, CURVES, looks)
    )
    blank: dict[str, Any] = dict.fromkeys(
        ("geometry", "first_minutes", "shares", "one_mission", "film", "maps"), ()
    ) | dict.fromkeys(("points", "closed_form_m", "pitch_deg", "fix_error_m"), 0)
    blank |= {
        "everything": figures.EVERYTHING,
        "abeam": np.zeros(1),
        "third_m": (0, 0),
        "found": findings_record,
        "example": SimpleNamespace(title=""),
    }
    values = figures.missions_values(
        paired(rows_of_arms), CURVES, TITLES | {f"{c}-x": c for c in findings.CAUSES}, looks
    )
    return page_of(
        "experiments.studies.asymmetry",
        [],
        blank | values | {"offsets": (), "excess": ()} | other_values,
        findings_record,
    )


@pytest.fixture(autouse=True)
def _no_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are left as they are, not drawn into the page."""
    monkeypatch.setattr("reports.page.replace", lambda block, **_: block)


def tables(page: Page, section: str) -> list[list[list[str]]]:
    """Cells of the tables of a section."""
    (blocks,) = (part.blocks for part in page.sections if part.title == section)
    return [
        [[cell.text for cell in cells] for cells in block.rows]
        for block in blocks
        if isinstance(block, PageTable)
    ]


def text_of(page: Page) -> str:
    """All paragraphs of a page."""
    return " ".join(
        block.text
        for section in page.sections
        for block in section.blocks
        if isinstance(block, Text)
    )


def test_the_page_is_the_golden_one() -> None:
    """Two routes in four conditions; what pitch adds, and remedies leave of it (1 % to 120 %), is
    as of `rows`; with three transmitters errors are half as large; trim has verdicts of all kinds.
    """
    mixed = [r for r in verdicts("met", "open") if r["route"] == "T3"]
    mixed += [r for r in verdicts("missed", "no harm shown") if r["route"] == "T4"]
    three = [
        r | {"variant": "laisn-3-2", "e_p_run_mean_m": 0.5 * r["e_p_run_mean_m"]} for r in rows()
    ]
    others = [r for r in ALL_CAUSES if r["cause"] != "trim"]
    require_golden(page_with([*others, *mixed, *three]), "asymmetry")


def test_pitch_that_moves_no_fix_is_summed_up_so() -> None:
    assert "moves no fix" in page_with([r | {"pitch_fix_error_m": 0.0} for r in ALL_CAUSES]).summary


def test_a_condition_has_its_means_over_routes() -> None:
    (cells,) = [
        table_row
        for table_row in tables(page_with(ALL_CAUSES + rows()), "On missions")[0]
        if table_row[0] == TITLES[TRIM]
    ]
    # the root mean square and the largest pitch that `row` has
    assert cells[:3] == [TITLES[TRIM], "10", "5.0 / 6.0"]
    assert cells[3] == f"0.50 ± {half_interval(0.1):.2f}"
    assert cells[4] == f"2.50 ± {half_interval(0.3):.2f}"
    assert cells[5] == f"2.00 ± {half_interval(0.2):.2f}"
    assert cells[6] == "–"
    # by `CURVES`, 1 and 3 m are those of τ = 0.03 and 0.1 m
    assert cells[7] == "0.065"
    # 4 of 64 on one route and none on the other: 4 ± 1.96 √(64 · 64/63 · p (1 − p)), p = 1/16
    assert cells[8] == f"4 ± {1.959964 * np.sqrt(RUNS * RUNS / (RUNS - 1) / 16 * 15 / 16):.0f}"
    assert cells[9:] == [f"T4: 3.00 ± {1.959964 * 0.2 / np.sqrt(RUNS - 1):.2f}"]


def test_three_transmitters_have_a_column_of_their_own() -> None:
    """What pitch adds to them is half of what it adds to two."""
    three = [
        r | {"variant": "laisn-3-2", "e_p_run_mean_m": 0.5 * r["e_p_run_mean_m"]} for r in rows()
    ]
    (cells,) = [
        table_row
        for table_row in tables(page_with([*ALL_CAUSES, *rows(), *three]), "On missions")[0]
        if table_row[0] == TITLES[TRIM]
    ]
    assert cells[5:7] == [f"2.00 ± {half_interval(0.2):.2f}", f"1.00 ± {half_interval(0.1):.2f}"]


def test_remedies_have_their_share_of_the_sum_and_their_verdicts() -> None:
    """Pitch adds 1 m and 3 m; of it, an AHRS leaves a twentieth, readings with 0.5° of noise leave
    three tenths, and exact attitude leaves 1 %.
    """
    mixed = [r for r in verdicts("met", "open") if r["route"] == "T3"]
    mixed += [r for r in verdicts("missed", "no harm shown") if r["route"] == "T4"]
    page = page_with([r for r in ALL_CAUSES if r["cause"] != "trim"] + mixed)
    shares, locks, routes = tables(page, "Remedies")
    trim = [cells for cells in shares if cells[2] == "trim"]
    assert [cells[4].partition(" ")[0] for cells in trim] == [
        "99.0",
        "95.0",
        "70.0",
        "40.0",
        "60.0",
        "−20.0",
    ]
    for cells in trim:
        # harm shown, then met, open and missed: of errors, and of mirror locks
        assert [cells[3], *cells[5:]] == ["2", "2", "1 / 0 / 1", "1", "0 / 1 / 0"]
    section = next(part for part in page.sections if part.title == "Remedies")
    table = next(block for block in section.blocks if isinstance(block, PageTable))
    # 95 % is beyond the aim of 90 %, with 0.06 m · 1.96 / √63 or so to spare; 99 % are at the aim
    # itself
    assert [cells[4].tone for cells in table.rows if cells[2].text == "trim"] == [
        "",
        "yes",
        "no",
        "no",
        "no",
        "no",
    ]
    # 4 of 64 runs on one of two routes behind the real leader, which any remedy avoids
    exact, none = (stats.binomtest(k, 128).proportion_ci(0.95, "exact") for k in (4, 0))
    by_arm = {cells[2]: cells[3:] for cells in locks if cells[1] == "trim"}
    assert by_arm["real leader"] == [
        f"3.12 % ({100 * exact.low:.2f} to {100 * exact.high:.2f} %)",
        "–",
    ]
    assert by_arm[TITLES[findings.AHRS]][0] == f"0.00 % (0.00 to {100 * none.high:.2f} %)"
    assert by_arm[TITLES[findings.AHRS]][1].startswith("100.0 (")
    assert routes[0][1] == f"1.00 ± {1.959964 * 0.2 / np.sqrt(RUNS - 1):.2f}"
    assert [cell.partition(" ")[0] for cell in routes[1][2:5]] == ["99.0", "95.0", "70.0"]
    # against a level leader with the same sensor 0.2 of 1 m and 0.8 of 3 m stay
    assert "the aim is missed on 6 of 6 missions (0 open)" in text_of(page)


def test_stage_4_reads_tau_as_pitch() -> None:
    """τ = 0.03 m adds 1 ± 0.5 m; by the curve of pitch, which is straight between its values, 1°
    adds 1 m, 0.5° half a metre and 2° 1.5 m.
    """
    actual = tables(page_with(ALL_CAUSES), "The paper's Stage 4 as degrees of pitch")[0]
    assert actual[0] == ["T3", "1.00 ± 0.50", "1.0 (0.5 to 2.0)", "2.00 ± 0.50", "3.0 (2.0 to 4.5)"]


def test_the_planner_has_the_bound_over_the_sine_of_pitch_abeam() -> None:
    page = page_with(ALL_CAUSES)
    (planner,) = tables(page, "Table for a planner")
    assert len(planner) == 20
    for _, bound, pitch, abeam, *_ in (cells for cells in planner if cells[:2] == ["40", "0.5"]):
        depth_offset = float(bound) / np.sin(np.deg2rad(float(pitch)))
        assert float(abeam) == pytest.approx(min(depth_offset, 50.0), abs=0.06)


def test_figures_of_missions_are_levers_added_errors_and_medians() -> None:
    """Three missions: pitch adds 1, 4 and 2 m with a lever of 5 m sin 5°; the median error is
    2.5 m.
    """
    mission_rows = []
    for i, error in enumerate((1.0, 4.0, 2.0)):
        labels = {"route": f"T{i + 2}"}
        mission_rows += [
            row("level", 0.5, **labels),
            row("real", 0.5 + error, **labels),
            row("ahrs-0.5", 0.7, **labels),
        ]
    (part,) = figures.excess_over_lever(paired(mission_rows)).parts
    assert part.lines[1].x == pytest.approx(np.full(3, 5.0 * np.sin(np.deg2rad(5.0))))
    assert part.lines[1].y == pytest.approx([1.0, 4.0, 2.0])
    missions = [
        mission
        for cause in ("trim", "dive", "waves")
        for mission in paired(mission_row | {"cause": cause} for mission_row in mission_rows)
    ]
    for figure in figures.over_offset(missions):
        (part,) = figure.parts
        assert [line.y[0] for line in part.lines[::2]] == pytest.approx([0.5, 2.5, 0.7])
        # one scale for all causes
        assert part.y_limits == (0.0, pytest.approx(1.05 * 2.5))


@pytest.mark.system
def test_a_message_is_drawn_from_the_motion() -> None:
    """A fix turns about the leader: cos B̂ = cos B cos φ − (Δz / D) sin φ."""
    keys = {"set": {"duration_s": 60.0}, "scenario": ["T6"]}
    example = figures.fly_example(
        plan_of(study_of(str(built_in_files("asymmetry")["missions"]), keys))
    )
    message = figures.Message.of(example.flight.trajectory, example.step)
    ahead, port, up = message.hydrophone
    horizontal_range = np.hypot(ahead, port)
    assert message.pitch == pytest.approx(example.flight.trajectory.pitch[example.step, 0])
    assert horizontal_range == pytest.approx(np.hypot(*message.fix), rel=1e-9)
    fix_ahead = ahead * np.cos(message.pitch) + up * np.sin(message.pitch)
    assert message.fix[0] == pytest.approx(fix_ahead, rel=1e-9)
    true_positions = example.flight.trajectory.site_position[example.step]
    sites = [example.flight.trajectory.site(name) for name in ("leader/tx_rear", "leader/tx_front")]
    hydrophone = example.flight.trajectory.site("follower/hydrophone")
    assert np.linalg.norm(message.transmitters - message.hydrophone, axis=1) == pytest.approx(
        np.linalg.norm(true_positions[sites] - true_positions[hydrophone], axis=1), rel=1e-9
    )


def test_the_map_prints_the_difference_of_closed_form_and_engine() -> None:
    """A map made by hand whose engine is 3 mm off the closed form at one point, and 0.876 m
    abeam at 5° and 10 m.
    """
    points = [
        (pitch, depth_offset, range_m, bearing)
        for pitch in (0.0, 5.0)
        for depth_offset in (0.0, 5.0, 10.0)
        for range_m in (20.0, 50.0)
        for bearing in (90.0, 135.0)
    ]
    columns = dict(
        zip(
            ("pitch_deg", "depth_offset_m", "range_m", "bearing_deg"),
            np.array(points).T,
            strict=True,
        )
    )
    closed_form = 0.1 * (1.0 + columns["depth_offset_m"])
    engine = closed_form.copy()
    engine[points.index((5.0, 10.0, 20.0, 90.0))] = closed_form[
        points.index((5.0, 10.0, 20.0, 90.0))
    ] = 0.876
    engine[points.index((5.0, 5.0, 50.0, 135.0))] -= 0.003
    closed_form[0] = np.nan
    difference_of_variants = np.where(np.arange(len(points)) % 8 == 0, -0.003, 0.001)
    columns |= {
        "error_laisn-2_m": engine,
        "error_closed_form_m": closed_form,
        "error_laisn-3-2_m": engine + difference_of_variants,
    }
    printed = text_of(page_with(ALL_CAUSES, **figures.map_values(columns) | {"maps": ()}))
    assert "At 5° and 10 m the error abeam is 0.876 to 1.100 m, whatever the range" in printed
    assert (
        "differ from those of LAISN-2 by 0.001 m in the median, and by less than 0.003 m at 95 %"
        in printed
    )
    assert (
        "Over all 24 points of the map, closed form and simulation differ by at most 0.003 m"
        in printed
    )
