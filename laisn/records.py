"""Records whose arrays stay as they are."""

from dataclasses import fields
from typing import Any

import numpy as np


def own_arrays(record: Any) -> None:
    """Give a frozen record copies of the arrays that it was made of, which nobody can write.

    Whoever made it keeps arrays of its own: they stay writable, and writing them changes no record. To be called from
    `__post_init__`.
    """
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.ndarray):
            # in the order of the given one, so that sums over it round alike
            own = value.copy(order="K")
            own.flags.writeable = False
            object.__setattr__(record, field.name, own)
