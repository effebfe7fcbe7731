"""Travel time, sound speed, clocks, echoes and losses of messages against closed forms."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from experiments.campaign.montecarlo import Cell, histories
from laisn.arrays import Bools, Ints, records
from laisn.compiled import compiled
from laisn.navigator import Navigator
from laisn.swarm import MESSAGE
from sim.flight import navigation_settings
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Acoustics, Navigation, Timing
from sim.sensing.acoustics import TRANSMITTERS
from sim.sensing.noise import Address, Stream, seed_and_run, uniforms
from sim.sensing.observation import IdealMeasurements, measure, observe, propagate
from sim.sensing.sensors import SensorErrors, errors_of, paths_taken
from sim.water.floors import LevelFloor
from sim.water.rays import Path, SoundProfile, image, mean_slowness, path_slowness, speed_at
from tests.straight import make_scenario, make_trajectory

REAR, FRONT, MIDDLE = range(3)
"""Columns of the transmitters in arrays of ranges."""
C = 1500.0
"""The navigator's speed of sound [m/s]."""


@compiled
def compiled_slowness(sound: SoundProfile, upper: float, lower: float) -> float:
    return float(mean_slowness(sound, upper, lower))


def test_without_settings_ranges_are_the_distances_of_the_sites_at_the_ping():
    trajectory = make_trajectory(
        (30.0, -12.0, -11.0), leader_velocity=(1.0, 0.2, 0.0), follower_velocity=(0.9, 0.0, 0.0)
    )
    truth = observe(trajectory, SensingSettings.of(make_scenario()))
    message_step = truth.message_step
    assert_array_equal(message_step, np.arange(10, 201, 10))
    for i, site in enumerate(TRANSMITTERS):
        offset = (
            trajectory.site_position[message_step, trajectory.site(site)]
            - trajectory.site_position[message_step, trajectory.site("follower/hydrophone")]
        )
        assert_array_equal(truth.slant_range[:, i], np.linalg.norm(offset, axis=1))


@pytest.mark.parametrize("speed", [-3.0, 0.0, 2.0])
def test_travel_time_to_a_receding_hydrophone(speed):
    trajectory = make_trajectory((60.0, 0.0, -8.0), follower_velocity=(speed, 0.0, 0.0))
    sound = propagate(trajectory, SensingSettings.of(make_scenario(Acoustics(travel_time=True))))
    east_at_ping = 60.0 + speed * 0.1 * sound.emission_step[:, None] - np.array([-1.0, 1.0, 0.0])
    # emitted at t_e, a ping arrives at t_a: (t_a − t_e) c = R + v (t_a − t_e). The middle
    # transmitter, 0.1 m aside, has a range that is 5 mm longer, and is left out.
    assert_allclose(
        sound.range[:, :2, Path.DIRECT], (east_at_ping * C / (C - speed))[:, :2], atol=1e-9
    )


def test_a_message_is_available_at_the_first_step_after_its_last_ping():
    trajectory = make_trajectory((74.0, 0.0, -8.0))
    simultaneous_pings = propagate(
        trajectory, SensingSettings.of(make_scenario(Acoustics(travel_time=True)))
    )
    # 75 m take 0.05 s
    assert_array_equal(simultaneous_pings.message_step, simultaneous_pings.emission_step + 1)
    three_slots = make_scenario(Acoustics(travel_time=True, ping_slot_s=0.2))
    three_slots = three_slots.model_copy(update={"navigation": Navigation(variant="laisn-3-1")})
    slotted_pings = propagate(trajectory, SensingSettings.of(three_slots))
    assert_array_equal(slotted_pings.message_step, slotted_pings.emission_step + 5)
    assert slotted_pings.message_step[-1] <= 200
    assert not np.any(np.isnan(observe(trajectory, SensingSettings.of(three_slots)).slant_range))


