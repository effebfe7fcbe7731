"""What is stored of a cell: every figure under its name."""

from dataclasses import replace

import numpy as np

from experiments.campaign import plans
from experiments.campaign.plans import CellPlan
from experiments.flight.library import load
from tests.asymmetry.test_missions import RESULT


def test_a_row_has_the_figures_of_its_cell() -> None:
    row = plans._row(CellPlan(scenario=load("T5", []), runs=3), RESULT, {"bound_rms_m": 0.1})
    expected = {
        "runs": 3, "steps": 100, "seed": 1, "variant": "laisn-2", "e_p_max_m": 7.0, "e_p_mean_m": 0.6,
        "e_p_std_m": 0.25, "e_b_max_deg": 17.0, "e_b_mean_deg": 1.6, "e_b_std_deg": 0.9, "e_p_p50_m": 0.51,
        "e_p_p90_m": 0.92,
        "e_p_p95_m": 0.953, "e_p_p99_m": 0.994, "e_b_p50_deg": 1.0, "e_b_p99_deg": 4.0, "nees": 2.0, "nis": 2.1,
        "mirror_locked_runs": 2, "worst_run": 702, "bound_rms_m": 0.1, "fixes_gated": 6, "fixes_lost": 9,
        "e_p_mean_unlocked_m": 0.6,
    }  # fmt: skip
    assert {name: row[name] for name in expected} == expected
    assert RESULT.table is not None
    everybody = replace(RESULT, table=replace(RESULT.table, mirror_locked=np.array([True] * 3)))
    assert plans._row(CellPlan(scenario=load("T5", []), runs=3), everybody, {})["e_p_mean_unlocked_m"] is None
