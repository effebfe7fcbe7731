"""The stages as data: every published row belongs to one setting, and every setting is that of
the paper.
"""

import csv
import re

import pytest

from experiments.flight.library import ROUTES
from experiments.studies.reproduce.findings import _data, published
from tests.experiments.studies.reproduce.cells import ENTRIES, SETTINGS, columns, entries

SCENARIOS = {key: entry.scenario for key, entry in ENTRIES.items()}


def rows_of_the_file():
    return list(csv.DictReader(_data("published_tables.csv").splitlines()))


def test_a_published_row_is_of_the_setting_that_its_columns_describe():
    by_name = {s.name: s for s in SETTINGS}
    for row in rows_of_the_file():
        made, setting = columns(row["setting"]), by_name[row["setting"]]
        assert (row["table"], row["stage"]) == (setting.table, str(setting.stage))
        described = [column for column in row if column in made]
        assert len(described) == 9
        assert [float(row[column]) for column in described] == [
            float(made[column]) for column in described
        ]


def test_all_144_published_rows_are_reached_once():
    rows = published()
    assert len(rows) == len(rows_of_the_file()) == 144
    planned = {
        (s.name, route, variant)
        for s in SETTINGS
        if s.printed
        for route in ROUTES
        for variant in s.variants
    }
    assert set(rows) == planned


@pytest.mark.parametrize(
    ("key", "metric", "value"),
    [
        (("base", "T2", "laisn-2"), "e_p_max_m", 5.12),  # Table 1
        (("base", "T8", "laisn-3-2"), "e_b_max_deg", 60.06),
        (("10s-slow", "T3", "laisn-3-2"), "e_p_max_m", 92.16),  # Table 2
        (("5s", "T9", "laisn-3-2"), "e_b_mean_deg", 0.64),  # Table 3
        (("10s", "T6", "laisn-2"), "e_p_std_m", 7.99),  # Table 4
        (("L1", "T5", "laisn-2"), "e_p_mean_m", 0.76),  # Table 5
        (("HT0.2", "T2", "laisn-3-2"), "e_p_std_m", 2.43),  # Table 6
        (("asymmetric", "T5", "laisn-2"), "e_p_max_m", 40.08),  # Table 7
        (("heading2.5", "T4", "laisn-2"), "e_b_mean_deg", 3.25),  # Table 8
        (("heading5", "T9", "laisn-3-2"), "e_p_max_m", 20.58),  # Table 9
    ],
)
def test_figures_stand_where_the_paper_prints_them(key, metric, value):
    assert published()[key][metric] == value


def test_settings_that_the_paper_only_describes_are_flown_too():
    described = [s for s in SETTINGS if s.table == "text"]
    received = {s.name: SCENARIOS[s.name, "T5", "laisn-2"].acoustics for s in described}
    assert received["muD0.3"].range_scale_mean_m == 0.3
    assert [a.range_tau_m for name, a in received.items() if name.startswith("tau")] == [
        (0.03,) * 3,
        (0.06,) * 3,
    ]


def test_columns_of_a_table_are_the_values_of_its_setting():
    base = {
        "dt_s": 0.1,
        "dt_range_s": 1.0,
        "leader_length_m": 2.0,
        "h_t_m": 0.1,
        "tau_rear_m": 0.01,
        "tau_other_m": 0.01,
        "mu_range_m": 0.1,
        "sigma_range_m": 0.05,
        "mu_heading_leader_deg": 0.0,
        "beta_m2": 0.1,
        "threshold_m": 0.1,
        "gate": "v-max",
    }
    for name, changed in (
        ("base", {}),
        ("muD0.3", {"dt_range_s": 5.0, "mu_range_m": 0.3}),
        ("asymmetric", {"dt_range_s": 5.0, "tau_rear_m": 0.06}),
        ("tau0.03", {"dt_range_s": 5.0, "tau_rear_m": 0.03, "tau_other_m": 0.03}),
        ("L1", {"dt_range_s": 5.0, "leader_length_m": 1.0}),
        ("HT0.2", {"dt_range_s": 5.0, "h_t_m": 0.2}),
        ("heading2.5", {"mu_heading_leader_deg": 2.5}),
        (
            "10s-slow-beta300",
            {"dt_s": 1.0, "dt_range_s": 10.0, "beta_m2": 300.0, "threshold_m": 10.0},
        ),
    ):
        actual = columns(name)
        assert {key: actual[key] for key in base} == base | changed


