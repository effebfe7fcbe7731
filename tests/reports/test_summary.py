"""Summary of a flight and events for its log, from a flight of formulas."""

import re
from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

import laisn_sim
from experiments.flight import results
from laisn.arrays import Floats
from laisn.estimates import FixKind
from reports.summary import mirror_lock_events, safety_warnings, summarise
from sim.assembly import routes_of
from sim.flight import FlightRecord
from sim.scenario.parts import MissionPlan
from sim.tracking import track_error
from tests import synthetic
from tests.synthetic import make_flight


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return make_flight(30.0, 2)


def bearing_error_deg(estimate: Floats, truth: Floats, leader: Floats) -> Floats:
    """Angle at the leader between estimate and truth [°], by complex numbers."""
    to_estimate, to_truth = ((point - leader) @ np.array([1j, 1.0]) for point in (estimate, truth))
    return np.abs(np.rad2deg(np.angle(to_estimate / to_truth)))


def figures(position: Floats, bearing: Floats) -> dict[str, float]:
    return {
        "e_p_max_m": position.max(),
        "e_p_mean_m": position.mean(),
        "e_p_std_m": position.std(),
        "e_b_max_deg": bearing.max(),
        "e_b_mean_deg": bearing.mean(),
        "e_b_std_deg": bearing.std(),
    }


def test_the_summary_has_the_errors_of_each_follower_and_of_all(flight: FlightRecord) -> None:
    summary = summarise(flight)
    leader = flight.trajectory.position[flight.step_index(), 0, :2]
    pairs = [(e.state[:, :2], flight.hydrophone(i)[:, :2]) for i, e in enumerate(flight.estimates)]
    position = [np.linalg.norm(actual - truth, axis=1) for actual, truth in pairs]
    bearing = [bearing_error_deg(actual, truth, leader) for actual, truth in pairs]
    of_all = figures(np.concatenate(position), np.concatenate(bearing))
    assert {name: summary[name] for name in of_all} == pytest.approx(of_all)
    assert (summary["seed"], summary["run"], summary["flown_s"]) == (1, 0, pytest.approx(30.0))
    routes = routes_of(MissionPlan.of(flight.scenario))
    for i, name in enumerate(("follower1", "follower2")):
        row = summary["followers"][name]
        expected = figures(position[i], bearing[i])
        assert {key: row[key] for key in expected} == pytest.approx(expected)
        off_route = track_error(
            routes[i + 1], flight.trajectory.time, flight.trajectory.position[:, i + 1, :2]
        )
        assert row["track_error_rms_m"] == pytest.approx(np.sqrt(np.mean(off_route**2)))
        kinds = Counter(
            FixKind(kind).name.lower() for kind in flight.estimates[i].fix_kind.tolist()
        )
        assert {kind: count for kind, count in row["fixes"].items() if count} == kinds


def test_a_notebook_shows_mean_and_largest_error_of_each_follower(flight: FlightRecord) -> None:
    shown = results.Flight(**vars(flight))._repr_html_()
    for i, estimates in enumerate(flight.estimates):
        error = np.linalg.norm(estimates.state[:, :2] - flight.hydrophone(i)[:, :2], axis=1)
        assert (
            f"<td>follower{i + 1}</td><td>{error.mean():.2f} m</td><td>{error.max():.2f} m</td>"
            in shown
        )
    assert shown.index("mean E_P") < shown.index("largest E_P")
    assert "followers: 2" in shown


def test_the_summary_names_those_that_came_nearest(flight: FlightRecord) -> None:
    summary, trajectory = summarise(flight), flight.trajectory
    for axes, kind in ((3, "approach"), (2, "horizontal")):
        distance = {
            (i, j): np.linalg.norm(
                trajectory.position[:, i, :axes] - trajectory.position[:, j, :axes], axis=1
            )
            for i, j in combinations(range(3), 2)
        }
        pair = min(distance, key=lambda p: distance[p].min())
        assert summary[f"closest_{kind}_m"] == pytest.approx(distance[pair].min())
        assert sorted(summary[f"closest_{kind}_pair"]) == sorted(trajectory.names[i] for i in pair)
        assert summary[f"closest_{kind}_s"] == pytest.approx(
            trajectory.time[distance[pair].argmin()], abs=0.11
        )


