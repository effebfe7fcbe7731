"""Shares that causes have in the error of a range: they add up, and each has a closed form when it
acts alone.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import laisn_sim
from laisn_sim.cli import analyses
from reports import flight_report
from reports.range_budget import Cause, RangeErrorBudget, range_error_budget
from sim.flight import FlightRecord, excerpt
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Acoustics, Navigation, Scenario
from sim.sensing.observation import measure, observe, propagate
from sim.sensing.sensors import SensorErrors, errors_of
from sim.trajectory import Trajectory
from tests.straight import make_scenario, make_trajectory
from tests.synthetic import SITES, make_estimates, make_flight

PITCH = np.deg2rad(5.0)
DEPTH_OFFSET = 10.0
"""Of the follower below the leader [m]."""
HALF_BASELINE = 1.0
"""Distance of the rear and of the front transmitter from the leader's origin [m]."""
QUIET = SensorErrors(range_tau=(0.0, 0.0, 0.0), range_scale_mean=0.0, range_scale_sigma=0.0)


def flight_of(
    scenario: Scenario, trajectory: Trajectory, errors: SensorErrors | None = None
) -> FlightRecord:
    """A flight on this trajectory, with measurements of these errors or of the scenario's."""
    measured = measure(
        observe(trajectory, SensingSettings.of(scenario)),
        errors or errors_of(SensingSettings.of(scenario)),
        seed=scenario.seed,
        run=scenario.run,
    )
    return FlightRecord(
        scenario=scenario,
        trajectory=trajectory,
        measurements=(measured,),
        estimates=(make_estimates(scenario, trajectory, measured, 0),),
    )


def shares_alone(budget: RangeErrorBudget, cause: Cause) -> np.ndarray:
    """Shares of a cause; those of all others must be zero."""
    others = np.delete(budget.share, cause, axis=2)
    assert_allclose(others, 0.0, atol=1e-9)
    return budget.share[..., cause]


def test_shares_add_up_to_the_error():
    flight = make_flight(60.0)
    budget = range_error_budget(flight)
    received = np.isfinite(budget.used_range)
    assert received.any()
    assert not received.all()
    assert_allclose(budget.share.sum(axis=2)[received], budget.error[received], rtol=0, atol=1e-9)
    # the last number of the chain is the one the follower computes from its measurements
    measured = flight.measurements[0]
    # its hydrophone sits higher than its depth sensor
    dz = measured.message[:, 5] - (
        measured.depth[measured.message_step - 1] - SITES["follower"]["hydrophone"][2]
    )
    assert_allclose(
        budget.used_range[received],
        np.sqrt(measured.ranges**2 - dz[:, None] ** 2)[received],
        atol=1e-12,
    )


def test_shares_add_up_with_everything_at_work():
    acoustics = Acoustics(
        travel_time=True,
        ping_slot_s=0.07,
        sound_speed_profile=((0.0, 1480.0), (30.0, 1510.0)),
        clock_offset_s=1e-4,
        clock_drift_ppm=20.0,
        sound_speed_bias_m_s=4.0,
    )
    trajectory = make_trajectory(
        (20.0, -30.0, -14.0),
        leader_velocity=(1.0, 0.3, 0),
        follower_velocity=(1.2, 0, 0.05),
        heading_pitch_roll=(1.2, 0.2, -0.1),
    )
    # three pings are waited for
    scenario = make_scenario(acoustics).model_copy(
        update={"navigation": Navigation(variant="laisn-3-2")}
    )
    budget = range_error_budget(flight_of(scenario, trajectory))
    assert_allclose(budget.share.sum(axis=2), budget.error, rtol=0, atol=1e-9)
    at_work = np.abs(budget.share).max(axis=(0, 1)) > 1e-4
    assert [Cause(i) for i in np.flatnonzero(~at_work)] == [Cause.ECHO, Cause.DEPTH]


@pytest.mark.parametrize("slant", [15.0, 40.0, 100.0])
def test_lever_arm_abeam_is_the_closed_form(slant):
    abeam = np.sqrt(slant**2 - DEPTH_OFFSET**2)
    trajectory = make_trajectory(
        (0.0, -abeam, -8.0 - DEPTH_OFFSET), heading_pitch_roll=(np.pi / 2, PITCH, 0.0)
    )
    scenario = make_scenario()
    budget = range_error_budget(flight_of(scenario, trajectory, QUIET))
    slant_error = (
        propagate(trajectory, SensingSettings.of(scenario)).range[..., 0]
        - propagate(
            make_trajectory((0.0, -abeam, -8.0 - DEPTH_OFFSET)), SensingSettings.of(scenario)
        ).range[..., 0]
    )
    # the front transmitter rises, away from a follower below: longer by Δz (L/2) sin φ / R
    closed_form = DEPTH_OFFSET * HALF_BASELINE * np.sin(PITCH) / slant
    assert_allclose(slant_error[:, 1], closed_form, rtol=0.02)
    assert_allclose(slant_error[:, 0], -closed_form, rtol=0.02)
    assert_allclose(
        budget.asymmetry[:, Cause.LEVER_ARM], 2 * closed_form * slant / abeam, rtol=0.02
    )
    assert_allclose(budget.asymmetry[:, Cause.FORESHORTENING], 0.0, atol=1e-12)
    # the intersection of the circles moves along the hull by (D_rear² − D_front²) / 2L = Δz sin φ
    shift_along_hull = (budget.used_range[:, 0] ** 2 - budget.used_range[:, 1] ** 2) / (
        4 * HALF_BASELINE
    )
    assert_allclose(np.abs(shift_along_hull), 0.87, rtol=0.02)


