"""A flight that is navigated by ranges themselves: settings, log, film, report and figures."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from laisn.errors import LaisnError
from laisn.estimates import HYPOTHESES, FixKind, TightEstimates
from laisn.settings import NavigationSettings, TightSettings
from reports.bound import flight_bound
from reports.flight_report import final_states, follower_curves
from reports.summary import summarise
from sim.film.film_data import FilmData
from sim.flight import (
    SLIP_M_SQRT_S,
    FlightRecord,
    excerpt,
    navigate,
    navigation_settings,
    position_and_bearing_errors,
    settings_as,
)
from sim.log import reader, writer
from sim.log.contents import LogError
from sim.scenario.settings import AssumeTable, Scenario
from tests.sim.log.damage import Parts
from tests.synthetic import bits


def scenario(*assignments: str) -> Scenario:
    return load_scenario(
        "T2", ["navigation.variant=tight", "duration_s=40", "motion=kinematic", *assignments]
    )


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    """Two transmitters and no known start: the hypotheses on both sides of the leader last for a
    while.
    """
    return fly(scenario("navigation.assume.transmitters=2", "navigation.assume.known_start=false"))[
        0
    ]


@pytest.fixture(scope="module")
def errors(flight: FlightRecord) -> list[Any]:
    """Errors of position and of bearing at each step, of each follower."""
    return position_and_bearing_errors(flight)


def estimates_of(flight: FlightRecord) -> TightEstimates:
    (estimates,) = flight.estimates
    assert isinstance(estimates, TightEstimates)
    return estimates


def test_a_scenario_has_the_defaults_of_the_settings() -> None:
    """The assumptions of a scenario, in SI units, are those of `TightSettings`."""
    plain_scenario, flight = scenario(), fly(scenario())[0]
    settings = navigation_settings(plain_scenario, flight.trajectory.sites, 0)
    assert isinstance(settings, TightSettings)
    expected_settings = TightSettings(
        hydrophone_height=settings.hydrophone_height,
        baseline=plain_scenario.leader.baseline_m or 0.0,
        middle_offset=plain_scenario.leader.middle_offset_m or 0.0,
        floor_depth=plain_scenario.ocean.floor_depth_m,
    )
    for field in fields(TightSettings):
        expected, value = getattr(expected_settings, field.name), getattr(settings, field.name)
        assert value == (pytest.approx(expected) if isinstance(expected, float) else expected), (
            field.name
        )


@pytest.mark.parametrize(
    ("key", "value", "field", "expected"),
    [
        ("transmitters", "2", "transmitters", 2),
        ("known_start", "false", "known_start", False),
        ("start_sigma_m", "2.5", "start_sigma", 2.5),
        ("speed_sigma_m_s", "0.4", "speed_sigma", 0.4),
        ("speed_bias_sigma_m_s", "0.5", "speed_bias_sigma", 0.5),
        ("heading_sigma_deg", "3", "heading_sigma", np.deg2rad(3.0)),
        ("heading_bias_sigma_deg", "10", "heading_bias_sigma", np.deg2rad(10.0)),
        ("range_sigma_m", "0.02", "range_sigma", 0.02),
        ("range_scale_sigma_m", "0.1", "range_scale_sigma", 0.1),
        ("range_scale_bias_sigma_m", "0.6", "range_scale_bias_sigma", 0.6),
        ("leader_heading_sigma_deg", "2", "leader_heading_sigma", np.deg2rad(2.0)),
        ("leader_heading_bias_sigma_deg", "4", "leader_heading_bias_sigma", np.deg2rad(4.0)),
        ("current_sigma_m_s", "0.7", "current_sigma", 0.7),
        ("offset_sigma_m", "0.05", "offset_sigma", 0.05),
        ("slip_m_sqrt_s", "0.11", "slip", 0.11),
        ("outlier_probability", "0.2", "outlier_probability", 0.2),
        ("outlier_span_m", "9", "outlier_span", 9.0),
    ],
)
def test_every_key_reaches_its_setting(
    key: str, value: str, field: str, expected: float, flight: FlightRecord
) -> None:
    settings = navigation_settings(
        scenario(f"navigation.assume.{key}={value}"), flight.trajectory.sites, 0
    )
    assert getattr(settings, field) == pytest.approx(expected)


@pytest.mark.parametrize("flag", ["exact_leader", "drift", "deviation", "current", "offsets"])
def test_every_assumption_reaches_its_setting(flag: str, flight: FlightRecord) -> None:
    opposite = not getattr(AssumeTable(), flag)
    settings = navigation_settings(
        scenario(f"navigation.assume.{flag}={str(opposite).lower()}"), flight.trajectory.sites, 0
    )
    assert isinstance(settings, TightSettings)
    default = TightSettings().assume
    assert settings.assume == replace(default, **{flag: opposite})


def test_physical_vehicles_slip_and_points_do_not(flight: FlightRecord) -> None:
    def slip(*assignments: str) -> float:
        settings = navigation_settings(scenario(*assignments), flight.trajectory.sites, 0)
        assert isinstance(settings, TightSettings)
        return settings.slip

    assert slip() == 0.0
    assert slip("motion=physics") == SLIP_M_SQRT_S > 0.0
    assert slip("motion=physics", "navigation.assume.slip_m_sqrt_s=0") == 0.0


def test_settings_of_another_navigator_than_the_scenario_s_are_refused(
    flight: FlightRecord,
) -> None:
    with pytest.raises(LaisnError, match=r"navigates by 'tight'; expected one of laisn-2, "):
        settings_as(NavigationSettings, flight.scenario, flight.trajectory.sites, 0)
    laisn = navigation_settings(load_scenario("T2", []), flight.trajectory.sites, 0)
    assert isinstance(laisn, NavigationSettings)


def test_navigated_again_the_flight_has_the_same_estimates_from_ranges_alone(
    flight: FlightRecord,
) -> None:
    again = navigate(flight.scenario, flight.trajectory)
    assert bits(again.estimates) == bits(flight.estimates)
    estimates = estimates_of(flight)
    assert set(estimates.fix_kind.tolist()) == {FixKind.RANGES}
    # a second hypothesis lasts for more than five messages
    assert np.count_nonzero(estimates.weight[:, 1] > 0.01) > 5
    # of the quantities beyond the first five, none is estimated by default
    assert np.isnan(estimates.full_state[:, 5:]).all()


def test_its_log_gives_the_same_flight_to_the_bit(flight: FlightRecord, tmp_path: Path) -> None:
    writer.write(flight, tmp_path / "a.mcap")
    assert bits(reader.read(tmp_path / "a.mcap")) == bits(flight)


def test_a_mixture_that_lacks_a_message_is_detected(flight: FlightRecord, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer.write(flight, path)
    parts = Parts.of(path.read_bytes())
    del parts.messages[
        next(
            i for i, message in enumerate(parts.messages) if message[1].topic == "/follower/mixture"
        )
    ]
    path.write_bytes(parts.written())
    with pytest.raises(
        LogError, match="the messages of /follower/mixture are not at the times of a flight"
    ):
        reader.read(path)


def test_an_excerpt_keeps_the_mixtures_of_its_messages(flight: FlightRecord) -> None:
    whole, excerpt_estimates = estimates_of(flight), estimates_of(excerpt(flight, 10.0, 20.0))
    # from 10 to 20 s: messages each second, steps of 0.1 s
    assert excerpt_estimates.fix_step.tolist() == (whole.fix_step[10:20] - 100).tolist()
    np.testing.assert_array_equal(excerpt_estimates.weight, whole.weight[10:20])
    np.testing.assert_array_equal(excerpt_estimates.state, whole.state[100:200])


def test_the_film_shows_every_side_and_they_average_to_the_estimate(flight: FlightRecord) -> None:
    data, estimates = FilmData(flight, 10.0), estimates_of(flight)
    times_with_several = 0
    for time in np.arange(1.05, 40.0, 1.7):
        state = data.at(float(time))
        (sides,) = state.hypotheses
        weight, centres = (
            np.array([side.weight for side in sides]),
            np.stack([side.centre for side in sides]),
        )
        # not exactly the estimate, as the film leaves out hypotheses of less than a hundredth
        assert np.hypot(*((weight @ centres) / weight.sum() - state.estimate[0])[:2]) < 0.5
        times_with_several += len(sides) > 1
    assert times_with_several > 3
    assert estimates.weight.shape[1] == HYPOTHESES


def test_the_summary_begins_where_the_start_is_found(
    flight: FlightRecord, errors: list[Any]
) -> None:
    # the first message, at step 10, finds the start
    assert np.isnan(errors[0][0][:9]).all()
    row = summarise(flight)["followers"]["follower"]
    truth, estimates = flight.hydrophone(0)[9:, :2], estimates_of(flight)
    error = estimates.state[9:, :2] - truth
    normalised = np.einsum(
        "ni,nij,nj->n", error, np.linalg.inv(estimates.covariance[9:, :2, :2]), error
    )
    bound = flight_bound(flight, 0)[9:]
    assert row["nees"] == pytest.approx(normalised.mean(), rel=1e-9)
    assert row["bound_rms_m"] == pytest.approx(np.sqrt(np.mean(bound**2)))
    assert row["rms_over_bound"] == pytest.approx(
        np.sqrt(np.mean(np.sum(error**2, axis=1)) / np.mean(bound**2))
    )
    # a message each second
    assert row["fixes"]["ranges"] == 40


def test_a_current_that_carries_no_points_does_not_change_their_bound() -> None:
    of_points = [
        fly(scenario("motion=kinematic", f"ocean.current_speed_m_s={speed}"))[0]
        for speed in (0.0, 0.5)
    ]
    np.testing.assert_array_equal(*(flight_bound(flight, 0) for flight in of_points))


def test_the_bound_falls_with_a_third_transmitter_and_grows_where_no_message_arrives(
    flight: FlightRecord,
) -> None:
    three_transmitters = fly(scenario("navigation.assume.transmitters=3"))[0]
    assert np.all(flight_bound(three_transmitters, 0)[10:] < flight_bound(flight, 0)[10:])
    (received,) = flight.measurements
    ranges = received.ranges.copy()
    # the sixth message, at step 60, and all later ones are lost
    ranges[5:] = np.nan
    without_late_messages = replace(flight, measurements=(replace(received, ranges=ranges),))
    assert np.array_equal(flight_bound(without_late_messages, 0)[:59], flight_bound(flight, 0)[:59])
    assert np.all(np.diff(flight_bound(without_late_messages, 0)[60:]) > 0.0)


def labels_over_time(flight: FlightRecord, errors: list[Any]) -> list[str]:
    """Labels of what the report draws over time."""
    (over_time,) = follower_curves(flight, 0, errors[0], flight_bound(flight, 0)).panels
    return [part.y_label for part in over_time.parts]


def test_the_report_draws_bound_and_weights_and_prints_results(
    flight: FlightRecord, errors: list[Any]
) -> None:
    assert labels_over_time(flight, errors)[-2:] == ["fixes", "weights"]
    (states,) = final_states(flight).values()
    assert [*states] == ["log bias [m/s]", "compass bias [°]", "range scale [m]"]
    laisn = fly(load_scenario("T2", ["duration_s=20", "motion=kinematic"]))[0]
    assert labels_over_time(laisn, position_and_bearing_errors(laisn))[-1] == "fixes"
