"""The Python interface: light to import, with the names of the files and the numbers of the
command.
"""

import os
import pydoc
import subprocess
import sys
import tomllib
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

import laisn_sim
from experiments.study.file import study_of
from experiments.study.study import RESULTS, RUNS
from sim.scenario.file import validate
from tools import import_graph

ROOT = Path(__file__).resolve().parents[2]
SHORT = {"duration_s": 20, "followers.0.depth_m": 12}


@pytest.fixture(scope="module")
def flight() -> laisn_sim.Flight:
    return laisn_sim.fly("T5", SHORT)


def python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run code in a folder, which Python looks into first."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_importing_laisn_sim_loads_no_heavy_module(tmp_path: Path) -> None:
    heavy = (
        "{'numpy', 'pydantic', 'typer', 'mujoco', 'typing', 'pathlib', 'experiments', 'sim', "
        "'laisn'}"
    )
    code = (
        f"import sys; before = set(sys.modules); import laisn_sim; print(({heavy} & "
        "set(sys.modules)) - before)"
    )
    assert python(code, tmp_path).stdout == "set()\n"


def test_every_public_name_has_a_docstring_and_packages_are_typed() -> None:
    for name in (
        *laisn_sim.__all__,
        "Flight",
        "LaisnError",
        "Navigator",
        "Scenario",
        "StudyFolder",
        "Table",
    ):
        assert getattr(laisn_sim, name).__doc__, name
        assert name in dir(laisn_sim)
    with pytest.raises(AttributeError, match=r"no attribute 'flie'; available: .*fly"):
        laisn_sim.flie  # noqa: B018
    for package in import_graph.PACKAGES:
        assert (ROOT / package / "py.typed").is_file()


def test_help_is_a_few_screens() -> None:
    assert 24 < len(pydoc.render_doc(laisn_sim).splitlines()) < 200


def test_a_foreign_package_of_the_name_sim_is_reported(tmp_path: Path) -> None:
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "__init__.py").write_text("")
    output = python("import laisn_sim; laisn_sim.load('T5')", tmp_path).stderr
    assert "ImportError: `import sim` finds" in output
    assert str(tmp_path) in output


def test_errors_are_distances_of_the_columns(flight: laisn_sim.Flight) -> None:
    table = laisn_sim.errors(flight)
    distance = np.hypot(
        table["estimate_east_m"] - table["east_m"], table["estimate_north_m"] - table["north_m"]
    )
    np.testing.assert_allclose(table["e_p_m"], distance, rtol=1e-12)
    assert table["e_p_m"].mean() == pytest.approx(
        laisn_sim.summary(flight)["e_p_mean_m"], rel=1e-12
    )
    np.testing.assert_allclose(table["time_s"], np.arange(1, 201) / 10, rtol=1e-12)
    # T5 begins level at its depth, astern
    assert table["depth_m"][0] == pytest.approx(12.0, abs=0.3)
    leader = flight.trajectory.position[flight.step_index(), 0, :2]
    from_leader = np.column_stack([table["east_m"], table["north_m"]]) - leader
    np.testing.assert_allclose(table["distance_m"], np.hypot(*from_leader.T), rtol=1e-12)
    bearing = np.radians(table["bearing_deg"]) + flight.trajectory.heading[flight.step_index(), 0]
    direction = np.column_stack([np.sin(bearing), np.cos(bearing)])
    np.testing.assert_allclose(
        from_leader, table["distance_m"][:, None] * direction, rtol=0, atol=1e-9
    )


def test_another_variant_is_navigated_as_it_would_have_been_flown(flight: laisn_sim.Flight) -> None:
    again = laisn_sim.navigate(flight, {"navigation.variant": "laisn-3-2"})
    flown = laisn_sim.fly("T5", SHORT | {"navigation.variant": "laisn-3-2"})
    assert again.scenario == flown.scenario
    assert again.estimates[0].state.tobytes() == flown.estimates[0].state.tobytes()
    assert again.estimates[0].state.tobytes() != flight.estimates[0].state.tobytes()
    with pytest.raises(
        laisn_sim.LaisnError, match=r"leader\.depth_m: a replay can change navigation only"
    ):
        laisn_sim.navigate(flight, {"leader.depth_m": 3.0})


def test_a_user_navigator_is_called(flight: laisn_sim.Flight) -> None:
    calls = []

    def user_navigator(settings, start):
        calls.append((settings.variant, start[:2]))
        return laisn_sim.Navigator(settings, start)

    again = laisn_sim.navigate(flight, navigator=user_navigator)
    ((variant, start),) = calls
    assert variant == "laisn-2"
    np.testing.assert_array_equal(start, flight.trajectory.site_path("follower/hydrophone")[0, :2])
    assert again.estimates[0].state.tobytes() == flight.estimates[0].state.tobytes()


