"""The tightly coupled navigator as a whole: recovery, invariance, consistency, and refusals of
invalid input.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from laisn import swarm
from laisn.arrays import Floats
from laisn.bound import BoundGeometry, TrueNoise, position_bound
from laisn.estimates import TightEstimates
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges, Reception
from laisn.settings import Assume, TightSettings
from laisn.tight.model import model_of, new_belief
from laisn.tight.navigator import MissionEstimates, TightNavigator, filter_mission, run_mission
from laisn.tight.ranging import new_range_message
from tests.laisn.tight.mission import DT, EVERYTHING, Mission


@pytest.mark.parametrize(
    ("assume", "transmitters", "errors"),
    [
        (Assume(), 3, {"log": 0.2, "compass": 0.1, "scale": 0.1}),
        (Assume(), 2, {"log": -0.1, "compass": -0.1, "scale": 0.05}),
        (Assume(drift=True), 3, {"log": 0.2, "compass": 0.1, "scale": 0.1}),
        (Assume(exact_leader=False), 3, {"log": 0.2, "compass": 0.1, "leader": 0.09}),
        (Assume(offsets=True), 3, {"log": 0.1, "compass": 0.1, "offsets": (0.0, 0.012, -0.01)}),
        (Assume(clock=True), 3, {"log": 0.2, "compass": 0.1, "clock": (1.5, 1.5e-3)}),
        (Assume(clock=True), 2, {"log": 0.1, "compass": -0.1, "clock": (-1.5, -1.5e-3)}),
    ],
)
def test_exact_measurements_with_constant_biases_lead_to_the_truth(
    assume: Assume, transmitters: int, errors: dict[str, Any]
) -> None:
    mission = Mission(steps=6000)
    setting = TightSettings(assume=assume, transmitters=transmitters, heading_bias_sigma=0.15)
    result = TightNavigator(setting, mission.start).run(mission.measured(**errors))
    error = np.hypot(*(result.state[-1000:, :2] - mission.follower[-1000:]).T)
    # biases that are taken to wander a little keep a little of every error
    assert np.sqrt(np.mean(error**2)) < 0.055
    last = dict(zip(result.names, result.full_state[-1], strict=True))
    assert last["log_bias_m_s"] == pytest.approx(errors["log"], abs=0.02)
    assert last["compass_bias_rad"] == pytest.approx(errors["compass"], abs=0.02)
    if "clock" in errors:
        # the scale error of ranges that are nearly equal is one with the clock's offset
        clock_offset = errors["clock"][0] + errors["clock"][1] * DT * mission.steps
        assert last["clock_offset_m"] + last["range_scale_m"] == pytest.approx(
            clock_offset, abs=0.05
        )
        assert last["clock_drift_m_s"] == pytest.approx(errors["clock"][1], abs=3e-4)
    if "leader" in errors:
        assert last["leader_compass_bias_rad"] == pytest.approx(errors["leader"], abs=0.01)


def test_messages_that_are_late_as_a_whole_do_no_harm() -> None:
    """One in ten, by 0.3 to 4.8 m, with two transmitters: as their differences are right, so is
    the side.
    """
    mission, rng = Mission(steps=6000, steps_per_message=50), np.random.default_rng(4)
    measured = mission.measured(rng, log=0.2, compass=0.05, scale=0.1)
    delay_m = np.where(
        rng.random(mission.message_step.size) < 0.1,
        rng.uniform(0.3, 4.8, mission.message_step.size),
        0.0,
    )
    errors = []
    for excess in (np.zeros(mission.message_step.size), delay_m):
        received = replace(measured, ranges=measured.ranges + excess[:, None])
        actual = TightNavigator(TightSettings(transmitters=2), mission.start).run(received)
        errors.append(np.hypot(*(actual.state[:, :2] - mission.follower[1:]).T))
        assert actual.used[excess > 1.0].max(initial=0) <= 1
    assert np.count_nonzero(delay_m) > 5
    assert np.sqrt(np.mean(errors[1] ** 2)) < 1.2 * np.sqrt(np.mean(errors[0] ** 2))


def test_a_current_is_found() -> None:
    mission = Mission(steps=6000, current=(0.15, -0.1))
    setting = TightSettings(assume=Assume(current=True))
    result = TightNavigator(setting, mission.start).run(mission.measured(log=0.1, compass=0.05))
    last = dict(zip(result.names, result.full_state[-1], strict=True))
    assert [last["current_east_m_s"], last["current_north_m_s"]] == pytest.approx(
        [0.15, -0.1], abs=0.03
    )
    assert np.hypot(*(result.state[-1, :2] - mission.follower[-1])) < 0.15


def turned_and_moved(measurements: Measurements, angle: float, shift: Floats) -> Measurements:
    """Measurements of the same mission in a world that is turned clockwise by an angle [rad] and
    then moved by a shift [m].
    """
    message = measurements.message.copy()
    message[:, 1:3] = rotated(message[:, 1:3], angle) + shift
    message[:, 3] += angle
    return replace(measurements, heading=measurements.heading + angle, message=message)


def rotated(points: Floats, angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, -s], [s, c]]))


@given(
    angle=st.floats(-np.pi, np.pi),
    east=st.floats(-1e4, 1e4),
    north=st.floats(-1e4, 1e4),
    transmitters=st.sampled_from([2, 3]),
    everything=st.booleans(),
    seed=st.integers(0, 100),
)
@settings(max_examples=15, deadline=None, derandomize=True)
def test_in_a_world_turned_and_moved_estimates_are_turned_and_moved_with_it(
    angle: float, east: float, north: float, transmitters: int, everything: bool, seed: int
) -> None:
    mission, shift = Mission(steps=600), np.array([east, north])
    setting = TightSettings(
        assume=EVERYTHING if everything else Assume(), transmitters=transmitters
    )
    measurements = mission.measured(np.random.default_rng(seed), log=0.2, compass=0.1)
    estimates = run_mission(setting, measurements, mission.start)
    moved_start = np.concatenate([rotated(mission.start[None, :2], angle)[0] + shift, np.zeros(2)])
    moved_estimates = run_mission(
        setting, turned_and_moved(measurements, angle, shift), moved_start
    )
    np.testing.assert_allclose(
        moved_estimates.state[:, :2], rotated(estimates.state[:, :2], angle) + shift, atol=1e-5
    )


@pytest.mark.parametrize("transmitters", [2, 3])
@pytest.mark.parametrize("assume", [Assume(), EVERYTHING])
def test_online_steps_a_run_and_a_compiled_loop_agree_to_the_bit(
    assume: Assume, transmitters: int
) -> None:
    mission = Mission(steps=400)
    setting = TightSettings(assume=assume, transmitters=transmitters)
    measurements = mission.measured(np.random.default_rng(0), log=0.2, compass=0.1)
    result = TightNavigator(setting, mission.start).run(measurements)
    online = TightNavigator(setting, mission.start)
    for i, (own, reception) in enumerate(measurements.steps()):
        online.step(own, reception)
        assert online.state.tobytes() == result.state[i].tobytes()
        assert online.covariance.tobytes() == result.covariance[i].tobytes()
    actual = run_mission(setting, measurements, mission.start)
    assert actual.state.tobytes() == result.state.tobytes()
    assert actual.covariance[:, 1].tobytes() == result.covariance[:, 0, 1].tobytes()
    assert actual.outcome[:, 1].tolist() == result.used.tolist()
    np.testing.assert_array_equal(actual.outcome[:, 2], result.nis)


def test_errors_match_the_covariance_and_approach_the_bound() -> None:
    mission, runs = Mission(steps=3000), 40
    rng = np.random.default_rng(11)
    setting = TightSettings()
    squared, normalised = np.empty((runs, 3000)), np.empty((runs, 3000))
    for run in range(runs):
        # constants are drawn from their distributions in the settings
        measurements = mission.measured(
            rng,
            log=rng.normal(0, 0.3),
            compass=rng.normal(0, np.deg2rad(8.0)),
            scale=rng.normal(0, 0.2),
        )
        state, covariance, _ = run_mission(setting, measurements, mission.start)
        x, y = (state[:, :2] - mission.follower[1:]).T
        xx, xy, yy = covariance.T
        squared[run] = x**2 + y**2
        normalised[run] = (x * x * yy - 2 * x * y * xy + y * y * xx) / (xx * yy - xy * xy)
    arms = mission.arms()
    bound = position_bound(
        BoundGeometry(
            dt=DT,
            speed=mission.speed[1:],
            heading=mission.heading[1:],
            message_step=mission.message_step,
            from_leader=(mission.follower - mission.leader)[mission.message_step],
            arms=np.concatenate([arms, np.zeros((*arms.shape[:2], 1))], axis=2),
        ),
        TrueNoise(heading_sigma=np.deg2rad(1.2), range_sigma=0.003, start=0.01),
    )
    ratio = np.sqrt(squared.mean() / np.trace(bound, axis1=1, axis2=2).mean())
    assert 0.9 < ratio < 1.1
    assert 1.6 < normalised.mean() < 2.4


@pytest.mark.parametrize("transmitters", [2, 3])
def test_covariances_stay_positive_definite_for_a_million_steps(transmitters: int) -> None:
    setting = TightSettings(assume=EVERYTHING, transmitters=transmitters)
    model, mission = model_of(setting), Mission(steps=10_000)
    belief = new_belief(setting, model, (mission.start[0], mission.start[1]))
    measurements = mission.measured(np.random.default_rng(3), log=0.2, compass=0.1)
    readings, step = (measurements.speed, measurements.heading), measurements.message_step
    messages = (
        step,
        measurements.message.view(swarm.MESSAGE)[:, 0],
        measurements.ranges,
        measurements.depth[step - 1],
    )
    estimates = MissionEstimates(np.empty((10_000, 2)), np.empty((0, 3)), np.empty((0, 3)))
    way_of_lap = mission.follower[-1] - mission.follower[0]
    for lap in range(100):
        assert (
            filter_mission(belief, model, new_range_message(), readings, messages, estimates) == 0
        )
        for k in range(int(belief.n_hypotheses) * model.modes):
            covariance = belief.covariance[k, : model.n_states, : model.n_states]
            np.testing.assert_array_equal(covariance, covariance.T)
            sigma = np.sqrt(np.diag(covariance))
            assert np.linalg.eigvalsh(covariance / np.outer(sigma, sigma)).min() > 1e-9, lap
        # the next lap begins where the mission began
        belief.state[:, :2] -= way_of_lap


OWN = OwnMotion(1.0, 0.2, 8.0)


MESSAGE = LeaderMessage(0.1, 20.0, 5.0, 0.3, 1.0, 8.0)


RANGES = Ranges(20.0, 21.0, 20.5)


@pytest.mark.parametrize(
    ("own", "message", "ranges", "pattern"),
    [
        (OWN._replace(speed=np.nan), None, None, "step 1: own motion .* is not finite"),
        (OWN._replace(heading=np.inf), None, None, "is not finite"),
        (OWN._replace(speed=1e6), None, None, r"the speed is 1e\+06 m/s, expected"),
        (OWN, MESSAGE._replace(east=np.nan), RANGES, "leader message .* is not finite"),
        (OWN, MESSAGE._replace(heading=np.nan), RANGES, "leader message .* is not finite"),
        (OWN, MESSAGE._replace(north=1e12), RANGES, "leader message .* farther than"),
        (OWN, MESSAGE, RANGES._replace(front=-3.0), "ranges .* expected 0"),
        (OWN, MESSAGE, RANGES._replace(rear=np.inf), "ranges .* expected 0"),
        (OWN, MESSAGE, RANGES._replace(rear=1e9), "ranges .* expected 0"),
    ],
)
def test_invalid_measurements_are_reported_and_leave_the_estimate_unchanged(
    own: OwnMotion, message: LeaderMessage | None, ranges: Ranges | None, pattern: str
) -> None:
    navigator = TightNavigator(TightSettings(), np.array([0.0, 0.0, 1.0, 0.0]))
    before = navigator.state, navigator.covariance
    reception = None if message is None or ranges is None else Reception(message, ranges)
    with pytest.raises(ValueError, match=pattern):
        navigator.step(own, reception)
    np.testing.assert_array_equal(navigator.state, before[0])
    np.testing.assert_array_equal(navigator.covariance, before[1])


def test_lost_ranges_and_messages_widen_the_covariance() -> None:
    mission = Mission(steps=600)
    complete = mission.measured(np.random.default_rng(2))
    ranges = complete.ranges.copy()
    ranges[30:] = np.nan
    without_ranges = TightNavigator(TightSettings(), mission.start).run(
        replace(complete, ranges=ranges)
    )
    undisturbed = TightNavigator(TightSettings(), mission.start).run(complete)
    assert np.array_equal(without_ranges.state[:309], undisturbed.state[:309])
    assert without_ranges.used[29:].tolist() == [3] + [0] * 30
    assert np.all(np.isnan(without_ranges.nis[30:]))
    variance = np.trace(without_ranges.covariance[:, :2, :2], axis1=1, axis2=2)
    assert np.all(np.diff(variance[300:]) > 0)
    assert variance[-1] > 4 * np.trace(undisturbed.covariance[-1, :2, :2])
    # without a message at all it is the same dead reckoning
    first_messages = replace(
        complete,
        message_step=complete.message_step[:30],
        message=complete.message[:30],
        ranges=complete.ranges[:30],
    )
    without_messages = TightNavigator(TightSettings(), mission.start).run(first_messages)
    np.testing.assert_allclose(without_messages.state[-1], without_ranges.state[-1], atol=0.02)


def test_hypotheses_are_output_heaviest_first_and_one_is_at_the_truth() -> None:
    """A follower dead astern, which two transmitters on the axis cannot distinguish from its
    mirror image.
    """
    mission = Mission(steps=600)
    angle = mission.leader_heading[0]
    mission.follower += (
        np.array([-30.0 * np.sin(angle), -30.0 * np.cos(angle)]) - mission.follower[0]
    )
    result = TightNavigator(TightSettings(transmitters=2), mission.start).run(
        mission.measured(np.random.default_rng(3), log=0.2, compass=0.1)
    )
    ambiguous = np.count_nonzero(result.weight > 0.0, axis=1) > 1
    assert np.count_nonzero(ambiguous) > 10
    assert np.all(np.diff(result.weight, axis=1) <= 0.0)
    assert result.weight.sum(axis=1) == pytest.approx(np.ones(len(result.weight)))
    # the mean over the mixture is that of its output hypotheses
    mean = np.nansum(result.weight[:, :, None] * result.hypothesis, axis=1)
    np.testing.assert_allclose(mean, result.full_state[:, :2], atol=1e-9)


def test_single_ranges_keep_an_estimate_that_one_transmitter_alone_gives() -> None:
    mission = Mission(steps=3000)
    complete = mission.measured(np.random.default_rng(4), log=0.1)
    ranges = complete.ranges.copy()
    ranges[np.arange(len(ranges)) % 2 == 0, 0] = np.nan
    ranges[np.arange(len(ranges)) % 2 == 1, 1:] = np.nan
    result = TightNavigator(TightSettings(), mission.start).run(replace(complete, ranges=ranges))
    error = result.state[:, :2] - mission.follower[1:]
    normalised = np.einsum(
        "ni,ni->n", error, np.linalg.solve(result.covariance[:, :2, :2], error[..., None])[..., 0]
    )
    assert normalised.mean() < 6.0
    assert np.hypot(*error.T).max() < 5.0


def test_invalid_estimates_and_settings_are_reported() -> None:
    with pytest.raises(ValueError, match="transmitters is 4, expected 2 or 3"):
        TightSettings(transmitters=4)
    with pytest.raises(ValueError, match="range_sigma is 0"):
        TightSettings(range_sigma=0.0)
    with pytest.raises(ValueError, match="speed_sigma is -1"):
        TightSettings(speed_sigma=-1.0)
    with pytest.raises(ValueError, match="outlier_probability is 1"):
        TightSettings(outlier_probability=1.0)
    with pytest.raises(ValueError, match="start is"):
        TightNavigator(TightSettings(), np.array([0.0, np.nan, 0.0, 0.0]))
    mission = Mission(steps=20)
    navigator = TightNavigator(TightSettings(), mission.start)
    result = navigator.run(mission.measured())
    with pytest.raises(ValueError, match="at step 20 already"):
        navigator.run(mission.measured())
    with pytest.raises(ValueError, match=r"TightEstimates.used has shape \(1,\), expected \(2,\)"):
        TightEstimates(**{**result.__dict__, "used": result.used[:1]})
    with pytest.raises(ValueError, match=r"every 0\.1 s, but the filter steps 1 s"):
        TightNavigator(TightSettings(dt=1.0), mission.start).run(mission.measured())
