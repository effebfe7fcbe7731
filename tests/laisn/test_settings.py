"""Settings of all navigators: what each number may be."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from laisn.beacons import BeaconSettings
from laisn.bound import TrueNoise
from laisn.settings import Assume, NavigationSettings, TightSettings, transmitters_of

SIGNED = {"hydrophone_height", "middle_offset"}
POSITIVE: dict[type, set[str]] = {
    NavigationSettings: {"dt", "baseline", "leader_speed_max", "follower_speed_max"},
    TightSettings: {"dt", "baseline", "start_sigma", "range_sigma", "outlier_span"},
    BeaconSettings: {"dt", "baseline", "start_sigma", "range_sigma", "outlier_span"},
    TrueNoise: set(),
}
"""Settings that may not be 0: what is divided by."""


@pytest.mark.parametrize("kind", POSITIVE)
def test_numbers_are_finite_and_not_negative_but_for_heights_and_offsets(kind: Any) -> None:
    for name in (
        item.name for item in fields(kind) if isinstance(getattr(kind(), item.name), float)
    ):
        if name == "outlier_probability":
            for chance in (0.0, 1.0, -0.1, 1.1, np.nan):
                with pytest.raises(
                    ValueError,
                    match=f"outlier_probability is {chance}, expected a number between 0 and 1",
                ):
                    kind(outlier_probability=chance)
            continue
        refused, taken = [np.nan, np.inf, -1e-9], [1e-9, 1e9]
        if name in SIGNED:
            refused, taken = [np.nan, np.inf], [-1.0, 0.0, 1.0]
        elif name in POSITIVE[kind]:
            refused = [*refused, 0.0]
        else:
            taken = [*taken, 0.0]
        for value in taken:
            assert getattr(kind(**{name: value}), name) == value
        bound = (
            "" if name in SIGNED else ", positive" if name in POSITIVE[kind] else ", zero or more"
        )
        for value in refused:
            with pytest.raises(
                ValueError, match=rf"{name} is {value}, expected a finite number{bound}$"
            ):
                kind(**{name: value})


@pytest.mark.parametrize("name", ["variant", "gate", "side_rule"])
def test_choices_are_those_that_there_are(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 'sideways'; available: "):
        NavigationSettings(**{name: "sideways"})  # type: ignore[arg-type]


def test_how_many_transmitters_there_are() -> None:
    """The paper's Section 2.2 has two, 2.3 has three."""
    others = ("laisn-3-1", "laisn-3-2", "laisn-best", "laisn-main")
    assert [transmitters_of("laisn-2"), *(transmitters_of(v) for v in others)] == [2, 3, 3, 3, 3]  # type: ignore[arg-type]
    assert NavigationSettings(variant="laisn-3-1").transmitters == 3
    for count in (1, 4):
        with pytest.raises(ValueError, match=f"transmitters is {count}, expected 2 or 3"):
            TightSettings(transmitters=count)
    offsets = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    assert TightSettings(transmitters=2, transmitter_offsets=offsets).transmitter_offsets == offsets
    with pytest.raises(ValueError, match="has 2 places, expected one for each of 3 transmitters"):
        TightSettings(transmitters=3, transmitter_offsets=offsets)


def test_only_sensor_noise_is_assumed_by_default() -> None:
    """docs/tight.md: an exact leader, no drift, no current, no offsets."""
    assert Assume() == Assume(exact_leader=True, drift=False, current=False, offsets=False)
    assert TightSettings().assume == Assume()