def test_mirror_locks_are_reported_at_start_and_end(flight: FlightRecord) -> None:
    """The second follower's estimate is mirrored in the leader's axis from 10 s to 15 s, and
    from 28 s on.
    """
    steps = flight.step_index()
    time, leader = flight.trajectory.time[steps], flight.trajectory.position[steps, 0, :2]
    heading, actual = flight.trajectory.heading[steps, 0], flight.estimates[1]
    truth = flight.hydrophone(1)[:, :2]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    side = np.einsum("ni,ni->n", truth - leader, starboard)
    mirrored = ((time > 9.95) & (time < 14.95)) | (time > 27.95)
    state = actual.state.copy()
    state[:, :2] = truth - np.where(mirrored, 2 * side, 0.0)[:, None] * starboard
    mirror_locked = replace(flight, estimates=(flight.estimates[0], replace(actual, state=state)))
    events = mirror_lock_events(mirror_locked)
    assert [event.time_s for event in events] == pytest.approx([10.0, 15.0, 28.0])
    assert [event.level for event in events] == ["warning", "info", "warning"]
    assert [event.text for event in events][1] == "mirror lock ends"
    assert {event.source for event in events} == {"follower2"}


def test_leaving_the_water_is_reported_once(flight: FlightRecord) -> None:
    """The leader rises above the surface at 12 s, the first follower sinks below the floor at 20
    s, and both again.
    """
    trajectory = flight.trajectory
    position, time = trajectory.position.copy(), trajectory.time
    position[(time > 11.95) & (time < 13) | (time > 25), 0, 2] = 0.05
    position[time > 19.95, 1, 2] = -flight.scenario.ocean.floor_depth_m - 0.05
    events = safety_warnings(
        replace(flight, trajectory=synthetic.moved(trajectory, position=position))
    )
    reported = [
        (event.time_s, event.text)
        for event in events
        if not re.search("touch|off its route", event.text)
    ]
    assert reported == [
        (pytest.approx(12.0), "leader breaks the surface"),
        (pytest.approx(20.0), "follower1 goes below the sea floor"),
    ]
    assert all("off its route" in event.text for event in safety_warnings(flight))


WITHOUT_ERRORS = {
    "acoustics.range_tau_m": [0, 0, 0],
    "acoustics.range_scale_mean_m": 0,
    "acoustics.range_scale_sigma_m": 0,
    "sensors.speed_bias_m_s": 0,
    "sensors.speed_sigma_m_s": 0,
    "sensors.heading_bias_deg": 0,
    "sensors.heading_sigma_deg": 0,
}


@pytest.mark.parametrize("variant", ["laisn-2", "tight", "ekf", "dead-reckoning"])
@pytest.mark.parametrize("keys", [["acoustics.range_tau_m"], [*WITHOUT_ERRORS]])
def test_a_flight_with_exact_ranges_has_a_summary_without_a_bound(
    variant: str, keys: list[str]
) -> None:
    zero = {key: WITHOUT_ERRORS[key] for key in keys}
    settings = {"duration_s": 10.0, "motion": "kinematic", "navigation.variant": variant}
    flight = laisn_sim.fly("T5", settings | zero)
    [row] = laisn_sim.summary(flight)["followers"].values()
    assert (row["bound_rms_m"], row["rms_over_bound"]) == (None, None)
    if zero == WITHOUT_ERRORS:
        # nothing errs, so that the estimate does not either, but for the mixture of `tight`
        assert row["e_p_max_m"] < (0.05 if variant == "tight" else 1e-4)
