"""Flying the missions of the pitch study: what each cause of pitch does to followers, and what each remedy is worth.

A condition is flown with followers on all routes in the water at once. Each of them then navigates many times with the
same noise behind the leader as it moved (real) and behind one that kept level, and with every remedy. What differs
between two arms of a mission is therefore the pitch, or the remedy, and nothing else. No two missions share noise.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from experiments.asymmetry.added_error import paired, undecided, with_verdicts
from experiments.asymmetry.conditions import Condition, fleet
from experiments.asymmetry.missions import Pair, Plan, Row, pair
from experiments.asymmetry.remedies import ARMS, Arm
from experiments.campaign.cells import PERCENTILES, Cell, CellResult
from experiments.campaign.montecarlo import simulate
from laisn.settings import Variant
from sim.motion import simulate_motion


def cell(mission: Pair, arm: Arm, variant: Variant, runs: int) -> Cell:
    """The first runs of one arm and variant of a mission."""
    told = {**arm.settings, "navigation.variant": variant}
    if arm.expect_pitch:
        told["navigation.expected_pitch_deg"] = mission.facts["pitch_rms_deg"]
    numbers = range(mission.first_run, mission.first_run + runs)
    return Cell.of(mission.scenario(told), 0, numbers, mission=mission.level if arm.leader == "level" else mission.real)


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
        mission = pair(trajectory, follower, condition, route, offset)
        cells: dict[tuple[str, str], Cell] = {
            (arm.key, variant): cell(mission, arm, variant, plan.runs) for arm, variant in _arms(plan)
        }
        flown = {
            (arm, variant): row_of(
                simulate(told, keep_runs=True),
                **mission.facts,
                condition=condition.key,
                cause=condition.cause,
                route=route,
                depth_offset_m=offset,
                variant=variant,
                arm=arm,
            )
            for (arm, variant), told in cells.items()
        }
        for look, further in zip(plan.looks, plan.looks[1:], strict=False):
            runs = range(mission.first_run + look, mission.first_run + further)
            for (*_, variant), compared in paired(flown.values()).items():
                for arm in undecided(compared, plan.looks, look):
                    more = simulate(replace(cells[arm, variant], runs=runs), keep_runs=True)
                    flown[arm, variant] = _extended(flown[arm, variant], more)
        for compared in paired(flown.values()).values():
            rows += with_verdicts(compared, plan.looks)
    return rows
