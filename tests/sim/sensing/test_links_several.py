"""Navigators that take the messages of several links: the positions of the transmitters of a
further link, and how its ranges improve estimates.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.geometry import place_transmitters
from laisn.settings import TightSettings
from laisn_sim import Flight
from laisn_sim.cli.main import app

BEACONS = [[-60.0, -80.0, 5.0], [160.0, -60.0, 25.0], [40.0, 150.0, 12.0]]
ESCORT_SITES = [[-3.0, 0.0, 0.1], [2.5, 0.0, 0.0], [0.4, 1.5, 0.0]]
"""Transmitters of the escort, forward, port and up [m]; those of the leader are 2 m apart."""


def mission(variant: str, *further: str, **changes: Any) -> dict[str, Any]:
    """Four followers between a leader and an escort, who navigate by the leader's broadcast and by
    the further links that are named.
    """
    routes = [[[0.0, -12.0, -8.0 + 2.0 * i], [100.0, 68.0, 52.0 + 2.0 * i]] for i in range(4)]
    return {
        "duration_s": 60.0,
        "motion": "kinematic",
        "acoustics": {"travel_time": True},
        "links": [
            {"name": "lbl", "beacons_m": BEACONS, "interval_s": 2.0},
            {"name": "escort", "sender": "escort", "transmitters_m": ESCORT_SITES},
        ],
        "navigation": {"variant": variant, "further_links": further},
        "followers": [
            *(
                {"name": f"f{i}", "waypoints": route, "depth_m": 12.0}
                for i, route in enumerate(routes)
            ),
            {"name": "escort", "waypoints": [[0.0, 40.0, -20.0], [100.0, 120.0, 40.0]]},
        ],
        **changes,
    }


def errors_of(flight: Flight, follower: int) -> Floats:
    """Horizontal distance of the estimate from the hydrophone at each step, shape (n,), [m]."""
    offset = flight.estimates[follower].state[:, :2] - flight.hydrophone(follower)[:, :2]
    return np.asarray(np.hypot(*offset.T))


def test_a_message_of_an_escort_places_the_transmitters_of_the_escort() -> None:
    """Not those of the leader, whose baseline the settings of the navigator have."""
    exact_broadcast = {
        "sensors.leader_heading_sigma_deg": 0.0,
        "sensors.leader_position_sigma_m": 0.0,
    }
    flight = laisn_sim.fly(mission("ekf", "escort"), exact_broadcast)
    messages = flight.measurements[0].links["escort"]
    assert len(messages.message) > 50
    truth = flight.trajectory
    escort = truth.names.index("escort")
    for i in range(0, len(messages.message), 10):
        reception = messages.reception(i, {})
        k = round(reception.message.timestamp / 0.1)
        east, north, up = truth.position[k, escort]
        heading = truth.heading[k, escort]
        expected = [
            (
                east + forward * np.sin(heading) - port * np.cos(heading),
                north + forward * np.cos(heading) + port * np.sin(heading),
                -(up + upward),
            )
            for forward, port, upward in ESCORT_SITES
        ]
        settings = TightSettings(use_attitude=False)
        np.testing.assert_allclose(
            place_transmitters(reception, settings), expected, rtol=0, atol=1e-6
        )


@pytest.mark.parametrize("variant", ["ekf", "tight"])
@pytest.mark.parametrize("further", ["lbl", "escort"])
def test_ranges_of_a_further_link_make_estimates_better_and_consistent(
    variant: str, further: str
) -> None:
    without = laisn_sim.fly(mission(variant))
    with_link = laisn_sim.fly(mission(variant, further))
    settled = slice(100, None)
    rms = []
    for flight in (without, with_link):
        squares = [errors_of(flight, i)[settled] ** 2 for i in range(4)]
        rms.append(float(np.sqrt(np.mean(squares))))
    assert rms[1] < 0.8 * rms[0]
    # The squared error over its covariance (NEES) of two coordinates is 2 on average; errors are
    # correlated in time, so that four followers give about ten independent ones.
    nees = []
    for i in range(4):
        error = (with_link.estimates[i].state[:, :2] - with_link.hydrophone(i)[:, :2])[settled]
        covariance = with_link.estimates[i].covariance[settled, :2, :2]
        nees.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error))
    assert 0.4 < np.mean(nees) < 5.0


def test_the_tight_navigator_keeps_its_position_by_beacons_when_the_leader_is_not_heard() -> None:
    """A compass that is 4° off leads it astray for 60 s; with the beacons alone it errs by less
    than 2 m.
    """
    settings = {
        "acoustics.loss_probability": 0.0,
        "acoustics.max_range_m": 400.0,
        "sensors.heading_bias_deg": 4.0,
    }
    table = mission("tight", "lbl")
    # the leader is out of reach
    table["leader"] = {"waypoints": [[0.0, 900.0, 900.0], [60.0, 960.0, 900.0]]}
    flight = laisn_sim.fly(table, settings)
    assert np.isnan(flight.measurements[0].ranges).all()
    assert np.isfinite(flight.measurements[0].links["lbl"].ranges).any()
    assert errors_of(flight, 0)[100:].max() < 2.0
    without_beacons = laisn_sim.navigate(flight, {"navigation.further_links": []})
    assert errors_of(without_beacons, 0)[-1] > 3.0


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("link", "escort", "navigated on 'leader', and what was measured is fixed"),
        ("further_links", ["escort"], "no messages of 'escort' to f0"),
        ("sound_speed", "profile", "measured ranges by 'mean'"),
    ],
)
def test_a_replay_refuses_what_the_flight_has_not_measured(
    key: str, value: object, text: str
) -> None:
    """Estimates of a replay would be those without the change."""
    flight = laisn_sim.fly(mission("tight", "lbl", duration_s=5.0))
    with pytest.raises(LaisnError, match=text):
        laisn_sim.navigate(flight, {f"navigation.{key}": value})


@pytest.mark.system
def test_the_command_flies_and_reports_several_links_without_a_bound(tmp_path: Path) -> None:
    """The Cramér-Rao bound and the smoother are those of one link; the smoother says so."""
    scenario = tmp_path / "both.toml"
    laisn_sim.load(mission("tight", "lbl", "escort", duration_s=20.0)).save(scenario)
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["fly", str(scenario), "--no-video", "--out", str(out)])
    assert result.exit_code == 0, result.output
    summary = json.loads((out / "summary.json").read_text())
    for summary_of_follower in summary["followers"].values():
        assert summary_of_follower["rms_over_bound"] is None
        assert summary_of_follower["bound_rms_m"] is None
        assert summary_of_follower["e_p_mean_m"] < 0.5
    page = (out / "report.html").read_text()
    assert "which is not known for several links" in page
    flight = laisn_sim.read_log(out / "flight.mcap")
    renavigated = laisn_sim.navigate(flight)
    np.testing.assert_array_equal(renavigated.estimates[0].state, flight.estimates[0].state)
    log = str(out / "flight.mcap")
    result = CliRunner().invoke(app, ["replay", log, "--variant", "tight", "--smooth", "5"])
    assert result.exit_code != 0
    assert "smoothing takes the messages of one link" in " ".join(result.output.split())


@pytest.mark.system
def test_a_closed_loop_and_a_study_take_several_links(tmp_path: Path) -> None:
    """Followers that steer by estimates of `tight` receive both; runs of a study equal flights."""
    by_estimate = {f"followers.{i}.guidance_position": "estimate" for i in range(4)}
    table = mission("tight", "lbl", duration_s=20.0, motion="physics")
    steered = laisn_sim.fly(table, by_estimate)
    assert steered.measurements[0].links["lbl"].message.size
    renavigated = laisn_sim.navigate(steered)
    np.testing.assert_array_equal(renavigated.estimates[0].state, steered.estimates[0].state)
    scenario = laisn_sim.load(mission("tight", "lbl", duration_s=20.0))
    scenario.save(tmp_path / "both.toml")
    results = laisn_sim.study(
        tmp_path / "both.toml", navigators={"t": "tight"}, runs=2, out=tmp_path / "study"
    )
    mean_errors = [errors_of(laisn_sim.fly(scenario, {"run": run}), 0).mean() for run in range(2)]
    assert results.table["e_p_mean_m"][0] == pytest.approx(np.mean(mean_errors), rel=1e-6)


def test_a_further_link_without_positions_is_refused() -> None:
    table = mission("tight", "escort")
    table["links"][1]["content"] = ["heading"]
    with pytest.raises(
        LaisnError, match=r"further_links: 'escort' has messages without depth, position, speed"
    ):
        laisn_sim.fly(table)
