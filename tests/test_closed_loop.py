"""Followers that steer by their own estimates."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from experiments.campaign.missions import simulate_mission
from experiments.closed_loop import study
from experiments.flight.fly import fly
from experiments.flight.library import ROUTES, load
from laisn.arrays import Floats
from laisn.messages import OwnMotion, Reception
from laisn.navigator import Navigator
from laisn.navigators import new_navigator
from laisn.settings import NavigationSettings
from laisn.tight.navigator import TightNavigator
from sim.closed_loop import Pilot
from sim.flight import Flight, navigate
from sim.motion import simulate_motion
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory
from tests import straight


def mission(*assignments: str, route: str = "T6", duration: float = 60.0) -> Scenario:
    return load(
        route,
        ["followers.0.steers_by=estimate", "navigation.variant=laisn-3-2", f"duration_s={duration}", *assignments],
    )


def steered(scenario: Scenario, navigator: Any = Navigator) -> tuple[Trajectory, Floats]:
    """The motion, and the states on which it was steered, shape (n, 4)."""
    states: list[Floats] = []

    class Overheard(navigator):  # type: ignore[misc]
        def step(self, own: OwnMotion, reception: Reception | None = None) -> list:  # type: ignore[type-arg]
            records = super().step(own, reception)
            states.append(self.state.copy())
            return records

    return simulate_motion(scenario, None, Overheard), np.array(states)


@pytest.mark.parametrize(
    "assignments",
    [
        (),
        ("timing.filter_step_s=0.5", "timing.message_interval_s=5"),
        ("timing.message_interval_s=0.1", "duration_s=5"),
        (
            "acoustics.loss_chance=0.2",
            "acoustics.burst_chance=0.1",
            "acoustics.surface_echo_chance=0.1",
            "sensors.speed_drift_m_s=0.3",
            "sensors.heading_drift_deg=9",
            "sensors.leader_position_drift_m_s=0.1",
        ),
        (
            "leader.broadcast_attitude=true",
            "navigation.use_attitude=true",
            "sensors.leader_attitude_sigma_deg=0.5",
            "sensors.leader_attitude_feels_acceleration=true",
            "sensors.leader_gyro_time_constant_s=30",
            "sensors.depth_sigma_m=0.05",
        ),
    ],
)
def test_the_finished_mission_gives_the_estimates_that_steered_it(assignments: tuple[str, ...]) -> None:
    scenario = mission(*assignments)
    trajectory, states = steered(scenario)
    flight = navigate(scenario, trajectory, Navigator)
    assert flight.measurements[0].message_step.size > 5
    np.testing.assert_array_equal(states, flight.estimates[0].state)


def test_so_it_does_where_sound_takes_its_time() -> None:
    """Where the hydrophone is between two instants is rounded otherwise on a shorter grid."""
    scenario = mission("acoustics.travel_time=true", "acoustics.ping_slot_s=0.13", "acoustics.clock_drift_ppm=30")
    trajectory, states = steered(scenario)
    flight = navigate(scenario, trajectory, Navigator)
    late = flight.measurements[0].message_step % scenario.message_every
    assert late.size > 50
    assert late.min() >= 3
    np.testing.assert_allclose(states, flight.estimates[0].state, rtol=0, atol=1e-9)


def test_who_knows_its_position_swims_as_if_told_the_truth() -> None:
    exact = ("sensors.speed_bias_m_s=0", "sensors.speed_sigma_m_s=0", "sensors.heading_bias_deg=0",
             "sensors.heading_sigma_deg=0", "acoustics.range_tau_m=[0,0,0]", "acoustics.range_scale_mean_m=0",
             "acoustics.range_scale_sigma_m=0")  # fmt: skip
    flight, _ = fly(mission(*exact, duration=100.0))
    told, _ = fly(mission(*exact, "followers.0.steers_by=truth", duration=100.0))
    error = np.hypot(*(flight.estimates[0].state[:, :2] - flight.hydrophone(0)[:, :2]).T)
    apart = np.linalg.norm(flight.trajectory.position[:, 1] - told.trajectory.position[:, 1], axis=1)
    assert error.max() < 0.005
    assert 0.0 < apart.max() < 0.01


def test_who_hears_nothing_follows_its_log_and_compass_astray() -> None:
    """It keeps 1 m/s northwards by a log that reads 0.2 m/s and a compass that reads 5° too much."""
    scenario = mission(
        "leader.waypoints=[[0, 0, 0], [300, 0, 300]]",
        "followers.0.waypoints=[[0, 20, 0], [300, 20, 300]]",
        "acoustics.max_range_m=1",
        "sensors.speed_bias_m_s=0.2",
        "sensors.speed_sigma_m_s=0",
        "sensors.heading_bias_deg=5",
        "sensors.heading_sigma_deg=0",
        duration=120.0,
    )
    flight, _ = fly(scenario)
    assert np.isnan(flight.measurements[0].ranges).all()
    made_good = (flight.trajectory.position[1200, 1] - flight.trajectory.position[600, 1]) / 60.0
    expected = 0.8 * np.array([-np.sin(np.deg2rad(5.0)), np.cos(np.deg2rad(5.0))])
    assert made_good[:2] == pytest.approx(expected, abs=0.005)


def test_between_filter_steps_it_dead_reckons() -> None:
    class Still:
        """Says that it swims at 1.5 and −0.5 m/s past 3, 4 m."""

        state = np.array([3.0, 4.0, 1.5, -0.5])

        def __init__(self, settings: NavigationSettings, start: Floats) -> None:
            assert start == pytest.approx([0.0, 20.0, 0.2, 0.1])

        def step(self, own: OwnMotion, reception: Reception | None = None) -> None:
            assert own.depth == pytest.approx(10.0)

    whole = straight.make_trajectory((0.0, 20.0, -10.0), follower_velocity=(0.2, 0.1, 0.0))
    pilot = Pilot(straight.make_scenario(filter_step=0.5), 0, Still)

    def flown(since: int) -> Trajectory:
        return whole

    believed = np.array([pilot.believe(tick, flown) for tick in range(9)])
    assert np.isnan(believed[:5]).all()
    expected = Still.state[:2] + np.outer(0.1 * np.array([0, 1, 2, 3]), Still.state[2:])
    np.testing.assert_allclose(believed[5:], expected, atol=1e-12)


def test_its_path_belongs_to_a_run_so_that_campaigns_refuse_it() -> None:
    with pytest.raises(ValueError, match=r"followers\.0\.steers_by = 'estimate'.*laisn fly --run N"):
        simulate_mission(mission())


def test_the_point_motion_cannot_be_steered() -> None:
    with pytest.raises(ValueError, match="needs motion = 'physics'"):
        mission("motion=kinematic")


def test_a_fleet_is_measured_follower_by_follower(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates 3 m east and 4 m south of the truth; followers where their routes have them, but for a last stretch."""
    asked = []

    def flown(scenario: Scenario) -> tuple[Flight, None]:
        asked.append(scenario)
        short = study.scenario(("T3", "T6"), 10.0).model_copy(update={"motion": "kinematic"})
        flight = navigate(short, simulate_motion(short), Navigator)
        off = np.where(flight.trajectory.time > 9.05, 8.0, 0.0)
        position = flight.trajectory.position.copy()
        position[:, 2, 0] += off
        flight = replace(flight, trajectory=replace(flight.trajectory, position=position))
        estimates = []
        for i, found in enumerate(flight.estimates):
            state = found.state.copy()
            state[:, :2] = flight.hydrophone(i)[:, :2] + np.array([3.0, -4.0]) * (i + 1)
            estimates.append(replace(found, state=state))
        return replace(flight, estimates=tuple(estimates)), None

    monkeypatch.setattr(study, "fly", flown)
    one, other = study.measure(3, "laisn-3-1", "estimate")
    assert one == pytest.approx({"error": 5.0, "off": 0.0, "end": 0.0}, abs=1e-6)
    # for the last 10 of 101 instants
    assert other == pytest.approx({"error": 10.0, "off": 8.0 * np.sqrt(10 / 101), "end": 8.0}, abs=1e-6)
    (scenario,) = asked
    assert (scenario.run, scenario.navigation.variant) == (3, "laisn-3-1")
    assert {follower.steers_by for follower in scenario.followers} == {"estimate"}


