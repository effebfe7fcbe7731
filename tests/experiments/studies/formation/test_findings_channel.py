"""What the broadcast of a formation's leader demands of a modem, by hand."""

import math

import pytest

from experiments.studies.formation.findings import LeaderBroadcast
from sim.scenario.file import validate


def formation(**tables: object) -> LeaderBroadcast:
    """The broadcast to followers 29 m behind and 40 m aside, and 5 m behind, at its leader's depth;
    `tables` are further tables of the scenario.
    """
    stations = [
        {"station": {"behind_m": 29.0, "port_m": 40.0, "depth_m": 10.0}},
        {"station": {"behind_m": 5.0, "port_m": 0.0, "depth_m": 10.0}},
    ]
    base = {"name": "s", "followers": stations, "leader": {"depth_m": 10.0, "baseline_m": 2.0}}
    return LeaderBroadcast.of(validate(base | {"ocean": {"floor_depth_m": 40.0}} | tables, "test"))


def test_bits_of_a_message_are_those_of_its_quantities() -> None:
    # 86400 numbers, 2 million places along two axes, 3600 headings, 500 speeds, 4000 depths, a
    # checksum of 16 bits
    plain = formation(
        leader={"depth_m": 10.0, "broadcast_attitude": False, "broadcast_waypoints": 0}
    )
    assert plain.message_bits == 17 + 2 * 21 + 12 + 9 + 12 + 16
    # with a message every 10 s there are a tenth of the numbers; 900 tilts about two axes take 10
    # bits each
    leader = {"depth_m": 10.0, "broadcast_waypoints": 0}
    every_10_s = formation(leader=leader, timing={"message_interval_s": 10.0})
    assert every_10_s.message_bits == 14 + 2 * 21 + 12 + 9 + 12 + 16 + 20
    # a waypoint is a place and one of 86400 seconds; by default there are two
    with_waypoints = formation(leader={"depth_m": 10.0, "broadcast_attitude": False})
    assert with_waypoints.message_bits == plain.message_bits + 2 * (2 * 21 + 17)


def test_the_farthest_station_is_measured_from_the_farther_transmitter() -> None:
    # of transmitters 1 m ahead and astern of the leader, the one ahead: √(30² + 40²)
    assert formation().reach_m == pytest.approx(50.0)


def test_passive_followers_share_the_channel_and_interrogating_ones_do_not() -> None:
    channel = formation(acoustics={"sound_speed_m_s": 1500.0})
    bits, travel_time = channel.message_bits, 50.0 / 1500.0
    assert channel.shortest_interval_s(80.0) == pytest.approx(bits / 80.0 + travel_time)
    assert channel.asked_interval_s(80.0, 50) == pytest.approx(
        50 * (bits / 80.0 + 2.0 * travel_time)
    )
    assert math.isclose(
        channel.asked_interval_s(80.0, 50), 5.0 * channel.asked_interval_s(80.0, 10)
    )
