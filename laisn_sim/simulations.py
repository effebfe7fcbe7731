"""Missions that are stepped together from outside: what a `Simulation` gives as numbers of one
mission, these give as arrays of all, and their vehicles move side by side.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, Self, SupportsIndex, TypeGuard, overload

import numpy as np
import numpy.typing as npt

from experiments.campaign.progress import compiling_shown
from experiments.flight.library import as_scenario, table_of_changes
from laisn.arrays import Bools, Floats, Ints
from laisn.errors import LaisnError
from laisn.simd import LANES
from laisn.swarm import ESTIMATE, READING
from laisn_sim.simulation import (
    InstantNumbers,
    LastReception,
    Simulation,
    instants_of,
    last_reception,
)
from sim import attitude
from sim.custom_control import Belief, Command, Readings, Wrench, as_numbers
from sim.feasibility import engine_errors
from sim.flight import Termination
from sim.mission_group import MissionGroup
from sim.scenario.parts import MissionPlan, MotionSettings
from sim.scenario.settings import Scenario
from sim.simulation import DivergedError, Mission, navigation_error, new_mission
from sim.vehicle.solvers import Engine

Which = Sequence[int] | Sequence[bool] | Bools | Ints
"""Some of n missions: their indices, or n truth values."""


@dataclass(frozen=True, kw_only=True)
class VehicleTruths:
    """True states of a vehicle in each of n missions, at their instants."""

    position: Floats  # of the body's origin, east, north, up, shape (n, 3), [m]
    quaternion: Floats  # attitude from body to world, (w, x, y, z), shape (n, 4)
    velocity: Floats  # of the origin in the world, shape (n, 3), [m/s]
    angular_velocity: Floats  # in the body frame, shape (n, 3), [rad/s]
    water_velocity: Floats  # at the origin in the world, shape (n, 3), [m/s]
    effectors: Floats  # states of the effectors: thrust [N], revolutions [1/s], deflection [rad]

    @property
    def depth(self) -> Floats:
        """Of the origin, shape (n,), [m]."""
        return -self.position[:, 2]

    @property
    def heading(self) -> Floats:
        """Clockwise from north, in [0, 2π), shape (n,), [rad]."""
        return attitude.heading_pitch_roll(self.quaternion)[0]

    @property
    def pitch(self) -> Floats:
        """Positive nose up, shape (n,), [rad]."""
        return attitude.heading_pitch_roll(self.quaternion)[1]

    @property
    def roll(self) -> Floats:
        """Positive starboard down, shape (n,), [rad]."""
        return attitude.heading_pitch_roll(self.quaternion)[2]


def _engine_updates(motion: MotionSettings, named: Iterable[str]) -> dict[str, Engine]:
    """Changes of a table `timing` in which these keys are named: each hull's own equations of
    motion if no solver is and they hold.
    """
    if "engine" in named or motion.kind != "physics":
        return {}
    return {} if engine_errors(replace(motion, engine="direct")) else {"engine": "direct"}


def _indices(which: Which | None, count: int) -> list[int]:
    """Indices of missions as they are named; LaisnError if there are no such missions."""
    if which is None:
        return list(range(count))
    try:
        chosen = np.asarray(which)
    except ValueError:
        # lists of unlike lengths
        chosen = np.empty((0, 0))
    if chosen.dtype == np.bool_ and chosen.shape == (count,):
        return [int(i) for i in np.flatnonzero(chosen)]
    is_index = chosen.ndim == 1 and (chosen.dtype.kind in "iu" or chosen.size == 0)
    indices = [int(i) for i in chosen] if is_index else []
    if not is_index or any(not 0 <= i < count for i in indices):
        raise LaisnError(
            f"which is {which!r:.80}, expected indices below {count}, or {count} truth values"
        )
    if len(set(indices)) < len(indices):
        raise LaisnError(f"which is {which!r:.80}, expected indices of missions, each once")
    return indices


def _is_whole_number(value: object) -> TypeGuard[int]:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _listed(values: Any, name: str, expected: str) -> list[Any]:
    """Values of a list or a one-dimensional array; LaisnError if it is neither."""
    is_list = isinstance(values, Iterable) and not isinstance(values, str | bytes | Mapping)
    if not is_list or (isinstance(values, np.ndarray) and values.ndim != 1):
        raise LaisnError(f"{name} is {values!r:.80}, expected {expected}")
    return list(values)


def _tables(each: Any) -> list[Mapping[str, Any]]:
    """Changes of each of some missions; LaisnError if they are none."""
    tables = _listed(each, "each", "a list of tables of changes by dotted key")
    for i, table in enumerate(tables):
        if not isinstance(table, Mapping):
            raise LaisnError(
                f"each[{i}] is {table!r:.80}, expected a table of changes by dotted key"
            )
    return tables


def _require_one_for_each(values: Sequence[Any], name: str, count: int) -> None:
    if len(values) != count:
        raise LaisnError(
            f"{name} has {len(values)} values, expected one for each of {count} missions"
        )


def _for_each(value: Any, name: str, count: int) -> list[Any]:
    """A whole number or None for each of some missions, of one for all or one for each."""
    if value is None or _is_whole_number(value):
        return [value] * count
    values = _listed(value, name, f"a whole number, or one for each of {count} missions")
    _require_one_for_each(values, name, count)
    return values


def _hulls(plan: MissionPlan) -> tuple[object, ...]:
    """What names of vehicles and numbers of effectors follow from."""
    return plan.names, plan.models


@contextmanager
def _noting_mission(i: int) -> Iterator[None]:
    """Say in a note of an error which mission it is of."""
    try:
        yield
    except Exception as error:
        error.add_note(f"mission {i}")
        raise


def _require_same_vehicles(missions: Iterable[Mission]) -> None:
    """LaisnError if vehicles of missions differ in names or numbers of effectors, which arrays of
    all have in common.
    """
    effectors = {
        tuple(zip(mission.plant.names, map(len, mission.plant.effector_names), strict=True))
        for mission in missions
    }
    if len(effectors) > 1:
        raise LaisnError(
            "the missions' vehicles differ in names or numbers of effectors: "
            f"{' and '.join(map(str, sorted(effectors)[:2]))}; arrays of all need the same"
        )


class _Group(NamedTuple):
    """Up to eight missions, and how they move side by side; None: one after the other."""

    missions: list[Mission]
    together: MissionGroup | None

    @classmethod
    def of(cls, missions: list[Mission]) -> Self:
        try:
            return cls(missions, MissionGroup(missions))
        except ValueError:
            return cls(missions, None)


class Simulations(Sequence[Simulation]):
    """Missions of one kind that are stepped together from outside, for learning or batches.

    Each is a `Simulation`, with the motion, measurements and estimates that it has alone, to the
    bit, and can be looked at and commanded by itself. The vehicles of up to eight missions that
    differ in numbers alone move side by side in vector registers, and groups of eight on all cores.

    >>> import numpy as np
    >>> import laisn_sim
    >>> sims = laisn_sim.Simulations("T5", {"navigation.variant": "tight"}, count=16)
    >>> while sims.time.min() < 20.0:
    ...     heading = sims.readings["follower"].heading + 0.1
    ...     sims.command("follower", laisn_sim.Command(heading, 1.0, 10.0))
    ...     sims.step(1.0)
    >>> flight = sims[3].flight()
    """

    def __init__(
        self,
        source: str | Path | Mapping[str, Any] | Scenario,
        changes: Mapping[str, Any] | None = None,
        *,
        count: int | None = None,
        each: Sequence[Mapping[str, Any]] | None = None,
    ) -> None:
        """Set out on `count` missions of a scenario, or on one with each of the further changes of
        `each`; source, changes and errors are as of `load`.

        Mission i has the noise of run i after the scenario's, unless `each` names a `run`. Vehicles
        are moved by the solver "direct" if no `timing.engine` is named. LaisnError also if vehicles
        move as points, or the missions' vehicles have different names or numbers of effectors.
        """
        if count is not None and not _is_whole_number(count):
            raise LaisnError(f"count is {count!r:.80}, expected a whole number of missions")
        tables: list[Mapping[str, Any]] = [{}] * (1 if count is None else count)
        if each is not None:
            tables = _tables(each)
        if not tables or (count is not None and len(tables) != count):
            raise LaisnError(
                f"count is {count!r} and each has {len(tables)} tables, expected as many missions "
                "as tables, at least one"
            )
        self._sims: list[Simulation] = []
        with compiling_shown():
            for i, own in enumerate(tables):
                all_changes = {**table_of_changes(changes), **own}
                with _noting_mission(i):
                    scenario = as_scenario(source, all_changes)
                named = scenario.timing.model_fields_set
                updates = _engine_updates(MotionSettings.of(scenario), named)
                timing = scenario.timing.model_copy(update=updates)
                run = scenario.run + (0 if "run" in own else i)
                self._sims.append(
                    Simulation(scenario.model_copy(update={"timing": timing, "run": run}))
                )
        _require_same_vehicles(sim.mission for sim in self._sims)
        self._groups = [_Group([], None)] * -(-len(self._sims) // LANES)
        self._executors: dict[int, ThreadPoolExecutor] = {}
        self._numbers: InstantNumbers | None = None
        # missions and their numbers of instants that `_numbers` are of
        self._numbers_of: list[tuple[Mission, int]] = []
        self._has_stepped = False

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """LaisnError: see `Simulation`."""
        raise LaisnError("Simulations are neither copied nor pickled; make others, and step them")

    def __repr__(self) -> str:
        return f"<Simulations: {len(self)} of {self._sims[0].scenario.name!r}>"

    def __len__(self) -> int:
        return len(self._sims)

    @overload
    def __getitem__(self, index: int) -> Simulation: ...
    @overload
    def __getitem__(self, index: slice) -> list[Simulation]: ...
    def __getitem__(self, index: int | slice) -> Simulation | list[Simulation]:
        """A mission, to be looked at, commanded or asked for its flight by itself."""
        return self._sims[index]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the vehicles of each mission, the leader's first."""
        return self._sims[0].names

    @property
    def time(self) -> Floats:
        """Since the start of each mission, shape (n,), [s]."""
        return np.array([sim.time for sim in self._sims])

    @property
    def done(self) -> Bools:
        """Which missions are at their end, shape (n,)."""
        return np.array([sim.done for sim in self._sims])

    @property
    def outcomes(self) -> tuple[Termination, ...]:
        """How each mission ended; INTERRUPTED until it has."""
        return tuple(sim.outcome for sim in self._sims)

    def step(self, duration: float | None = None) -> Self:
        """Advance all missions that are not at their end, to the next control instant or by a
        duration [s], a multiple of 0.1 s, at most to the end of each.

        A mission that leaves finite numbers is over; `outcomes` says so. LaisnError if all missions
        are over or the duration is no positive multiple of 0.1 s; ArithmeticError naming a mission
        and a follower whose navigator failed, or what a part of a mission in Python raised with a
        note that names the mission, when all others are there.
        """
        instants = instants_of(duration)
        if self.done.all():
            raise LaisnError("all missions have ended")
        if self._has_stepped:
            self._step(instants)
            return self
        self._has_stepped = True
        with compiling_shown():
            self._step(instants)
        return self

    def _step(self, instants: int) -> None:
        ends = [-1 if sim.done else sim.end_of_step(instants) for sim in self._sims]
        failures: dict[int, Exception] = {}
        for failed in self._advance_groups(ends):
            failures |= failed
        for i, (sim, end) in enumerate(zip(self._sims, ends, strict=True)):
            if end < 0:
                continue
            try:
                # with a failure, only looked at whether it ended before that
                sim.advance(sim.mission.instants - 1 if i in failures else end)
                if sim.done:
                    failures.pop(i, None)
            except DivergedError:
                # its outcome says so
                continue
            except Exception as error:  # of parts in Python
                failures[i] = error
        for i, failure in sorted(failures.items()):
            if isinstance(failure, ArithmeticError):
                raise ArithmeticError(f"mission {i}: {failure}") from failure
            failure.add_note(f"mission {i}")
            raise failure

    @property
    def _threads(self) -> ThreadPoolExecutor:
        """Of this process: one that was forked off another has not got the threads of that."""
        process = os.getpid()
        if process not in self._executors:
            self._executors[process] = ThreadPoolExecutor(len(os.sched_getaffinity(0)))
        return self._executors[process]

    def _advance_groups(self, ends: Sequence[int]) -> list[dict[int, ArithmeticError]]:
        """Advance missions as far as they move side by side; what went wrong, by mission."""
        for number in range(len(self._groups)):
            self._form_group(number)
        if len(self._groups) == 1:
            return [self._advance_group(0, ends)]
        threads = self._threads
        running = [
            threads.submit(self._advance_group, number, ends) for number in range(len(self._groups))
        ]
        try:
            return [group.result() for group in running]
        finally:
            # no mission moves on after a step that was interrupted
            for group in running:
                group.cancel()
            wait(running)

    def _form_group(self, number: int) -> None:
        """Form a group of missions anew if one of them was set out anew."""
        missions = [sim.mission for sim in self._sims[number * LANES : (number + 1) * LANES]]
        if self._groups[number].missions != missions:
            self._groups[number] = _Group.of(missions)

    def _advance_group(self, number: int, ends: Sequence[int]) -> dict[int, ArithmeticError]:
        together = self._groups[number].together
        if together is None:
            return {}
        first = number * LANES
        failed = together.advance(ends[first : first + LANES])
        return {first + i: navigation_error(follower) for i, follower in failed.items()}

    def command(
        self,
        vehicle: str,
        command: Command | Wrench | Floats | None,
        which: Which | None = None,
    ) -> None:
        """Command a vehicle of all missions, or of those of `which`, from now on, as of
        `Simulation.command`.

        Each number of a `Command` or a `Wrench` may be an array of one for each of these missions,
        in the order of `which`; an array of states of the effectors has shape (m,), for all, or
        (missions, m). Where a command is refused, no mission is commanded.
        """
        indices = _indices(which, len(self))
        self._sims[0].require_command(vehicle, None)
        commands = self._commands(command, len(indices))
        for i, own in zip(indices, commands, strict=True):
            try:
                self._sims[i].require_command(vehicle, own)
            except LaisnError as error:
                raise LaisnError(f"mission {i}: {error}") from None
        for i, own in zip(indices, commands, strict=True):
            self._sims[i].take_command(vehicle, own)

    def _commands(
        self, command: Command | Wrench | Floats | None, count: int
    ) -> Sequence[Command | Wrench | Floats | None]:
        """Commands of each of some missions."""
        if command is None:
            return [None] * count
        rows = self._rows(command, count)
        if isinstance(command, np.ndarray):
            return list(rows)
        return [type(command)(*values) for values in rows.tolist()]

    @staticmethod
    def _rows(command: Command | Wrench | Floats, count: int) -> Floats:
        """Numbers of a command of each of some missions."""
        if isinstance(command, np.ndarray):
            parts: Sequence[Any] = [command]
            shape: tuple[int, ...] = (count, command.shape[-1] if command.ndim else 1)
        elif isinstance(command, Command | Wrench):
            parts = command
            shape = (count,)
        else:
            raise LaisnError(
                f"command {command!r:.80}; expected a Command, a Wrench, an array or None"
            )
        try:
            rows = [np.broadcast_to(as_numbers(part), shape) for part in parts]
        except (TypeError, ValueError):
            raise LaisnError(
                f"command {command!r:.80}; expected numbers, or arrays of {count}, one for each "
                "mission that is commanded"
            ) from None
        return rows[0] if isinstance(command, np.ndarray) else np.stack(rows, axis=1)

    def reset(
        self,
        which: Which | None = None,
        *,
        seed: int | Sequence[int] | Ints | None = None,
        run: int | Sequence[int] | Ints | None = None,
        each: Sequence[Mapping[str, Any]] | None = None,
    ) -> Self:
        """Set out anew on all missions, or on those of `which`, perhaps with the noise of other
        seeds or runs, one for all or one for each in the order of `which`, or with further changes
        of each.

        LaisnError as of `Simulations`; all missions are then as they were.
        """
        indices = _indices(which, len(self))
        count = len(indices)
        tables: Sequence[Mapping[str, Any] | None] = [None] * count
        if each is not None:
            tables = _tables(each)
            _require_one_for_each(tables, "each", count)
        values = zip(
            indices,
            _for_each(seed, "seed", count),
            _for_each(run, "run", count),
            tables,
            strict=True,
        )
        scenarios = {}
        for i, own_seed, own_run, changes in values:
            with _noting_mission(i):
                scenario = self._sims[i].scenario_anew(seed=own_seed, run=own_run, changes=changes)
            scenarios[i] = scenario
        present = {i: sim.scenario for i, sim in enumerate(self._sims)}
        chosen = [*(present | scenarios).values()]
        by_hulls = {_hulls(MissionPlan.of(scenario)): scenario for scenario in chosen}
        if len(by_hulls) > 1:
            _require_same_vehicles(map(new_mission, by_hulls.values()))
        for i, scenario in scenarios.items():
            with _noting_mission(i):
                self._sims[i].set_out(scenario)
        return self

    @property
    def _stacked(self) -> InstantNumbers:
        """Numbers of all missions, the missions along the first axis, to be copied."""
        present = [(sim.mission, sim.mission.instants) for sim in self._sims]
        if self._numbers is None or self._numbers_of != present:
            listed = [sim.numbers for sim in self._sims]
            self._numbers = InstantNumbers(*map(np.stack, zip(*listed, strict=True)))
            self._numbers_of = present
        return self._numbers

    @property
    def truth(self) -> dict[str, VehicleTruths]:
        """True states of all vehicles by name, as arrays of all missions."""
        numbers = self._stacked
        counts = map(len, self._sims[0].mission.plant.effector_names)
        return {
            name: VehicleTruths(
                position=numbers.pose[:, i, :3].copy(),
                quaternion=numbers.pose[:, i, 3:].copy(),
                velocity=numbers.twist[:, i, :3].copy(),
                angular_velocity=numbers.twist[:, i, 3:].copy(),
                water_velocity=numbers.water[:, i].copy(),
                effectors=numbers.effector_states[:, i, :effectors].copy(),
            )
            for i, (name, effectors) in enumerate(zip(self.names, counts, strict=True))
        }

    def _by_follower(self, numbers: Floats) -> dict[str, npt.NDArray[Any]]:
        return {name: numbers[:, i].copy() for i, name in enumerate(self.names[1:])}

    @property
    def readings(self) -> dict[str, Readings]:
        """What each follower's sensors read last by name: `Readings` of arrays of all missions.

        They hold no receptions, which `latest` has, and no readings of further sensors, which those
        of a single mission have.
        """
        readings = {}
        for name, numbers in self._by_follower(self._stacked.readings).items():
            time: Any = self.time
            reading: Any = numbers.view(READING)[:, 0]
            readings[name] = Readings(
                time=time,
                speed=reading["speed"],
                heading=reading["heading"],
                depth=reading["depth"],
                pitch=reading["pitch"],
                yaw_rate=reading["turning"],
                pitch_rate=reading["pitching"],
                heel=np.arcsin(np.clip(reading["heel"], -1.0, 1.0)),
                roll_rate=reading["rolling"],
                reception=None,
            )
        return readings

    @property
    def estimates(self) -> dict[str, Belief]:
        """What each follower's navigator believes by name, brought forward between filter steps:
        `Belief` of arrays of all missions.
        """
        beliefs = {}
        for name, numbers in self._by_follower(self._stacked.estimates).items():
            estimate: Any = numbers.view(ESTIMATE)[:, 0]
            beliefs[name] = Belief(
                east=estimate["position"][:, 0],
                north=estimate["position"][:, 1],
                east_velocity=estimate["velocity"][:, 0],
                north_velocity=estimate["velocity"][:, 1],
                log_bias=estimate["log_bias"],
                compass_bias=estimate["compass_bias"],
                east_current=estimate["current"][:, 0],
                north_current=estimate["current"][:, 1],
            )
        return beliefs

    @property
    def latest(self) -> dict[str, LastReception]:
        """What each follower has received last by name: arrays of all missions."""
        received = self._by_follower(self._stacked.received)
        return {name: last_reception(list(numbers.T)) for name, numbers in received.items()}
