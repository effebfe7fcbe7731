"""Flights that campaigns store: flown again if damaged, and shared by cells."""

import warnings

import numpy as np
import pytest

from experiments.campaign import campaign, montecarlo
from experiments.campaign.store import DamagedResult, Store
from sim.scenario.settings import Acoustics, Leader
from tests.experiments.campaign.plans import scenario


@pytest.mark.parametrize("damage", ["empty", "garbage", "cut off", "another archive"])
def test_a_damaged_flight_is_flown_again_with_a_warning(tmp_path, damage):
    given = scenario()
    flown = campaign.mission(given, Store(tmp_path))
    [path] = (tmp_path / "store").iterdir()
    whole = path.read_bytes()
    if damage == "another archive":
        np.savez(path, pose=flown.pose)
    else:
        path.write_bytes(
            {"empty": b"", "garbage": b"PK no archive", "cut off": whole[: len(whole) // 2]}[damage]
        )
    with pytest.warns(
        DamagedResult, match=rf"{path.name} cannot be read and is computed again: ."
    ) as caught:
        again = campaign.mission(given, Store(tmp_path))
    assert len(caught) == 1
    assert again.position.tobytes() == flown.position.tobytes()
    assert path.read_bytes() == whole


def test_no_flipped_byte_of_a_flight_changes_a_number(tmp_path):
    given = scenario()
    flown, store = campaign.mission(given, Store(tmp_path)), Store(tmp_path)
    [path] = (tmp_path / "store").iterdir()
    whole = path.read_bytes()
    refused = 0
    for place in np.random.default_rng(5).choice(len(whole), 60, replace=False).tolist():
        damaged = bytearray(whole)
        damaged[place] ^= 0x20
        path.write_bytes(damaged)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = store.get(path.stem)
        if found is None:
            refused += [warning.category for warning in caught] == [DamagedResult]
        else:
            assert found[1]["pose"].tobytes() == flown.pose.tobytes()
            assert found[1]["twist"].tobytes() == flown.twist.tobytes()
    assert refused > 50


def test_one_flight_serves_other_transmitters_and_errors():
    one = scenario()
    other = scenario(
        leader=Leader(baseline_m=1.0, middle_offset_m=0.2),
        acoustics=Acoustics(range_scale_mean_m=0.3),
    )
    assert montecarlo.motion_key(one) == montecarlo.motion_key(other)
    assert montecarlo.motion_key(one) != montecarlo.motion_key(scenario("T3"))
    flown, moved = (
        montecarlo.simulate_mission(other),
        montecarlo.with_transmitter_sites(montecarlo.simulate_mission(one), other.leader),
    )
    np.testing.assert_array_equal(moved.site_offset, flown.site_offset)
    np.testing.assert_array_equal(moved.position, flown.position)