def test_places_and_headings_are_those_at_the_filter_steps():
    """Every 0.5 s; the leader heads south while the follower heads east."""
    trajectory = make_trajectory(
        (30.0, -12.0, -11.0),
        leader_velocity=(0.0, -1.0, 0.0),
        follower_velocity=(0.8, 0.0, 0.0),
        heading_pitch_roll=(np.pi, 0.1, 0.0),
    )
    truth = observe(trajectory, SensingSettings.of(make_scenario(filter_step=0.5)))
    time = 0.5 * np.arange(1, 41)
    ahead = np.column_stack([30.0 + 0.8 * time, np.full(40, -12.0)])
    assert_allclose(truth.hydrophone, ahead, atol=1e-12)
    assert_allclose(truth.leader_position, np.column_stack([np.zeros(40), -time]), atol=1e-12)
    assert_allclose(truth.leader_heading, np.pi, atol=1e-12)
    assert_allclose(truth.heading, np.pi / 2, atol=1e-12)


def test_laisn_2_does_not_wait_for_the_third_ping():
    """After the end of its listening window it does not receive that ping either."""
    trajectory = make_trajectory((74.0, 0.0, -8.0))
    scenario = make_scenario(Acoustics(travel_time=True, ping_slot_s=0.2))
    slotted_pings = propagate(trajectory, SensingSettings.of(scenario))
    # front ping 0.2 s after the rear one, under way for 0.05 s
    assert_array_equal(slotted_pings.message_step, slotted_pings.emission_step + 3)
    slant_range = observe(trajectory, SensingSettings.of(scenario)).slant_range
    assert np.all(np.isnan(slant_range[:, MIDDLE]))
    assert not np.any(np.isnan(slant_range[:, :MIDDLE]))
    # where it arrives in time, it is received
    simultaneous_pings = make_scenario(Acoustics(travel_time=True))
    assert not np.any(
        np.isnan(observe(trajectory, SensingSettings.of(simultaneous_pings)).slant_range)
    )


def test_of_two_messages_in_one_step_the_first_is_kept() -> None:
    """Messages leave every 0.1 s, in which sound travels 150 m.

    The hydrophone closes at 1 m/s and is (161.05 − t) m from the rear transmitter, thus nearer than
    150 m from 11.05 s on. The messages of 10.9 s and of 11 s both arrive in the step to 11.1 s.
    """
    trajectory = make_trajectory((160.05, 0.0, -8.0), follower_velocity=(-1.0, 0.0, 0.0))
    scenario = make_scenario(Acoustics(travel_time=True))
    scenario = scenario.model_copy(
        update={"timing": Timing(filter_step_s=0.1, message_interval_s=0.1)}
    )
    sound = propagate(trajectory, SensingSettings.of(scenario))
    expected = np.delete(np.arange(1, 200), 109)
    assert_array_equal(sound.emission_step, expected)
    assert_array_equal(sound.message_step, np.where(expected < 110, expected + 2, expected + 1))


def test_arrival_does_not_depend_on_the_filter_step():
    trajectory = make_trajectory(
        (40.0, 25.0, -12.0), leader_velocity=(1.0, 0, 0), follower_velocity=(0.3, 1.1, -0.2)
    )
    acoustics = Acoustics(travel_time=True, ping_slot_s=0.05)
    fine = propagate(trajectory, SensingSettings.of(make_scenario(acoustics, filter_step=0.1)))
    coarse = propagate(trajectory, SensingSettings.of(make_scenario(acoustics, filter_step=1.0)))
    assert coarse.range.shape[0] == fine.range.shape[0]
    assert_allclose(coarse.range, fine.range, atol=1e-9)


def test_pings_leave_from_where_the_transmitter_is_in_its_slot():
    slot, speed = 0.13, 1.7
    trajectory = make_trajectory((0.0, 20.0, -8.0), leader_velocity=(speed, 0, 0))
    sound = propagate(trajectory, SensingSettings.of(make_scenario(Acoustics(ping_slot_s=slot))))
    east_at_emission = speed * sound.emission_step * 0.1
    assert_allclose(
        sound.transmitter[:, FRONT, 0], east_at_emission + speed * slot + 1.0, atol=1e-12
    )
    assert_allclose(
        sound.transmitter[:, MIDDLE, 0], east_at_emission + speed * 2 * slot, atol=1e-12
    )


