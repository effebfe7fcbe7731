"""All studies of which documents quote numbers: `make studies` computes them again and keeps their
records in the docs.

`python -m tools.documents.studies NAME …` flies some of them, and with `--resume` goes on with
those that were interrupted, if the sources are the same.
"""

import argparse
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

from experiments.study.study import run as run_study
from reports.findings import RESULTS_FILE
from tools.documents import (
    benchmark_navigators,
    bending,
    claim_seeds,
    coverage,
    flights,
    hull_trials,
    real_ranges,
    route_keeping,
    tight_limits,
    vehicle_missions,
)
from tools.documents.markers import RECORDS

POINT_MOTION = {"set": {"motion": "kinematic", "followers.0.depth_m": 8.0}}
"""The paper's point motion, at the depth of the leader."""
STUDIES: dict[str, Callable[[Path], object]] = {
    "flights": flights.run,
    "hull-trials": hull_trials.run,
    "vehicle-missions": vehicle_missions.run,
    "route-keeping": route_keeping.run,
    "coverage": coverage.run,
    "reproduce-physics": partial(run_study, "reproduce", {}),
    "reproduce-kinematic": partial(run_study, "reproduce", POINT_MOTION),
    "claim-seeds": claim_seeds.run,
    "closed-loop": partial(run_study, "closed-loop", {}),
    "formation": partial(run_study, "formation", {}),
    "asymmetry": partial(run_study, "asymmetry", {}),
    "estimators": partial(run_study, "estimators", {}),
    "tight-limits": tight_limits.run,
    "real-ranges": real_ranges.run,
    "rivals": partial(run_study, "rivals", {}),
    "benchmark": benchmark_navigators.run,
    "bending": bending.run,
    "thermocline": partial(run_study, "thermocline", {}),
    "front": partial(run_study, "front", {}),
}
"""Function that flies each study into the folder it is given."""


def main() -> None:
    """Fly the studies named on the command line, or all of them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    # argparse checks the default of `*`, [], against choices too
    parser.add_argument(
        "names", nargs="*", choices=[*STUDIES, []], help="studies; all if none is named"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on with what these sources have computed"
    )
    options = parser.parse_args()
    for name in options.names or STUDIES:
        print(f"{name} …", flush=True)
        # of its own, and empty: nothing that was computed before may stand in for what is computed
        # now
        folder = Path("out") / "studies" / name
        if not options.resume:
            shutil.rmtree(folder, ignore_errors=True)
        STUDIES[name](folder)
        RECORDS.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(folder / RESULTS_FILE, RECORDS / f"{name}.json")


if __name__ == "__main__":
    main()
