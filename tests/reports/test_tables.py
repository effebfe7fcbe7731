"""Tables of a flight: distances and errors of each follower, by geometry."""

import numpy as np

from laisn.metrics import position_errors
from reports.tables import errors_table, measurements_table
from sim.flight import excerpt
from tests.synthetic import make_flight


def test_distances_of_all_followers_are_from_the_leader() -> None:
    flight = make_flight(20.0, 3)
    steps = flight.step_index()  # of the trajectory, at each filter step
    table = errors_table(flight).arrow.to_pydict()
    names = np.array(table["follower"])
    leader = flight.trajectory.position[steps, 0, :2]
    for i, name in enumerate(flight.trajectory.names[1:]):
        of_follower = names == name
        east, north = (flight.hydrophone(i)[:, :2] - leader).T
        np.testing.assert_allclose(
            np.array(table["distance_m"])[of_follower], np.hypot(east, north)
        )
        expected = position_errors(flight.estimates[i].state[:, :2], flight.hydrophone(i)[:, :2])
        np.testing.assert_allclose(np.array(table["e_p_m"])[of_follower], expected)


def test_rows_of_an_excerpt_have_times_of_the_mission() -> None:
    part = excerpt(make_flight(20.0), 5.0, 15.0)
    expected = part.trajectory.time[part.step_index()]
    for table in (errors_table(part), measurements_table(part)):
        np.testing.assert_allclose(table["time_s"], expected)