class Derived(laisn_sim.Navigator):
    """Of the user's own, by a navigator of the project."""


class WithoutFixes(laisn_sim.Navigator):
    def step(self, own, reception=None, duration=None):
        super().step(own, reception, duration)


@pytest.mark.parametrize(
    "navigator",
    [
        laisn_sim.Navigator,
        Derived,
        lambda settings, start: laisn_sim.Navigator(settings, start),
        # what can be called, and has no name of its own
        partial(laisn_sim.Navigator),
    ],
)
@pytest.mark.usefixtures("no_plugins")
def test_a_navigator_of_the_project_is_flown_as_the_users(
    flight: laisn_sim.Flight, navigator: Any
) -> None:
    """A flight navigates under way, a replay on the whole mission; both are the same to the bit as
    the scenario's own.
    """
    flown = laisn_sim.fly(flight.scenario, navigator=navigator)
    replayed = laisn_sim.navigate(flight, navigator=navigator)
    for again in (flown, replayed):
        for name, expected in vars(flight.estimates[0]).items():
            np.testing.assert_array_equal(getattr(again.estimates[0], name), expected)


@pytest.mark.usefixtures("no_plugins")
def test_a_derived_navigator_that_returns_no_fixes_is_named(flight: laisn_sim.Flight) -> None:
    with pytest.raises(laisn_sim.LaisnError, match=r"WithoutFixes.* returned NoneType from `step`"):
        laisn_sim.fly(flight.scenario, navigator=WithoutFixes)


def test_truth_and_measurements_are_tables(flight: laisn_sim.Flight) -> None:
    truth, measured = laisn_sim.truth(flight), laisn_sim.measurements(flight)
    assert (len(truth), len(measured)) == (2 * 201, 200)
    # a velocity is the rate of a position: central differences err by a sixth of dt² times the jerk
    follower = truth["vehicle"] == "follower"
    rate = np.gradient(truth["east_m"][follower], truth["time_s"][follower])[1:-1]
    np.testing.assert_allclose(rate, truth["velocity_east_m_s"][follower][1:-1], rtol=0, atol=2e-3)
    # T5 broadcasts every second and sends no attitude
    received = ~np.isnan(measured["range_rear_m"])
    assert received.sum() == 20
    np.testing.assert_allclose(measured["time_s"][received], np.arange(1, 21), rtol=1e-12)
    np.testing.assert_array_equal(
        measured["leader_time_s"][received], flight.measurements[0].message[:, 0]
    )
    assert np.isnan(measured["leader_pitch_deg"]).all()
    distance = np.hypot(
        measured["leader_east_m"] - truth["east_m"][follower][1:],
        measured["leader_north_m"] - truth["north_m"][follower][1:],
    )[received]
    assert np.abs(measured["range_middle_m"][received] - distance).max() < 1.0


def test_records_of_arrays_print_shapes(flight: laisn_sim.Flight) -> None:
    for record in (flight.trajectory, flight.measurements[0], flight.estimates[0]):
        assert len(repr(record)) < 500
    assert repr(flight.estimates[0]).startswith(
        "<Estimates: state (200, 4), covariance (200, 4, 4)"
    )


def test_numpy_values_tuples_and_ranges_are_taken_as_numbers_and_lists() -> None:
    scenario = laisn_sim.load(
        "T5", {"duration_s": np.int64(20), "acoustics.range_tau_m": np.full(3, 0.1), "run": 3}
    )
    assert scenario == laisn_sim.load(
        "T5", {"duration_s": 20, "acoustics.range_tau_m": (0.1, 0.1, 0.1), "run": 3}
    )
    for values in (range(10, 13), np.arange(10, 13), (10, 11, 12)):
        assert study_of("T5", {"vary": {"followers.0.depth_m": values}}).factors[0].values == (
            10,
            11,
            12,
        )


