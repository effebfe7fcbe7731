"""Cells of a study from records by run and place."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.study.run import Cells


def cells_of(arms: Mapping[str, Sequence[Sequence[Mapping[str, Any]]]]) -> Cells:
    """Cells whose records are given by arm, run and place."""
    rows, lists = [], []
    for arm, runs in arms.items():
        for i in range(len(runs[0])):
            rows.append({"arm": arm})
            each = {name: [run[i][name] for run in runs] for name in runs[0][i]}
            lists.append(each | {"run": np.arange(len(runs))})
    return Cells(rows, lists)
