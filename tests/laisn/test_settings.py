"""Settings of navigators and of the bound: which numbers and choices are accepted."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from laisn.beacons import BeaconSettings
from laisn.bound import TrueNoise
from laisn.errors import LaisnError
from laisn.settings import (
    Assume,
    NavigationSettings,
    RivalSettings,
    Settings,
    TightSettings,
    WaterBeaconSettings,
    transmitters_of,
)

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
                    match=f"outlier_probability is {chance}, expected a .* between 0 and 1",
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


ALL_SETTINGS: list[Any] = [
    NavigationSettings,
    TightSettings,
    RivalSettings,
    BeaconSettings,
    WaterBeaconSettings,
    TrueNoise,
    Assume,
]
NO_NUMBER = ["0.1", True, None, [0.1], np.array([0.1]), 1j]


@pytest.mark.parametrize("kind", ALL_SETTINGS)
def test_what_is_not_of_the_declared_type_is_refused(kind: Any) -> None:
    """Whatever the field: a truth value and a text are no number, a number is no truth value."""
    wrong = {float: NO_NUMBER, int: [*NO_NUMBER, 2.5], bool: [1, 0.0, "yes", None]}
    checked = 0
    for item in fields(kind):
        for value in wrong.get(type(getattr(kind(), item.name)), ["sideways", 1, None]):
            checked += 1
            with pytest.raises(LaisnError, match=f"^{item.name} is .*, expected "):
                kind(**{item.name: value})
    assert checked >= 20


@pytest.mark.parametrize("kind", ALL_SETTINGS[:-1])
def test_whole_numbers_have_the_bounds_of_numbers_with_a_point(kind: Any) -> None:
    """A whole number counts as the number with a point: -1 is as -1.0, and 1 is stored as 1.0."""
    for item in fields(kind):
        if not isinstance(getattr(kind(), item.name), float) or "probability" in item.name:
            continue
        for given in (1, np.int64(1), np.float32(1.0)):
            value = getattr(kind(**{item.name: given}), item.name)
            assert type(value) is float
            assert value == 1.0
        if item.name not in SIGNED:
            with pytest.raises(LaisnError, match=f"^{item.name} is -1, expected a finite number"):
                kind(**{item.name: -1})
        if item.name in POSITIVE.get(kind, set()):
            with pytest.raises(LaisnError, match=f"^{item.name} is 0, expected .*, positive$"):
                kind(**{item.name: 0})


def test_places_are_three_finite_numbers_each() -> None:
    given: Any = [[1, 0, 0], np.array([-1.0, 0.0, 0.0])]
    places = TightSettings(transmitters=2, transmitter_offsets=given).transmitter_offsets
    assert places == ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0))
    for wrong in ([[1, 0]], [[1, 0, np.nan]], [[1, 0, "0"]], 1.0, [1.0]):
        with pytest.raises(LaisnError, match=r"^transmitter_offsets is "):
            Settings(transmitter_offsets=wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["variant", "gate", "side_rule"])
def test_an_unknown_choice_is_refused_with_those_available(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 'sideways', expected one of "):
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
