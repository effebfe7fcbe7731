"""What a follower measures of a motion that goes on, stretch after stretch.

The numbers are those that `observe` and `measure` give of the finished mission, to the bit.
"""

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.messages import SensorHeader
from laisn.spilled import spillable_zeros
from sim.attitude import body_point_in_world
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing import acoustics, noise, sensors
from sim.sensing.links import navigated_link
from sim.sensing.measurement_record import MeasurementRecord
from sim.sensing.noise import Address
from sim.sensing.observation import (
    LONG_MISSION_INSTANTS,
    Span,
    new_receptions,
    read_steps,
    read_steps_compiled,
    sense_steps,
    sense_steps_compiled,
)
from sim.sensing.reception import new_inbox
from sim.sensing.sensor import SensorDriver, VehicleState
from sim.sensing.sensor_model import sensor_model_of
from sim.trajectory import StateHistory, Trajectory
from sim.water.rays import Path


class SenderMotion:
    """The motion of a mission with the sender of a link as its first vehicle, and where its
    transmitters are.
    """

    def __init__(self, sensing: SensingSettings, at_start: Trajectory, truth: StateHistory) -> None:
        """Before its first instant, of the link that `sensing` navigates on; `at_start` has the
        sites of the vehicles, `truth` is the room for their motion.
        """
        self.link = navigated_link(sensing.links)
        self.motion_at_start = at_start if self.link is None else self.link.motion_of(at_start)
        n, v, _ = truth.pose.shape
        self.truth = truth if self.link is None else StateHistory.empty(n, v, 0)
        self._senses_acceleration = (
            sensing.broadcast_attitude and sensing.sensors.leader_attitude_senses_acceleration
        )
        self._tilt_gain = sensors.complementary_filter_gain(sensing.sensors)
        # what accelerations add to the sender's measured pitch and roll at each instant [rad]
        self.tilts = spillable_zeros((n, 2))
        self.tilts[:] = 0.0 if sensing.broadcast_attitude else np.nan
        self._instants = 0  # how many are taken over

    def advance(self, truth: StateHistory, last: int) -> None:
        """Take over the instants of a motion until the one with this index."""
        first = self._instants
        self._instants = last + 1
        if self.link is not None:
            self.link.copy_instants(truth, first, last, self.truth)
        if self._senses_acceleration:
            pose = self.truth.pose[:, 0]
            twist = self.truth.twist[:, 0]
            for k in range(max(first, 1), last + 1):
                sensors.update_tilt_error(self._tilt_gain, k, pose, twist, self.tilts)


