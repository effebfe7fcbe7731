"""What the bound of a scenario is made of: its noise, in the words of the bound, and the
geometry of its mission.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from experiments.flight.library import load_scenario
from laisn.bound import TrueNoise
from reports.bound import geometry_of, least_rms, noise_of
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Acoustics, Navigation, Scenario
from tests import straight

ASSUMED = [
    "speed_bias_sigma_m_s=0.31",
    "heading_bias_sigma_deg=7",
    "range_scale_bias_sigma_m=0.23",
    "leader_heading_bias_sigma_deg=6",
    "current_sigma_m_s=0.41",
    "offset_sigma_m=0.013",
]
NOISY = [
    "sensors.speed_sigma_m_s=0.25",
    "sensors.heading_sigma_deg=3",
    "sensors.leader_heading_sigma_deg=1.5",
    "acoustics.range_tau_m=[0.03,0.04,0.12]",
    "acoustics.range_scale_sigma_m=0.07",
    *(f"navigation.assume.{assumption}" for assumption in ASSUMED),
]


def with_transmitters(scenario: Scenario, transmitters: int) -> Scenario:
    """The scenario with the tightly coupled navigator, which uses so many transmitters."""
    navigation = Navigation(variant="tight", assume={"transmitters": transmitters})
    return scenario.model_copy(update={"navigation": navigation})


def folded_normal_sigma(sigma_deg: float) -> float:
    """Standard deviation of |N(0, σ)|: its mean square is σ², its mean σ √(2/π) [rad]."""
    return float(
        np.sqrt(np.deg2rad(sigma_deg) ** 2 - (np.deg2rad(sigma_deg) * np.sqrt(2 / np.pi)) ** 2)
    )


def noise_with(settings: Sequence[str]) -> TrueNoise:
    """The noise of T5 with these settings, as the bound states it."""
    scenario = load_scenario("T5", settings)
    return noise_of(SensingSettings.of(scenario), scenario.navigation)


def test_noise_is_that_of_the_sensors_and_biases_are_those_assumed() -> None:
    actual = noise_with(NOISY)
    expected = TrueNoise(
        # a uniform error of width τ has the variance τ²/12; the widths' mean square is 0.13²/3
        speed_sigma=0.25,
        heading_sigma=folded_normal_sigma(3.0),
        range_sigma=0.13 / 6,
        range_scale_sigma=0.07,
        leader_heading_sigma=folded_normal_sigma(1.5),
        speed_bias=0.31,
        heading_bias=float(np.deg2rad(7.0)),
        range_scale_bias=0.23,
    )
    assert vars(actual) == pytest.approx(vars(expected), rel=1e-12)


@pytest.mark.parametrize(
    ("settings", "unknown"),
    [
        (["sensors.leader_heading_bias_deg=2"], {"leader_heading_bias": np.deg2rad(6.0)}),
        (["leader.sensors.heading_bias_deg=2"], {"leader_heading_bias": np.deg2rad(6.0)}),
        (["ocean.current_speed_m_s=0.1"], {"current": 0.41}),
        (["navigation.variant=tight"], {}),
        (
            ["navigation.variant=tight", "navigation.assume.exact_leader=false"],
            {"leader_heading_bias": np.deg2rad(6.0), "leader_way_sigma": 0.05},
        ),
        (
            ["navigation.variant=tight", "navigation.assume.current=true"],
            {"current": 0.41, "current_walk": 0.001, "leader_way_sigma": 0.05},
        ),
        (["navigation.variant=tight", "navigation.assume.offsets=true"], {"range_offset": 0.013}),
    ],
)
def test_further_unknowns_are_those_that_the_mission_has_or_the_navigator_estimates(
    settings: list[str], unknown: dict[str, float]
) -> None:
    plain, actual = noise_with(NOISY), noise_with([*NOISY, *settings])
    assert vars(actual) == pytest.approx(vars(replace(plain, **unknown)), rel=1e-12)


def test_among_beacons_no_leader_has_a_compass() -> None:
    """Beacons are surveyed: they have neither a heading nor its bias."""
    links = 'links=[{ name = "lbl", beacons_m = [[0.0, 50.0, 5.0], [50.0, 0.0, 5.0]] }]'
    among_beacons = [links, "navigation.link=lbl", "navigation.variant=beacons"]
    actual = noise_with([*NOISY, *among_beacons, "sensors.leader_heading_bias_deg=2"])
    assert actual.leader_heading_bias == 0.0
    assert actual.leader_heading_sigma == 0.0


def test_with_travel_time_the_leader_is_where_it_was_when_it_sent() -> None:
    """The message of each full second arrives at the step after it, 0.1 s later; the leader's
    velocity through the water is that over ground less the current.
    """
    scenario = straight.make_scenario(Acoustics(travel_time=True))
    flown = straight.make_trajectory(
        (0.0, 4.0, -11.0), leader_velocity=(1.0, 0.0, 0.0), follower_velocity=(1.5, 0.0, 0.0)
    )
    water = flown.water_velocity.copy()
    water[...] = [0.3, -0.2, 0.0]
    actual = geometry_of(
        replace(flown, water_velocity=water), SensingSettings.of(with_transmitters(scenario, 3))
    )
    sent_time = np.arange(1.0, actual.message_step.size + 1)
    assert actual.message_step.tolist() == [
        10 * k + 1 for k in range(1, actual.message_step.size + 1)
    ]
    east = 1.5 * (sent_time + 0.1) - sent_time
    assert actual.from_leader == pytest.approx(
        np.column_stack([east, np.full(sent_time.size, 4.0)])
    )
    assert actual.leader_velocity == pytest.approx(np.tile([0.7, 0.2], (sent_time.size, 1)))


def test_the_geometry_of_straight_paths_is_that_by_hand() -> None:
    """The leader heads east, 1 m from its middle to either end; the follower is 3 m deeper, and
    4 m north.
    """
    scenario = straight.make_scenario()
    flown = straight.make_trajectory(
        (0.0, 4.0, -11.0), leader_velocity=(1.0, 0.0, 0.0), follower_velocity=(1.5, 0.0, 0.0)
    )
    actual = geometry_of(flown, SensingSettings.of(with_transmitters(scenario, 3)))
    assert actual.dt == 0.1
    assert actual.speed == pytest.approx(np.full(200, 1.5))
    assert actual.heading == pytest.approx(np.full(200, np.pi / 2))
    assert actual.message_step.tolist() == list(range(10, 201, 10))
    seconds = np.arange(1.0, 21.0)
    assert actual.from_leader == pytest.approx(np.column_stack([0.5 * seconds, np.full(20, 4.0)]))
    # rear, front, and middle, which is 0.1 m to port: from the leader to the east and north, and
    # how much deeper than the hydrophone
    assert actual.arms == pytest.approx(
        np.tile([[-1.0, 0.0, -3.0], [1.0, 0.0, -3.0], [0.0, 0.1, -3.0]], (20, 1, 1))
    )
    arrived = np.ones((20, 3), dtype=bool)
    arrived[4, 1] = arrived[5] = False
    arms_with_losses = geometry_of(
        flown, SensingSettings.of(with_transmitters(scenario, 3)), received=arrived
    ).arms
    assert np.argwhere(np.isnan(arms_with_losses).all(axis=2)).tolist() == [
        [4, 1],
        [5, 0],
        [5, 1],
        [5, 2],
    ]
    assert geometry_of(flown, SensingSettings.of(with_transmitters(scenario, 2))).arms.shape == (
        20,
        2,
        3,
    )


def test_before_any_message_the_least_error_is_that_of_dead_reckoning() -> None:
    """Straight north at 1 m/s for a second: the log errs along the path, the compass across it;
    the variances of all steps add up.
    """
    scenario = straight.make_scenario()
    flown = straight.make_trajectory((0.0, 4.0, -11.0), follower_velocity=(1.0, 0.0, 0.0))
    geometry = geometry_of(flown, SensingSettings.of(with_transmitters(scenario, 3)))
    noise = TrueNoise(speed_sigma=0.2, heading_sigma=0.05, speed_bias=0.0, heading_bias=0.0)
    steps = np.arange(1.0, 10.0)
    assert least_rms(geometry, noise)[:9] == pytest.approx(
        0.1 * np.sqrt(steps * (0.2**2 + 0.05**2)), rel=1e-6
    )