@given(upper=st.floats(0, 60), lower=st.floats(0, 60))
@example(upper=40.0, lower=40.0)
@example(upper=20.0005, lower=20.0)
def test_mean_slowness_of_a_linear_profile(upper, lower):
    """∫ dz / c is ln(c₂ / c₁) / 1.4 in the gradient of 1.4 1/s, down to 50 m, and linear below."""
    sound = SoundProfile.through([[0.0, 1450.0], [50.0, 1520.0]])
    c1, c2 = (1450.0 + 1.4 * min(d, 50.0) for d in (upper, lower))
    below_profile = max(upper - 50, 0), max(lower - 50, 0)
    if abs(upper - lower) < 1e-3:
        expected = 1 / speed_at(sound, (upper + lower) / 2)
    elif c1 == c2:
        expected = 1 / c1
    else:
        expected = (np.log(c2 / c1) / 1.4 + (below_profile[1] - below_profile[0]) / 1520.0) / (
            lower - upper
        )
    assert_allclose(mean_slowness(sound, upper, lower), expected, rtol=1e-9)
    # in compiled code too
    assert_allclose(compiled_slowness(sound, upper, lower), expected, rtol=1e-9)


def test_sound_has_the_speed_between_and_beyond_the_points_of_a_profile() -> None:
    sound = SoundProfile.through([[2.0, 1450.0], [10.0, 1490.0], [30.0, 1470.0]])
    for depth in (0.0, 2.0, 4.0, 10.0, 25.0, 30.0, 99.0):
        assert speed_at(sound, depth) == pytest.approx(
            np.interp(depth, sound.depth, sound.speed), rel=1e-15
        )


def test_profile_and_bias_scale_the_range():
    trajectory = make_trajectory((20.0, 0.0, -18.0))
    refracting = make_scenario(Acoustics(sound_speed_profile=((0.0, 1480.0), (20.0, 1500.0))))
    ranges = propagate(trajectory, SensingSettings.of(refracting)).range[:, FRONT, Path.DIRECT]
    mean_slowness_over_depth = np.log(1498.0 / 1488.0) / 10.0
    assert_allclose(ranges, np.hypot(19.0, 10.0) * C * mean_slowness_over_depth, rtol=1e-12)
    biased = make_scenario(Acoustics(sound_speed_bias_m_s=15.0))
    assert_allclose(
        propagate(trajectory, SensingSettings.of(biased)).range[:, FRONT, Path.DIRECT],
        np.hypot(19, 10) * 1.01,
        rtol=1e-12,
    )


def test_clock_offset_and_drift_shift_all_ranges():
    trajectory = make_trajectory((20.0, 0.0, -8.0))
    without_errors = propagate(trajectory, SensingSettings.of(make_scenario())).range
    sound = propagate(
        trajectory,
        SensingSettings.of(make_scenario(Acoustics(clock_offset_s=1e-3, clock_drift_ppm=50.0))),
    )
    shift = C * (1e-3 + 50e-6 * sound.emission_step * 0.1)
    assert_allclose(
        (sound.range - without_errors)[:, :, Path.DIRECT], np.tile(shift[:, None], 3), atol=1e-10
    )


@pytest.mark.parametrize(
    ("path", "image_height"), [(Path.SURFACE, 8.0 + 11.0), (Path.BOTTOM, 2 * 30.0 - 8.0 - 11.0)]
)
def test_echo_comes_from_the_image(path, image_height):
    trajectory = make_trajectory((15.0, 9.0, -11.0))
    scenario = make_scenario(Acoustics(surface_echo_probability=0.1, bottom_echo_probability=0.1))
    sound = propagate(trajectory, SensingSettings.of(scenario))
    assert_allclose(
        sound.range[:, FRONT, path], np.sqrt(14.0**2 + 9.0**2 + image_height**2), rtol=1e-12
    )
    assert np.all(sound.range[:, :, path] > sound.range[:, :, Path.DIRECT])
    refracting = scenario.model_copy(
        update={
            "acoustics": scenario.acoustics.model_copy(
                update={"sound_speed_profile": ((0.0, 1400.0), (10.0, 1600.0), (30.0, 1450.0))}
            )
        }
    )
    mean_slowness_of_echo = (
        propagate(trajectory, SensingSettings.of(refracting)).arrival.ratio[0, FRONT, path] / C
    )
    longer_part = (
        np.linspace(0.0, 11.0, 1_000_001)
        if path is Path.SURFACE
        else np.linspace(8.0, 30.0, 1_000_001)
    )
    shorter_part = (
        longer_part[longer_part <= 8.0]
        if path is Path.SURFACE
        else longer_part[longer_part >= 11.0]
    )
    slowness = 1 / np.interp(
        np.concatenate([longer_part, shorter_part]), [0, 10, 30], [1400, 1600, 1450]
    )
    assert_allclose(mean_slowness_of_echo, slowness.mean(), rtol=1e-6)