class Returning:
    """A navigator whose `run` gives no estimates."""

    def __init__(self, settings: object, start: object) -> None: ...

    def run(self, measurements: object) -> None: ...


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (
            lambda flight: laisn_sim.fly("T5", [1]),
            r"changes: expected a table of values by dotted key \(given: \[1\]\)",
        ),
        (lambda flight: laisn_sim.fly("T5", {3: 4}), "3: unknown key"),
        (lambda flight: laisn_sim.navigate(flight, 3), "changes: expected a table"),
        (
            lambda flight: laisn_sim.navigate(flight, navigator=Returning),
            "NoneType from `run`; expected .*Estimates",
        ),
        (
            lambda flight: laisn_sim.fly("T5", {"duration_s": 2}, navigator=Returning),
            "NoneType from `run`; expected",
        ),
        (
            lambda flight: laisn_sim.fly("T5", navigator="tight"),
            "navigator: expected a class, .*given: 'tight'.*navigation.variant",
        ),
        (lambda flight: laisn_sim.fly("T5", controller=3), "controller: expected a class"),
        (lambda flight: laisn_sim.navigate(flight, navigator="tight"), "navigator: expected a"),
        (
            lambda flight: laisn_sim.study("T5", navigators={"mine": 3}),
            "navigators: mine: expected a class",
        ),
        (lambda flight: laisn_sim.Simulation("T5", observers=[3]), "observers: expected functions"),
        (lambda flight: laisn_sim.study("T5", vary=3), r"vary: .*valid dictionary \(given: 3\)"),
        (lambda flight: laisn_sim.load({"followers": []}), "followers: .*at least 1 item"),
        (
            lambda flight: laisn_sim.hull("../tests/sim/vehicle/remus100"),
            "unknown model .*available: bluerov2_heavy, follower",
        ),
        (lambda flight: laisn_sim.hull("bluerov"), "unknown model 'bluerov'"),
    ],
)
@pytest.mark.usefixtures("no_plugins")
def test_wrong_arguments_are_refused(flight: laisn_sim.Flight, call: Any, text: str) -> None:
    with pytest.raises(laisn_sim.LaisnError, match=text):
        call(flight)


def test_a_log_gives_the_flight_again(flight: laisn_sim.Flight, tmp_path: Path) -> None:
    path = laisn_sim.write_log(flight, tmp_path / "flight.mcap")
    again = laisn_sim.read_log(path)
    # the folder of a flight stands for its log
    assert laisn_sim.read_log(tmp_path).scenario == again.scenario == flight.scenario
    assert again.estimates[0].state.tobytes() == flight.estimates[0].state.tobytes()


SCENARIO = """
duration_s = 20
name = "two"
[[followers]]
route = "T3"
[[followers]]
waypoints = [[0, 0, 0], [20, 20, 0]]
depth_profile = [[0, 8], [10, 9]]
[acoustics]
range_tau_m = [0.1, 0.2, 0.3]
sound_speed_profile = [[0, 1500], [20, 1490]]
[navigation]
transmitters_m = [[-1, 0, 0], [1, 0, 0]]
[ocean.waves]
kind = "jonswap"
"""


def test_a_scenario_takes_what_a_file_may_hold() -> None:
    table = tomllib.loads(SCENARIO)
    scenario = laisn_sim.Scenario(**table)
    assert scenario == validate(table, "file") == laisn_sim.load(table)
    assert [f.name for f in scenario.followers] == ["follower-1", "follower-2"]
    assert laisn_sim.Scenario(followers=[{"route": "T3"}]).name == "mission"
    with pytest.raises(ValidationError, match=r"followers\n.*at least 1 item"):
        laisn_sim.Scenario(followers=[])
    for invalid in ({"depth_m": "deep"}, {"rute": "T3"}, {"waypoints": [[0, 0], [20, 20, 0]]}):
        with pytest.raises(ValueError, match=f"followers.0.{next(iter(invalid))}"):
            laisn_sim.Scenario(followers=[{"route": "T3"} | invalid])


def test_the_repr_of_a_scenario_holds_only_differences_from_the_defaults() -> None:
    import sim.scenario.settings

    scenario = laisn_sim.Scenario(**tomllib.loads(SCENARIO))
    assert eval(repr(scenario), vars(sim.scenario.settings)) == scenario
    assert repr(laisn_sim.load("T3")) == "Scenario(name='T3', followers=(Follower(route='T3'),))"


def test_a_flight_is_drawn_with_its_estimates_and_errors(flight: laisn_sim.Flight) -> None:
    table = laisn_sim.errors(flight)
    leader, truth, estimate, *_ = flight.plot("routes").data
    np.testing.assert_allclose(truth.x, table["east_m"], rtol=1e-4)
    np.testing.assert_allclose(estimate.x, table["estimate_east_m"], rtol=1e-4)
    np.testing.assert_allclose(estimate.y, table["estimate_north_m"], rtol=1e-4, atol=1e-9)
    assert "leader" in leader.hovertemplate
    *_, error = (trace for trace in flight.plot().data if trace.yaxis is None)
    np.testing.assert_allclose(error.x, table["time_s"], rtol=1e-4)
    np.testing.assert_allclose(error.y, table["e_p_m"], rtol=1e-4)
    assert next(axis.title.text for axis in flight.plot("motion").select_yaxes()) == "depth [m]"
    with pytest.raises(
        laisn_sim.LaisnError, match="plot 'speed': expected one of errors, routes, motion"
    ):
        flight.plot("speed")
    with pytest.raises(laisn_sim.LaisnError, match="follower 1: expected 0 … 0"):
        flight.plot(follower=1)


