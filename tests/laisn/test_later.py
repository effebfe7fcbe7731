"""`later`: modules of SciPy for filterpy's other filters are loaded once these filters are used."""

import math
import subprocess
import sys
from collections.abc import Callable

import pytest

from laisn.later import later

_PROGRAM = """
import copy, pickle, sys
import numpy as np
from laisn.navigator import Filter

moving = Filter(0.1, np.array([1.0, 2.0, 3.0, 4.0]), np.ones(4))
moving.predict(0.0)
print(*moving.state)
print(*(name in sys.modules for name in ("filterpy.kalman", "scipy.stats", "scipy.linalg")))
from filterpy.discrete_bayes import predict
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from filterpy.stats import norm

points = MerweScaledSigmaPoints(1, 0.1, 2.0, 0.0)
unscented = UnscentedKalmanFilter(1, 1, 0.1, lambda x: x, lambda x, dt: x, points)
unscented.Q *= 0.0
unscented.predict()
copy.deepcopy(unscented).update([3.0])
unscented.update([3.0])
print(float(unscented.x[0]), float(unscented.P[0, 0]))
print(norm.pdf(0.0), pickle.loads(pickle.dumps(norm)).cdf(0.0))
print(*predict([0.0, 1.0, 0.0], 1, [0.2, 0.5, 0.3]))
import scipy.stats
print(type(scipy.stats).__name__)
"""


@pytest.fixture(scope="module")
def lines() -> list[list[str]]:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=True
    )
    return [line.split() for line in done.stdout.splitlines()]


def test_the_navigators_filter_is_filterpys_and_loads_no_statistics(lines: list[list[str]]) -> None:
    assert [float(number) for number in lines[0]] == pytest.approx([1.3, 2.4, 3.0, 4.0])
    assert lines[1] == ["True", "False", "False"]


def test_filterpys_other_filters_work_with_modules_loaded_later(lines: list[list[str]]) -> None:
    """A prior N(0, 1) and a reading 3 of variance 1: the mean 1.5 and the variance 0.5. A robot
    that moves by one cell errs by the given kernel: 0.2, 0.5, 0.3, here around a ring of three.
    """
    assert [float(number) for number in lines[2]] == pytest.approx([1.5, 0.5])
    assert [float(number) for number in lines[3]] == pytest.approx(
        [1 / math.sqrt(2 * math.pi), 0.5]
    )
    assert [float(number) for number in lines[4]] == pytest.approx([0.3, 0.2, 0.5])
    assert lines[5] == ["module"]


def test_modules_are_themselves_after_the_block_also_after_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)

    def fail() -> None:
        with later("colorsys", "math"):
            assert sys.modules["math"] is math
            from colorsys import rgb_to_hsv

            functions.append(rgb_to_hsv)
            assert rgb_to_hsv(0.0, 0.0, 1.0) is None
            raise ZeroDivisionError

    functions: list[Callable[..., tuple[float, float, float]]] = []
    with pytest.raises(ZeroDivisionError):
        fail()
    assert "colorsys" not in sys.modules
    # blue stands at two thirds of the circle
    assert functions[0](0.0, 0.0, 1.0) == pytest.approx((2 / 3, 1.0, 1.0))
    assert type(sys.modules["colorsys"]).__name__ == "module"
