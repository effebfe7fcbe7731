"""Stations in a flight's report, against a flight for which the distances are known in closed
form.
"""

import dataclasses
import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from laisn.arrays import Floats
from laisn_sim.cli.fly import show
from reports import flight_figures, flight_report
from reports.summary import summarise
from sim.flight import FlightRecord, position_and_bearing_errors
from sim.scenario.formation import Formation, Proximity, Station
from sim.scenario.settings import Follower
from tests import synthetic
from tests.synthetic import make_flight

STATIONS = ((10.0, 10.0), (20.0, 12.0))
"""Behind and depth of the two followers [m]; the leader swims at 1 m/s."""


def flight_beside_stations(
    offsets_east: tuple[Floats, Floats], seconds: float = 60.0
) -> FlightRecord:
    """Two followers straight astern of a leader that swims north at 1 m/s; at each instant they are
    `offsets_east` [m] east of their stations.
    """
    flight = make_flight(seconds, 2)
    truth = flight.trajectory
    followers = tuple(
        Follower(name=f"follower{i + 1}", station=Station(behind_m=behind, depth_m=depth))
        for i, (behind, depth) in enumerate(STATIONS)
    )
    position, velocity = np.zeros_like(truth.position), np.zeros_like(truth.velocity)
    position[..., 1], velocity[..., 1] = truth.time[:, None], 1.0
    position[:, 0, 2] = -8.0
    for i, ((behind, depth), offset) in enumerate(zip(STATIONS, offsets_east, strict=True)):
        position[:, i + 1] += np.stack(
            [offset, np.full_like(offset, -behind), np.full_like(offset, -depth)], axis=-1
        )
    northbound = np.zeros_like(truth.quaternion)
    # body x to the north
    northbound[..., 0] = northbound[..., 3] = np.sqrt(0.5)
    trajectory = synthetic.moved(
        truth,
        position=position,
        velocity=velocity,
        quaternion=northbound,
        angular_velocity=np.zeros_like(truth.angular_velocity),
        water_velocity=np.zeros_like(truth.water_velocity),
    )
    scenario = flight.scenario.model_copy(update={"followers": followers})
    return dataclasses.replace(flight, scenario=scenario, trajectory=trajectory)


def constant_offsets(first: float, second: float) -> tuple[Floats, Floats]:
    """Offsets of the first and the second follower that do not change, at each instant [m]."""
    n = make_flight(60.0, 2).trajectory.time.size
    return np.full(n, first), np.full(n, second)


def text_of(flight: FlightRecord, folder: Path) -> str:
    """Text of the report, without markup."""
    errors = position_and_bearing_errors(flight)
    flight_report.flight_report(flight, errors, summarise(flight), folder / "report.html", None)
    return re.sub(r"<[^>]*>|\s+", " ", (folder / "report.html").read_text(encoding="utf-8"))


def test_the_nearest_pair_is_named(tmp_path: Path) -> None:
    """Followers 0.3 and 1.5 m aside; they are 10 m apart along, 1.2 m across, 2 m in depth."""
    text = text_of(flight_beside_stations(constant_offsets(0.3, 1.5)), tmp_path)
    # leader and first follower are 10 m apart along and 2 m in depth, too, but only 0.3 m across
    distance, horizontal_distance = np.sqrt(10.0**2 + 0.3**2 + 2.0**2), np.hypot(10.0, 0.3)
    assert f"Closest approach: leader and follower1, {distance:.1f} m at 0 s" in text
    assert f"horizontally leader and follower1, {horizontal_distance:.1f} m" in text


def test_avoidance_is_reported_with_its_duration(tmp_path: Path) -> None:
    """The second follower stands 9.6 m behind the first, and for the last 20 s of a minute 4.9
    m, 0.4 m to its side.
    """
    n = make_flight(60.0, 2).trajectory.time.size
    flight = flight_beside_stations(constant_offsets(0.0, 0.4))
    position = flight.trajectory.position.copy()
    position[..., 2] = -10.0
    position[n - 200 :, 2, 1] += 5.1
    scenario = flight.scenario.model_copy(
        update={"formation": Formation(proximity=Proximity(range_sigma_m=0.0))}
    )
    avoiding = dataclasses.replace(
        flight, scenario=scenario, trajectory=synthetic.moved(flight.trajectory, position=position)
    )
    # looks every half second from 40.5 to 60 s; each sees the other
    assert "Gave way to others: follower1 for 20 s, follower2 for " in text_of(avoiding, tmp_path)
    assert "Gave way" not in text_of(flight, tmp_path)


