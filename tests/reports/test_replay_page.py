"""The page of a replay on measured data, for a vehicle whose numbers are known."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from laisn.estimates import Estimates, FixKind
from laisn.messages import LeaderMessage, Measurements
from reports.replay_page import (
    Replayed,
    _over_time,
    ellipse,
    nis_judgement,
    write_replay_page,
)

STEPS = 40


def replayed_vehicle(**changes: Any) -> Replayed:
    """East at 1 m/s for 40 s, a message every 10 s from a leader 30 m to the north; the estimate is
    3 m too far north.

    The covariance has standard deviations of 0.5 m (east) and 2 m (north).
    """
    time = np.arange(1.0, STEPS + 1.0)
    step = np.array([10, 20, 30, 40])
    leader = LeaderMessage(
        timestamp=0.0, east=0.0, north=30.0, heading=np.pi / 2, speed=1.0, depth=5.0
    )
    messages = np.tile(np.array(leader, dtype=np.float64), (4, 1))
    messages[:, 1] = step
    state = np.column_stack([time, np.full(STEPS, 3.0), np.ones(STEPS), np.zeros(STEPS)])
    covariance = np.tile(np.diag([0.25, 4.0, 1.0, 1.0]), (STEPS, 1, 1))
    # 1 m to either side of the leader along its heading, which is east
    ranges = np.tile([np.hypot(30.0, 1.0), np.hypot(30.0, 1.0), np.nan], (4, 1))
    measurements = Measurements(
        dt=1.0,
        speed=np.ones(STEPS),
        heading=np.full(STEPS, np.pi / 2),
        depth=np.full(STEPS, 5.0),
        message_step=step,
        message=messages,
        ranges=ranges,
    )
    estimates = Estimates(
        state=state,
        covariance=covariance,
        fix_step=step,
        fix_position=state[step - 1, :2],
        fix_sigma=np.ones(4),
        fix_kind=np.full(4, FixKind.TWO_POINTS),
        innovation=np.tile([0.0, 2.0], (4, 1)),
        innovation_covariance=np.tile(np.diag([1.0, 4.0]), (4, 1, 1)),
    )
    path = np.column_stack([time, time, np.zeros(STEPS)])
    fields: dict[str, object] = {
        "name": "auv",
        "measurements": measurements,
        "estimates": estimates,
        "time": time,
        "baseline": 2.0,
        "path": path,
        "mean_error": 3.0,
    }
    return Replayed(**fields | changes)  # type: ignore[arg-type]


def test_figures_are_those_of_the_vehicle() -> None:
    replayed = replayed_vehicle()
    assert replayed.sigma == pytest.approx(np.full(STEPS, 2.0))
    # 2² / 4 over two quantities
    assert replayed.nis == pytest.approx(np.full(4, 0.5))
    # the estimate is 27 m from the leader's middle, the true place 30 m
    residual = np.hypot(30.0, 1.0) - np.hypot(27.0, 1.0)
    assert replayed.residuals[:, :2] == pytest.approx(np.full((4, 2), residual))
    assert np.isnan(replayed.residuals[:, 2]).all()


def test_an_ellipse_has_the_axes_of_its_covariance() -> None:
    rotation = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    covariance = rotation @ np.diag([9.0, 0.25]) @ rotation.T
    outline = ellipse(np.array([5.0, -2.0]), covariance) - [5.0, -2.0]
    distance = np.hypot(*outline.T)
    assert (distance.max(), distance.min()) == pytest.approx((6.0, 1.0), rel=1e-3)
    farthest = outline[np.argmax(distance)]
    assert abs(farthest @ rotation[:, 1]) < 0.2


def test_the_page_names_uncertainty_error_and_remarks(tmp_path: Path) -> None:
    path = tmp_path / "page" / "report.html"
    write_replay_page([replayed_vehicle()], Path("auv.mcap"), "laisn-2", ["a gap of 3 s"], path)
    text = path.read_text(encoding="utf-8")
    assert "auv: the 2σ position uncertainty is 4.00 m (median) and at most 4.00 m, at 1 s." in text
    assert "Its mean error is 3.00 m." in text
    drawn = (
        "estimate, with 2σ ellipses",
        "2σ of position [m]",
        "range residual [m]",
        "NIS per quantity",
    )
    for words in ("a gap of 3 s", "4 two points", "Replay of auv.mcap", "surveyed path", *drawn):
        assert words in text


def test_curves_and_legend_name_each_transmitter_that_was_heard(tmp_path: Path) -> None:
    names = ["rear or first transmitter", "front or second transmitter"]
    _, residuals, _ = _over_time(replayed_vehicle()).parts
    assert [line.name for line in residuals.lines] == names
    path = tmp_path / "page.html"
    write_replay_page([replayed_vehicle()], Path("log.mcap"), "tight", [], path)
    html = path.read_text(encoding="utf-8")
    assert re.findall("residual of the ([^<]*)<", html) == names


@pytest.mark.parametrize(
    ("value", "judgement"),
    [
        (1.1, "the filter is as sure as it should be"),
        (3.0, "the filter is surer than its measurements agree with"),
        (9.0, "the filter is far surer than its measurements agree with"),
        (0.3, "the filter is less sure than its measurements allow"),
        (0.01, "the filter is far less sure than its measurements allow"),
        (np.nan, ""),
    ],
)
def test_the_nis_is_judged(value: float, judgement: str) -> None:
    assert nis_judgement(value) == judgement


def test_the_page_judges_the_nis_of_its_vehicles(tmp_path: Path) -> None:
    """Innovations are 0 m east and 2 m north with variances of 1 and 4 m²: NIS is (0 + 1) / 2."""
    path = tmp_path / "page.html"
    write_replay_page([replayed_vehicle()], Path("log.mcap"), "tight", [], path)
    html = path.read_text(encoding="utf-8")
    assert "Its mean NIS is 0.50 (1 expected): the filter is as sure as it should be." in html
    assert '<div class="tile good"><dt>NIS per quantity</dt><dd>0.50' in html
    assert 'id="scene-view"' in html