def test_level_leader_without_errors_has_no_error():
    trajectory = make_trajectory(
        (20.0, -30.0, -14.0), leader_velocity=(1, 0, 0), follower_velocity=(1, 0.1, 0)
    )
    assert_allclose(
        range_error_budget(flight_of(make_scenario(), trajectory, QUIET)).share, 0.0, atol=1e-9
    )


def test_each_acoustic_cause_alone():
    trajectory = make_trajectory((31.0, 0.0, -8.0))
    cases = {
        Cause.SOUND_SPEED: (Acoustics(sound_speed_bias_m_s=15.0), 0.01 * 30.0),
        Cause.CLOCK: (Acoustics(clock_offset_s=1e-3), 1.5),
        Cause.ECHO: (Acoustics(surface_echo_probability=1.0), np.hypot(30.0, 16.0) - 30.0),
    }
    for cause, (acoustics, expected) in cases.items():
        scenario = make_scenario(acoustics)
        flight = flight_of(scenario, trajectory, QUIET)
        if cause is Cause.ECHO:
            echo = propagate(trajectory, SensingSettings.of(scenario)).range[..., 1]
            flight = FlightRecord(
                scenario=scenario,
                trajectory=trajectory,
                measurements=(
                    flight.measurements[0].__class__(
                        **{**vars(flight.measurements[0]), "ranges": echo}
                    ),
                ),
                estimates=flight.estimates,
            )
        assert_allclose(shares_alone(range_error_budget(flight), cause)[:, 1], expected, rtol=1e-9)


def test_random_and_depth_errors_are_what_was_drawn():
    trajectory = make_trajectory((0.0, -20.0, -11.0))
    scenario = make_scenario()
    noisy = range_error_budget(flight_of(scenario, trajectory, SensorErrors()))
    assert_allclose(noisy.share.sum(axis=2), noisy.share[..., Cause.RANDOM], atol=1e-9)
    depths = {"depth_sigma": 0.1, "leader_depth_sigma": 0.2}
    depth_errors = SensorErrors(
        range_tau=(0, 0, 0), range_scale_mean=0, range_scale_sigma=0, **depths
    )
    depth_shares = shares_alone(
        range_error_budget(flight_of(scenario, trajectory, depth_errors)), Cause.DEPTH
    )
    assert np.abs(depth_shares).max() > 1e-3
    measured = measure(
        observe(trajectory, SensingSettings.of(scenario)), SensorErrors(**depths), seed=1, run=0
    )
    difference = measured.message[:, 5] - measured.depth[measured.message_step - 1]
    level_range = noisy.level_range
    assert_allclose(
        depth_shares,
        np.sqrt(level_range**2 + 3.0**2 - difference[:, None] ** 2) - level_range,
        atol=1e-9,
    )


def test_a_file_holds_a_row_for_each_ping_received_and_its_shares_add_up(tmp_path):
    flight = make_flight(60.0, 2)
    rows = list(analyses.records(flight))
    assert len(rows) == sum(
        int(np.isfinite(measured.ranges).sum()) for measured in flight.measurements
    )
    for row in rows:
        shares = sum(row[f"{cause.name.lower()}_m"] for cause in Cause)
        assert row["level_range_m"] + shares == pytest.approx(row["used_range_m"], abs=1e-9)
    measured = flight.measurements[1]
    front = [
        row for row in rows if row["follower"] == "follower2" and row["transmitter"] == "front"
    ]
    received = measured.message_step[np.isfinite(measured.ranges[:, 1])]
    assert_allclose([row["time_s"] for row in front], received * measured.dt, atol=1e-9)


def test_the_page_names_the_cause_of_the_asymmetry():
    """Abeam of a leader at 5°, 10 m deeper: bow less stern is off by Δz L sin φ / D, and by
    nothing else.
    """
    trajectory = make_trajectory(
        (20.0, 0.0, -8.0 - DEPTH_OFFSET), heading_pitch_roll=(0.0, PITCH, 0.0)
    )
    table = flight_report.share_table(
        range_error_budget(flight_of(make_scenario(), trajectory, QUIET))
    )
    shown = {row[0].text: [cell.sort for cell in row[1:]] for row in table.rows}
    expected = (
        100 * DEPTH_OFFSET * 2 * HALF_BASELINE * np.sin(PITCH) / np.hypot(20.0, HALF_BASELINE)
    )
    rear, front, middle, rms, largest = shown.pop("lever arm")
    assert [rms, largest, rear + front] == pytest.approx([expected] * 3, rel=0.01)
    assert middle == pytest.approx(0.0, abs=1e-9)
    assert set(shown) == {"foreshortening"}
    assert shown["foreshortening"][3] < 0.02 * expected
    assert table.caption.endswith(
        "Without effect here: travel time and motion, echo, sound speed, clock, random "
        "error, depth measurement."
    )


