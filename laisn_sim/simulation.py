"""A mission that is stepped from outside: what happens is seen at each instant, and vehicles
take commands.
"""

from __future__ import annotations

import json
import weakref
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn, Self, SupportsIndex, cast

import numpy as np

from experiments.campaign.progress import compiling_shown
from experiments.flight.fly import OUTCOME_BY_ERROR
from experiments.flight.library import as_scenario, table_of_changes
from experiments.flight.results import Flight
from laisn.arrays import Floats, Records
from laisn.errors import LaisnError
from laisn.messages import LeaderMessage, Ranges, Reception
from laisn.swarm import ESTIMATE, READING
from reports.summary import flight_events, mirror_locked_steps, summarise
from sim import attitude
from sim.closed_loop import (
    AnyClosedLoop,
    ClosedLoopFlight,
    PythonClosedLoop,
    closed_loop_mission,
)
from sim.custom_control import (
    Belief,
    Command,
    Readings,
    Wrench,
    belief_of,
    readings_of,
    require_command,
)
from sim.flight import Termination
from sim.leader import LeaderUnit
from sim.log.writer import FlightLog
from sim.scenario.parts import MissionPlan, MotionSettings
from sim.scenario.settings import Scenario
from sim.simulation import (
    EFFECTOR_STATES,
    MOTION,
    NOTHING,
    TICK,
    WRENCH,
    DivergedError,
    EndedError,
    Mission,
    Observer,
    require_physics,
    require_regular_end,
)
from sim.tracking import bounds_of

if TYPE_CHECKING:
    from laisn_sim.live import LiveView

_LONGEST_PICTURE_S = 20.0  # longest time of the mission between two pictures of a live page
_SAME_TIME = 1e-6  # times no further apart are the same; they are sums of control steps [s]
_RECEIVED_NUMBERS = 1 + len(LeaderMessage._fields) + len(Ranges._fields)


def instants_of(duration: float | None) -> int:
    """How many control instants a step takes; LaisnError if its duration is none."""
    if duration is None:
        return 1
    instants = 0
    if isinstance(duration, int | float | np.integer | np.floating) and duration is not True:
        # whole numbers too large for a float are none either
        with suppress(OverflowError, ValueError):
            instants = round(float(duration) / TICK)
    if instants < 1 or abs(instants * TICK - duration) > _SAME_TIME:
        raise LaisnError(f"duration is {duration!r} s, expected a positive multiple of {TICK:g} s")
    return instants


def _interrupt_log(log: FlightLog, flight: ClosedLoopFlight) -> None:
    """End the log of a mission that is not over, if it has begun."""
    if not log.ended and flight.steps > 0:
        log.finish(flight, Termination.INTERRUPTED)


@dataclass(frozen=True, kw_only=True)
class VehicleTruth:
    """True state of a vehicle at an instant."""

    position: Floats  # of the body's origin, east, north, up, shape (3,), [m]
    quaternion: Floats  # attitude from body to world, (w, x, y, z), shape (4,)
    velocity: Floats  # of the origin in the world, shape (3,), [m/s]
    angular_velocity: Floats  # in the body frame, shape (3,), [rad/s]
    water_velocity: Floats  # at the origin in the world, shape (3,), [m/s]
    effectors: Floats  # states of the effectors: thrust [N], revolutions [1/s], deflection [rad]

    @property
    def depth(self) -> float:
        """Of the origin [m]."""
        return -float(self.position[2])

    @property
    def heading(self) -> float:
        """Clockwise from north, in [0, 2π) [rad]."""
        return float(attitude.heading_of(self.quaternion.tolist()))

    @property
    def pitch(self) -> float:
        """Positive nose up [rad]."""
        return float(attitude.pitch_of(self.quaternion.tolist()))

    @property
    def roll(self) -> float:
        """Positive starboard down [rad]."""
        return float(attitude.roll_of(self.quaternion.tolist()))


class LastReception(NamedTuple):
    """What a follower has received last on the link that it navigates on; NaN before the first."""

    time: Any  # when it was in, since the start [s]
    message: LeaderMessage
    ranges: Ranges


class InstantNumbers(NamedTuple):
    """What a mission of v vehicles and f followers is at, in numbers."""

    pose: Floats  # as of `StateHistory`, shape (v, 7), as the next
    twist: Floats
    water: Floats
    effector_states: Floats
    readings: Floats  # records of READING as numbers, shape (f, 8)
    estimates: Floats  # records of ESTIMATE as numbers, shape (f, 11)
    # time, `LeaderMessage` and `Ranges` of the last reception, shape (f, 14)
    received: Floats


