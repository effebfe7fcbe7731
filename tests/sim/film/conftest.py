"""A flight to film."""

import pytest

from tests.synthetic import make_flight


@pytest.fixture(scope="module")
def flight():
    return make_flight(60.0)