class FollowerSensing:
    """What one follower measures, as far as it is sensed."""

    def __init__(
        self,
        sensing: SensingSettings,
        follower: int,
        sender: SenderMotion,
        transmitters: int,
        record: MeasurementRecord,
    ) -> None:
        """Nothing is sensed yet; `transmitters` is N_T, how many of the sender's it uses."""
        link = sender.link
        at_start = sender.motion_at_start
        self._follower = follower
        self._sender = sender
        self._record = record
        self._model = sensor_model_of(sensing, link)
        self._errors = sensors.errors_of(sensing, follower, link)
        self._hidden = None if link is None else link.hidden
        self._hears = link is None or link.hears(follower)
        self._transmitters = 3 if link is None else link.transmitters
        self._transmitters_and_dt = (min(transmitters, self._transmitters), self._model.dt)
        seed, run = noise.seed_and_run(sensing.seed, sensing.run)
        self._address = Address(seed, run, follower, 0)
        hydrophones = [f"{name}/hydrophone" for name in at_start.names[1:]]
        depth_sensor = f"{at_start.names[follower + 1]}/depth_sensor"
        names = (*acoustics.TRANSMITTERS, *hydrophones, depth_sensor)
        self._offset = at_start.site_offset[[at_start.site(name) for name in names]]
        n = len(sender.tilts)
        steps = (n - 1) // self._model.stride
        self._use_compiled = n > LONG_MISSION_INSTANTS
        self._message_inbox = new_inbox(follower + 1, self._model.message_every)
        self._reading_inbox = new_inbox(1, 1)
        self._true_values = spillable_zeros((steps, 3))
        self._receptions = new_receptions(record.message_step.shape[1])
        self._drivers = sensors.custom_sensors(sensing, follower)
        self._environment = sensors.environment_of(sensing)
        self._steps = steps  # of the whole mission
        self._done = 0  # filter steps that are sensed
        self._messages = 0  # messages that are in
        self.custom: dict[str, Floats] = {}
        """Readings of further sensors by their names, shape (n, c), as far as they are read."""

    @property
    def headers(self) -> dict[str, SensorHeader]:
        """Channels and rates of further sensors by their names."""
        return {driver.name: driver.header for driver in self._drivers}

    def advance(self, last: int) -> None:
        """Sense all filter steps until an instant, which the motion of the sender has."""
        span = Span(self._follower, 0, self._done, self._messages)
        self._done = last // self._model.stride
        if self._done == span.done:
            return
        self._sense(span, last)
        self._receive(span)
        if self._drivers:
            self._read_custom(span)

    def close(self) -> None:
        """Give back the memory of true values; nothing is sensed any more."""
        self._true_values = self._true_values[:0].copy()
        self._receptions = new_receptions(0)

    def _sense(self, span: Span, last: int) -> None:
        model = self._model
        views = [array.view() for array in self._sender.truth]
        for view in views:
            view.flags.writeable = False
        motion = acoustics.Motion(StateHistory(*views), 0.0, last)
        tilts = self._sender.tilts
        inbox = self._message_inbox
        true_values = self._true_values
        receptions = self._receptions
        if self._use_compiled:
            sites = acoustics.Sites(self._offset[:3], self._offset[3:-1])
            errors = model.errors[self._follower]
            messages = sense_steps_compiled(
                model,
                errors,
                span,
                sites,
                self._offset[-1],
                motion,
                tilts,
                inbox,
                true_values,
                receptions,
            )
        else:
            *places, depth_sensor = self._offset.tolist()
            messages = sense_steps(
                model,
                self._errors,
                span,
                acoustics.Sites(places[:3], places[3:]),
                depth_sensor,
                motion,
                tilts,
                inbox,
                true_values,
                receptions,
            )
        if self._hidden is not None:
            receptions.content[span.messages : messages, self._hidden] = np.nan
        self._messages = messages if self._hears else 0

    def _receive(self, span: Span) -> None:
        """Read the new steps and messages with the noise of the run, into the record."""
        f = self._follower
        record = self._record
        receptions = self._receptions
        new = slice(span.messages, self._messages)
        taken_up = receptions.message_step[: self._messages]
        emitted = receptions.emission_step[: self._messages]
        out = (record.own[f], record.message[f], record.ranges[f])
        true_values = self._true_values[: self._done]
        content = receptions.content[: self._messages]
        ranges = receptions.ranges[: self._messages]
        if self._use_compiled:
            sent = (taken_up, emitted, content, ranges)
            errors = self._model.errors[f]
            read_steps_compiled(
                errors,
                self._transmitters_and_dt,
                self._address,
                span,
                true_values,
                sent,
                self._reading_inbox,
                out,
            )
        else:
            # numbers of the new messages alone, after places of those before
            numbers = (
                [None] * span.messages + content[new].tolist(),
                [None] * span.messages + ranges[new].tolist(),
            )
            read_steps(
                self._errors,
                self._transmitters_and_dt,
                self._address,
                span,
                true_values,
                (taken_up, emitted, *numbers),
                self._reading_inbox,
                out,
            )
        record.ranges[f, new, self._transmitters :] = np.nan
        record.message_step[f, new] = receptions.message_step[new]
        record.messages[f] = self._messages

    def _read_custom(self, span: Span) -> None:
        """Read the further sensors at the new steps."""
        f = self._follower
        new = slice(span.messages, self._messages)
        steps: Ints = np.arange(span.done + 1, self._done + 1)
        states = self._states(span, steps)
        taken_up = self._receptions.message_step[new] - span.done - 1
        lost_rows = taken_up[np.isnan(self._record.ranges[f, new]).all(axis=1)]
        for driver in self._drivers:
            true = driver.true(states, self._environment, int(steps[0]))
            draws = driver.draws(int(self._address.seed), int(self._address.run), f, steps)
            readings = driver.read(true, draws, int(steps[0]))
            if driver.acoustic:
                readings[lost_rows] = np.nan
            self._store(driver, steps, readings)

    def _store(self, driver: SensorDriver, steps: Ints, readings: Floats) -> None:
        if driver.name not in self.custom:
            self.custom[driver.name] = np.empty((self._steps, *readings.shape[1:]))
        self.custom[driver.name][steps - 1] = readings

    def _states(self, span: Span, steps: Ints) -> VehicleState:
        """True states of the follower at filter steps, with the sources of messages that are in."""
        truth = self._sender.truth
        receptions = self._receptions
        new = slice(span.messages, self._messages)
        source = np.full((steps.size, 3, 3), np.nan)
        direct = receptions.ranges[new][:, :, [Path.DIRECT]]
        taken_up = receptions.message_step[new] - span.done - 1
        source[taken_up] = np.where(np.isnan(direct), np.nan, receptions.transmitter[new])
        grid = slice(
            int(steps[0]) * self._model.stride,
            int(steps[-1]) * self._model.stride + 1,
            self._model.stride,
        )
        v = self._follower + 1
        motion = (truth.pose[grid, v], truth.twist[grid, v], truth.water[grid, v])
        hydrophone = self._offset[3 + self._follower]
        places = (np.column_stack(body_point_in_world(motion[0].T, hydrophone)), source)
        time = np.arange(grid.start, grid.stop, grid.step, dtype=np.float64) * CONTROL_STEP_S
        return VehicleState.of_motion(time, motion, self._offset[-1], places, self._follower)
