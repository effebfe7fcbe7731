"""Motions that campaigns store: flown again if damaged, and shared by cells."""

import warnings

import numpy as np
import pytest

from experiments.campaign import campaign, montecarlo
from experiments.campaign.montecarlo import CellSettings
from experiments.campaign.store import DamagedResult, Store, key_of
from sim.scenario.parts import MotionSettings
from sim.scenario.sensors import VehicleSensors
from sim.scenario.settings import Acoustics, Leader
from sim.simulation import simulate_motion
from sim.vehicle.mjcf import spec_of
from tests.experiments.campaign.plans import scenario

BIASED = VehicleSensors(speed_bias_m_s=0.4)


@pytest.mark.parametrize("damage", ["empty", "garbage", "cut off", "another archive"])
def test_a_damaged_flight_is_flown_again_with_a_warning(tmp_path, damage):
    flown = campaign.mission(scenario(), Store(tmp_path))
    [path] = (tmp_path / "store").iterdir()
    whole = path.read_bytes()
    if damage == "another archive":
        with path.open("wb") as file:
            np.savez(file, pose=flown.pose)
    else:
        path.write_bytes(
            {"empty": b"", "garbage": b"PK no archive", "cut off": whole[: len(whole) // 2]}[damage]
        )
    with pytest.warns(
        DamagedResult, match=rf"{path.name} cannot be read and is computed again: ."
    ) as caught:
        again = campaign.mission(scenario(), Store(tmp_path))
    assert len(caught) == 1
    assert again.position.tobytes() == flown.position.tobytes()
    assert path.read_bytes() == whole


def test_no_flipped_bit_of_a_flight_changes_a_number(tmp_path):
    flown, store = campaign.mission(scenario(), Store(tmp_path)), Store(tmp_path)
    [path] = (tmp_path / "store").iterdir()
    whole = path.read_bytes()
    refused = 0
    for offset in np.random.default_rng(5).choice(len(whole), 60, replace=False).tolist():
        damaged = bytearray(whole)
        damaged[offset] ^= 0x20
        path.write_bytes(damaged)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            actual = store.get(path.stem)
        if actual is None:
            refused += [warning.category for warning in caught] == [DamagedResult]
        else:
            assert actual[1]["pose"].tobytes() == flown.pose.tobytes()
            assert actual[1]["twist"].tobytes() == flown.twist.tobytes()
    assert refused > 50


def test_one_flight_serves_cells_with_other_transmitters_and_errors():
    plain = scenario()
    biased_followers = [
        follower.model_copy(update={"sensors": BIASED}) for follower in plain.followers
    ]
    with_errors = scenario(
        leader=Leader(baseline_m=1.0, middle_offset_m=0.2, broadcast_attitude=True, sensors=BIASED),
        acoustics=Acoustics(range_scale_mean_m=0.3),
    ).model_copy(update={"followers": tuple(biased_followers)})
    keys = [key_of(MotionSettings.of(mission)) for mission in (plain, with_errors, scenario("T3"))]
    assert keys[0] == keys[1] != keys[2]
    flown_motion = simulate_motion(with_errors)
    served_motion = montecarlo.with_transmitter_sites(
        montecarlo.simulate_mission(plain), CellSettings.of(with_errors).transmitters
    )
    np.testing.assert_array_equal(served_motion.site_offset, flown_motion.site_offset)
    np.testing.assert_array_equal(served_motion.position, flown_motion.position)


def test_a_stored_flight_has_the_transmitters_of_the_hull_whoever_flew_it_first(tmp_path):
    """A cell whose scenario does not place the transmitters takes their places from it."""
    store = Store(tmp_path)
    first = campaign.mission(scenario(leader=Leader(baseline_m=1.0)), store)
    later = campaign.mission(scenario(leader=Leader(baseline_m=None)), store)
    front = spec_of("leader").site("tx_front").pos
    for flown in (first, later):
        np.testing.assert_array_equal(flown.sites["leader/tx_front"], front)
