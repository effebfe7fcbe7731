"""Cells of a study from records by arm, run and row: a follower or a route."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.study.run import Cells


def cells_of(arms: Mapping[str, Sequence[Sequence[Mapping[str, Any]]]]) -> Cells:
    """Cells whose records are given by arm, run and row."""
    rows, run_arrays = [], []
    for arm, runs in arms.items():
        for i in range(len(runs[0])):
            rows.append({"arm": arm})
            columns = {name: [run[i][name] for run in runs] for name in runs[0][i]}
            run_arrays.append(columns | {"run": np.arange(len(runs))})
    return Cells(rows, run_arrays)
