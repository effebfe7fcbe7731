"""The reproduction: its tables, the tests behind its claims, drawn routes, and a smoke run of
each study.
"""

import shlex

import numpy as np
import pyarrow.parquet as pq
import pytest

from experiments.campaign.montecarlo import Cell, simulate
from experiments.campaign.plans import steps_of
from experiments.flight.library import ROUTES, load_scenario
from experiments.studies.reproduce import findings as claims
from experiments.studies.reproduce.figures import table_rows
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import plan_of
from experiments.study.run import StudyResults, fly_further, fly_studies
from experiments.study.study import run
from reports import findings
from tests.experiments.studies.reproduce.cells import SETTINGS
from tools.documents import claim_seeds

SHORT = {"motion": "kinematic", "followers.0.depth_m": 8.0, "duration_s": 30.0}


@pytest.mark.system
def test_a_reproduction_writes_tables_and_report(tmp_path):
    keys = {"set": SHORT, "vary": {"case": ["base", "measured-gate", "5s"]}}
    report = run("reproduce", keys, tmp_path, quick=True, workers=1, quiet=True).report()
    table = pq.read_table(tmp_path / "tables.parquet").to_pylist()
    assert len(table) == 8 * (3 + 2 + 2)
    row = next(
        table_row
        for table_row in table
        if (table_row["setting"], table_row["trajectory"], table_row["variant"])
        == ("base", "T2", "laisn-2")
    )
    assert row["published_e_p_max_m"] == 5.12
    assert row["ratio_e_p_max"] == pytest.approx(row["ours_e_p_max_m"] / 5.12)
    assert (row["seed"], row["runs"], row["stage"]) == (1, 2, 1)
    assert row["fly_worst_run"].startswith("laisn fly T2 --run ")
    html = report.read_text(encoding="utf-8")
    for text in (
        "Table 1.",
        "Table 4.",
        "Figure 2.",
        "Figure 3.",
        "Claims",
        "no data",
        "independent replications",
    ):
        assert text in html
    actual = findings.read_findings(tmp_path / findings.RESULTS_FILE)
    assert actual.command == (
        "laisn reproduce --quick --set motion=kinematic --set followers.0.depth_m=8.0 --set "
        "duration_s=30.0 "
        "--vary 'case=[base,measured-gate,\"5s\"]'"
    )
    first = report.read_bytes()
    run("reproduce", keys, tmp_path, quick=True, workers=1, quiet=True)
    assert report.read_bytes() == first


def test_replications_have_the_figures_of_their_runs(tmp_path, monkeypatch):
    """The first replication has the three runs of a cell of the tables, the second has the next."""
    monkeypatch.setattr(claims, "REPLICATIONS", 4)
    vary: dict[str, dict[str, list[object]]] = {
        "tables": {"case": ["base"]},
        "replications": {"run": [0, 3, 6, 9]},
    }
    plans = {
        part: plan_of(
            study_of(
                str(file),
                {"set": SHORT, "seed": 2, "runs": 3, "vary": vary[part] | {"scenario": ["T3"]}},
            )
        )
        for part, file in built_in_files("reproduce").items()
    }
    outcomes = dict(
        zip(plans, fly_studies([*plans.values()], tmp_path, workers=1, quiet=True), strict=True)
    )
    fly_further(outcomes, claims.further_runs, tmp_path, workers=1, quiet=True)
    values, route_index = claims.MetricValues.of(outcomes).values, ROUTES.index("T3")
    scenario = next(entry for entry in plans["tables"].entries if entry.arm == "laisn-2").scenario
    assert (scenario.seed, scenario.duration_s, scenario.followers[0].route) == (2, 30.0, "T3")
    for number in (0, 1):
        table = simulate(Cell.of(scenario, runs=range(3 * number, 3 * number + 3))).runs
        for metric, summary in (
            ("e_p_mean_m", np.mean),
            ("e_p_max_m", np.max),
            ("e_b_max_deg", np.max),
        ):
            assert values["base laisn-2", metric].shape == (4, 8)
            assert values["base laisn-2", metric][number, route_index] == pytest.approx(
                summary(table[metric]), rel=1e-12
            )
        steps = steps_of(Cell.of(scenario, runs=range(3 * number, 3 * number + 3)))
        expected = claims.over_time(steps)["e_p_astern_m"]
        assert values["base laisn-2", "e_p_astern_m"][number, route_index] == pytest.approx(
            expected, nan_ok=True
        )
    assert (
        values["base laisn-2", "e_p_mean_m"][0, route_index]
        != values["base laisn-2", "e_p_mean_m"][1, route_index]
    )
    assert np.isnan(np.delete(values["base laisn-2", "e_p_mean_m"], route_index, axis=1)).all()
    assert {("base laisn-2", name) for name in claims.TIMED} <= values.keys()
    assert ("base laisn-3-2", "e_p_abeam_m") not in values


def test_resamples_scatter_as_means_over_replications_do():
    rng = np.random.default_rng(3)
    shared = rng.normal(10.0, 1.0, (20, 8))
    values = {("a", "x"): shared, ("b", "x"): shared + rng.normal(0.0, 0.5, (20, 8))}
    figures = claims.MetricValues(values=values)
    first, second = (figures.means_or_nan(name, "x") for name in "ab")
    assert first[0] == pytest.approx(shared.mean(axis=0))
    assert first[1:, 0].std() == pytest.approx(shared[:, 0].std() / np.sqrt(20), rel=0.1)
    # replications are drawn alike in all cells, so that noise that both share drops out of a ratio
    assert np.corrcoef(first[1:, 0], second[1:, 0])[0, 1] > 0.5


