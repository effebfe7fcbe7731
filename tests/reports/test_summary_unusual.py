"""Vehicles far off their routes, and vehicles that pass close to each other, are reported."""

from dataclasses import replace

import numpy as np
import pytest

from reports.summary import approach_events, route_events, safety_warnings
from sim.assembly import routes_of
from sim.scenario.parts import MissionPlan
from sim.scenario.point_motion import plan
from tests import synthetic
from tests.synthetic import make_flight


def placed(position):
    """A flight with the positions of one that keeps to its routes, changed by a function."""
    flight = make_flight(20.0)
    truth = flight.trajectory
    there = truth.position.copy()
    for v, route in enumerate(routes_of(MissionPlan.of(flight.scenario))):
        planned = plan(route).at(truth.time)
        there[:, v, :2] = np.column_stack([planned.east, planned.north])
    return replace(flight, trajectory=synthetic.moved(truth, position=position(there)))


@pytest.mark.parametrize("vehicle", [0, 1])
def test_a_vehicle_far_off_its_route_is_reported_with_its_distance(vehicle):
    assert route_events(placed(lambda there: there)) == []

    def drift(there):
        there[:, vehicle, 0] += np.linspace(0.0, 106.0, len(there))
        return there

    flight = placed(drift)
    (event,) = route_events(flight)
    name, end = flight.trajectory.names[vehicle], flight.trajectory.time[-1]
    assert (event.time_s, event.source) == (end, name)
    assert event.text == f"{name} is 106 m off its route (maximum), and 106 m at the end"


@pytest.mark.parametrize(
    ("apart_m", "text"),
    [
        (0.25, "leader and follower pass within 0.25 m"),
        (1.05, ""),
        (0.05, "follower and leader touch"),
    ],
)
def test_vehicles_that_pass_close_to_each_other_or_touch_are_reported(apart_m, text):
    def above(there):
        there[:, 1] = there[:, 0] + [0.0, 50.0, 0.0]
        there[100, 1] = there[100, 0] + [0.0, 0.0, apart_m]
        return there

    flight = placed(above)
    at = flight.trajectory.time[100]
    events = [event for event in safety_warnings(flight) if " is " not in event.text]
    assert [(event.time_s, event.text) for event in events] == [(at, text)] * bool(text)
    # contacts have events of their own
    assert [event.text for event in approach_events(flight)] == [text] * (apart_m == 0.25)
