"""The leader as a vehicle that senses, receives, navigates and is controlled under way.

Without any of these it keeps to its route by the truth, and broadcasts where it is. Python calls
what is here, once for each instant.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from laisn.arrays import Floats, Record, records
from laisn.errors import LaisnError
from laisn.estimates import Estimates
from laisn.messages import Reception
from laisn.navigators import find
from laisn.swarm import ESTIMATE, READING, SeparateNavigators, SwarmRecord, write_start
from sim.attitude import heel_of
from sim.control import follower as steering
from sim.custom_control import CustomControl, readings_of
from sim.custom_sensing import Carrier, CustomSensing
from sim.estimated_route import follow_route
from sim.flight import VehicleRecord, settings_of
from sim.link_receiver import Fleet, Receiver, Sender
from sim.scenario.parts import LinkSettings, SensingSettings
from sim.scenario.settings import CONTROL_STEP_S, Leader
from sim.sensing import noise, sensors
from sim.sensing.measurement_record import MeasurementRecord
from sim.sensing.observation import leader_start
from sim.sensing.sensor_model import sensor_model_of
from sim.sensing.sensors import SensorErrors
from sim.simulation import RouteControl, static_trajectory
from sim.trajectory import StateHistory
from sim.vehicle.plant import Plant

LEADER = 0
"""Index of the leader among vehicles."""


def _read_instruments(
    errors: SensorErrors, address: noise.Address, instant: sensors.Instant, reading: Record
) -> None:
    """Read the leader's own sensors at a filter step; log, compass and pressure sensor have the
    noise that they have in what it broadcasts.
    """
    # they have the fields of all sensors
    e: Any = errors
    motion = noise.normals_at(address, noise.Stream.LEADER_MOTION)
    depth = noise.normals_at(address, noise.Stream.LEADER_DEPTH)
    gyro = noise.normals_at(address, noise.Stream.LEADER_GYRO)
    tilt = noise.normals_at(address, noise.Stream.LEADER_TILT)
    (reading.speed,) = sensors.SpeedLog.read(e, sensors.SpeedLog.true(e, instant, None), motion)
    (reading.heading,) = sensors.Compass.read(e, sensors.Compass.true(e, instant, None), motion)
    (reading.depth,) = sensors.PressureSensor.read(
        e, sensors.PressureSensor.true(e, instant, None), depth
    )
    (reading.pitch,) = sensors.Inclinometer.read(e, (instant.pitch,), tilt)
    rates = (instant.angular_velocity[2], instant.angular_velocity[1])
    reading.turning, reading.pitching = sensors.Gyros.read(e, rates, gyro)


def _read_roll(
    e: SensorErrors, address: noise.Address, pose: Floats, twist: Floats, reading: Record
) -> None:
    """Read heel and rate of roll of the leader, as of a follower."""
    tilt = noise.normals_at(address, noise.Stream.LEADER_TILT)
    gyro = noise.normals_at(address, noise.Stream.LEADER_ROLL_GYRO)
    reading.heel = sensors.read_heel(e, heel_of(pose[3:]), tilt)
    reading.rolling = sensors.read_rolling(e, twist[3], gyro)


def needs_unit(leader: Leader, links: LinkSettings) -> bool:
    """Whether the leader senses under way: to navigate, to be controlled, as it receives, or as it
    carries further sensors.
    """
    receives = any("leader" in table.receivers for table in links.tables)
    return bool(leader.controller or leader.navigation or leader.sensors.custom) or receives


class LeaderUnit:
    """The leader's sensors, receivers, navigator and controller."""

    def __init__(
        self,
        leader: Leader,
        sensing: SensingSettings,
        plant: Plant,
        routes: RouteControl,
        receivers: Mapping[str, Receiver],
        fleet: Fleet,
    ) -> None:
        """Set out; LaisnError if the leader has no hydrophone for what it receives, or no such
        navigator or controller.
        """
        self._dt = sensing.links.filter_step_s
        self._stride = round(self._dt / CONTROL_STEP_S)
        self._errors = sensors.leader_errors_of(sensing)
        # noise of the leader is the same in all addresses of one link; this is the main one
        self._address = noise.Address(
            *noise.seed_and_run(sensing.seed, sensing.run), follower=0, step=0
        )
        self._routes = routes
        # the leader's number among receivers, after the followers
        self._receiver_number = fleet.followers
        self._receivers = [r for r in receivers.values() if LEADER in r.link.receivers]
        hydrophone = fleet.hydrophones[-1]
        if self._receivers and not np.isfinite(hydrophone).all():
            raise LaisnError(
                "the leader's hull has no hydrophone for what it receives; expected a key "
                "leader.hydrophone_m or a site hydrophone"
            )
        self._depth_sensor = plant.sites["leader/depth_sensor"]
        self._hydrophone = np.nan_to_num(hydrophone)
        self.reading: Any = records(READING, 1)
        self.estimate: Any = records(ESTIMATE, 1)
        # what steering by the estimate remembers
        self._memory = records(steering.FOLLOWER_MEMORY, 1)
        self._memory[0].log = self._memory[0].compass = np.nan
        self._memory[0].by_thrust = routes.autopilot_designs[LEADER]["by_pitch"] == 0.0
        steps = (fleet.instants - 1) // self._stride
        self._measured = MeasurementRecord.empty(1, steps, max(steps, 1))
        self._main_receiver, self._further_receivers = self._links_of(sensing.links)
        model = sensor_model_of(sensing)
        self.custom_sensing = CustomSensing(
            sensors.leader_custom_sensors(sensing),
            Carrier(
                vehicle=LEADER,
                receiver=self._receiver_number,
                noise_number=noise.LEADER_NUMBER,
                hydrophone=self._hydrophone,
                depth_sensor=self._depth_sensor,
            ),
            plant.ocean.environment._replace(rays=model.sound.rays),
            model,
        )
        self.latest_custom: dict[str, Floats] = {}
        """Readings of further sensors at the last filter step by their names."""
        at_start = static_trajectory(plant)
        start = leader_start(at_start, self._hydrophone)
        # the navigator; None: the leader knows the truth
        self.swarm: SeparateNavigators | None = None
        # whether it keeps to its route by its estimate
        self._by_estimate = leader.guidance_position == "estimate"
        self._estimates_current = False
        self._taken_links: tuple[str, ...] = ()  # further links on which it navigates
        if leader.navigation is not None:
            navigation = leader.navigation
            self._taken_links = navigation.further_links
            sites = plant.sites
            if self._main_receiver is not None:
                sites = self._main_receiver.link.with_sites(sites)
            settings = settings_of(sensing, navigation, sites, "leader")
            spec = find(navigation.variant)
            self.swarm = SeparateNavigators(spec.make, settings, start[None])
            write_start(self.estimate, start[None], settings)
            self._estimates_current = "current" in settings.estimated
        # states and covariances of the navigator at filter steps
        self.concluded = SwarmRecord.empty(1, steps, 0, Estimates, whole=False)
        self.concluded = self.concluded._replace(covariance=np.full((1, steps, 4, 4), np.nan))
        # how many filter steps are over, shape (1,): an array, which `sender` shares
        self.steps = np.zeros(1, dtype=np.int64)
        self.sender = Sender(
            readings=self._measured.own[0],
            state=self.concluded.state[0],
            covariance=self.concluded.covariance[0],
            start=start,
            hydrophone=self._hydrophone,
            steps=self.steps,
            read=self.steps,
        )
        self._control: CustomControl | None = None
        if leader.controller:
            self._control = CustomControl({LEADER: leader}, plant, routes)

    def _links_of(self, links: LinkSettings) -> tuple[Receiver | None, list[Receiver]]:
        """The link that the navigator takes for its main one, and all others."""
        by_name = {receiver.name: receiver for receiver in self._receivers}
        main = by_name.pop(links.main_of_leader, None)
        return main, [*by_name.values()]

    def receptions(self) -> tuple[Reception | None, dict[str, Reception]]:
        """What was received by this filter step and not before: on the main link, or None, and on
        the others by name.
        """
        further_receptions = {}
        for receiver in self._further_receivers:
            reception = receiver.reception(self._receiver_number, self.latest_custom)
            if reception is not None:
                further_receptions[receiver.name] = reception
        main = None
        if self._main_receiver is not None:
            main = self._main_receiver.reception(self._receiver_number, self.latest_custom)
        return main, further_receptions

    def advance(self, k: int, truth: StateHistory) -> None:
        """Sense, receive and navigate at instant k."""
        if k % self._stride:
            self.estimate.position[0] += CONTROL_STEP_S * self.estimate.velocity[0]
        else:
            step = k // self._stride
            motion = (truth.pose[k, LEADER], truth.twist[k, LEADER], truth.water[k, LEADER])
            instant = sensors.instant_of(
                (step * self._dt, 0), motion, self._depth_sensor, (0.0, 0.0)
            )
            address = self._address._replace(step=step)
            _read_instruments(self._errors, address, instant, self.reading[0])
            _read_roll(self._errors, address, motion[0], motion[1], self.reading[0])
            for receiver in self._receivers:
                receiver.receive(k, [self._receiver_number])
                receiver.take_readings(k, [self._receiver_number])
            if step > 0:
                row = self.reading[0]
                self._measured.own[0, step - 1] = row.speed, row.heading, row.depth
                hearing = None if self._main_receiver is None else self._main_receiver.hearing
                self.latest_custom = self.custom_sensing.read(k, truth, hearing)
                self._navigate(step)
                self.steps[0] = step
        if self.swarm is None:
            self._know_truth(k, truth)

    def _know_truth(self, k: int, truth: StateHistory) -> None:
        """Without a navigator the leader knows where its origin is, as on a route by the truth."""
        self.estimate.position[0] = truth.pose[k, LEADER, :2]
        self.estimate.velocity[0] = truth.twist[k, LEADER, :2]
        self.estimate.current[0] = truth.water[k, LEADER, :2]

    def _navigate(self, step: int) -> None:
        if self.swarm is None:
            return
        main, further_receptions = self.receptions()
        receptions = {
            name: further_receptions[name]
            for name in self._taken_links
            if name in further_receptions
        }
        self.swarm.receptions = [receptions]
        self.swarm.custom = [self.latest_custom]
        self.swarm.advance(0, step, self.reading[0], main, self.estimate, self.concluded)

    def steer(self, k: int) -> None:
        """Write the leader's command from instant k on, unless the caller of the simulation gives
        it or the leader keeps to its route by the truth.
        """
        if self._routes.commanded_from_outside[LEADER]:
            # it starts anew where it then is
            self._memory[0].log = np.nan
            return
        if self._control is not None:
            is_due = k > 0 and k % self._stride == 0
            main, further_receptions = self.receptions() if is_due else (None, {})
            time = k * CONTROL_STEP_S
            readings = readings_of(
                time, self.reading[0], main, self.latest_custom, further_receptions
            )
            senses = steering.Senses(self.reading[0], self.estimate[0])
            self._control.command(k, LEADER, readings, senses, self._memory[0])
        elif self._by_estimate:
            senses = steering.Senses(self.reading[0], self.estimate[0])
            memory = self._memory[0]
            current = self._estimates_current
            follow_route(k, LEADER, senses, memory, self._routes, self._stride, current)

    def record(self, steps: range) -> VehicleRecord:
        """What the leader has measured and concluded in filter steps `steps.start` + 1 …
        `steps.stop`.
        """
        record = self._record_until(steps.stop)
        measurements = record.measurements.part(steps.start, steps.stop)
        estimates = record.estimates
        if estimates is not None:
            estimates = estimates.part(steps.start, steps.stop)
        return VehicleRecord(measurements=measurements, estimates=estimates)

    def _record_until(self, steps: int) -> VehicleRecord:
        """The same of the first steps."""
        number = self._receiver_number
        links = {
            receiver.name: receiver.messages(number, steps) for receiver in self._further_receivers
        }
        custom = self.custom_sensing.readings(range(steps))
        headers = self.custom_sensing.headers
        measurements = self._measured.measurements(
            0, range(steps), self._dt, custom, headers, None, links
        )
        if self._main_receiver is not None:
            main = self._main_receiver.messages(number, steps)
            places = main.places
            measurements = replace(
                measurements,
                message_step=main.message_step,
                message=main.message,
                ranges=main.ranges,
                transmitters=None if places is None else np.tile(places, (len(main.ranges), 1, 1)),
            )
        estimates = None
        if self.swarm is not None:
            estimates = self.swarm.estimates(self.concluded, 0, range(steps))
        return VehicleRecord(measurements=measurements, estimates=estimates)