def test_a_follower_without_receptions_has_no_budget():
    flight = make_flight(30.0)
    without_ranges = replace(
        flight.measurements[0], ranges=np.full_like(flight.measurements[0].ranges, np.nan)
    )
    actual = flight_report.range_budget(replace(flight, measurements=(without_ranges,)))
    assert (actual["silent"], actual["figure"], actual["tables"]) == (["follower"], None, [])
    assert list(analyses.records(replace(flight, measurements=(without_ranges,)))) == []


def test_an_excerpt_of_a_flight_has_the_shares_of_the_whole_flight_at_its_times():
    flight = make_flight(30.0, 2)
    of_flight, of_excerpt = (
        range_error_budget(flight, 1),
        range_error_budget(excerpt(flight, 11.0, 23.0), 1),
    )
    in_excerpt = (of_flight.time > 11.0 + 1e-9) & (of_flight.time < 23.0 + 1e-9)
    assert np.array_equal(of_excerpt.time, of_flight.time[in_excerpt])
    assert np.array_equal(of_excerpt.share, of_flight.share[in_excerpt], equal_nan=True)


BEACONS = [[-50.0, -50.0, 5.0], [150.0, -50.0, 25.0], [50.0, 120.0, 25.0]]
# rear above the sender's depth sensor, front and middle below
SITES_OF_SECOND = [[-1.0, 0.0, 0.6], [1.0, 0.0, -0.4], [0.0, 0.1, -0.2]]
LINKS = {
    "beacons": (
        {"name": "lbl", "beacons_m": BEACONS},
        "beacons",
        [place[2] for place in BEACONS],
    ),
    "a second leader": (
        {"name": "second", "sender": "ahead", "transmitters_m": SITES_OF_SECOND},
        "laisn-3-2",
        [9.0 - site[2] for site in SITES_OF_SECOND],
    ),
}


@pytest.mark.parametrize(("link", "variant", "depths"), LINKS.values(), ids=LINKS)
def test_each_transmitter_of_a_link_has_its_own_depth(
    link: dict[str, object], variant: str, depths: list[float]
) -> None:
    keys = {
        "duration_s": 20.0,
        "motion": "kinematic",
        "links": [{**link, "interval_s": 2.0}],
        "followers": [
            {"name": "a", "waypoints": [[0, 0, -30], [120, 120, -30]], "depth_m": 12.0},
            {"name": "ahead", "waypoints": [[0, 10, 20], [120, 130, 20]], "depth_m": 9.0},
        ],
        # the other one navigates on the leader's broadcast
        "followers.0.navigation": {"link": link["name"], "variant": variant},
    }
    flight = laisn_sim.fly("T5", keys)
    budget = range_error_budget(flight)
    measured = flight.measurements[0]
    # motion is level, the depth of the hydrophone what the depth sensor says less its height
    sites = flight.trajectory.sites
    height = sites["a/hydrophone"][2] - sites["a/depth_sensor"][2]
    own_depth = measured.depth[measured.message_step - 1] - height
    difference = np.array(depths) - own_depth[:, None]
    assert len(budget.time) == len(difference) > 5
    assert_allclose(budget.used_range, np.sqrt(measured.ranges**2 - difference**2), atol=1e-9)
    assert_allclose(budget.share[..., [Cause.FORESHORTENING, Cause.LEVER_ARM]], 0.0, atol=1e-9)
    assert_allclose(budget.share[..., Cause.DEPTH], 0.0, atol=1e-9)
    assert_allclose(budget.share.sum(axis=2), budget.error, rtol=0, atol=1e-9)


def test_the_height_of_transmitters_on_a_level_hull_is_no_lever_arm() -> None:
    """The navigator takes the pings to leave at heights that are wrong by 0.5 m."""
    trajectory = make_trajectory((20.0, -30.0, -14.0))
    scenario = make_scenario()
    assumed = ((-1.0, 0.0, 0.5), (1.0, 0.0, 0.5), (0.0, 0.1, 0.5))
    navigation = Navigation(variant="laisn-3-2", transmitters_m=assumed)
    flight = flight_of(scenario.model_copy(update={"navigation": navigation}), trajectory, QUIET)
    budget = range_error_budget(flight)
    # a depth difference of 6.5 m in place of 6 m
    expected = np.sqrt(budget.level_range**2 + 6.0**2 - 6.5**2) - budget.level_range
    assert_allclose(shares_alone(budget, Cause.DEPTH), expected, rtol=0, atol=1e-9)
