"""Imported hulls have all that a mission needs."""

import pytest

from sim.vehicle.own_hull import hull_errors
from tests.gazebo.imported import DATA, import_file


@pytest.mark.parametrize("name", ["torpedo", "hovering", "long_range", "probe"])
@pytest.mark.parametrize("role", ["leader", "follower"])
def test_imported_hulls_lack_nothing(name: str, role: str) -> None:
    assert hull_errors(import_file(DATA / f"{name}.sdf").text, role) == []
