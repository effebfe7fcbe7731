"""Keys of classes of the user's own: their types, lists and units."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest

import laisn_sim
from experiments.campaign.plans import disturbance_of
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.plugins import register
from laisn.settings import Settings
from sim.scenario.class_keys import class_arguments


@dataclass(frozen=True, kw_only=True)
class Typed:
    """Fields of every type that tables can hold."""

    on: bool = True
    gain: float = 0.5
    count: int = 2
    word: str = "a"
    mode: Literal["fast", "slow"] = "fast"
    limit: float | None = None
    azimuths: list[float] = ()  # type: ignore[assignment]
    pair: tuple[float, float] = (0.0, 0.0)
    any_tuple: tuple = ()  # type: ignore[type-arg]
    matrix: tuple[tuple[float, ...], ...] = ()
    weights: Floats | Sequence[float] = ()


class ByDefaults:
    """A class without annotations: its defaults show the types."""

    def __init__(self, on=False, gain=1, word="a", free=None, **others):  # type: ignore[no-untyped-def]
        self.others = others


TURN = math.pi / 180.0


@pytest.mark.parametrize(
    ("kind", "key", "value", "expected"),
    [
        (Typed, "on", False, {"on": False}),
        (Typed, "gain", 3, {"gain": 3.0}),
        (Typed, "gain_deg", 90, {"gain": 90 * TURN}),
        (Typed, "count", 7, {"count": 7}),
        (Typed, "word", "no", {"word": "no"}),
        (Typed, "mode", "slow", {"mode": "slow"}),
        (Typed, "limit_m", 4.0, {"limit": 4.0}),
        (Typed, "azimuths", (45, 135.0), {"azimuths": [45.0, 135.0]}),
        (Typed, "azimuths_deg", (45.0, 135), {"azimuths": [45.0 * TURN, 135 * TURN]}),
        (Typed, "pair_m", (1, 2.5), {"pair": (1.0, 2.5)}),
        (Typed, "any_tuple_deg", (1.0, (2.0,)), {"any_tuple": (TURN, (2.0 * TURN,))}),
        (Typed, "matrix", ((1, 2), (3, 4)), {"matrix": ((1.0, 2.0), (3.0, 4.0))}),
        (Typed, "weights", (1.0, 2.0), {"weights": (1.0, 2.0)}),
        (ByDefaults, "on", True, {"on": True}),
        (ByDefaults, "gain", 0.25, {"gain": 0.25}),
        (ByDefaults, "free", (1, "x"), {"free": (1, "x")}),
        (ByDefaults, "other_m", 2.0, {"other": 2.0}),
    ],
)
def test_values_become_those_of_the_fields(
    kind: Any, key: str, value: Any, expected: dict[str, Any]
) -> None:
    arguments = class_arguments(kind, "mine:Kind", {key: value}, "ocean.current.custom")
    assert arguments == expected
    assert [*map(type, arguments.values())] == [*map(type, expected.values())]


@pytest.mark.parametrize(
    ("kind", "key", "value", "message"),
    [
        (Typed, "on", "no", ".on: Input should be a valid boolean (given: 'no'; mine:Kind)"),
        (Typed, "on", "False", "; write false, without quotes and in lower case"),
        (Typed, "on", 0, ".on: Input should be a valid boolean (given: 0"),
        (Typed, "gain", "0.5", ".gain: Input should be a valid number (given: '0.5'"),
        (Typed, "gain", True, ".gain: Input should be a valid number (given: True"),
        (Typed, "gain", (0.5,), ".gain: Input should be a valid number (given: (0.5,)"),
        (Typed, "gain_deg", "0.5", ".gain_deg: expected a number, or a list of numbers [°]"),
        (Typed, "gain_deg", True, ".gain_deg: expected a number, or a list of numbers [°]"),
        (Typed, "count", 2.5, ".count: Input should be a valid integer"),
        (Typed, "word", 3, ".word: Input should be a valid string"),
        (Typed, "mode", "other", ".mode: Input should be 'fast' or 'slow'"),
        (Typed, "azimuths", (1.0, "x"), ".azimuths[1]: Input should be a valid number"),
        (Typed, "pair", (1.0,), ".pair[1]: Field required"),
        (Typed, "gian", 1.0, "has no key 'gian'; did you mean 'gain'? it has: on, gain"),
        (ByDefaults, "on", "yes", ".on: Input should be a valid boolean (given: 'yes'"),
        (ByDefaults, "gain", "1", ".gain: Input should be a valid integer or a valid number"),
    ],
)
def test_values_of_other_types_are_refused(kind: Any, key: str, value: Any, message: str) -> None:
    with pytest.raises(LaisnError, match=re.escape(message)):
        class_arguments(kind, "mine:Kind", {key: value}, "ocean.current.custom")


@dataclass(frozen=True)
class Stream:
    """A current of 0.2 m/s to the east, or to the west."""

    speed: float = 0.2
    reverse: bool = False

    def velocity(self, position: Floats, time: float) -> tuple[float, float]:
        return (-self.speed if self.reverse else self.speed), 0.0


@dataclass(frozen=True, kw_only=True)
class Beams:
    """A sensor that reads its own parameters."""

    name = "beams"
    stream = 46
    channels = {"first": "rad", "last": "rad", "slant": ""}  # noqa: RUF012

    azimuths: tuple[float, ...] = (0.0, 0.0)
    use_slant: bool = True

    def true(self, state: Any, environment: Any) -> tuple[float, float, float]:
        return self.azimuths[0], self.azimuths[-1], float(self.use_slant)

    def read(self, true: Floats, draws: Floats) -> Floats:
        return true


@dataclass
class Drift:
    """A disturbance."""

    amplitude: float = 0.1
    flip: bool = False

    def disturb(self, measurements: Any, seed: int, run: int) -> Any:
        return measurements


class Reckoning:
    """A navigator."""

    @dataclass(frozen=True, kw_only=True)
    class Settings(Settings):
        """Its own."""

        gains: tuple[float, ...] = ()
        flip: bool = False

    def __init__(self, settings: Any, start: Floats) -> None:
        self.state = np.array(start)
        self.covariance = np.eye(4)

    def step(self, own: Any, reception: Any, dt: float) -> None:
        """Do nothing."""


def _fly_with(kind: str, keys: dict[str, Any]) -> Any:
    """A second of T5 with a class of each kind and keys of its table."""
    short = {"duration_s": 1.0}
    if kind == "current":
        changes = {"ocean.current": {"model": register(Stream), "custom": keys}}
        return laisn_sim.fly("T5", short | changes)
    if kind == "sensor":
        table = {"sensor": register(Beams), **keys}
        return laisn_sim.fly("T5", short | {"motion": "kinematic", "sensors.custom": [table]})
    changes = {"motion": "kinematic", "navigation.custom": keys}
    return laisn_sim.fly("T5", short | changes, navigator=Reckoning)


@pytest.mark.parametrize("value", ["False", "no", "true", 1, 0.0])
@pytest.mark.parametrize(
    ("kind", "key"),
    [
        ("current", "ocean.current.custom.reverse"),
        ("sensor", "sensors.custom[0].use_slant"),
        ("navigator", "navigation.custom.flip"),
    ],
)
def test_what_is_no_bool_is_refused_for_classes_of_all_kinds(
    kind: str, key: str, value: object
) -> None:
    with pytest.raises(LaisnError, match=rf"{re.escape(key)}: Input should be a valid boolean"):
        _fly_with(kind, {key.rpartition(".")[2]: value})


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"sensors.custom": [{}, {"lok_m": 1.0}]}, "sensors.custom[1]"),
        ({"followers.0.sensors.custom": [{"lok_m": 1.0}]}, "followers[0].sensors.custom[0]"),
        ({"leader.sensors.custom": [{}, {"lok_m": 1.0}]}, "leader.sensors.custom[1]"),
    ],
)
def test_a_sensor_is_named_by_its_number_in_the_list(changes: dict[str, Any], key: str) -> None:
    tables = {
        path: [{"sensor": "dvl", **table} for table in list_of_tables]
        for path, list_of_tables in changes.items()
    }
    with pytest.raises(LaisnError, match=rf"(^|\s){re.escape(key)}: dvl has no key 'lok'"):
        laisn_sim.load("T5", tables)


@pytest.mark.parametrize("value", ["False", "no", "true", 1, 0.0])
def test_what_is_no_bool_is_refused_for_a_disturbance(value: object) -> None:
    table = {"use": register(Drift), "flip": value}
    with pytest.raises(LaisnError, match=r"disturb\.flip: Input should be a valid boolean"):
        disturbance_of(table)


def test_a_disturbance_takes_keys_with_units() -> None:
    disturbance = disturbance_of({"use": register(Drift), "amplitude_deg": 2, "flip": True})
    assert disturbance == Drift(amplitude=2 * TURN, flip=True)


def test_a_list_of_angles_reaches_the_class_in_radians() -> None:
    flight = _fly_with("sensor", {"azimuths_deg": [45, 135.0, -90.0], "use_slant": False})
    readings = flight.measurements[0].custom["beams"]
    np.testing.assert_allclose(
        readings, np.tile([np.pi / 4, -np.pi / 2, 0.0], (len(readings), 1)), rtol=0, atol=1e-15
    )


def test_a_list_reaches_a_navigator_and_is_saved_with_its_flight() -> None:
    flight = _fly_with("navigator", {"gains": [1, 2.5]})
    assert flight.scenario.navigation.settings().gains == (1.0, 2.5)


@pytest.mark.parametrize("value", [[1.0, {"a": 1}], {"a": 1}, [math.inf], math.nan])
def test_what_a_table_cannot_hold_is_refused_in_one_line(value: object) -> None:
    with pytest.raises(LaisnError) as error:
        _fly_with("sensor", {"azimuths_deg": value})
    [_, line] = str(error.value).splitlines()
    assert line.strip().startswith("sensors.custom[0].azimuths_deg: ")