def test_the_record_counts_who_is_lost() -> None:
    """Follower i of run r: error i + r, off its place 10 i, and lost in the first run where i is even."""
    runs = [
        [
            {"error": float(i + r), "off": 10.0 * i, "end": 60.0 if r == 0 and i % 2 == 0 else 50.0}
            for i in range(len(ROUTES))
        ]
        for r in range(len(study.RUNS))
    ]
    found = study.findings_of({(v, by): runs for v in study.VARIANTS for by in ("truth", "estimate")})
    assert found["error laisn-2 T4"].value == 2.0 + 2.0
    assert found["off laisn-3-2 T9"].value == 70.0
    assert (found["lost-runs laisn-2 T2"].value, found["lost-runs laisn-2 T3"].value) == (1, 0)
    assert (found["lost-runs laisn-3-1"].value, found["missions"].value) == (4, 40)
    assert format(found["lost laisn-2"], ".0% i") == "10 % (3 to 24 %)"


def test_who_navigates_by_ranges_themselves_steers_by_what_it_would_estimate_afterwards() -> None:
    scenario = mission("navigation.variant=tight", "acoustics.loss_chance=0.2")
    trajectory, states = steered(scenario, TightNavigator)
    flight = navigate(scenario, trajectory, new_navigator)
    np.testing.assert_array_equal(states, flight.estimates[0].state)
