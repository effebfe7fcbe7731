"""Flying the missions of the pitch study: what each cause of pitch does to followers, and what each remedy is worth.

A condition is flown with followers on all routes in the water at once. Each of them then navigates many times with the
same noise behind the leader as it moved (real) and behind one that kept level, and with every remedy. What differs
between two arms of a mission is therefore the pitch, or the remedy, and nothing else. No two missions share noise.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.asymmetry.added_error import paired, undecided, with_verdicts
from experiments.asymmetry.conditions import SEED, Condition, first_run, fleet, scenario
from experiments.asymmetry.missions import Plan, Row, Sensed, pair, sense
from experiments.asymmetry.remedies import ARM, ARMS, Arm
from experiments.campaign.cells import PERCENTILES, Cell, CellResult
from experiments.campaign.montecarlo import simulate
from laisn.settings import Variant
from sim.motion import simulate_motion
from sim.sensing.ahrs import random_error
from sim.sensing.observation import errors_of
from sim.sensing.sensor_errors import SensorErrors
from sim.sensing.truth import MissionTruth


def cell(sensed: Sensed, errors: SensorErrors, arm: Arm, variant: Variant, runs: range) -> Cell:
    """The runs of one arm and variant of a mission."""
    random = random_error(arm.sensors)
    expected = float(np.deg2rad(sensed.facts["pitch_rms_deg"])) if arm.expect_pitch else 0.0
    truth: MissionTruth = getattr(sensed, arm.seen)
    return Cell(
        truth=truth,
        errors=replace(
            errors,
            leader_pitch_sigma=random.sigma,
            leader_roll_sigma=random.sigma,
            leader_attitude_time=random.time,
            leader_attitude_offset_sigma=float(np.deg2rad(arm.sensors.leader_attitude_offset_sigma_deg)),
        ),
        settings=replace(
            sensed.settings, variant=variant, use_attitude=arm.use_attitude, expected_pitch=expected
        ),
        seed=SEED,
        runs=runs,
    )  # fmt: skip


def row_of(result: CellResult, **others: Any) -> Row:
    """A row of the table of results, which must hold each run; `others` are the fields that no result holds."""
    if result.table is None:
        raise ValueError("the result lacks its table of runs; simulate with keep_runs=True")
    return Row(
        **others,
        first_run=int(result.table.run[0]),
        runs=result.runs,
        e_p_mean_m=result.errors.e_p_mean_m,
        e_p_run_mean_m=tuple(result.table.e_p_mean_m.tolist()),
        captured_run=tuple(result.table.captured.tolist()),
        e_p_std_m=result.errors.e_p_std_m,
        e_p_95_m=result.e_p_percentiles_m[PERCENTILES.index(95)],
        e_p_max_m=result.errors.e_p_max_m,
        e_b_mean_deg=result.errors.e_b_mean_deg,
        captured=result.captured,
        gated=result.fixes["gated"],
    )


def _arms(plan: Plan) -> Iterator[tuple[Arm, Variant]]:
    return ((arm, variant) for arm in ARMS for variant in arm.variants if variant in plan.variants)


def _extended(row: Row, result: CellResult) -> Row:
    """A row with more runs; its means stay those of the first ones, which did not depend on what came out."""
    assert result.table is not None
    return replace(
        row,
        e_p_run_mean_m=row.e_p_run_mean_m + tuple(result.table.e_p_mean_m.tolist()),
        captured_run=row.captured_run + tuple(result.table.captured.tolist()),
    )


def fly_condition(condition: Condition, offset: float, plan: Plan) -> list[Row]:
    """Fly one condition with followers on all routes at a depth offset, and navigate each in every arm and variant.

    Arms whose verdict is open after a look are flown on to the next, unless even the last would hardly settle it.
    Fleets of this size are quickest: the price of a step grows faster than the number of vehicles.
    """
    trajectory = simulate_motion(fleet(condition, plan.routes, (offset,), plan.duration_s))
    rows = []
    for follower, route in enumerate(plan.routes):
        sensed = sense(pair(trajectory, follower), condition, route, offset, plan.duration_s)
        errors = errors_of(scenario(condition, route, offset, plan.duration_s))
        first = first_run(condition, route, offset)

        def fly(
            arm: Arm, variant: str, begin: int, end: int, sensed: Sensed = sensed,
            errors: SensorErrors = errors, first: int = first,
        ) -> CellResult:  # fmt: skip
            runs = range(first + begin, first + end)
            named = next(v for v in arm.variants if v == variant)
            return simulate(cell(sensed, errors, arm, named, runs), keep_runs=True)

        flown: dict[tuple[str, str], Row] = {
            (arm.key, variant): row_of(
                fly(arm, variant, 0, plan.runs),
                **sensed.facts,
                condition=condition.key,
                cause=condition.cause,
                route=route,
                depth_offset_m=offset,
                variant=variant,
                arm=arm.key,
            )
            for arm, variant in _arms(plan)
        }
        for look, further in zip(plan.looks, plan.looks[1:], strict=False):
            for (*_, variant), mission in paired(flown.values()).items():
                for key in undecided(mission, plan.looks, look):
                    more = fly(ARM[key], variant, look, further)
                    flown[key, variant] = _extended(flown[key, variant], more)
        for mission in paired(flown.values()).values():
            rows += with_verdicts(mission, plan.looks)
    return rows