def last_reception(numbers: Sequence[Any]) -> LastReception:
    """A reception of its numbers, time, message and ranges in order, or of arrays of them."""
    time, *content = numbers
    fields = len(LeaderMessage._fields)
    return LastReception(time, LeaderMessage(*content[:fields]), Ranges(*content[fields:]))


class Simulation:
    """A mission under way, from its first instant to its end, every 0.1 s.

    All followers sense and navigate under way. What their navigators conclude is what a `flight`
    shows; it is the flight that `laisn_sim.fly` gives where no vehicle was commanded.

    >>> import laisn_sim
    >>> sim = laisn_sim.Simulation("T5", {"navigation.variant": "tight"})
    >>> while sim.time < 30.0:
    ...     sim.step()
    >>> sim.command("leader", laisn_sim.Command(heading=0.0, speed=0.8, depth=6.0))
    >>> sim.step(20.0)
    >>> flight = sim.flight()
    """

    def __init__(
        self,
        source: str | Path | Mapping[str, Any] | Scenario,
        changes: Mapping[str, Any] | None = None,
        *,
        observers: Iterable[Observer] | Observer = (),
        live: bool | float | LiveView = False,
        log: str | Path | None = None,
    ) -> None:
        """Set out on a scenario's mission; source, changes and errors are as of `load`.

        `observers` are functions or objects, or a single one, that are called with each `Block` of
        instants as soon as they are over, each instant once: `step(30.0)` calls them once with a
        block of 30 s, and with `live` at each picture of its page. LaisnError also if vehicles move
        as points.

        `live` shows the mission on a page of this machine, `live.address`: True at ten times its
        time, a number at that many seconds a second, inf as fast as it can. `step` then returns
        when its time has come, and waits while the page pauses the mission.

        `log`: path of an MCAP log, written during the mission as `NAME.partial` (which `laisn log
        recover` reads) and given its end and name at the end of the mission, by `close`, or when
        the process ends.
        """
        self._observers = [observers] if callable(observers) else list(observers)
        for observer in self._observers:
            if not callable(observer):
                raise LaisnError(
                    "observers: expected functions, or objects that can be called (given: "
                    f"{observer!r:.80})"
                )
        self._log_path = None if log is None else Path(log)
        self.live: LiveView | None = None
        if live is not False:
            # pages take long to load
            from laisn_sim.live import live_view

            self.live = live_view(live)
        self._log: FlightLog | None = None
        with compiling_shown():
            self.set_out(as_scenario(source, changes))

    def set_out(self, scenario: Scenario) -> None:
        """Set out anew on the mission of a scenario, as of `scenario_anew`; LaisnError, and nothing
        has changed, if it cannot be controlled from outside.
        """
        mission = closed_loop_mission(scenario)
        loop = cast(AnyClosedLoop, mission.controller)
        # `readings` hold it of all vehicles
        loop.state.reads_roll[:] = True
        commands = mission.take_commands()
        estimates = np.asarray(loop.state.estimates).view(np.float64)
        seen = mission.keep_instants(
            loop.state.reading_values, estimates.reshape(len(loop.state.estimates), -1)
        )
        mission.advance(0)
        self._end_log()
        self.scenario = scenario
        self._mission = mission
        self._loop = loop
        self._commands = commands
        self._seen = seen
        self._outcome = Termination.INTERRUPTED
        # floor, areas and routes that end the mission if a vehicle leaves them
        self._bounds = bounds_of(MotionSettings.of(scenario))
        # what was flown until now, which grows with the mission
        self._flown = ClosedLoopFlight(scenario, mission)
        mission.observers = self._observers
        if self._log_path is not None:
            self._log = FlightLog(self._log_path)
            mission.observers = [self._write_log, *self._observers]
            # without a reference to this object
            self._at_exit = weakref.finalize(self, _interrupt_log, self._log, self._flown)
        if self.live:
            self.live.begin(MissionPlan.of(scenario))

    def _write_log(self, _: object) -> None:
        if self._log is not None and not self._log.ended:
            self._log.update(self._flown)

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """LaisnError: a copy would go on in the memory of this mission."""
        raise LaisnError(
            "a Simulation is neither copied nor pickled; to branch, make a second one of the same "
            "scenario and step it with the same commands: it is equal to the bit"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the log, and serve no page any more."""
        self.close()

    def close(self) -> None:
        """End the log, if there is one, with what was flown until now, and serve no page any more.
        Nothing later is logged.
        """
        self._end_log()
        if self.live:
            self.live.close()

    def _end_log(self) -> None:
        if self._log is None or self._log.ended or self._flown.steps < 1:
            return
        if not self.done:
            _interrupt_log(self._log, self._flown)
            return
        flight = self.flight()
        summary = json.dumps(summarise(flight), indent=2, allow_nan=False) + "\n"
        events = flight_events(flight)
        self._log.finish(self._flown, self.outcome, summary=summary, events=events)

    def __repr__(self) -> str:
        vehicles = len(self.names)
        return f"<Simulation {self.scenario.name!r}: {self.time:g} s, vehicles: {vehicles}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Of the vehicles, the leader's first."""
        return self._mission.plant.names

    @property
    def _instant(self) -> int:
        """Index of the latest control instant, 0 at the start."""
        return self._mission.instants - 1

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return round(self._instant * TICK, 6)

    @property
    def done(self) -> bool:
        """Whether the mission is at its end; `outcome` says how."""
        return self.outcome is not Termination.INTERRUPTED

    @property
    def outcome(self) -> Termination:
        """How the mission ended; INTERRUPTED until it has."""
        if self._outcome is Termination.INTERRUPTED and self._instant >= self._mission.last:
            return Termination.COMPLETED
        return self._outcome

    def step(self, duration: float | None = None) -> Self:
        """Advance to the next control instant, or by a duration [s], a multiple of 0.1 s, at most
        to the end of the mission.

        LaisnError if the mission is over or the duration is no positive multiple of 0.1 s;
        DivergedError if the simulation left finite numbers; ArithmeticError naming a follower whose
        navigator failed.
        """
        if self.done:
            raise LaisnError(f"the mission has ended at {self.time:g} s: {self.outcome.value}")
        end = self.end_of_step(instants_of(duration))
        while self._instant < end and not self.done:
            self.advance(min(end, self._instant + self._instants_of_picture))
            self._show_live()
        if self.outcome is not Termination.INTERRUPTED:
            self._end_log()
        return self

    @property
    def _instants_of_picture(self) -> int:
        """Instants from one picture of a live page to the next."""
        if self.live is None:
            return self._mission.last + 1
        return max(1, round(min(self.live.span, _LONGEST_PICTURE_S) / TICK))

    def _show_live(self) -> None:
        if self.live is None or self._instant < self._loop.state.sensors.stride:
            return
        if self.done:
            self.finish_live(self.flight())
            return
        if self.live.is_due:
            self.live.show(self.flight())
        self.live.wait(self.time)

    def finish_live(self, flight: Flight) -> None:
        """Show on the live page that the mission is over with a flight."""
        if self.live is None:
            return
        locks = [mirror_locked_steps(flight, i) for i in range(len(flight.estimates))]
        self.live.finish(flight, flight_events(flight), locks)

    @property
    def mission(self) -> Mission:
        """What is flown, for those who advance it elsewhere (`laisn_sim.simulations`)."""
        return self._mission

    def end_of_step(self, instants: int) -> int:
        """The last instant of a step of so many, at most that of the mission."""
        return min(self._instant + instants, self._mission.last)

    def advance(self, end: int) -> None:
        """Advance until an instant, or the end of the mission; errors as of `step`."""
        ends_on_contact = self.scenario.contact == "end"
        try:
            if self._mission.advance_within(
                end, until_contact=ends_on_contact, bounds=self._bounds
            ):
                require_regular_end(
                    self._mission.trajectory(), self._bounds, ends_on_contact=ends_on_contact
                )
        except DivergedError as error:
            self._outcome = Termination.DIVERGED
            self._mission.instants = error.trajectory.time.size
            raise
        except EndedError as error:
            self._outcome = OUTCOME_BY_ERROR[type(error)]
            self._mission.instants = error.trajectory.time.size

    def command(
        self, vehicle: str, command: Command | Wrench | tuple[float, float, float] | Floats | None
    ) -> None:
        """Command a vehicle from now on, until another command; its own controller is not asked.

        Args:
            vehicle: its name: "leader", or that of a follower.
            command: heading [rad], speed through the water [m/s] and depth [m], which an autopilot
                with true readings holds; a `Wrench` about the hull's axes; states of all effectors
                in the order of the hull's actuators, shape (m,), each in the unit of its kind: N,
                revolutions per second [1/s], rad, or that of its curve; or None: the vehicle is the
                scenario's again, and goes on along its route or to its station.

        Raises:
            LaisnError: there is no such vehicle, or the command is not one that a vehicle can be
                given.
        """
        self.require_command(vehicle, command)
        self.take_command(vehicle, command)

    def require_command(self, vehicle: str, command: object) -> None:
        """LaisnError as of `command`."""
        if vehicle not in self.names:
            raise LaisnError(f"vehicle {vehicle!r:.80}: expected one of {', '.join(self.names)}")
        if command is not None:
            effectors = len(self._mission.plant.effector_names[self.names.index(vehicle)])
            require_command(command, effectors, f"command of {vehicle}:")

    def take_command(
        self, vehicle: str, command: Command | Wrench | tuple[float, float, float] | Floats | None
    ) -> None:
        """Command a vehicle as `require_command` demands."""
        index = self.names.index(vehicle)
        outside = self._commands
        # guidance begins anew where control changes hands, and after a wrench or states of
        # effectors, which it does not follow
        outside.begins[index] |= command is None or outside.kind[index] != MOTION
        self._mission.routes.commanded_from_outside[index] = command is not None
        if command is None:
            outside.kind[index] = NOTHING
            return
        if isinstance(command, Wrench):
            outside.kind[index] = WRENCH
        elif isinstance(command, np.ndarray):
            outside.kind[index] = EFFECTOR_STATES
        else:
            outside.kind[index] = MOTION
        outside.values[index, : len(command)] = command
        # whoever commands it may lead it off its route
        routes = list(self._bounds.routes)
        routes[index] = None
        self._bounds = self._bounds._replace(routes=tuple(routes))

    @property
    def truth(self) -> dict[str, VehicleTruth]:
        """True states of all vehicles by name."""
        k = self._instant
        truth = self._mission.truth
        states = {}
        for i, name in enumerate(self.names):
            effectors = len(self._mission.plant.effector_names[i])
            states[name] = VehicleTruth(
                position=truth.pose[k, i, :3].copy(),
                quaternion=truth.pose[k, i, 3:].copy(),
                velocity=truth.twist[k, i, :3].copy(),
                angular_velocity=truth.twist[k, i, 3:].copy(),
                water_velocity=truth.water[k, i].copy(),
                effectors=truth.effector_states[k, i, :effectors].copy(),
            )
        return states

    def _custom_readings(self, follower: int) -> dict[str, Floats]:
        if isinstance(self._loop, PythonClosedLoop):
            return dict(self._loop.latest_custom[follower])
        return {}

    @property
    def _leader(self) -> LeaderUnit | None:
        """The leader, if it senses under way."""
        return self._loop.leader if isinstance(self._loop, PythonClosedLoop) else None

    @property
    def _is_filter_step(self) -> bool:
        return self._instant > 0 and self._instant % self._loop.state.sensors.stride == 0

    def _further_receptions(self, follower: int) -> dict[str, Reception]:
        """What is in of links beside the main one at this instant by name."""
        if not (self._is_filter_step and isinstance(self._loop, PythonClosedLoop)):
            return {}
        received = self._loop.receptions(follower)
        received.pop(self.scenario.navigation_of(follower).link, None)
        return received

    @property
    def receptions(self) -> dict[str, Reception | None]:
        """By vehicle, what it has received at this instant on the link that it navigates on; None:
        nothing. The leader is among them if it senses under way.
        """
        is_due = self._is_filter_step
        receptions: dict[str, Reception | None] = {}
        if self._leader is not None:
            receptions["leader"] = self._leader.receptions()[0] if is_due else None
        for i, name in enumerate(self.names[1:]):
            receptions[name] = None
            if is_due and isinstance(self._loop, PythonClosedLoop):
                main = self.scenario.navigation_of(i).link
                receptions[name] = self._loop.receptions(i).get(main)
            elif is_due:
                last = self._last_received(i).tolist()
                if last[0] == self.time:
                    receptions[name] = Reception(*last_reception(last)[1:])
        return receptions

    def _last_received(self, follower: int) -> Floats:
        """Numbers of a `LastReception`, shape (14,)."""
        measured = self._loop.state.measured
        if isinstance(self._loop, PythonClosedLoop):
            measured = self._loop.hearing_on(self._loop.group_of(follower).link).measured
        numbers = np.full(_RECEIVED_NUMBERS, np.nan)
        # compiled loops may have gone on beyond the end of the mission
        steps = self._instant // self._loop.state.sensors.stride
        last = measured.within(follower, steps).stop - 1
        if last >= 0:
            step = int(measured.message_step[follower, last])
            numbers[0] = round(step * self.scenario.timing.filter_step_s, 6)
            numbers[1:-3] = measured.message[follower, last]
            numbers[-3:] = measured.ranges[follower, last]
        return numbers

    @property
    def latest(self) -> dict[str, LastReception]:
        """What each follower has received last by name, whenever that was."""
        return {
            name: last_reception(self._last_received(i).tolist())
            for i, name in enumerate(self.names[1:])
        }

    @property
    def numbers(self) -> InstantNumbers:
        """All numbers of the present instant, not to be written to."""
        k = self._instant
        truth = self._mission.truth
        return InstantNumbers(
            pose=truth.pose[k],
            twist=truth.twist[k],
            water=truth.water[k],
            effector_states=truth.effector_states[k],
            readings=self._seen.readings_at[k],
            estimates=self._seen.estimates_at[k],
            received=np.array([self._last_received(i) for i in range(len(self.names) - 1)]),
        )

    @property
    def readings(self) -> dict[str, Readings]:
        """What each vehicle's sensors read last by name, of the leader if it senses under way;
        `receptions` in it are of links beside the one that is navigated on.
        """
        receptions = self.receptions
        readings: dict[str, Readings] = {}
        leader = self._leader
        if leader is not None:
            further = leader.receptions()[1] if self._is_filter_step else {}
            received = receptions["leader"]
            custom = dict(leader.latest_custom)
            readings["leader"] = readings_of(
                self.time, leader.reading[0], received, custom, further
            )
        rows: Records = self._seen.readings_at[self._instant].view(READING)[:, 0].view(np.recarray)
        for i, name in enumerate(self.names[1:]):
            row = rows[i]
            custom = self._custom_readings(i)
            further = self._further_receptions(i)
            readings[name] = readings_of(self.time, row, receptions[name], custom, further)
        return readings

    @property
    def estimates(self) -> dict[str, Belief]:
        """What each vehicle's navigator believes by name, brought forward between filter steps; of
        the leader if it senses under way.
        """
        estimates: dict[str, Belief] = {}
        if self._leader is not None:
            estimates["leader"] = belief_of(self._leader.estimate[0])
        rows: Records = self._seen.estimates_at[self._instant].view(ESTIMATE)[:, 0]
        rows = rows.view(np.recarray)
        for i, name in enumerate(self.names[1:]):
            estimates[name] = belief_of(rows[i])
        return estimates

    def reset(
        self,
        *,
        seed: int | None = None,
        run: int | None = None,
        changes: Mapping[str, Any] | None = None,
    ) -> Self:
        """Set out anew, perhaps with the noise of another seed or run, or further changes of the
        scenario by dotted key, which later resets keep; commands are forgotten.

        A log begins anew as well, and takes the place of the one before. LaisnError as of `load`,
        and if vehicles move as points: the mission is then as it was.
        """
        self.set_out(self.scenario_anew(seed=seed, run=run, changes=changes))
        return self

    def scenario_anew(
        self,
        *,
        seed: int | None = None,
        run: int | None = None,
        changes: Mapping[str, Any] | None = None,
    ) -> Scenario:
        """What `reset` sets out on, by its arguments; nothing has changed yet."""
        scenario = self.scenario
        noise = {"seed": seed, "run": run}
        changed = {key: value for key, value in noise.items() if value is not None}
        if changed or changes:
            scenario = as_scenario(scenario, {**table_of_changes(changes), **changed})
        require_physics(scenario.name, scenario.motion)
        return scenario

    def flight(self) -> Flight:
        """The flight until now, with a plot and a report, as `laisn_sim.fly` gives it.

        LaisnError before the first filter step.
        """
        if self._instant < self._loop.state.sensors.stride:
            raise LaisnError("there is no flight yet: no filter step is over")
        trajectory = self._mission.trajectory()
        flight = self._flown.flight(trajectory, self.outcome)
        # the same fields, with plot and report
        return Flight(**vars(flight))