def test_seeds_are_compared_by_their_verdicts_on_all_claims():
    all_hold, last_undecided = ["holds"] * 10, ["holds"] * 9 + ["undecided"]
    actual = claim_seeds.findings_of(
        {seed: last_undecided if seed == 3 else all_hold for seed in range(20)}
    )
    assert (actual["same"].value, actual["seeds"].value) == (19, 20)
    assert (actual["same 1"].value, actual["same 10"].value, actual["verdict 10"].value) == (
        20,
        19,
        "holds",
    )


@pytest.mark.system
def test_the_study_of_seeds_judges_each_of_them(tmp_path, monkeypatch):
    monkeypatch.setattr(claims, "REPLICATIONS", 2)
    monkeypatch.setattr(claims, "published", dict)
    keys = {"set": SHORT, "vary": {"case": ["base", "5s"]}}
    claim_seeds.run(tmp_path, seeds=(3, 4), runs=1, keys=keys, workers=1, quiet=True)
    actual = findings.read_findings(tmp_path / findings.RESULTS_FILE)
    assert actual["seeds"].value == 2
    assert actual["verdict 2"].value == "no data"
    assert actual["verdict 1"].value != "no data"


def test_all_claims_hold_on_the_published_tables():
    distance = np.array([[42.3, 54.7, 76.5, 74.7, 39.5, 45.6, 40.8, 76.1]] * 2)
    ours = claims.MetricValues(values={("base laisn-2", "distance_m"): distance})
    verdicts = {
        claim.number: on_paper.verdict
        for claim, _, on_paper in claims.judge(ours, claims.published())
    }
    # μ_D = 0.3 has no published table; what the paper claims, its own tables bear out
    assert verdicts.pop(8) == "no data"
    assert set(verdicts.values()) == {"holds"}


def verdict(number, figure):
    """The verdict on a claim where every figure is 1, except where `figure(s, m, v, x)` of setting,
    mission, variant and metric has another value.
    """
    values = {
        (f"{setting.name} {v}", x): np.array(
            [[figure(setting.name, m, v, x) or 1.0 for m in ROUTES]]
        )
        for setting in SETTINGS
        for v in setting.variants
        for x in (*claims.METRICS, "distance_m")
    }
    return claims.CLAIMS[number - 1].judge(claims.MetricValues(values=values, exact=True)).verdict


@pytest.mark.parametrize(
    ("five", "ten", "expected"),
    [
        (1.5, 6.0, "holds"),
        (3.0, 6.0, "depends"),
        (1.5, 1.5, "depends"),
        (3.0, 1.5, "does not hold"),
    ],
)
def test_the_interval_claim_follows_its_criterion(five, ten, expected):
    assert verdict(2, lambda s, m, v, x: {"5s": five, "10s": ten}.get(s)) == expected


@pytest.mark.parametrize(
    ("t2", "t5", "expected"),
    [
        (0.5, 0.5, "holds"),
        (0.5, 2.0, "does not hold"),
        (0.5, 1.0, "depends"),
        (1.0, 1.0, "does not hold"),
    ],
)
def test_the_asymmetry_claim_follows_its_criterion(t2, t5, expected):
    values = {("asymmetric", "T2", "laisn-3-2"): t2, ("asymmetric", "T5", "laisn-3-2"): t5}
    assert verdict(7, lambda s, m, v, x: values.get((s, m, v))) == expected


def test_the_heading_claim_needs_errors_in_proportion_to_distance():
    distance = dict(zip(ROUTES, np.linspace(30.0, 100.0, 8), strict=True))

    def proportional(setting, mission, variant, metric):
        if metric == "distance_m":
            return distance[mission]
        if setting == "heading5":
            return 0.115 * distance[mission]
        return 0.1 if mission in ("T3", "T4") else None

    assert verdict(9, proportional) == "holds"
    assert (
        verdict(9, lambda s, m, v, x: None if s == "heading5" else proportional(s, m, v, x))
        != "holds"
    )


def test_errors_abeam_and_astern_are_means_over_steps_of_their_sectors():
    """Abeam are bearings about 90° and 270°, with errors of 1 and 3 m."""
    bearing = np.repeat([90.0, 180.0, 0.0, 270.0], 400)
    error = np.repeat([1.0, 5.0, 99.0, 3.0], 400)
    steps = {"bearing_deg": bearing, "e_p_mean_m": error, "e_b_max_deg": error, "speed_m_s": error}
    steps["time_s"] = np.arange(error.size)
    actual = claims.over_time(steps)
    assert (actual["e_p_abeam_m"], actual["e_p_astern_m"]) == (2.0, 5.0)
    actual = claims.over_time({name: values[:400] for name, values in steps.items()})
    assert actual["e_p_abeam_m"] == 1.0
    assert np.isnan(actual["e_p_astern_m"])


def test_the_command_of_a_row_repeats_its_cell():
    plan = plan_of(
        study_of(
            str(built_in_files("reproduce")["tables"]),
            {"seed": 3, "vary": {"case": ["asymmetric"]}},
        )
    )
    rows = [
        dict.fromkeys(claims.METRICS, 1.0)
        | plan.points[entry.point]
        | {"point": entry.point, "arm": entry.arm, "worst_run": 17}
        for entry in plan.entries
    ]
    outcomes = StudyResults(plan=plan, rows=rows, runs=[], steps=[], store=None)
    for row, entry in zip(table_rows(outcomes, {}), plan.entries, strict=True):
        words = shlex.split(row["fly_worst_run"])
        assert words[:5] == ["laisn", "fly", row["trajectory"], "--run", "17"]
        scenario = load_scenario(
            row["trajectory"], [words[i + 1] for i, word in enumerate(words) if word == "--set"]
        )
        assert scenario.model_copy(update={"name": entry.scenario.name}) == entry.scenario
