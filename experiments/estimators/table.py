"""The comparison as a table: `python -m experiments.estimators.table [CASE …] [--runs 60] [--seed 11]`."""

import argparse

import numpy as np

from experiments.estimators.cases import CASES
from experiments.estimators.paired import Paired, compare

ROUTES = ("T2", "T3", "T4", "T5", "T6", "T7", "T8", "T9")
INTERVALS = (1.0, 5.0)


def line(results: list[Paired]) -> str:
    """One line for each route, then the median and the worst ratio."""
    lines = [
        f"  {r.route} {r.interval:g} s: E_P {r.tight_mean:.3f} m, LAISN-2 {r.laisn_mean:.3f} m, ratio {r.ratio:.3f}; "
        f"RMS {r.tight_rms:.3f} m" + ("" if np.isnan(r.bound_rms) else f" = {r.tight_rms / r.bound_rms:.2f} × bound")
        + f"; largest {r.tight_max:.1f} m; NEES {r.nees:.2f}; captured {r.tight_captured}, LAISN-2 {r.laisn_captured} "
        f"of {r.runs}"
        for r in results
    ]  # fmt: skip
    ratios = [r.ratio for r in results]
    return "\n".join([*lines, f"  median ratio {np.median(ratios):.3f}, worst {max(ratios):.3f}"])


def main() -> None:
    """Print the comparison of the cases named on the command line, or of all of them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("cases", nargs="*", help="G1 … G7; all if none is named")
    parser.add_argument("--routes", nargs="*", default=list(ROUTES))
    parser.add_argument("--intervals", nargs="*", type=float, default=list(INTERVALS), help="between messages [s]")
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=11)
    given = parser.parse_args()
    for case in CASES:
        if given.cases and case.name not in given.cases:
            continue
        for interval in given.intervals:
            print(f"{case.name}: {case.title}; messages every {interval:g} s, seed {given.seed}", flush=True)
            results = [compare(case, route, interval, runs=given.runs, seed=given.seed) for route in given.routes]
            print(line(results), flush=True)


if __name__ == "__main__":
    main()