def test_a_report_without_stations_names_no_station_error(tmp_path: Path) -> None:
    text = text_of(make_flight(20.0, 2), tmp_path)
    assert "station error" not in text
    assert "Closest approach" not in text


def test_panels_show_the_distance_over_time_to_one_scale() -> None:
    near, far = constant_offsets(0.3, 0.5)
    far[500:] = 2.0
    flight = flight_beside_stations((near, far))
    figures = flight_figures.station_errors(flight, [0, 1])
    drawn = [figure.parts[0].lines[0].y for figure in figures]
    np.testing.assert_allclose(drawn[0], 0.3, atol=1e-6)
    assert drawn[1].max() == pytest.approx(2.0)
    assert drawn[1][0] == pytest.approx(0.5)
    for figure in figures:
        assert figure.parts[0].y_limits == pytest.approx((0.0, 2.2))


def test_a_panel_of_station_errors_ends_at_ten_metres() -> None:
    (figure, _) = flight_figures.station_errors(
        flight_beside_stations(constant_offsets(50.0, 0.5)), [0, 1]
    )
    assert figure.parts[0].y_limits[1] == 10.0


def test_the_terminal_shows_each_figure_under_its_head() -> None:
    flight = flight_beside_stations((np.linspace(0.1, 0.9, 601), np.linspace(0.2, 2.9, 601)))
    summary, printed = summarise(flight), io.StringIO()
    show(Console(file=printed, width=120), flight, summary)
    head, *lines = printed.getvalue().splitlines()
    for line, (name, row) in zip(lines, summary["followers"].items(), strict=False):
        assert line.startswith(name)
        for title, figure in (
            ("RMS", f"{row['station_rms_m']:.2f} m"),
            ("95 %", f"{row['station_p95_m']:.2f} m"),
            ("max", f"{row['station_max_m']:.2f} m"),
            ("E_P: mean", f"{row['e_p_mean_m']:.2f} m"),
            ("joined at", f"{row['joined_s']:.0f} s"),
        ):
            assert line[: head.index(title) + len(title)].endswith(f" {figure}"), title


def test_the_report_has_columns_and_a_section_of_stations(tmp_path: Path) -> None:
    flight = flight_beside_stations(constant_offsets(0.3, 1.5))
    rows: dict[str, dict[str, Any]] = {
        "follower1": {
            "station_rms_m": 0.31,
            "station_p95_m": 0.62,
            "station_max_m": 0.93,
            "joined_s": 4.0,
        },
        "follower2": {
            "station_rms_m": 7.0,
            "station_p95_m": 8.0,
            "station_max_m": 11.0,
            "joined_s": None,
            "lost": True,
        },
    }
    n = flight.measurements[0].speed.size
    errors = [(np.zeros(n), np.zeros(n))] * 2
    path = tmp_path / "report.html"
    flight_report.flight_report(flight, errors, {"followers": rows}, path, None)
    html = path.read_text(encoding="utf-8")
    assert "off its station, since it joined" in html
    assert 'id="do-they-keep-station"' in html
    text = re.sub(r"<[^>]*>|\s+", " ", html)
    assert re.search(r"follower1 +0\.31 +0\.62 +0\.93 +4 ", text)
    assert re.search(r"follower2 +7\.00 +8\.00 +11\.00 +– +yes", text)


def test_the_report_of_routes_has_no_columns_or_section_of_stations(tmp_path: Path) -> None:
    flight = make_flight(20.0, 2)
    n = flight.measurements[0].speed.size
    path = tmp_path / "report.html"
    flight_report.flight_report(
        flight,
        [(np.zeros(n), np.zeros(n))] * 2,
        {"followers": {"follower1": {}, "follower2": {}}},
        path,
        None,
    )
    html = path.read_text(encoding="utf-8")
    assert "off its station, since it joined" not in html
    assert 'id="do-they-keep-station"' not in html


def test_the_command_shows_stations_and_those_who_have_none() -> None:
    summary = summarise(flight_beside_stations(constant_offsets(0.3, 1.5)))
    of_route = summarise(make_flight(20.0))["followers"]["follower"]
    shown = summary | {"followers": summary["followers"] | {"scout": of_route}}
    output = io.StringIO()
    console = Console(width=120, file=output)
    show(console, flight_beside_stations(constant_offsets(0.3, 1.5)), shown)
    lines = output.getvalue().splitlines()
    (line,) = (line for line in lines if line.startswith("scout"))
    assert line.split()[1] == f"{of_route['e_p_max_m']:.2f}"
    assert [line.split()[0] for line in lines if line.startswith("follower")] == [
        *("follower", "follower1", "follower2", "follower"),
    ]
