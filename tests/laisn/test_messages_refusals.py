"""What navigators refuse, number by number, and what they take although it is missing."""

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
PLACES = np.array([[0.0, -1.0, 8.0], [0.0, 1.0, 8.0], [-0.1, 0.0, 8.0]])
ALL: dict[str, Callable[[Floats], Navigator | TightNavigator | BeaconNavigator]] = {
    "laisn": lambda start: Navigator(NavigationSettings(), start),
    "tight": lambda start: TightNavigator(TightSettings(), start),
    "beacons": lambda start: BeaconNavigator(BeaconSettings(), start),
}
HULL = ["laisn", "tight"]


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_every_number_of_ones_own_must_be_finite(name: str, broken: float) -> None:
    for i in range(2 if np.isnan(broken) else 3):
        # a missing depth is NaN
        own = OwnMotion(*[broken if j == i else value for j, value in enumerate(OWN)])
        with pytest.raises(LaisnError, match=r"step 1: own motion .* is not finite"):
            ALL[name](START).step(own)
    for i in range(4):
        with pytest.raises(ValueError, match="expected four finite numbers"):
            ALL[name](np.where(np.arange(4) == i, broken, START))
    for duration in (broken, 0.0, -1.0):
        with pytest.raises(LaisnError, match="expected a positive time"):
            ALL[name](START).step(OWN, None, duration)


@pytest.mark.parametrize("name", HULL)
@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_the_leaders_pose_and_speed_must_be_finite_and_its_tilt_may_be_missing(
    name: str, broken: float
) -> None:
    for i in range(6):
        message = LeaderMessage(*[broken if j == i else value for j, value in enumerate(MESSAGE)])
        with pytest.raises(LaisnError, match=r"step 1: leader message .* is not finite"):
            ALL[name](START).step(OWN, Reception(message, RANGES))
    level = MESSAGE._replace(pitch=np.nan, roll=np.nan, heading_sigma=np.nan)
    (record,) = ALL[name](START).step(OWN, Reception(level, RANGES))
    assert record.step == 1


@pytest.mark.parametrize("name", ALL)
def test_a_range_may_be_missing_and_not_infinite(name: str) -> None:
    for i in range(3):
        for broken in (np.inf, -np.inf):
            ranges = Ranges(*[broken if j == i else value for j, value in enumerate(RANGES)])
            with pytest.raises(LaisnError, match=r"step 1: range.* NaN "):
                ALL[name](START).step(OWN, Reception(MESSAGE, ranges, PLACES))
        missing = Ranges(*[np.nan if j == i else value for j, value in enumerate(RANGES)])
        ALL[name](START).step(OWN, Reception(MESSAGE, missing, PLACES))


@pytest.mark.parametrize("name", HULL)
def test_a_transmitter_may_be_nowhere_and_not_infinitely_far(name: str) -> None:
    for place in np.ndindex(3, 3):
        places = PLACES.copy()
        places[place] = np.nan
        ALL[name](START).step(OWN, Reception(MESSAGE, RANGES, places))
        places[place] = -np.inf
        with pytest.raises(LaisnError, match="NaN stands for"):
            ALL[name](START).step(OWN, Reception(MESSAGE, RANGES, places))


def mission(**changes: Floats) -> Measurements:
    given = {
        "speed": np.ones(3),
        "heading": np.zeros(3),
        "depth": np.full(3, 8.0),
        "message": np.array([MESSAGE]),
        "ranges": np.array([RANGES]),
    }
    return Measurements(dt=0.1, message_step=np.array([2]), **{**given, **changes})


def test_a_mission_needs_a_new_navigator_of_its_step() -> None:
    for name in ALL:
        navigator = ALL[name](START)
        measurements = mission(transmitters=PLACES[None]) if name == "beacons" else mission()
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
