"""Records handed to compiled code by Python, each as an array of one: such a call takes 1 µs, with records 30 µs."""

from typing import Any, TypeAlias

import numpy as np

from laisn.compiled import compiled
from laisn.tight import estimator, own_motion

ScalarRecord: TypeAlias = Any
"""A record as the only element of an array, shape (1,)."""


def scalar_record(record: Any) -> ScalarRecord:
    """A copy of a record, as an array of one; its element is a record over the same memory."""
    return np.array([record], dtype=record.dtype)


@compiled
def advance(b: ScalarRecord, m: ScalarRecord, speed: float, heading: float, dt: float) -> None:
    """`laisn.tight.own_motion.advance` of a belief."""
    own_motion.advance(b[0], m[0], speed, heading, dt)


@compiled
def moments(b: ScalarRecord, m: ScalarRecord) -> None:
    """`laisn.tight.own_motion.moments` of a belief."""
    own_motion.moments(b[0], m[0])


@compiled
def place_arms(heard: ScalarRecord, m: ScalarRecord, pitch: float, roll: float, deeper: float) -> None:
    """`laisn.tight.estimator.place_arms` of a message."""
    estimator.place_arms(heard[0], m[0], pitch, roll, deeper)


@compiled
def receive(b: ScalarRecord, m: ScalarRecord, heard: ScalarRecord) -> int:
    """`laisn.tight.estimator.receive` of a message."""
    return estimator.receive(b[0], m[0], heard[0])