def test_a_flight_writes_its_report(flight: laisn_sim.Flight, tmp_path: Path) -> None:
    again = laisn_sim.navigate(flight, {"navigation.variant": "laisn-3-2"})
    for written, name in ((flight, "a.html"), (again, "b.html")):
        path = written.report(tmp_path / name)
        assert path == tmp_path / name
        mean = laisn_sim.errors(written)["e_p_m"].mean()
        assert f"The mean position error is {mean:.2f}" in path.read_text(encoding="utf-8")


def test_representations_are_short_and_html_in_notebooks(flight: laisn_sim.Flight) -> None:
    assert repr(flight) == "<Flight 'T5': 20 s, followers: 1, laisn-2, completed>"
    mean = laisn_sim.errors(flight)["e_p_m"].mean()
    assert f"<td>{mean:.2f} m</td>" in flight._repr_html_()
    table = laisn_sim.errors(flight)
    assert repr(table).startswith("<Table: 200 rows, 12 columns: follower, time_s, e_p_m,")
    assert table._repr_html_().count("<tr>") == 1 + 5
    wide = laisn_sim.Table(pa.table({f"c{i}": ["<b>"] for i in range(99)}))
    assert len(repr(wide)) < 120
    assert "<b>" not in wide._repr_html_()
    with pytest.raises(laisn_sim.LaisnError, match="unknown column 'x'; available: follower"):
        table["x"]


def test_other_libraries_take_tables_as_they_are() -> None:
    arrow = pa.table({"a": [1, 2], "b": ["x", "y"]})
    assert pa.table(laisn_sim.Table(arrow)) == arrow
    assert laisn_sim.Table(arrow).rows() == [{"a": 1, "b": "x"}, {"a": 2, "b": "y"}]


def test_a_study_by_keywords_is_that_of_a_file(tmp_path: Path) -> None:
    file = {
        "scenario": "T5",
        "set": {"duration_s": 20},
        "vary": {"followers.0.depth_m": [10, 15]},
        "runs": 2,
    }
    from_file = laisn_sim.study(file, out=tmp_path / "a", workers=1)
    keys = {"vary": file["vary"], "set": file["set"], "runs": 2}
    from_keywords = laisn_sim.study("T5", out=tmp_path / "b", workers=1, **keys)
    assert (
        from_file.table.arrow
        == from_keywords.table.arrow
        == pq.read_table(tmp_path / "a" / RESULTS)
    )
    assert from_file.runs.arrow == pq.read_table(tmp_path / "a" / RUNS)
    # records hold six digits
    assert from_file.findings["e_p_mean_m: point 0, arm all, follower"].value == float(
        f"{from_file.table['e_p_mean_m'][0]:.6g}"
    )
    assert laisn_sim.StudyFolder(tmp_path / "a").table.arrow == from_file.table.arrow
    (line,) = from_file.plot("followers.0.depth_m").data
    np.testing.assert_allclose(line.x, from_file.table["followers.0.depth_m"])
    np.testing.assert_allclose(line.y, from_file.table["e_p_mean_m"], rtol=1e-4)
    with pytest.raises(laisn_sim.LaisnError, match="unknown column 'speed'"):
        from_file.plot("speed")
    assert from_file.report().is_file()
    if find_spec("pandas"):
        assert (
            list(from_file.table.to_pandas()["e_p_mean_m"])
            == from_file.table["e_p_mean_m"].tolist()
        )
    else:
        with pytest.raises(laisn_sim.LaisnError, match="pip install pandas"):
            from_file.table.to_pandas()
    assert str(from_file.report()) in from_file._repr_html_()
    with pytest.raises(laisn_sim.LaisnError, match="holds no results of a study"):
        laisn_sim.StudyFolder(tmp_path / "c")


def test_keywords_replace_settings_of_a_study_key_by_key() -> None:
    file = {
        "scenario": "T5",
        "runs": 5,
        "set": {"duration_s": 20},
        "vary": {"leader.baseline_m": [1, 2]},
    }
    actual = study_of(
        file,
        {
            "runs": None,
            "realizations": 1,
            "vary": {"followers.0.depth_m": [9]},
            "set": {"duration_s": 30},
        },
    )
    assert (actual.runs, dict(actual.settings)) == (5, {"duration_s": 30})
    assert [(f.key, f.values) for f in actual.factors] == [
        ("leader.baseline_m", (1, 2)),
        ("followers.0.depth_m", (9,)),
    ]
    with pytest.raises(laisn_sim.LaisnError, match="T5 is a scenario: give --vary"):
        study_of("T5", {})
