"""Vehicles far off their routes, and vehicles that pass close to each other, are reported."""

import json
from dataclasses import replace

import numpy as np
import pytest

from laisn import metrics
from reports.summary import approach_events, route_events, safety_warnings, summarise
from sim.assembly import routes_of
from sim.scenario.parts import MissionPlan
from sim.scenario.point_motion import plan
from tests import synthetic
from tests.synthetic import make_flight


def flight_on_routes(change):
    """A flight whose vehicles keep to their routes; `change` then changes the positions."""
    flight = make_flight(20.0)
    truth = flight.trajectory
    positions = truth.position.copy()
    for v, route in enumerate(routes_of(MissionPlan.of(flight.scenario))):
        planned = plan(route).at(truth.time)
        positions[:, v, :2] = np.column_stack([planned.east, planned.north])
    return replace(flight, trajectory=synthetic.moved(truth, position=change(positions)))


@pytest.mark.parametrize("vehicle", [0, 1])
def test_a_vehicle_far_off_its_route_is_reported_with_its_distance(vehicle):
    assert route_events(flight_on_routes(lambda positions: positions)) == []

    def drift(positions):
        positions[:, vehicle, 0] += np.linspace(0.0, 106.0, len(positions))
        return positions

    flight = flight_on_routes(drift)
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
    def above(positions):
        positions[:, 1] = positions[:, 0] + [0.0, 50.0, 0.0]
        positions[100, 1] = positions[100, 0] + [0.0, 0.0, apart_m]
        return positions

    flight = flight_on_routes(above)
    time_of_passing = flight.trajectory.time[100]
    events = [event for event in safety_warnings(flight) if " is " not in event.text]
    assert [(event.time_s, event.text) for event in events] == [(time_of_passing, text)] * bool(
        text
    )
    # contacts have events of their own
    assert [event.text for event in approach_events(flight)] == [text] * (apart_m == 0.25)


def test_a_follower_without_any_estimate_has_no_errors_and_is_named() -> None:
    """As where no message reaches one whose start is not known; the other's figures stay."""
    flight = make_flight(20.0, 2)
    first, second = flight.estimates
    never = replace(second, state=np.full_like(second.state, np.nan))
    figures = metrics.Summary._fields
    alone = summarise(flight)["followers"]["follower1"]
    summary = summarise(replace(flight, estimates=(first, never)))
    assert [summary["followers"]["follower2"][name] for name in figures] == [None] * 6
    assert summary["followers"]["follower1"] == alone
    # figures of all followers are those of the one that has any
    assert [summary[name] for name in figures] == [alone[name] for name in figures]
    sentence = summary["verdict"]["sentence"]
    assert sentence.startswith("No estimate in the whole mission: follower2; without a known start")
    json.dumps(summary, allow_nan=False)
