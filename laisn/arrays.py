"""Names of the array types that this project annotates with (docstrings give shapes), and records with named fields."""

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Record = Any
"""One record of a structured dtype, whose fields are attributes."""
Records = Any
"""An array of them."""


def records(dtype: npt.DTypeLike, *shape: int) -> Records:
    """Records of a structured dtype, all zero."""
    return np.zeros(shape, dtype).view(np.recarray)
