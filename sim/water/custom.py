"""A current of the user's own, in Python: compiled code calls it by an address.

The class has `velocity(position, time)`, which gives the velocity of the water, east, north and
perhaps up [m/s], at a place, shape (3,), east, north and up [m], and a time [s]. Its gradient and
rate are central differences. A call takes some ten microseconds, nine evaluations, for each vehicle
and physics step.
"""

import ctypes
from typing import NamedTuple, NoReturn, Protocol, SupportsIndex

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import call_address, compiled
from laisn.errors import LaisnError
from laisn.held import refuse_copy
from laisn.plugins import calling, class_and_file
from sim.attitude import Vector
from sim.water.currents import NO_DRIFT, CurrentFlow, Drift

_FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
# steps of the differences: currents change over metres and seconds, and numbers have 16 digits
_STEP_M = 0.01
_STEP_S = 0.01
# where the memory of a `CustomCurrent` has what
_PLACE = slice(0, 3)
_TIME = 3
_VELOCITY = slice(4, 7)
_RATE = slice(7, 10)
_GRADIENT = slice(10, 19)
_SIZE = 19


class CustomInstant(NamedTuple):
    """A `CustomCurrent` at one time."""

    drift: Drift
    time: float  # [s]
    address: int  # as of `CustomCurrent`, as the next
    memory: Floats

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)

    @compiled
    def flow(self, position: Vector, velocity: Vector) -> CurrentFlow:
        """As of `sim.water.currents.ShearedInstant.flow`."""
        m = self.memory
        m[0], m[1], m[2] = position
        m[3] = self.time
        call_address(self.address, 0, 0)
        gradient = ((m[10], m[11], m[12]), (m[13], m[14], m[15]), (m[16], m[17], m[18]))
        x, y, z = velocity
        rate = (
            m[7] + m[10] * x + m[11] * y + m[12] * z,
            m[8] + m[13] * x + m[14] * y + m[15] * z,
            m[9] + m[16] * x + m[17] * y + m[18] * z,
        )
        return CurrentFlow((m[4], m[5], m[6]), rate, gradient)


class CustomCurrent(NamedTuple):
    """A current of the user's own as compiled code takes it."""

    address: int  # of a function that reads place and time from the memory, and writes the answer
    memory: Floats  # place, time; velocity, its rate at the place, its gradient; shape (19,)

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)

    @compiled
    def at_time(self, time: float) -> CustomInstant:
        """The current at a time [s]."""
        return CustomInstant(NO_DRIFT, time, self.address, self.memory)


class VelocityField(Protocol):
    """What a current of the user's own must have."""

    def velocity(self, position: Floats, time: float) -> object:
        """East, north and perhaps up [m/s] at a place, shape (3,), [m], and a time [s]."""


class CustomCaller:
    """Calls an object's `velocity` for compiled code, as long as it lives.

    Attributes:
        compiled_current: the current, for compiled code.
    """

    def __init__(self, current: VelocityField) -> None:
        self._current = current
        self._kind = class_and_file(current)
        self._memory = np.zeros(_SIZE)
        self._error: BaseException | None = None
        self._function = _FUNCTION(self._answer)
        address = ctypes.cast(self._function, ctypes.c_void_p).value
        assert address is not None  # of a function that is there
        self.compiled_current = CustomCurrent(address, self._memory)

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)

    def _velocity(self, position: Floats, time: float) -> Floats:
        with calling(f"current {self._kind}: velocity"):
            answer = self._current.velocity(position, time)
        try:
            velocity = np.array(answer, dtype=np.float64)
        except (TypeError, ValueError):
            velocity = np.empty(0)
        if velocity.shape == (2,):
            velocity = np.append(velocity, 0.0)
        if velocity.shape != (3,) or not np.isfinite(velocity).all():
            raise LaisnError(
                f"current {self._kind}: `velocity` gave {answer!r:.60} at {position.tolist()} m, "
                f"{time:g} s; expected two or three finite numbers, east, north and up [m/s]"
            )
        return velocity

    def _answer(self, _first: int, _second: int) -> None:
        """Called by compiled code, which no exception may pass: it is kept for `raise_error`."""
        memory = self._memory
        if self._error is not None:
            memory[_VELOCITY] = np.nan
            return
        try:
            position = memory[_PLACE].copy()
            time = float(memory[_TIME])
            memory[_VELOCITY] = self._velocity(position, time)
            memory[_RATE] = self._difference(position, time, np.zeros(3), _STEP_S) / (2.0 * _STEP_S)
            columns = [
                self._difference(position, time, step, 0.0) / (2.0 * _STEP_M)
                for step in _STEP_M * np.eye(3)
            ]
            memory[_GRADIENT] = np.column_stack(columns).ravel()
        except BaseException as error:  # also Ctrl-C, which has to reach the command
            self._error = error
            memory[_VELOCITY] = np.nan

    def _difference(self, position: Floats, time: float, step: Floats, dt: float) -> Floats:
        after = self._velocity(position + step, time + dt)
        return after - self._velocity(position - step, time - dt)

    def raise_error(self) -> None:
        """Raise what the user's code has raised, if it has."""
        error = self._error
        if error is not None:
            self._error = None
            raise error
