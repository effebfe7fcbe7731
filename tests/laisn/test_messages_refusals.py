"""Numbers that navigators refuse, one by one, and those that may be missing."""

from collections.abc import Callable

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.beacons import BeaconNavigator, BeaconSettings
from laisn.errors import LaisnError
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges, Reception
from laisn.metrics import summarise
from laisn.navigator import Navigator
from laisn.settings import NavigationSettings, TightSettings
from laisn.tight.navigator import TightNavigator

START = np.array([-10.0, 10.0, 0.0, 1.0])
OWN, MESSAGE = OwnMotion(1.0, 0.0, 8.0), LeaderMessage(0.1, 0.0, 0.0, 0.0, 1.0, 8.0, 0.1, 0.1, 0.1)
RANGES = Ranges(13.0, 14.5, 14.0)
TRANSMITTERS = np.array([[0.0, -1.0, 8.0], [0.0, 1.0, 8.0], [-0.1, 0.0, 8.0]])
NAVIGATORS: dict[str, Callable[[Floats], Navigator | TightNavigator | BeaconNavigator]] = {
    "laisn": lambda start: Navigator(NavigationSettings(), start),
    "tight": lambda start: TightNavigator(TightSettings(), start),
    "beacons": lambda start: BeaconNavigator(BeaconSettings(), start),
}
BY_LEADER = ["laisn", "tight"]


@pytest.mark.parametrize("name", NAVIGATORS)
@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_own_motion_start_and_duration_must_be_finite(name: str, broken: float) -> None:
    for i in range(2 if np.isnan(broken) else 3):
        # a missing depth is NaN
        own = OwnMotion(*[broken if j == i else value for j, value in enumerate(OWN)])
        with pytest.raises(LaisnError, match=r"step 1: own motion .* is not finite"):
            NAVIGATORS[name](START).step(own)
    for i in range(4):
        with pytest.raises(ValueError, match="expected four finite numbers"):
            NAVIGATORS[name](np.where(np.arange(4) == i, broken, START))
    for duration in (broken, 0.0, -1.0):
        with pytest.raises(LaisnError, match="expected a positive time"):
            NAVIGATORS[name](START).step(OWN, None, duration)


@pytest.mark.parametrize("name", BY_LEADER)
@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_the_leaders_pose_and_speed_must_be_finite_and_its_tilt_may_be_missing(
    name: str, broken: float
) -> None:
    for i in range(6):
        message = LeaderMessage(*[broken if j == i else value for j, value in enumerate(MESSAGE)])
        with pytest.raises(LaisnError, match=r"step 1: leader message .* is not finite"):
            NAVIGATORS[name](START).step(OWN, Reception(message, RANGES))
    level = MESSAGE._replace(pitch=np.nan, roll=np.nan, heading_sigma=np.nan)
    (record,) = NAVIGATORS[name](START).step(OWN, Reception(level, RANGES))
    assert record.step == 1


@pytest.mark.parametrize("name", NAVIGATORS)
def test_a_range_may_be_missing_and_not_infinite(name: str) -> None:
    for i in range(3):
        for broken in (np.inf, -np.inf):
            ranges = Ranges(*[broken if j == i else value for j, value in enumerate(RANGES)])
            with pytest.raises(LaisnError, match=r"step 1: range.* NaN "):
                NAVIGATORS[name](START).step(OWN, Reception(MESSAGE, ranges, TRANSMITTERS))
        missing = Ranges(*[np.nan if j == i else value for j, value in enumerate(RANGES)])
        NAVIGATORS[name](START).step(OWN, Reception(MESSAGE, missing, TRANSMITTERS))


@pytest.mark.parametrize("name", BY_LEADER)
def test_a_transmitters_position_may_be_missing_and_not_infinite(name: str) -> None:
    for index in np.ndindex(3, 3):
        transmitters = TRANSMITTERS.copy()
        transmitters[index] = np.nan
        NAVIGATORS[name](START).step(OWN, Reception(MESSAGE, RANGES, transmitters))
        transmitters[index] = -np.inf
        with pytest.raises(LaisnError, match="NaN stands for"):
            NAVIGATORS[name](START).step(OWN, Reception(MESSAGE, RANGES, transmitters))


def mission(**changes: Floats) -> Measurements:
    arrays = {
        "speed": np.ones(3),
        "heading": np.zeros(3),
        "depth": np.full(3, 8.0),
        "message": np.array([MESSAGE]),
        "ranges": np.array([RANGES]),
    }
    return Measurements(dt=0.1, message_step=np.array([2]), **{**arrays, **changes})


def test_a_mission_needs_a_new_navigator() -> None:
    for name in NAVIGATORS:
        navigator = NAVIGATORS[name](START)
        measurements = mission(transmitters=TRANSMITTERS[None]) if name == "beacons" else mission()
        navigator.run(measurements)
        with pytest.raises(ValueError, match="at step 3 already; a mission needs a new one"):
            navigator.run(measurements)


def test_a_summary_needs_finite_errors_of_one_step_at_least() -> None:
    fine = np.array([1.0, 2.0])
    for position, bearing in (
        (np.array([]), np.array([])),
        (np.array([1.0, np.inf]), fine),
        (fine, fine * np.nan),
    ):
        with pytest.raises(ValueError, match="at least one step, and finite errors only"):
            summarise(position, bearing)
