"""Steps of any length and transmitters anywhere, for the tightly coupled navigator."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from laisn.errors import LaisnError
from laisn.estimates import FixKind, TightEstimates
from laisn.messages import Measurements, OwnMotion
from laisn.settings import Assume, TightSettings
from laisn.tight.navigator import TightNavigator, run_mission
from tests.laisn.passages import BEACONS, START, passage
from tests.synthetic import bits


def run_tight(measurements: Measurements, **other: Any) -> TightEstimates:
    return TightNavigator(TightSettings(dt=0.5, **other), START).run(measurements)


def test_the_tightly_coupled_navigator_recovers_the_truth_in_steps_of_any_length() -> None:
    durations = np.random.default_rng(5).uniform(0.3, 0.7, 400)
    durations[[50, 222]] = 6.0
    measurements, true_position = passage(durations)
    estimates = run_tight(measurements)
    assert np.abs(estimates.state[:, :2] - true_position[1:]).max() < 0.01
    assert set(estimates.fix_kind.tolist()) == {FixKind.RANGES}


def test_durations_of_one_step_change_nothing_of_the_tightly_coupled_navigator_to_the_bit() -> None:
    equal, _ = passage(None)
    changed = replace(equal, durations=np.full(400, 0.5))
    assert bits(run_tight(changed)) == bits(run_tight(equal))


def test_a_longer_step_adds_more_noise_to_dead_reckoning() -> None:
    """Readings err by 0.2 m/s along the way, in one step of 2 s or in four of ½ s: 0.4² or 4 ·
    0.1² m².
    """
    start = np.array([0.0, 0.0, 0.0, 1.0])
    no_biases = TightSettings(
        dt=0.5, start_sigma=1e-9, speed_bias_sigma=0.0, heading_bias_sigma=0.0, heading_sigma=0.0
    )
    long_step, short_steps = TightNavigator(no_biases, start), TightNavigator(no_biases, start)
    long_step.step(OwnMotion(1.0, 0.0, 9.0), duration=2.0)
    for _ in range(4):
        short_steps.step(OwnMotion(1.0, 0.0, 9.0))
    assert long_step.state[:2] == pytest.approx([0.0, 2.0])
    assert short_steps.state[:2] == pytest.approx([0.0, 2.0])
    assert long_step.covariance[1, 1] == pytest.approx(0.16, rel=1e-3)
    assert short_steps.covariance[1, 1] == pytest.approx(0.04, rel=1e-3)
    with pytest.raises(LaisnError, match="expected a positive time"):
        long_step.step(OwnMotion(1.0, 0.0, 9.0), duration=-1.0)


def test_offsets_from_a_leader_at_the_origin_are_positions_of_beacons() -> None:
    """The messages say that the leader is at the origin and level; no heading turns the offsets."""
    measurements, _ = passage(None)
    turned = measurements.message.copy()
    turned[:, 3] = np.pi / 2
    offsets = tuple((east, north, -depth) for east, north, depth in BEACONS.tolist())
    from_offsets = run_tight(
        replace(measurements, message=turned, transmitters=None), transmitter_offsets=offsets
    )
    np.testing.assert_allclose(
        from_offsets.state,
        run_tight(replace(measurements, message=turned)).state,
        rtol=0,
        atol=1e-9,
    )


def test_a_range_to_an_unknown_position_counts_as_not_received() -> None:
    measurements, _ = passage(None)
    assert measurements.transmitters is not None
    transmitters, ranges = measurements.transmitters.copy(), measurements.ranges.copy()
    transmitters[10:, 2], ranges[10:, 2] = np.nan, np.nan
    without_position = run_tight(replace(measurements, transmitters=transmitters))
    assert without_position.used.tolist() == [3] * 10 + [2] * 90
    np.testing.assert_array_equal(
        without_position.state, run_tight(replace(measurements, ranges=ranges)).state
    )


def test_inputs_unsupported_by_the_tightly_coupled_navigator_are_reported() -> None:
    measurements, _ = passage(None)
    assert measurements.transmitters is not None
    with pytest.raises(LaisnError, match="whom no compass of a leader turns"):
        run_tight(measurements, assume=Assume(exact_leader=False))
    with pytest.raises(LaisnError, match="a transmitter is farther than"):
        run_tight(
            replace(measurements, transmitters=np.full_like(measurements.transmitters, np.inf))
        )
    with pytest.raises(
        ValueError, match="transmitter_offsets has 2 places, expected one for each of 3"
    ):
        TightSettings(transmitter_offsets=((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))
    for unsupported in (
        measurements,
        replace(measurements, transmitters=None, durations=np.full(400, 0.5)),
    ):
        with pytest.raises(
            LaisnError, match="steps of equal length, and transmitters on the leader's hull only"
        ):
            run_mission(TightSettings(dt=0.5), unsupported, START)