def test_images_of_images_are_the_sources():
    source = 3.0, -2.0, -7.0
    for path in Path:
        floor = LevelFloor(25.0)
        once = image(source, path, source, floor)
        assert image(once, path, source, floor) == source


ECHOES = SensorErrors(surface_echo_probability=0.2, bottom_echo_probability=0.05)


def paths_of_messages(errors: SensorErrors, run: int, steps: Ints) -> Ints:
    """Paths of messages sent at these steps, shape (m, 3)."""
    return np.array(
        [paths_taken(errors, Address(*seed_and_run(1, run), 0, step)) for step in steps.tolist()]
    )


def test_echoes_occur_at_the_set_rate_independently():
    steps = np.arange(1, 50_001)
    path = paths_of_messages(ECHOES, 0, steps)
    for expected_path, probability in (
        (Path.SURFACE, 0.2),
        (Path.BOTTOM, 0.05),
        (Path.DIRECT, 0.75),
    ):
        rate = (path == expected_path).mean(axis=0)
        assert_allclose(
            rate, probability, atol=4.5 * np.sqrt(probability * (1 - probability) / steps.size)
        )
    both_surface_rate = np.mean((path[:, REAR] == Path.SURFACE) & (path[:, FRONT] == Path.SURFACE))
    assert_allclose(both_surface_rate, 0.04, atol=4.5 * np.sqrt(0.04 / steps.size))
    drawn = uniforms(1, 0, Stream.ECHO.number(), steps)[:, :3]
    assert_array_equal(
        path, np.select([drawn < 0.2, drawn < 0.25], [Path.SURFACE, Path.BOTTOM], Path.DIRECT)
    )


def test_common_echoes_are_as_frequent_and_hit_all_pings_of_a_message():
    steps = np.arange(1, 50_001)
    path = paths_of_messages(ECHOES._replace(common_echoes=True), 0, steps)
    assert_array_equal(path, np.repeat(path[:, :1], 3, axis=1))
    for expected_path, probability in ((Path.SURFACE, 0.2), (Path.BOTTOM, 0.05)):
        assert_allclose(
            (path == expected_path).mean(),
            probability,
            atol=4.5 * np.sqrt(probability * (1 - probability) / steps.size),
        )


def arrives(steps: Ints, errors: SensorErrors) -> Bools:
    """Whether each message arrives, of a mission that sends one at each step."""
    n = steps.size
    truth = IdealMeasurements(
        dt=0.1,
        start=np.zeros(4),
        speed=np.ones(n),
        heading=np.ones(n),
        depth=np.ones(n),
        hydrophone=np.zeros((n, 2)),
        leader_position=np.zeros((n, 2)),
        leader_heading=np.zeros(n),
        message_step=steps,
        emission_step=steps,
        sent=records(MESSAGE, n),
        slant_range=np.full((n, 3), 30.0),
    )
    return np.isfinite(measure(truth, errors, seed=1, run=0, use_compiled=True).ranges).all(axis=1)


@pytest.mark.system
def test_loss_has_the_rate_and_the_bursts_of_the_chain():
    """Of Gilbert and Elliott: p = 0.02 into a burst, r = 1/8 out of it, lost are p / (p + r)."""
    steps = np.arange(1, 200_001)
    arrived_without_bursts = arrives(steps, SensorErrors(loss_probability=0.3))
    assert_allclose(1 - arrived_without_bursts.mean(), 0.3, atol=4.5 * np.sqrt(0.21 / steps.size))
    bursts = SensorErrors(burst_probability=0.02, burst_mean_messages=8.0)
    arrived = arrives(steps, bursts)
    lengths = np.array([len(list(run)) for lost, run in groupby(~arrived) if lost])
    # lengths are geometric: standard deviation √(8 · 7)
    assert_allclose(lengths.mean(), 8.0, atol=4.5 * np.sqrt(56.0 / lengths.size))
    assert_allclose(1 - arrived.mean(), 0.02 / (0.02 + 1 / 8), atol=0.01)
    assert arrives(steps[:1000], SensorErrors()).all()


