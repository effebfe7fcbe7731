"""What a core could do at best, against which the time of a filter's step is held."""

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.lanes import LANES
from laisn.vector_math import fma
from tools.benchmarks.row import least_time


@compiled
def _peak(values: Floats, repeats: int) -> None:
    for _ in range(repeats):
        for lane in range(LANES):
            x = values[lane]
            # Eight vectors of eight lanes hide the latency of a chain of eight fused operations.
            x = fma(fma(fma(fma(x, 0.5, 1.0), 0.5, 1.0), 0.5, 1.0), 0.5, 1.0)
            values[lane] = fma(fma(fma(fma(x, 0.5, 1.0), 0.5, 1.0), 0.5, 1.0), 0.5, 1.0)


def peak_flops() -> float:
    """Floating-point operations that one core does in a second, measured on fused multiply-adds.

    A measurement takes 0.05 s or more: processor time may be counted in ticks of some milliseconds.
    """
    values = np.ones(LANES)
    repeats = 10_000_000
    return 16 * LANES * repeats / least_time(lambda: _peak(values, repeats))
