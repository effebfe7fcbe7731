"""First sentences of the report, each against a flight for which the figures are known in closed form."""

import dataclasses
import re

import numpy as np
import pytest

from experiments.flight.range_budget import LABELS, Cause, range_error_budget
from experiments.pages import flight_report
from laisn.estimates import FixKind
from tests.synthetic import make_flight


def spread(variance):
    """Covariances of equal variance in all directions, shape (n, 4, 4)."""
    return np.asarray(variance)[:, None, None] * np.eye(4)


def with_estimates(flight, follower=0, **changes):
    """The flight with other estimates of one follower."""
    found = list(flight.estimates)
    found[follower] = dataclasses.replace(found[follower], **changes)
    return dataclasses.replace(flight, estimates=tuple(found))


def moved(flight, offsets, follower=0, sigma=1.0):
    """The flight with estimates off by `offsets`, shape (n, 2), [m], and that sure of them."""
    state = flight.estimates[follower].state.copy()
    state[:, :2] = flight.hydrophone(follower)[:, :2] + offsets
    return with_estimates(flight, follower, state=state, covariance=spread(np.full(len(state), sigma**2)))


def of_kinds(flight, kinds):
    """The flight with fixes of these kinds, over and over."""
    (found,) = flight.estimates
    return with_estimates(flight, fix_kind=np.resize(np.array(kinds, dtype=np.int64), found.fix_kind.size))


@pytest.fixture(scope="module")
def flight():
    return make_flight(60.0)


def plain(sentences):
    return " ".join(sentences).replace("\N{NO-BREAK SPACE}", " ")


def test_the_largest_error_is_reported_with_time_and_place(flight):
    """E_P is 0.5 m but for 5 m after 30 s; the follower trails by 0.35 rad on circles of 60 and 69 m."""
    offsets = np.tile([0.3, 0.4], (600, 1))
    offsets[299] = [3.0, 4.0]
    # law of cosines, and of sines for the angle between the follower and the leader's port beam, where the centre is
    apart = np.sqrt(60**2 + 69**2 - 2 * 60 * 69 * np.cos(0.35))
    beam = np.degrees(np.arctan2(69 * np.cos(0.35) - 60, 69 * np.sin(0.35)))
    text = plain(flight_report.sentences(moved(flight, offsets)))
    mean = (599 * 0.5 + 5.0) / 600
    assert (
        f"error is {mean:.2f} m; the largest is 5.00 m, at 30 s, with the follower {apart:.0f} m from the leader"
        in text
    )
    (bearing,) = re.findall(r"at a bearing of (\d+)°", text)
    assert int(bearing) == pytest.approx(180 - beam, abs=0.6)


def test_errors_near_the_axis_are_separated_from_those_elsewhere(flight):
    """A quarter of the time just within the limit, ahead and astern, and some just beyond it."""
    steps = flight.step_index()
    away = flight.hydrophone(0)[:, :2] - flight.trajectory.position[steps, 0, :2]
    offsets = np.tile([0.0, 0.2], (600, 1))
    # means of 1 m and 0.2 m that are no medians
    offsets[:150] = [0.0, 0.5]
    offsets[:50] = [0.0, 2.0]
    offsets[150:240], offsets[240:] = [0.0, 0.6], [0.0, 0.1]
    one = flight_report.estimate_errors(moved(flight, offsets), 0)
    bearing = np.full(600, np.pi / 2)
    bearing[:75], bearing[75:150] = np.radians(14.9), np.radians(180 - 14.9)
    bearing[150:160] = np.radians(180 + 15.1)
    found = flight_report.error_numbers(one._replace(bearing=bearing))
    assert found["on_axis"] == 0.25
    assert found["error_on_axis"] == pytest.approx(1.0)
    assert found["error_off_axis"] == pytest.approx(0.2)
    np.testing.assert_allclose(one.distance, np.hypot(*away.T))
    for everywhere, share in ((0.0, 1.0), (np.pi / 2, 0.0)):
        found = flight_report.error_numbers(one._replace(bearing=np.full(600, everywhere)))
        assert found["on_axis"] == share
        assert found["error_on_axis"] is None
    text = plain(flight_report.sentences(moved(flight, offsets)))
    assert "The follower spent 100 % of the time within 15° of the leader's axis" in text


def test_fixes_are_reported_by_their_kind_the_most_frequent_first(flight):
    kinds = [FixKind.GATED, *[FixKind.TWO_POINTS] * 11, *[FixKind.ASTERN] * 3]
    text = plain(flight_report.sentences(of_kinds(flight, kinds)))
    assert "Kinds of the 60 fixes: two points 73 %, on the axis 20 %, rejected 6.7 %." in text


