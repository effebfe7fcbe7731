"""Records of missions, estimates and measurements: their parts, their steps, and refused arrays."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from laisn.estimates import Estimates, FixKind
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges


def estimates(n: int = 6, fixes: tuple[int, ...] = (1, 3, 3, 5, 6)) -> Estimates:
    """A record whose numbers identify their step or fix."""
    number = np.arange(1.0, len(fixes) + 1)
    return Estimates(
        state=np.arange(1.0, n + 1)[:, None] * [1.0, 10.0, 100.0, 1000.0],
        covariance=np.arange(1.0, n + 1)[:, None, None] * np.eye(4),
        fix_step=np.array(fixes),
        fix_position=number[:, None] * [1.0, 2.0],
        fix_sigma=number,
        fix_kind=number.astype(int) % 3,
        innovation=number[:, None] * [3.0, 4.0],
        innovation_covariance=number[:, None, None] * np.eye(2),
    )


def test_a_part_has_the_steps_after_the_first_up_to_the_last_and_their_fixes() -> None:
    whole, part = estimates(), estimates().part(2, 5)
    np.testing.assert_array_equal(part.state, whole.state[[2, 3, 4]])
    np.testing.assert_array_equal(part.covariance, whole.covariance[[2, 3, 4]])
    # fixes of steps 3, 3 and 5, which are steps 1, 1 and 3 of the part
    assert part.fix_step.tolist() == [1, 1, 3]
    for item in fields(Estimates)[3:]:
        np.testing.assert_array_equal(
            getattr(part, item.name), getattr(whole, item.name)[[1, 2, 3]]
        )


def test_steps_before_the_first_estimate_are_counted() -> None:
    for missing in (0, 1, 4, 6):
        whole = estimates()
        state = whole.state.copy()
        state[:missing] = np.nan
        arrays = {item.name: getattr(whole, item.name) for item in fields(Estimates)} | {
            "state": state
        }
        assert Estimates(**arrays).steps_without_estimate == missing


def test_arrays_of_another_shape_are_named() -> None:
    whole = estimates()
    arrays: dict[str, Any] = {item.name: getattr(whole, item.name) for item in fields(Estimates)}
    for name, value in arrays.items():
        # the number of steps is that of the states, of fixes that of their steps
        short = (
            value[:, :1]
            if name == "state"
            else (value[:, None] if name == "fix_step" else value[:-1])
        )
        with pytest.raises(ValueError, match=rf"Estimates\.{name} has shape .* expected"):
            Estimates(**{**arrays, name: short})


def test_kinds_keep_the_numbers_that_logs_have() -> None:
    names = "TWO_POINTS TANGENT ASTERN FUSED GATED SINGULAR LOST ONE_RANGE RANGES PARTLY"
    assert [kind.name for kind in FixKind] == names.split()
    assert [int(kind) for kind in FixKind] == list(range(10))


def measured(**changes: Any) -> Measurements:
    """Five steps with messages in the second and the fifth."""
    arguments: dict[str, Any] = {
        "dt": 0.5,
        "speed": np.arange(1.0, 6.0),
        "heading": np.arange(5.0) / 10,
        "depth": 8.0 + np.arange(5.0),
        "message_step": np.array([2, 5]),
        "message": np.arange(20.0).reshape(2, 10),
        "ranges": np.array([[20.0, 21.0, np.nan], [30.0, 31.0, 32.0]]),
    }
    return Measurements(**{**arguments, **changes})


def test_steps_are_handed_out_with_the_messages_that_arrive_in_them() -> None:
    places = np.arange(18.0).reshape(2, 3, 3)
    steps = list(measured(transmitters=places).steps())
    assert [own for own, _ in steps] == [OwnMotion(k + 1.0, k / 10, 8.0 + k) for k in range(5)]
    assert [reception is None for _, reception in steps] == [True, False, True, True, False]
    for i, k in enumerate((1, 4)):
        reception = steps[k][1]
        assert reception is not None
        assert reception.message == LeaderMessage(*np.arange(10.0 * i, 10.0 * i + 10.0).tolist())
        np.testing.assert_array_equal(reception.ranges, Ranges(*measured().ranges[i].tolist()))
        np.testing.assert_array_equal(reception.transmitters, places[i])
    plain = [reception for _, reception in measured().steps() if reception is not None]
    assert [reception.transmitters for reception in plain] == [None, None]


def test_time_is_that_of_equal_steps_or_the_sum_of_their_durations() -> None:
    np.testing.assert_allclose(measured().time, [0.5, 1.0, 1.5, 2.0, 2.5])
    durations = np.array([0.1, 0.4, 1.0, 0.5, 2.0])
    np.testing.assert_allclose(measured(durations=durations).time, [0.1, 0.5, 1.5, 2.0, 4.0])


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        ({"message_step": np.array([0, 5])}, "must increase within 1 … 5"),
        ({"message_step": np.array([2, 6])}, "must increase within 1 … 5"),
        ({"message_step": np.array([3, 3])}, "must increase within 1 … 5"),
        ({"message_step": np.array([5, 2])}, "must increase within 1 … 5"),
        ({"message_step": np.array([2])}, "Measurements.message has shape"),
        ({"heading": np.zeros(4)}, "Measurements.heading has shape"),
        ({"depth": np.zeros(6)}, "Measurements.depth has shape"),
        ({"message": np.zeros((2, 8))}, "Measurements.message has shape"),
        ({"ranges": np.zeros((2, 2))}, "Measurements.ranges has shape"),
        ({"durations": np.zeros(4)}, "Measurements.durations has shape"),
        ({"durations": np.array([1.0, 1.0, 0.0, 1.0, 1.0])}, "durations must be positive"),
        ({"durations": np.array([1.0, 1.0, np.inf, 1.0, 1.0])}, "durations must be positive"),
        ({"transmitters": np.zeros((2, 2, 3))}, "Measurements.transmitters has shape"),
    ],
)
def test_measurements_that_do_not_fit_together_are_refused(
    changes: dict[str, Any], pattern: str
) -> None:
    with pytest.raises(ValueError, match=pattern):
        measured(**changes)
    # at the ends it is fine
    assert measured(message_step=np.array([1, 5])).message_step.tolist() == [1, 5]
