"""A pressure sensor that gives no reading: every navigator uses the last depth, and no range
before the first.
"""

from dataclasses import replace

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.beacons import BeaconNavigator, BeaconSettings
from laisn.estimates import FixKind
from laisn.messages import Measurements
from laisn.navigator import Navigator
from laisn.navigators import OnlineNavigator
from laisn.settings import NavigationSettings, TightSettings
from laisn.tight.navigator import TightNavigator, run_mission
from tests.laisn import in_lanes
from tests.laisn.round_trip import Errors, round_trip
from tests.laisn.tight.mission import Mission

MISSING = slice(150, 185)
NAMES = ("laisn", "tight", "elsewhere", "beacons")


def given(name: str) -> tuple[OnlineNavigator, Measurements]:
    """A navigator and what it measures, at a depth of its own in each step."""
    if name == "beacons":
        measured, truth = round_trip(Errors(), seconds=60)
        navigator: OnlineNavigator = BeaconNavigator(
            BeaconSettings(), np.array([*truth[0], 0.0, 0.0])
        )
        return navigator, replace(measured, depth=np.linspace(0.0, 6.0, measured.depth.size))
    mission = Mission(steps=600)
    measured = mission.measured()
    # an arm of this length is no hull's
    places = ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.0)) if name == "elsewhere" else ()
    navigator = (
        Navigator(NavigationSettings(), mission.start)
        if name == "laisn"
        else TightNavigator(TightSettings(transmitter_offsets=places), mission.start)
    )
    return navigator, replace(measured, depth=np.linspace(2.0, 8.0, measured.depth.size))


def with_depth(measured: Measurements, missing: slice, value: float) -> Measurements:
    depth = measured.depth.copy()
    depth[missing] = value
    return replace(measured, depth=depth)


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_depth_is_the_last_one_that_was_read(name: str) -> None:
    navigator, measured = given(name)
    actual = navigator.run(with_depth(measured, MISSING, np.nan))
    expected = given(name)[0].run(with_depth(measured, MISSING, measured.depth[MISSING.start - 1]))
    np.testing.assert_array_equal(actual.state, expected.state)
    np.testing.assert_array_equal(actual.covariance, expected.covariance)
    assert np.abs(actual.state - given(name)[0].run(measured).state).max() > 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_no_range_is_used_before_the_first_depth(name: str) -> None:
    navigator, measured = given(name)
    actual = navigator.run(with_depth(measured, slice(0, 95), np.nan))
    before = measured.message_step <= 95
    assert np.all(actual.fix_kind[before] == FixKind.LOST)
    assert np.all(actual.fix_kind[~before] != FixKind.LOST)


@pytest.mark.system
@pytest.mark.parametrize("missing", [MISSING, slice(0, 95)])
def test_campaigns_do_the_same(missing: slice) -> None:
    def state(name: str) -> tuple[Floats, Measurements]:
        navigator, measured = given(name)
        measured = with_depth(measured, missing, np.nan)
        return navigator.run(measured).state, measured

    start = Mission(steps=600).start
    one_by_one, measured = state("tight")
    np.testing.assert_array_equal(run_mission(TightSettings(), measured, start).state, one_by_one)
    one_by_one, measured = state("laisn")
    together = in_lanes.run([measured], start, NavigationSettings()).state[..., 0]
    np.testing.assert_allclose(together, one_by_one, rtol=0, atol=1e-9)