def test_a_wrong_side_is_reported_with_its_share_and_longest_stretch(flight):
    """The estimate is the truth's mirror image in the leader's axis for 3 s, and again for 9 s, of 60 s."""
    steps = flight.step_index()
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    away = flight.hydrophone(0)[:, :2] - flight.trajectory.position[steps, 0, :2]
    side = np.einsum("ni,ni->n", away, starboard)
    assert np.abs(side).min() > 2
    wrong = np.zeros(600, dtype=bool)
    wrong[99:129] = wrong[399:489] = True
    mirrored = moved(flight, np.where(wrong, -2 * side, 0.0)[:, None] * starboard)
    np.testing.assert_array_equal(flight_report.estimate_errors(mirrored, 0).wrong_side, wrong)
    text = plain(flight_report.sentences(mirrored))
    assert "For 20 % of the time the estimate was on the wrong side of the leader's axis" in text
    assert "first at 10 s and for at most 9 s in succession" in text
    # half a metre across the axis is no wrong side
    near = moved(flight, np.where(wrong, -np.sign(side) * (np.abs(side) + 0.5), 0.0)[:, None] * starboard)
    assert "The estimate was never on the wrong side" in plain(flight_report.sentences(near))


def test_consistency_is_reported_by_the_filters_own_ellipse(flight):
    """A Rayleigh distribution is above 2σ with probability exp(−2); and one error in five lies outside by hand."""
    assert pytest.approx(0.1353, abs=1e-4) == flight_report.CONSISTENT_SHARE
    offsets = np.tile([1.9, 0.0], (600, 1))
    offsets[::5] = [0.0, 2.1]
    one = flight_report.estimate_errors(moved(flight, offsets), 0)
    assert one.outside.mean() == pytest.approx(0.2)
    text = plain(flight_report.sentences(moved(flight, offsets)))
    assert "ellipse for 20 % of the time; the expected share for a consistent filter is 14 %" in text
    random = np.random.default_rng(5).normal(0.0, 1.0, (600, 2))
    # binomial: a standard deviation of 1.4 %
    assert flight_report.estimate_errors(moved(flight, random), 0).outside.mean() == pytest.approx(
        flight_report.CONSISTENT_SHARE, abs=0.045
    )
    # certain filters: right where they are exact, wrong where they are not
    certain = moved(flight, np.where(np.arange(600)[:, None] < 450, 0.0, 0.01), sigma=0.0)
    assert flight_report.estimate_errors(certain, 0).outside.mean() == pytest.approx(0.25)


def test_the_cause_is_the_largest_share_of_the_asymmetry():
    """The synthetic ranges are straight lines between tilted hulls with up to 1 cm of noise: of 2 m, 3° take little."""
    flight = make_flight(60.0)
    sentence = flight_report.sentences(flight)[-1]
    budget = range_error_budget(flight)
    apart = budget.asymmetry[np.isfinite(budget.asymmetry).all(axis=1)]
    rms = np.sqrt((apart**2).mean(axis=0))
    assert LABELS[Cause(int(rms.argmax()))] in sentence
    assert f"({100 * rms.max():.2g} cm)" in sentence
    # shares add up to the errors of both ranges
    error = budget.error[np.isfinite(budget.asymmetry).all(axis=1)]
    assert f"an RMS error of {100 * np.sqrt(np.mean((error[:, 1] - error[:, 0]) ** 2)):.2g} cm" in sentence
    nothing = dataclasses.replace(budget, share=np.full_like(budget.share, np.nan))
    assert flight_report.cause_numbers([nothing]) == {"asymmetry_cm": None}


def test_several_followers_are_spoken_of_together():
    flight = make_flight(30.0, 3)
    for i, error in enumerate((0.5, 0.25, 2.0)):
        # a fifth of the time four times as far off as in the mean, else a quarter of it
        offsets = np.tile([0.25 * error, 0.0], (300, 1))
        offsets[::5] = [0.0, 4.0 * error]
        flight = moved(flight, offsets, i)
    text = flight_report.sentences(flight)
    assert 3 <= len(text) <= 7
    assert (
        "The mean position errors of 3 followers lie between 0.25 m (follower2) and 2.00 m (follower3); the largest "
        "error is 8.00 m (follower3, at 0 s)." in plain(text)
    )
    assert "Kinds of the 90 fixes" in plain(text)


def test_three_to_seven_paragraphs_and_none_of_what_diverged(flight):
    assert 3 <= len(flight_report.sentences(flight)) <= 7
    state = flight.estimates[0].state.copy()
    state[-1] = np.nan
    assert flight_report.sentences(with_estimates(flight, state=state)) == []


@pytest.mark.parametrize(
    ("share", "words"),
    [(0.0, "0.0 %"), (0.0004, "less than 0.1 %"), (0.0123, "1.2 %"), (0.0996, "10 %"), (0.5, "50 %"),
     (0.9999, "more than 99.9 %"), (1.0, "100 %")],
)  # fmt: skip
def test_shares_never_round_to_nothing_or_all(share, words):
    assert plain([flight_report.percent(share)]) == words
