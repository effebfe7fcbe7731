"""The study file of the paper's stages: every published row belongs to one setting, and every
setting is that of the paper.
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
    by_name = {setting.name: setting for setting in SETTINGS}
    for row in rows_of_the_file():
        setting_columns, setting = columns(row["setting"]), by_name[row["setting"]]
        assert (row["table"], row["stage"]) == (setting.table, str(setting.stage))
        described = [column for column in row if column in setting_columns]
        assert len(described) == 9
        assert [float(row[column]) for column in described] == [
            float(setting_columns[column]) for column in described
        ]


def test_each_of_the_144_published_rows_is_a_planned_cell():
    rows = published()
    assert len(rows) == len(rows_of_the_file()) == 144
    planned = {
        (setting.name, route, variant)
        for setting in SETTINGS
        if setting.printed
        for route in ROUTES
        for variant in setting.variants
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
    described = [setting for setting in SETTINGS if setting.table == "text"]
    acoustics = {
        setting.name: SCENARIOS[setting.name, "T5", "laisn-2"].acoustics for setting in described
    }
    assert acoustics["muD0.3"].range_scale_mean_m == 0.3
    assert [
        settings.range_tau_m for name, settings in acoustics.items() if name.startswith("tau")
    ] == [
        (0.03,) * 3,
        (0.06,) * 3,
    ]


def test_columns_of_a_table_are_the_values_of_its_setting():
    """Values as the paper states them for its settings."""
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


COLUMN_IN_TITLE = {
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
"""Patterns of values in titles of settings, and the columns that have them."""


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda setting: setting.name)
def test_a_setting_matches_its_title_in_the_stage_of_its_table(setting):
    actual = columns(setting.name)
    stated = {
        column: float(match[1])
        for pattern, column in COLUMN_IN_TITLE.items()
        if (match := re.search(pattern, setting.title))
    }
    assert stated
    assert {column: actual[column] for column in stated} == stated
    # Tables 1; 2 to 4; 5 and 6; 7; 8 and 9 are those of the five stages (paper, Section 3)
    stage_of = {"1": 1, "2-4": 2, "5": 3, "6": 3, "7": 4, "8": 5, "9": 5, "text": 4}
    model = next(other for other in SETTINGS if other.name == (setting.like or setting.name))
    assert setting.stage == stage_of[model.table]


def test_alternatives_differ_from_their_originals_only_in_what_the_paper_leaves_open():
    open_keys = {"beta_m2", "threshold_m", "gate"}
    centred = {"asymmetric-centred"}
    by_name = {s.name: s for s in SETTINGS}
    alternatives = [s for s in SETTINGS if s.table == "alternative"]
    assert alternatives
    for setting in alternatives:
        original = by_name[setting.like]
        assert setting.stage == original.stage
        alternative_scenario, original_scenario = (
            SCENARIOS[s.name, "T5", "laisn-2"] for s in (setting, original)
        )
        navigation = original_scenario.navigation.model_copy(
            update={key: getattr(alternative_scenario.navigation, key) for key in open_keys}
        )
        acoustics = original_scenario.acoustics.model_copy(
            update={"range_error_centred": setting.name in centred}
        )
        assert alternative_scenario == original_scenario.model_copy(
            update={"navigation": navigation, "acoustics": acoustics}
        )
    settings_of_paper = {s.name for s in SETTINGS if s.table != "alternative"}
    scenarios_of_paper = [
        scenario for (name, _, _), scenario in SCENARIOS.items() if name in settings_of_paper
    ]
    assert {
        (s.navigation.beta_m2, s.navigation.threshold_m, s.navigation.gate)
        for s in scenarios_of_paper
    } == {(0.1, 0.1, "v-max")}
    assert not any(scenario.acoustics.range_error_centred for scenario in scenarios_of_paper)


def test_scenarios_have_the_values_of_the_setting_and_of_further_keys():
    keys = {"motion": "kinematic", "followers.0.depth_m": 8.0}
    scenario = entries(set=keys, seed=9, vary={"case": ["heading5"]})[
        "heading5", "T4", "laisn-3-2"
    ].scenario
    assert scenario.sensors.leader_heading_bias_deg == 5.0
    assert scenario.sensors.leader_heading_sigma_deg == 2.0
    assert scenario.followers[0].depth_m == scenario.leader.depth_m
    assert (scenario.navigation.variant, scenario.seed, scenario.followers[0].route) == (
        "laisn-3-2",
        9,
        "T4",
    )
    assert scenario.acoustics.range_tau_m == (0.01, 0.01, 0.01)
    physical = SCENARIOS["heading5", "T4", "laisn-2"]
    assert physical.followers[0].depth_m != physical.leader.depth_m
    assert (physical.motion, scenario.motion) == ("physics", "kinematic")


def test_every_setting_is_simulated_with_its_variants_on_every_mission():
    assert set(SCENARIOS) == {
        (setting.name, route, variant)
        for setting in SETTINGS
        for route in ROUTES
        for variant in setting.variants
    }
