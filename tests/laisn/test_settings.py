"""Settings of navigators and of the bound: which numbers and choices are accepted."""

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
"""Settings that may not be 0, as something is divided by them."""


@pytest.mark.parametrize("settings_type", POSITIVE)
def test_numbers_are_finite_and_not_negative_but_for_heights_and_offsets(
    settings_type: Any,
) -> None:
    for name in (
        item.name
        for item in fields(settings_type)
        if isinstance(getattr(settings_type(), item.name), float)
    ):
        if name == "outlier_probability":
            for chance in (0.0, 1.0, -0.1, 1.1, np.nan):
                with pytest.raises(
                    ValueError,
                    match=f"outlier_probability is {chance}, expected a number between 0 and 1",
                ):
                    settings_type(outlier_probability=chance)
            continue
        refused, accepted = [np.nan, np.inf, -1e-9], [1e-9, 1e9]
        if name in SIGNED:
            refused, accepted = [np.nan, np.inf], [-1.0, 0.0, 1.0]
        elif name in POSITIVE[settings_type]:
            refused = [*refused, 0.0]
        else:
            accepted = [*accepted, 0.0]
        for value in accepted:
            assert getattr(settings_type(**{name: value}), name) == value
        bound = (
            ""
            if name in SIGNED
            else ", positive"
            if name in POSITIVE[settings_type]
            else ", zero or more"
        )
        for value in refused:
            with pytest.raises(
                ValueError, match=rf"{name} is {value}, expected a finite number{bound}$"
            ):
                settings_type(**{name: value})


@pytest.mark.parametrize("name", ["variant", "gate", "side_rule"])
def test_an_unknown_choice_is_refused_with_those_available(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 'sideways'; available: "):
        NavigationSettings(**{name: "sideways"})  # type: ignore[arg-type]


def test_variants_have_two_or_three_transmitters_and_offsets_for_each() -> None:
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
