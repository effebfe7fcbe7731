"""A pressure sensor without reading: every navigator uses the last depth, and no range before the
first depth.
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


def new_navigator(name: str) -> tuple[OnlineNavigator, Measurements]:
    """A new navigator and its measurements, with a depth that changes in every step."""
    if name == "beacons":
        measured, truth = round_trip(Errors(), seconds=60)
        navigator: OnlineNavigator = BeaconNavigator(
            BeaconSettings(), np.array([*truth[0], 0.0, 0.0])
        )
        return navigator, replace(measured, depth=np.linspace(0.0, 6.0, measured.depth.size))
    mission = Mission(steps=600)
    measured = mission.measured()
    # the transmitters of the hull, given as offsets one by one
    offsets = ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.0)) if name == "elsewhere" else ()
    navigator = (
        Navigator(NavigationSettings(), mission.start)
        if name == "laisn"
        else TightNavigator(TightSettings(transmitter_offsets=offsets), mission.start)
    )
    return navigator, replace(measured, depth=np.linspace(2.0, 8.0, measured.depth.size))


def with_depth(measured: Measurements, missing: slice, value: float) -> Measurements:
    depth = measured.depth.copy()
    depth[missing] = value
    return replace(measured, depth=depth)


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_depth_is_the_last_one_that_was_read(name: str) -> None:
    navigator, measured = new_navigator(name)
    actual = navigator.run(with_depth(measured, MISSING, np.nan))
    expected = new_navigator(name)[0].run(
        with_depth(measured, MISSING, measured.depth[MISSING.start - 1])
    )
    np.testing.assert_array_equal(actual.state, expected.state)
    np.testing.assert_array_equal(actual.covariance, expected.covariance)
    assert np.abs(actual.state - new_navigator(name)[0].run(measured).state).max() > 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_no_range_is_used_before_the_first_depth(name: str) -> None:
    navigator, measured = new_navigator(name)
    actual = navigator.run(with_depth(measured, slice(0, 95), np.nan))
    before_first_depth = measured.message_step <= 95
    assert np.all(actual.fix_kind[before_first_depth] == FixKind.LOST)
    assert np.all(actual.fix_kind[~before_first_depth] != FixKind.LOST)


@pytest.mark.system
@pytest.mark.parametrize("missing", [MISSING, slice(0, 95)])
def test_missions_of_campaigns_treat_missing_depths_as_the_navigators_do(missing: slice) -> None:
    def states_of(name: str) -> tuple[Floats, Measurements]:
        navigator, measured = new_navigator(name)
        measured = with_depth(measured, missing, np.nan)
        return navigator.run(measured).state, measured

    start = Mission(steps=600).start
    of_navigator, measured = states_of("tight")
    np.testing.assert_array_equal(run_mission(TightSettings(), measured, start).state, of_navigator)
    of_navigator, measured = states_of("laisn")
    of_lanes = in_lanes.run([measured], start, NavigationSettings()).state[..., 0]
    np.testing.assert_allclose(of_lanes, of_navigator, rtol=0, atol=1e-9)