def test_pings_from_beyond_the_maximum_range_are_not_received():
    trajectory = make_trajectory((50.0, 0.0, -8.0))
    ranges = observe(
        trajectory, SensingSettings.of(make_scenario(Acoustics(max_range_m=50.0)))
    ).slant_range
    assert np.isnan(ranges[:, REAR]).all()
    assert np.isfinite(ranges[:, FRONT]).all()


@pytest.mark.parametrize(
    "settings",
    [
        {"surface_echo_probability": 0.7, "bottom_echo_probability": 0.4},
        {"sound_speed_profile": ((5.0, 1500.0), (5.0, 1490.0))},
    ],
)
def test_impossible_settings_are_refused(settings):
    with pytest.raises(ValueError, match=r"add up|not deeper"):
        Acoustics(**settings)


@pytest.mark.parametrize(
    "acoustics",
    [
        Acoustics(surface_echo_probability=0.2, bottom_echo_probability=0.1),
        Acoustics(surface_echo_probability=0.2, bottom_echo_probability=0.1, common_echoes=True),
        Acoustics(
            loss_probability=0.1, burst_probability=0.2, burst_mean_messages=3.0, max_range_m=37.0
        ),
        Acoustics(
            surface_echo_probability=0.1,
            loss_probability=0.2,
            travel_time=True,
            ping_slot_s=0.04,
            clock_drift_ppm=30.0,
        ),
        # about half of the messages are heard
        Acoustics(
            source_level_db=109.0,
            message_length_s=0.2,
            ranging_pulse="end",
            travel_time=True,
            clock_offset_s=0.01,
        ),
    ],
)
@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-1", "laisn-3-2"])
def test_a_campaign_meets_the_echoes_and_losses_of_its_flights(acoustics, variant):
    trajectory = make_trajectory(
        (20.0, -30.0, -14.0),
        leader_velocity=(1.0, 0, 0),
        follower_velocity=(1.0, 0.1, 0),
        heading_pitch_roll=(1.5, 0.05, 0.02),
    )
    scenario = make_scenario(acoustics)
    navigator_settings = replace(
        navigation_settings(scenario, trajectory.sites, 0), variant=variant
    )
    scenario = scenario.model_copy(update={"navigation": Navigation(variant=variant)})
    truth, errors = (
        observe(trajectory, SensingSettings.of(scenario)),
        errors_of(SensingSettings.of(scenario)),
    )
    campaign_states = histories(
        Cell(truth=truth, errors=errors, settings=navigator_settings, runs=range(3))
    )
    for run in range(3):
        receptions = measure(
            truth, errors, seed=1, run=run, transmitters=navigator_settings.transmitters
        )
        assert_allclose(
            Navigator(navigator_settings, truth.start).run(receptions).state,
            campaign_states[..., run],
            atol=1e-9,
        )


def test_a_range_that_is_read_from_an_echo_is_the_length_of_its_path():
    trajectory = make_trajectory((15.0, 9.0, -11.0))
    scenario = make_scenario(Acoustics(surface_echo_probability=0.4, bottom_echo_probability=0.3))
    errors = errors_of(SensingSettings.of(scenario))._replace(
        range_tau=(0.0, 0.0, 0.0), range_scale_mean=0.0, range_scale_sigma=0.0
    )
    truth = observe(trajectory, SensingSettings.of(scenario))
    measured_ranges = measure(truth, errors, seed=1, run=2).ranges
    path = paths_of_messages(errors, 2, truth.emission_step)
    sound = propagate(trajectory, SensingSettings.of(scenario))
    assert_allclose(
        measured_ranges,
        np.take_along_axis(sound.range, path[..., None], axis=2)[..., 0],
        rtol=1e-15,
    )
    assert {int(p) for p in np.unique(path)} == {0, 1, 2}


def test_an_echo_along_the_boundary_has_the_slowness_there():
    """Source and receiver on the surface, or on the floor: no depth is crossed."""
    sound = SoundProfile.through([[0.0, 1400.0], [30.0, 1450.0]])
    for path, depth, speed in ((Path.SURFACE, 0.0, 1400.0), (Path.BOTTOM, 30.0, 1450.0)):
        assert path_slowness(
            sound, path, (0.0, 0.0, -depth), (0.0, 0.0, -depth), LevelFloor(30.0)
        ) == pytest.approx(1.0 / speed)
