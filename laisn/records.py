"""Records whose arrays have the shapes that they say, and stay as they are."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt


def require_shapes(record: Any, expected: Mapping[str, tuple[int, ...]]) -> None:
    """ValueError naming the first array of a record, by its field, whose shape is not the expected one."""
    for name, shape in expected.items():
        given = getattr(record, name).shape
        if given != shape:
            raise ValueError(f"{type(record).__name__}.{name} has shape {given}, expected {shape}")


def _is_settled(array: npt.NDArray[Any]) -> bool:
    """Whether an array lies in one piece, and neither it nor what it is a part of can be written."""
    whole: Any = array
    while isinstance(whole, np.ndarray) and not whole.flags.writeable:
        whole = whole.base
    return whole is None and array.flags.forc


def own_arrays(record: Any) -> None:
    """Give a frozen record copies of the arrays that it was made of, which nobody can write.

    Whoever made it keeps arrays of its own: they stay writable, and writing them changes no record. An array that
    nobody can write any more, such as another record's, needs no copy. To be called from `__post_init__`.
    """
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray) and not _is_settled(value):
            # in the order of the given one, so that sums over it round alike
            own = value.copy(order="K")
            own.flags.writeable = False
            object.__setattr__(record, field.name, own)
