"""Shapes of formations: where each follower stands, by geometry."""

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

import models
from laisn.arrays import Floats
from laisn_sim.cli.main import app
from sim import feasibility
from sim.scenario.file import validate, with_file_paths
from sim.scenario.formation import ShapeTable, Station, followers_of

Kind = Literal["line", "v", "column", "grid", "ring"]


def stations_of_shape(kind: Kind, count: int, **options: Any) -> Floats:
    """Behind, to port and depth of each follower, in that order, shape (count, 3), [m]."""
    tables = followers_of(ShapeTable(kind=kind, count=count, **options))
    assert [table["name"] for table in tables] == [f"follower-{i + 1}" for i in range(count)]
    stations = [table["station"] for table in tables]
    return np.array(
        [[station["behind_m"], station["port_m"], station["depth_m"]] for station in stations]
    )


def test_a_shape_without_further_keys_is_ten_metres_wide_behind_and_deep() -> None:
    """As `docs/scenario.md` lists its defaults: spacing, distance and depth of 10 m, layers of
    1 m.
    """
    expected = [(10.0, -5.0, 10.0), (10.0, 5.0, 11.0)]
    np.testing.assert_allclose(sorted(map(tuple, stations_of_shape("line", 2))), expected)


@pytest.mark.parametrize("key", ["behind_m", "port_m"])
def test_a_station_is_within_a_kilometre(key: str) -> None:
    table = {"behind_m": 10.0, "port_m": 0.0, "depth_m": 10.0}
    for distance in (-1000.0, 1000.0):
        assert getattr(Station.model_validate(table | {key: distance}), key) == distance
    for distance in (-1000.1, 1000.1):
        with pytest.raises(ValidationError, match=r"equal to -?1000"):
            Station.model_validate(table | {key: distance})


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("line", [(0, -2), (0, -1), (0, 0), (0, 1), (0, 2)]),
        ("column", [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0)]),
        ("grid", [(0, -1.5), (0, -0.5), (0, 0.5), (0, 1.5), (1, -1.5)]),
        # wings to port and starboard by turns, twice as far aside as behind, a spacing from rank to
        # rank
        (
            "v",
            [
                (0, 2 / math.sqrt(5)),
                (0, -2 / math.sqrt(5)),
                (1 / math.sqrt(5), 4 / math.sqrt(5)),
                (1 / math.sqrt(5), -4 / math.sqrt(5)),
                (2 / math.sqrt(5), 6 / math.sqrt(5)),
            ],
        ),
    ],
)
def test_five_followers_have_the_offsets_of_the_shape(
    kind: Kind, expected: list[tuple[float, float]]
) -> None:
    actual = stations_of_shape(kind, 5, spacing_m=8.0, behind_m=15.0)
    np.testing.assert_allclose((actual[:, :2] - [15.0, 0.0]) / 8.0, expected, atol=1e-6)


@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_a_ring_is_a_regular_polygon_whose_neighbours_are_a_spacing_apart(count: int) -> None:
    actual = stations_of_shape("ring", count, spacing_m=8.0, behind_m=15.0)[:, :2]
    centre = np.array([15.0 + 4.0 / math.sin(math.pi / count), 0.0])
    np.testing.assert_allclose(actual[0], [15.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(actual.mean(axis=0), centre, atol=1e-6)
    sides = np.hypot(*(actual - np.roll(actual, 1, axis=0)).T)
    np.testing.assert_allclose(sides, 8.0, atol=1e-5)
    # the second is to port
    assert actual[1, 1] > 0.0 or count == 2


def test_a_single_follower_stands_on_the_axis_where_a_shape_begins() -> None:
    for kind in ("line", "column", "grid", "ring"):
        np.testing.assert_allclose(
            stations_of_shape(kind, 1, behind_m=15.0), [[15.0, 0.0, 10.0]], atol=1e-9
        )


def test_followers_of_a_shape_have_its_model(tmp_path: Path) -> None:
    (tmp_path / "mine.xml").write_text(models.path("lauv").read_text("utf-8"), encoding="utf-8")
    for name, model in (("remus100", "remus100"), ("mine.xml", "lauv")):
        table = with_file_paths(
            {"formation": {"shape": {"kind": "v", "count": 3, "model": name}}}, tmp_path
        )
        scenario = validate(table, "a.toml")
        assert [f.model for f in scenario.followers] == 3 * [models.path(model).read_text("utf-8")]


@pytest.mark.parametrize("kind", ["line", "v", "column", "grid", "ring"])
@pytest.mark.parametrize("count", [1, 2, 7, 18])
def test_shapes_keep_their_spacing(kind: Kind, count: int) -> None:
    """The nearest two stand a spacing apart, and the foremost at the default distance of 10 m."""
    horizontal = stations_of_shape(kind, count, spacing_m=8.0)[:, :2]
    if count > 1:
        distance = np.hypot(
            *(horizontal[:, None] - horizontal[None]).transpose(2, 0, 1)
        ) + 1e9 * np.eye(count)
        # the first two of a V stand beside each other, two steps of 2 / √5 aside
        assert distance.min() == pytest.approx(
            32.0 / math.sqrt(5.0) if (kind, count) == ("v", 2) else 8.0, abs=1e-5
        )
    assert horizontal[:, 0].min() == pytest.approx(10.0)


def test_layers_are_taken_in_turn() -> None:
    options = {"depth_m": 12.0, "layer_m": 1.5}
    assert stations_of_shape("column", 4, **options)[:, 2].tolist() == [12.0, 13.5, 15.0, 16.5]
    assert stations_of_shape("column", 4, **options, layers=3)[:, 2].tolist() == [
        12.0,
        13.5,
        15.0,
        12.0,
    ]
    assert stations_of_shape("column", 4, **options, layers=1)[:, 2].tolist() == [12.0] * 4


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (
            {"kind": "grid", "count": 201},
            "formation.shape.count: Input should be less than or equal to 200 (given: 201)",
        ),
        ({"kind": "grid", "count": 4, "spacing": 9.0}, "formation.shape.spacing: unknown key"),
    ],
)
def test_an_invalid_shape_is_the_only_error(shape: dict[str, object], message: str) -> None:
    table = {"name": "many", "duration_s": 60.0, "formation": {"shape": shape}}
    with pytest.raises(ValueError, match="1 error\n") as error:
        validate(table, "many.toml", feasibility.infeasibilities)
    assert message in str(error.value)


def test_two_hundred_followers_are_checked_by_the_command_and_one_more_is_refused() -> None:
    """For the 1000 s of the swarm, on a grid in fifteen layers."""
    keys = {"kind": "grid", "spacing_m": 10.0, "layer_m": 1.0, "layers": 15}
    options = ", ".join(f"{key} = {value!r}" for key, value in keys.items()).replace("'", '"')

    def check(count: int) -> Any:
        shape = f"formation.shape={{ count = {count}, {options} }}"
        arguments = ["check", "swarm", "--set", "followers=[]", "--set", shape]
        return CliRunner().invoke(app, arguments)

    largest = check(200)
    assert largest.exit_code == 0, largest.output
    assert "swarm: valid: 1000 s, 200 followers" in largest.output
    refused = check(201)
    assert refused.exit_code == 2
    assert "formation.shape.count: Input should be less than or equal to 200" in refused.output