STATED = {
    r"Δt = ([\d.]+) s": "dt_s",
    r"Δt_D = ([\d.]+) s": "dt_range_s",
    r"β = ([\d.]+)": "beta_m2",
    r"\bT = ([\d.]+)": "threshold_m",
    r"\bL = ([\d.]+) m": "leader_length_m",
    r"H_T = ([\d.]+) m": "h_t_m",
    r"μ_D = ([\d.]+) m": "mu_range_m",
    r"τ = ([\d.]+) m": "tau_rear_m",
    r"compass ([\d.]+)° off": "mu_heading_leader_deg",
}
"""Values of a setting in titles, and the column that has it."""


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda setting: setting.name)
def test_a_setting_matches_its_title_in_the_stage_of_its_table(setting):
    actual = columns(setting.name)
    stated = {
        column: float(m[1])
        for words, column in STATED.items()
        if (m := re.search(words, setting.title))
    }
    assert stated
    assert {column: actual[column] for column in stated} == stated
    # Tables 1; 2 to 4; 5 and 6; 7; 8 and 9 are those of the five stages (paper, Section 3)
    stage_of = {"1": 1, "2-4": 2, "5": 3, "6": 3, "7": 4, "8": 5, "9": 5, "text": 4}
    model = next(s for s in SETTINGS if s.name == (setting.like or setting.name))
    assert setting.stage == stage_of[model.table]


def test_alternatives_are_named_and_differ_only_in_what_the_paper_leaves_open():
    free = {"beta_m2", "threshold_m", "gate"}
    centred = {"asymmetric-centred"}
    by_name = {s.name: s for s in SETTINGS}
    alternatives = [s for s in SETTINGS if s.table == "alternative"]
    assert alternatives
    for setting in alternatives:
        original = by_name[setting.like]
        assert setting.stage == original.stage
        made, like = (SCENARIOS[s.name, "T5", "laisn-2"] for s in (setting, original))
        kept = like.navigation.model_copy(
            update={key: getattr(made.navigation, key) for key in free}
        )
        received = like.acoustics.model_copy(
            update={"range_error_centred": setting.name in centred}
        )
        assert made == like.model_copy(update={"navigation": kept, "acoustics": received})
    own = {s.name for s in SETTINGS if s.table != "alternative"}
    fixed = [scenario for (name, _, _), scenario in SCENARIOS.items() if name in own]
    assert {(s.navigation.beta_m2, s.navigation.threshold_m, s.navigation.gate) for s in fixed} == {
        (0.1, 0.1, "v-max")
    }
    assert not any(scenario.acoustics.range_error_centred for scenario in fixed)


def test_scenarios_carry_the_setting():
    keys = {"motion": "kinematic", "followers.0.depth_m": 8.0}
    made = entries(set=keys, seed=9, vary={"case": ["heading5"]})[
        "heading5", "T4", "laisn-3-2"
    ].scenario
    assert made.sensors.leader_heading_bias_deg == 5.0
    assert made.sensors.leader_heading_sigma_deg == 2.0
    assert made.followers[0].depth_m == made.leader.depth_m
    assert (made.navigation.variant, made.seed, made.followers[0].route) == ("laisn-3-2", 9, "T4")
    assert made.acoustics.range_tau_m == (0.01, 0.01, 0.01)
    physical = SCENARIOS["heading5", "T4", "laisn-2"]
    assert physical.followers[0].depth_m != physical.leader.depth_m
    assert (physical.motion, made.motion) == ("physics", "kinematic")


def test_every_setting_is_simulated_with_its_variants_on_every_mission():
    assert set(SCENARIOS) == {(s.name, r, v) for s in SETTINGS for r in ROUTES for v in s.variants}
