"""Accuracy of the estimates in the report, each against a flight for which the figures are known
in closed form.
"""

import dataclasses
import re

import numpy as np
import pytest

from reports import flight_report
from reports.headline import CONSISTENT_OUTSIDE_SHARE
from sim.flight import position_and_bearing_errors
from tests.synthetic import make_flight


def equal_variances(variance):
    """Covariances of equal variance in all directions, shape (n, 4, 4)."""
    return np.asarray(variance)[:, None, None] * np.eye(4)


def with_estimates(flight, follower=0, **changes):
    """The flight with other estimates of one follower."""
    estimates = list(flight.estimates)
    estimates[follower] = dataclasses.replace(estimates[follower], **changes)
    return dataclasses.replace(flight, estimates=tuple(estimates))


def with_errors(flight, offsets, follower=0, sigma=1.0):
    """The flight with estimates that are off by `offsets`, shape (n, 2), [m], and state the
    standard deviation `sigma` [m].
    """
    state = flight.estimates[follower].state.copy()
    state[:, :2] = flight.hydrophone(follower)[:, :2] + offsets
    return with_estimates(
        flight, follower, state=state, covariance=equal_variances(np.full(len(state), sigma**2))
    )


@pytest.fixture(scope="module")
def flight():
    return make_flight(60.0)


def test_the_largest_error_has_its_time(flight):
    """E_P is 0.5 m but for 5 m after 30 s."""
    offsets = np.tile([0.3, 0.4], (600, 1))
    offsets[299] = [3.0, 4.0]
    actual = flight_report.accuracy(with_errors(flight, offsets), 0)
    assert (actual["largest"], actual["largest_s"]) == pytest.approx((5.0, 30.0))
    assert actual["mean"] == pytest.approx((599 * 0.5 + 5.0) / 600)
    assert actual["high"] == pytest.approx(0.5)
    assert actual["sigma"] == pytest.approx(
        np.sqrt(599 * 0.5**2 + 25.0 - 600 * actual["mean"] ** 2) / np.sqrt(600)
    )


def test_errors_near_the_axis_are_separated_from_those_elsewhere(flight, monkeypatch):
    """A quarter of the time just within the limit of 15°, ahead and astern, and some of it just
    beyond.
    """
    offsets = np.tile([0.0, 0.2], (600, 1))
    # means of 1 m and 0.2 m that are no medians
    offsets[:150] = [0.0, 0.5]
    offsets[:50] = [0.0, 2.0]
    offsets[150:240], offsets[240:] = [0.0, 0.6], [0.0, 0.1]
    bearing = np.full(600, np.pi / 2)
    bearing[:75], bearing[75:150] = np.radians(14.9), np.radians(180 - 14.9)
    bearing[150:160] = np.radians(180 + 15.1)
    monkeypatch.setattr(flight_report, "true_bearing", lambda *_: bearing)
    actual = flight_report.accuracy(with_errors(flight, offsets), 0)
    assert actual["near_axis"] == 0.25
    assert actual["mean_near"] == pytest.approx(1.0)
    assert actual["mean_elsewhere"] == pytest.approx((90 * 0.6 + 360 * 0.1) / 450)
    for constant_bearing, share, missing_figure in (
        (0.0, 1.0, "mean_elsewhere"),
        (np.pi / 2, 0.0, "mean_near"),
    ):
        bearing[:] = constant_bearing
        actual = flight_report.accuracy(with_errors(flight, offsets), 0)
        assert actual["near_axis"] == share
        assert np.isnan(actual[missing_figure])


def test_a_wrong_side_is_reported_with_its_share(flight):
    """The estimate is the truth's mirror image in the leader's axis for 3 s, and again for 9 s,
    of 60 s.
    """
    steps = flight.step_index()
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    from_leader = flight.hydrophone(0)[:, :2] - flight.trajectory.position[steps, 0, :2]
    side = np.einsum("ni,ni->n", from_leader, starboard)
    assert np.abs(side).min() > 2
    is_wrong = np.zeros(600, dtype=bool)
    is_wrong[99:129] = is_wrong[399:489] = True
    mirrored = with_errors(flight, np.where(is_wrong, -2 * side, 0.0)[:, None] * starboard)
    assert flight_report.accuracy(mirrored, 0)["wrong_side"] == pytest.approx(0.2)
    # half a metre across the axis is no wrong side
    near = with_errors(
        flight, np.where(is_wrong, -np.sign(side) * (np.abs(side) + 0.5), 0.0)[:, None] * starboard
    )
    assert flight_report.accuracy(near, 0)["wrong_side"] == 0.0


def test_consistency_is_reported_by_the_filters_own_ellipse(flight):
    """A Rayleigh distribution is above 2σ with probability exp(−2); and one error in five lies
    outside by hand.
    """
    assert pytest.approx(0.1353, abs=1e-4) == CONSISTENT_OUTSIDE_SHARE
    offsets = np.tile([1.9, 0.0], (600, 1))
    offsets[::5] = [0.0, 2.1]
    assert flight_report.accuracy(with_errors(flight, offsets), 0)["outside"] == pytest.approx(0.2)
    random = np.random.default_rng(5).normal(0.0, 1.0, (600, 2))
    # binomial: a standard deviation of 1.4 %
    assert flight_report.accuracy(with_errors(flight, random), 0)["outside"] == pytest.approx(
        CONSISTENT_OUTSIDE_SHARE, abs=0.045
    )
    # certain filters: right where they are exact, wrong where they are not
    certain = with_errors(flight, np.where(np.arange(600)[:, None] < 450, 0.0, 0.01), sigma=0.0)
    assert flight_report.accuracy(certain, 0)["outside"] == pytest.approx(0.25)


def page_of(flight, tmp_path):
    """Text of the report, without markup."""
    errors = position_and_bearing_errors(flight)
    flight_report.flight_report(flight, errors, {"followers": {}}, tmp_path / "report.html", None)
    return re.sub(r"<[^>]*>|\s+", " ", (tmp_path / "report.html").read_text(encoding="utf-8"))


def test_several_followers_are_summed_up_together(tmp_path):
    flight = make_flight(30.0, 3)
    for i, error in enumerate((0.5, 0.25, 2.0)):
        # a fifth of the time four times as far off as in the mean, else a quarter of it
        offsets = np.tile([0.25 * error, 0.0], (300, 1))
        offsets[::5] = [0.0, 4.0 * error]
        flight = with_errors(flight, offsets, i)
    assert (
        "The mean position errors of 3 followers lie between 0.25 m (follower2) and 2.00 m "
        "(follower3); the largest "
        "error is 8.00 m (follower3, at 0 s)."
    ) in page_of(flight, tmp_path)


def test_an_estimate_that_diverged_has_no_errors(flight, tmp_path):
    state = flight.estimates[0].state.copy()
    state[-1] = np.nan
    text = page_of(with_estimates(flight, state=state), tmp_path)
    assert "position error is" not in text
    assert "follower: the estimate is not finite." in text
