"""Studies from file to page: errors before flights, paired arms, commands that repeat runs, the
same bytes always.
"""

import multiprocessing
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
import tomli_w
from typer.testing import CliRunner

import models
from experiments.campaign import campaign
from experiments.campaign.store import CampaignError, Store
from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from experiments.study import study as study_module
from experiments.study.design import Draw
from experiments.study.estimate import Results
from experiments.study.file import (
    FOLDER,
    StudyError,
    built_in_files,
    shipped,
    study_from_table,
    study_of,
    table_in,
)
from experiments.study.measure import METRICS, records_of_run
from experiments.study.page import StudyPage, commands
from experiments.study.plan import plan_of
from experiments.study.run import fly_studies, fly_until_narrow
from experiments.study.study import RECORD, REPORT, RESULTS, RUNS, STUDY, run_studies
from laisn import metrics
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from laisn_sim.cli.studies import BUILT_IN
from reports import findings
from sim.flight import position_and_bearing_errors

SMALL = """
scenario = "T5"
runs = 3
realizations = 2
[set]
duration_s = 20.0
ocean.waves.kind = "jonswap"
[vary]
"followers.0.depth_m" = [10, 14]
[draw]
ocean.waves.height_m = { uniform = [0.2, 0.8] }
[[arm]]
name = "level"
[[arm]]
name = "attitude"
leader.broadcast_attitude = true
navigation.use_attitude = true
"""
FILES = (RESULTS, RUNS, RECORD, REPORT, STUDY)
WIDE = 2**1024 - 1
"""An integer of 1024 bits, which is beyond all floats."""


def study(text=SMALL, **changes):
    """The study of a file with this text, of which some keys have other values."""
    return study_from_table(tomllib.loads(text) | changes, "mine.toml", "mine")


@pytest.fixture(scope="module")
def study_folder(tmp_path_factory):
    """The results folder of the small study, computed by one process."""
    folder = tmp_path_factory.mktemp("study")
    run_studies({"study": study()}, folder, workers=1, quiet=True)
    return folder


def test_tables_have_a_row_for_each_point_arm_realization_and_follower(study_folder):
    table = pq.read_table(study_folder / RESULTS).to_pylist()
    assert [
        (record["point"], record["arm"], record["realization"], record["follower"])
        for record in table
    ] == [
        (point, arm, realization, "follower")
        for point in (0, 1)
        for arm in ("level", "attitude")
        for realization in (0, 1)
    ]
    assert [record["followers.0.depth_m"] for record in table] == [10] * 4 + [14] * 4
    runs = pq.read_table(study_folder / RUNS).to_pylist()
    assert len(runs) == 3 * len(table)
    for row, first in zip(table, range(0, len(runs), 3), strict=True):
        runs_of_row = runs[first : first + 3]
        assert [record["run"] for record in runs_of_row] == [0, 1, 2]
        assert np.mean([record["e_p_mean_m"] for record in runs_of_row]) == pytest.approx(
            row["e_p_mean_m"], rel=1e-12
        )


def test_the_study_of_a_folder_is_the_one_that_was_flown(study_folder):
    read_study = study_of(str(study_folder / STUDY), {"runs": 5})
    original = study()
    assert read_study.runs == 5
    assert (read_study.settings, read_study.factors, read_study.draws, read_study.arms) == (
        original.settings,
        original.factors,
        original.draws,
        original.arms,
    )
    assert read_study.draws[0].value(seed=1, realization=0) == original.draws[0].value(
        seed=1, realization=0
    )


def test_a_study_in_its_folder_finds_scenario_and_hulls(tmp_path):
    (tmp_path / "hulls").mkdir()
    (tmp_path / "hulls" / "mine.xml").write_bytes(models.path("follower").read_bytes())
    (tmp_path / "two.toml").write_text(
        'duration_s = 20\n[[followers]]\nroute = "T5"\n', encoding="utf-8"
    )
    key, name = "followers.0.model", "hulls/mine.xml"
    tables = [{"set": {key: name}}, {"vary": {key: [name]}}, {"arm": [{"name": "own", key: name}]}]
    for number, table in enumerate(tables):
        original = study_from_table({"scenario": "two.toml"} | table, "s", "s", tmp_path)
        folder = tmp_path / "out" / str(number)
        folder.mkdir(parents=True)
        (folder / STUDY).write_text(tomli_w.dumps(table_in(original, folder)), encoding="utf-8")
        read_study = study_of(str(folder / STUDY), {})
        assert [entry.scenario for entry in plan_of(read_study).entries] == [
            entry.scenario for entry in plan_of(original).entries
        ]
        assert plan_of(read_study).entries[0].scenario.followers[0].model


def test_every_column_is_a_label_a_count_or_a_metric_with_a_meaning(study_folder):
    labels = {
        "point",
        "arm",
        "realization",
        "follower",
        "followers.0.depth_m",
        "ocean.waves.height_m",
        "run",
    }
    counts = {"variant", "seed", "runs", "steps", "worst_run"}
    for name in (RESULTS, RUNS):
        assert set(pq.read_table(study_folder / name).column_names) <= labels | counts | set(
            METRICS
        )


def test_arms_share_realizations_and_noise(study_folder):
    plan = plan_of(study())
    for entry in plan.entries:
        twin = next(
            other
            for other in plan.entries
            if (other.point, other.realization) == (entry.point, entry.realization)
            and other.arm != entry.arm
        )
        assert entry.motion_key == twin.motion_key
        assert entry.scenario.seed == twin.scenario.seed
        assert entry.settings["ocean.waves.height_m"] == twin.settings["ocean.waves.height_m"]
    assert plan.flights == 4
    missions = {Store(study_folder).path(entry.motion_key) for entry in plan.entries}
    assert [path.is_file() for path in missions] == [True] * 4


def test_another_key_leaves_draws_as_they_were():
    larger_table = tomllib.loads(SMALL)
    larger_table["draw"]["leader.excess_buoyancy_n"] = {"uniform": [0, 5]}
    larger_table["realizations"] = 4
    before, after = plan_of(study()), plan_of(study_from_table(larger_table, "more.toml", "more"))
    key = "ocean.waves.height_m"
    drawn = {entry.realization: entry.settings[key] for entry in after.entries}
    assert {entry.realization: entry.settings[key] for entry in before.entries} == {
        realization: drawn[realization] for realization in (0, 1)
    }
    assert drawn[0] == Draw.of(key, {"uniform": [0.2, 0.8]}).value(seed=1, realization=0)


def test_the_command_of_a_run_repeats_it(study_folder, tmp_path):
    plan = plan_of(study())
    rows = {
        (row["point"], row["arm"], row["realization"], row["run"]): row
        for row in pq.read_table(study_folder / RUNS).to_pylist()
    }
    outcomes = fly_studies([plan], study_folder, workers=1, quiet=True)[0]
    lines = commands(plan, Results.of(outcomes.rows, outcomes.runs)).splitlines()
    assert len(lines) == 2 * 2 * 4
    words = shlex.split(lines[-1])
    run = int(words[words.index("--run") + 1])
    expected = rows[1, "attitude", 0, run], rows[1, "attitude", 1, run]
    assert words[0] == "laisn"
    result = CliRunner().invoke(app, [*words[1:], "--no-video", "--out", str(tmp_path / "one")])
    assert result.exit_code == 0, result.output
    error = findings.json.loads((tmp_path / "one" / "summary.json").read_text())["e_p_mean_m"]
    assert any(error == pytest.approx(row["e_p_mean_m"], rel=1e-9) for row in expected)
    sorted_errors = sorted(
        row["e_p_mean_m"] for key, row in rows.items() if key[:2] == (1, "attitude")
    )
    assert error == pytest.approx(sorted_errors[2], rel=1e-9), "the last line is the median run"


@pytest.mark.system
def test_two_workers_after_a_kill_give_the_same_bytes(study_folder, tmp_path):
    (tmp_path / "mine.toml").write_text(SMALL)
    folder = tmp_path / "out"
    code = "from laisn_sim.cli.main import main; main()"
    command = [
        sys.executable,
        "-c",
        code,
        "study",
        "mine.toml",
        "--out",
        str(folder),
        "--workers",
        "1",
    ]
    process = subprocess.Popen(
        command, cwd=tmp_path, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 300
    while (
        process.poll() is None
        and len(list(folder.glob("store/*.zip"))) < 2
        and time.monotonic() < deadline
    ):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (folder / REPORT).exists(), "it was killed too late"
    run_studies({"study": study()}, folder, workers=2, quiet=True)
    assert multiprocessing.active_children() == [], "workers would keep their memory"
    for name in FILES:
        assert (folder / name).read_bytes() == (study_folder / name).read_bytes(), name


@pytest.mark.system
def test_two_commands_in_one_folder_both_end_with_the_same_bytes(study_folder, tmp_path):
    (tmp_path / "mine.toml").write_text(SMALL)
    code = "from laisn_sim.cli.main import main; main()"
    command = [
        sys.executable,
        "-c",
        code,
        "study",
        "mine.toml",
        "--out",
        "shared",
        "--workers",
        "1",
        "--no-scene",
    ]
    processes = [
        subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
        for _ in "ab"
    ]
    for process in processes:
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors
    for name in FILES:
        assert (tmp_path / "shared" / name).read_bytes() == (study_folder / name).read_bytes(), name


def test_nothing_is_computed_twice(study_folder, monkeypatch):
    monkeypatch.setattr(campaign, "compute", None)
    monkeypatch.setattr(campaign, "_fly", None)
    run_studies({"study": study()}, study_folder, workers=1, quiet=True)


def test_all_invalid_keys_of_all_points_are_reported_at_once():
    with pytest.raises(StudyError) as error:
        plan_of(
            study(
                vary={
                    "leader.depth_m": [8, -1],
                    "leader.excess_bouyancy_n": [1],
                    "followers.3.depth_m": [1],
                }
            )
        )
    text = str(error.value)
    assert "did you mean 'excess_buoyancy_n'?" in text
    assert "leader.depth_m: Input should be greater than or equal to 0" in text
    assert "followers.3.depth_m is no key" in text


def test_what_is_not_feasible_is_reported_with_its_points():
    with pytest.raises(StudyError) as error:
        plan_of(study(vary={"followers.0.depth_m": [10, 40], "followers.3.depth_m": [1]}))
    text = str(error.value)
    assert "followers.3.depth_m is no key" in text
    assert "floor_depth_m" in text
    assert "in 4 of 8 scenarios, first at followers.0.depth_m = 40" in text
    assert len(text.splitlines()) <= 20


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"runs": 0}, "runs"),
        ({"speed": 1}, "unknown key of a study; did you mean 'seed'"),
        ({"zzz": 1}, "unknown key of a study; known here: name, question"),
        ({"arms": []}, "arms: unknown key of a study; did you mean 'arm'"),
        ({"factors": {}}, "factors: unknown key of a study; did you mean 'vary'"),
        (
            {
                "set": {"ocean.waves.kind": "regular"},
                "draw": {"ocean.waves": {"choice": [{"kind": "none"}]}},
            },
            r"\[draw\] sets ocean.waves, \[set\] sets ocean.waves.kind; .* is part of ocean.waves",
        ),
        (
            {
                "vary": {"ocean.waves.direction_deg": [0, 90]},
                "draw": {"ocean.waves": {"choice": [{"kind": "none"}]}},
            },
            r"\[draw\] sets ocean.waves, \[vary\] sets ocean.waves.direction_deg; "
            ".* is part of ocean.waves",
        ),
        (
            {
                "vary": {"ocean.current_profile.0": [[0, 0.1, 90]]},
                "set": {"ocean.current_profile": []},
            },
            r"\[vary\] sets ocean.current_profile.0, \[set\] sets ocean.current_profile; "
            ".*remove one",
        ),
        ({"vary": {"followers.00.depth_m": [10, 12]}}, "followers.00.depth_m is no key"),
        (
            {"draw": {"followers.\uff10.depth_m": {"uniform": [9, 11]}}, "vary": {}},
            "depth_m is no key",
        ),
        (
            {"vary": {f"leader.k{i}": [1, 2] for i in range(30)}},
            r"design: 1,073,741,824 points, at most 50,000 with these arms",
        ),
        (
            {"vary": {"leader.depth_m": {"from": 0, "to": WIDE, "steps": 3}}},
            "from and to must be two different numbers",
        ),
        (
            {"draw": {"leader.depth_m": {"uniform": [0, WIDE]}}},
            r"a parameter is a number within ±1e\+09",
        ),
        ({"set": {"leader.depth_m": {"rotate": WIDE}}}, "expected { cycle = .* or { rotate"),
        ({"draw": {"leader.depth_m": {"uniform": "ab"}}}, r"uniform expects \[low, high\]"),
        (
            {"draw": {"leader.depth_m": {"uniform": [8]}}},
            r"uniform expects \[low, high\] \(given: \[8\]\)$",
        ),
        (
            {"draw": {"leader.depth_m": {"uniform": ["a", 1]}}},
            r"a parameter is a number within ±1e\+09",
        ),
        ({"draw": {"leader.depth_m": {"ksone": {"n": 1e6}}}}, "unknown distribution 'ksone'"),
        (
            {
                "draw": {"ocean.waves": {"choice": [{"kind": "none"}]}},
                "arm": [{"name": "a", "ocean.waves.height_m": 1.0}],
            },
            "arm a sets ocean.waves.height_m, .draw. sets ocean.waves;",
        ),
        (
            {"draw": {"leader.depth_m": {"zipf": {"a": 1.0001}}}},
            "unknown distribution 'zipf'; available: choice, route_class, formation, bernoulli",
        ),
        (
            {"draw": {"leader.depth_m": {"norm": {"loc": [1, 2]}}}},
            r"a parameter is a number within ±1e\+09",
        ),
        (
            {"draw": {"leader.depth_m": {"gamma": {"a": 1e300}}}},
            r"a parameter is a number within ±1e\+09",
        ),
        (
            {"draw": {"followers.0.depth_m": {"uniform": [9, 11]}}},
            r"stands in \[vary\] and in \[draw\]",
        ),
        ({"arm": [{"name": "a", "followers.0.depth_m": 3}]}, r"stands in \[vary\] and in arm a"),
        ({"arm": [{"name": "a"}, {"name": "a"}]}, "repeated: a"),
        ({"arm": [{}]}, "needs a name"),
        ({"set": {"seed": 3}}, "numbered by it"),
        ({"report": {"metric": "e_p"}}, "unknown metric"),
        ({"report": {"against": "leader.depth_m"}}, "is not varied"),
        ({"set": {"duration_s": 20.0}, "draw": {}}, "equal realizations"),
        ({"points": 8}, "points belongs to"),
    ],
)
def test_an_error_is_reported_with_its_key(changes, expected):
    with pytest.raises(StudyError, match=expected):
        plan_of(study(**changes))


def refused(**changes):
    """The message with which the changed study is refused."""
    with pytest.raises(StudyError) as error:
        plan_of(study(**changes))
    return str(error.value)


def test_all_errors_of_the_file_s_own_keys_are_reported_at_once():
    text = refused(runs=0, speed=1, report={"metrik": "e_p"}, realizations=0)
    for expected in (
        "runs: Input",
        "speed: unknown key",
        "report.metrik: unknown key",
        "realizations: ",
    ):
        assert expected in text
    assert len(text.splitlines()) == 5
    text = refused(
        vary={"leader.depth_m": {"from": 0, "to": 9}, "acoustics.clock_offset_s": []},
        draw={"ocean.waves.height_m": {"unifrom": [0, 1]}},
        arm=[{"navigation.variant": "laisn-9"}],
    )
    for expected in (
        "vary.leader.depth_m: steps",
        "clock_offset_s: the list",
        "unknown distribution",
        "arm[0].name",
    ):
        assert expected in text
    assert len(text.splitlines()) == 5
    text = refused(scenario="T11", report={"metric": "e_p"})
    assert "unknown scenario 'T11'" in text
    assert "unknown metric 'e_p'" in text


@pytest.mark.parametrize(
    "changes", [{"runs": 0}, {"report": {"metric": "e_p"}}, {"points": 8}, {"arm": [{}]}]
)
def test_an_error_of_the_file_is_reported_before_any_point_is_validated(monkeypatch, changes):
    monkeypatch.setattr(
        "experiments.study.plan.scenario_or_errors", lambda *_: pytest.fail("a point was validated")
    )
    assert refused(**changes)


UNTIL = {"batch": 20, "until": {"metric": "e_p_mean_m", "half_width": 0.1, "most": 400}}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"runs": UNTIL}, "runs.until: the interval over several realizations does not narrow"),
        ({"realizations": 1, "draw": {}, "runs": {"batch": 20}}, "runs.until: Field required"),
        (
            {"realizations": 1, "draw": {}, "runs": UNTIL | {"batch": 3}},
            "runs.batch: Input should be greater than or equal to",
        ),
        (
            {
                "realizations": 1,
                "draw": {},
                "runs": {"until": {"metric": "e_p", "half_width": 1.0}},
            },
            "runs.until.metric: unknown",
        ),
        (
            {"realizations": 1, "draw": {}, "runs": {"until": {"half_width": 0.0}}},
            "runs.until.half_width: Input should be",
        ),
    ],
)
def test_a_wrong_number_of_runs_is_reported_with_its_key(changes, expected):
    assert expected in refused(**changes)


@pytest.mark.system
def test_batches_are_flown_until_every_interval_is_narrow_enough(tmp_path):
    keys = {"realizations": 1, "draw": {}, "arm": [], "set": {"duration_s": 20.0}}
    first_study = study(SMALL, runs=UNTIL, **keys)
    first_batch = Results.of(
        *rows_and_runs(
            fly_studies([plan_of(first_study)], tmp_path / "first", workers=1, quiet=True)[0]
        )
    )
    widths = [
        half_width(first_batch.estimate(condition, "e_p_mean_m")) for condition in first_batch.rows
    ]
    largest_half_width = 0.6 * max(widths)
    until_narrow = UNTIL | {"until": UNTIL["until"] | {"half_width": largest_half_width}}
    run_studies(
        {"study": study(SMALL, runs=until_narrow, **keys)},
        tmp_path / "until",
        workers=1,
        quiet=True,
    )
    rows = pq.read_table(tmp_path / "until" / RESULTS).to_pylist()
    (runs,) = {row["runs"] for row in rows}
    # 20 / 0.6² = 55.6: as a rule three batches are enough
    assert runs % 20 == 0
    assert 40 <= runs <= 120
    # the same as with that number of runs from the start, to the byte
    run_studies(
        {"study": study(SMALL, runs=runs, **keys)}, tmp_path / "fixed", workers=1, quiet=True
    )
    for name in (RESULTS, RUNS, RECORD):
        assert (tmp_path / "until" / name).read_bytes() == (tmp_path / "fixed" / name).read_bytes()
    actual = findings.read_findings(tmp_path / "until" / RECORD).findings
    assert (
        max((finding.high - finding.low) / 2 for key, finding in actual.items() if "point" in key)
        <= largest_half_width
    )
    at_most_30_runs = {"batch": 20, "until": {"half_width": 1e-6, "most": 30}}
    (outcomes,) = fly_until_narrow(
        [plan_of(study(SMALL, runs=at_most_30_runs, **keys))], tmp_path / "most", quiet=True
    )
    assert (outcomes.plan.study.runs, {row["runs"] for row in outcomes.rows}) == (30, {30})
    notes = StudyPage(plan=outcomes.plan, results=outcomes.results, failures={}).interval_notes
    assert [note.partition(", the most")[0] for note in notes] == ["after 30 runs"]


@pytest.mark.parametrize(
    ("until", "expected"),
    [
        ({"metric": "e_p_std_m", "half_width": 1.0}, "'e_p_std_m' is not a metric of single runs"),
        ({"metric": "nes", "half_width": 1.0}, "unknown metric 'nes'; did you mean nees"),
        ({"half_width": 1.0, "most": 10}, "until.most = 10 is below batch = 20"),
    ],
)
def test_runs_that_cannot_be_enough_are_refused_before_any_is_flown(
    until: dict[str, object], expected: str
) -> None:
    with pytest.raises(LaisnError, match=expected):
        plan_of(study(SMALL, realizations=1, runs=UNTIL | {"until": until}))


def rows_and_runs(outcomes):
    return outcomes.rows, outcomes.runs


def half_width(interval):
    return (interval.high - interval.low) / 2


@pytest.mark.system
def test_followers_that_steer_by_estimates_fly_every_run(tmp_path):
    closed_loop_study = study(
        """
scenario = "T3"
runs = 2
[set]
duration_s = 20.0
followers.0.guidance_position = "estimate"
[vary]
"navigation.variant" = ["laisn-2", "laisn-3-2"]
"""
    )
    plan = plan_of(closed_loop_study)
    assert plan.flights == 4
    run_studies({"study": closed_loop_study}, tmp_path, workers=1, quiet=True)
    row = pq.read_table(tmp_path / RUNS).to_pylist()[3]
    flight, _ = fly(plan.entries[1].scenario.model_copy(update={"run": 1}))
    ((position, _),) = position_and_bearing_errors(flight)
    assert row["e_p_mean_m"] == pytest.approx(float(position.mean()), rel=1e-12)


def test_runs_of_an_arm_that_flies_every_third_one_are_counted() -> None:
    arms = [{"name": "all"}, {"name": "some", "every": 3}]
    closed = {"duration_s": 20.0, "followers.0.guidance_position": "estimate"}
    plan = plan_of(study(SMALL, realizations=1, runs=7, arm=arms, draw={}, set=closed))
    # runs 0, 3 and 6 of the second arm
    assert plan.cell_runs == plan.flights == len(plan.points) * (7 + 3)


def test_mirror_locks_of_single_flights_are_those_of_cells(tmp_path):
    keys = {"scenario": "T7", "vary": {"followers.0.depth_m": [20]}, "set": {"duration_s": 80.0}}
    cell_study = study(SMALL, realizations=1, runs=8, arm=[], draw={}, **keys)
    plan = plan_of(cell_study)
    outcomes = fly_studies([plan], tmp_path, workers=1, quiet=True)[0]
    expected = outcomes.runs[0][1]["mirror_locked"]
    for run, mirror_locked in enumerate(expected):
        (row,) = records_of_run(plan.entries[0].scenario, run)
        assert row["mirror_locked"] == mirror_locked
    assert 0 < sum(expected) < 8, "the mission does not discriminate"


@pytest.mark.system
@pytest.mark.parametrize("variant", ["laisn-3-1", "tight"])
def test_followers_on_stations_are_judged_by_the_estimates_that_steered_them(variant):
    """As if each navigated on the finished mission; most ranges are echoes, so that many fixes
    are gated.
    """
    echoes = (
        "acoustics.surface_echo_probability=0.4",
        "acoustics.bottom_echo_probability=0.4",
        "sensors.speed_bias_m_s=0.3",
    )
    swarm = load_scenario("swarm", ("duration_s=20", f"navigation.variant={variant}", *echoes))
    rows = records_of_run(swarm, 2)
    flight, _ = fly(swarm.model_copy(update={"run": 2}))
    for row, (position, bearing), estimates in zip(
        rows, position_and_bearing_errors(flight), flight.estimates, strict=True
    ):
        assert row["e_p_mean_m"] == pytest.approx(position.mean(), rel=1e-9)
        assert row["e_p_max_m"] == pytest.approx(position.max(), rel=1e-9)
        assert row["e_b_mean_deg"] == pytest.approx(np.rad2deg(bearing).mean(), rel=1e-9)
        assert row["gated"] == metrics.fix_counts(estimates)["gated"]
    assert len({row["gated"] for row in rows}) > 1, "the mission does not discriminate"


def test_an_infeasible_mission_is_reported_and_the_others_continue(tmp_path, monkeypatch):
    from experiments.campaign import montecarlo
    from experiments.campaign.store import CampaignError

    # MuJoCo's missions are simulated one after the other
    one_by_one = study(engine="mujoco")
    plan = plan_of(one_by_one)
    simulate = montecarlo.simulate_mission

    def simulate_or_fail(scenario):
        if scenario.followers[0].depth_m == 14:
            raise CampaignError("mission 'T5': lost at 3 s")
        return simulate(scenario)

    monkeypatch.setattr(montecarlo, "simulate_mission", simulate_or_fail)
    run_studies({"study": one_by_one}, tmp_path, workers=1, quiet=True)
    assert {r["point"] for r in pq.read_table(tmp_path / RESULTS).to_pylist()} == {0}
    page = (tmp_path / REPORT).read_text()
    assert "lost at 3 s: 4 scenarios" in page
    assert len(plan.entries) == 8


def test_options_vary_a_scenario_without_a_file(tmp_path):
    words = [
        "study",
        "T5",
        "--vary",
        "leader.baseline_m=1.0,2.0",
        "--set",
        "duration_s=20",
        "--runs",
        "2",
        "--out",
    ]
    result = CliRunner().invoke(app, [*words, str(tmp_path), "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert [r["leader.baseline_m"] for r in pq.read_table(tmp_path / RESULTS).to_pylist()] == [
        1.0,
        2.0,
    ]


@pytest.mark.system
def test_a_dry_run_prints_the_cost_of_a_study_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text(SMALL)
    result = CliRunner().invoke(app, ["study", "mine.toml", "--dry-run"])
    assert result.exit_code == 0, result.output
    assert "4 flights, 8 cells, 24 runs" in result.output
    assert re.search(r"about \d+ s and \d+ MB, if nothing is stored yet", result.output)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize(
    ("closed_loop", "runs", "blocks"), [(False, 60, 1), (False, 200, 4), (True, 5, 1)]
)
def test_the_time_of_a_study_is_that_of_its_missions_and_cells(
    monkeypatch, closed_loop, runs, blocks
):
    # on a simulated clock: 3 s for a mission and 0.1 s for a block of runs of a cell, by two
    # workers, 0.7 s for a call
    depth, bias = {"from": 8, "to": 17, "steps": 10}, {"from": 0.0, "to": 2.0, "steps": 5}
    table = {
        "scenario": "T5",
        "runs": runs,
        "set": {"followers.0.guidance_position": "estimate" if closed_loop else "truth"},
    }
    table |= {"vary": {"followers.0.depth_m": depth, "sensors.heading_bias_deg": bias}}
    clock, stored = [0.0], set()

    def spend(key, seconds):
        clock[0] += 0.0 if key in stored else seconds / 2
        stored.add(key)

    def simulated(plans, folder, **options):
        (plan,) = plans
        clock[0] += 0.7
        for entry in plan.entries:
            duration = entry.scenario.duration_s
            for run in plan.runs_of(entry) if closed_loop else ():
                spend((entry.design_key, run, duration), 3.0)
            if not closed_loop:
                spend((entry.motion_key, duration), 3.0)
                spend((entry.design_key, plan.study.runs, duration), 0.1)
        return [SimpleNamespace(failures={})]

    monkeypatch.setattr(study_module, "fly_studies", simulated)
    monkeypatch.setattr(study_module, "perf_counter", lambda: clock[0])
    seconds, _ = study_module._cost(plan_of(study_from_table(table, "s", "s")), 2)
    assert seconds == pytest.approx(
        50 * runs * 3.0 / 2 if closed_loop else (10 * 3.0 + 50 * blocks * 0.1) / 2
    )


def test_a_dry_run_reports_a_mission_that_cannot_be_flown(monkeypatch):
    failed = SimpleNamespace(failures={"mission 'T5': lost at 3 s": []})
    monkeypatch.setattr(study_module, "fly_studies", lambda *_, **__: [failed])
    with pytest.raises(CampaignError, match="lost at 3 s"):
        study_module.effort_text(
            study_from_table({"scenario": "T5", "set": {"duration_s": 20}}, "s", "s"), 1
        )


@pytest.mark.parametrize("options", [[], ["--dry-run"]])
def test_points_are_counted_before_they_are_listed(tmp_path, options):
    ranges = [
        f'"{key}" = {{ from = 0, to = 1, steps = 1000 }}'
        for key in ("leader.a", "leader.b", "leader.c")
    ]
    (tmp_path / "many.toml").write_text("\n".join(['scenario = "T5"', "[vary]", *ranges]))
    result = CliRunner().invoke(app, ["study", str(tmp_path / "many.toml"), *options])
    assert result.exit_code == 2
    assert "1,000,000,000 points, at most 200,000" in result.output


@pytest.mark.parametrize(("steps", "last_line"), [(10, []), (1000, ["scenarios: 1000/1000"])])
def test_planning_shows_progress_where_scenarios_are_many(capsys, steps, last_line):
    values = {"from": 0, "to": 1, "steps": steps}
    plan_of(
        study_from_table(
            {"scenario": "T5", "vary": {"acoustics.range_scale_mean_m": values}}, "s", "s"
        ),
        quiet=False,
    )
    lines = [line.partition(",")[0] for line in capsys.readouterr().err.splitlines()]
    # what no test has compiled before is reported, too
    assert [line for line in lines if not line.startswith("compil")][-1:] == last_line


def test_drawn_formations_are_the_followers_of_their_realization():
    area = {"count": 4, "spacing_m": 7.0, "width_m": 60.0, "layer_m": 0.0}
    drawn_study = study_from_table(
        {"scenario": "swarm", "realizations": 3, "draw": {"followers": {"formation": area}}},
        "s",
        "s",
    )
    stations_by_realization = [
        [follower.station for follower in entry.scenario.followers]
        for entry in plan_of(drawn_study).entries
    ]
    assert [len(stations) for stations in stations_by_realization] == [4, 4, 4]
    assert stations_by_realization[0] != stations_by_realization[1]
    drawn = drawn_study.draws[0].value(seed=1, realization=2)
    assert [station.port_m for station in stations_by_realization[2]] == [
        follower["station"]["port_m"] for follower in drawn
    ]


@pytest.mark.system
@pytest.mark.parametrize("name", shipped())
def test_studies_that_ship_are_valid_and_have_a_head_and_a_question(name):
    for path in built_in_files(name).values() or [FOLDER / f"{name}.toml"]:
        assert path.read_text(encoding="utf-8").startswith("# ")
        plan = plan_of(study_of(str(path), {}))
        assert plan.study.file.question
        assert plan.study.name.startswith(name)
        if built_in_files(name):
            assert plan_of(study_of(str(path), {}, quick=True)).flights <= plan.flights


def test_each_study_that_ships_has_a_command_of_its_name():
    assert set(BUILT_IN) == set(shipped())
    for name in BUILT_IN:
        wide = {"COLUMNS": "200"}
        help_of_command, help_of_study = (
            CliRunner().invoke(app, [word, "--help"], env=wide).output for word in (name, "study")
        )
        assert set(re.findall(r"--[a-z-]+", help_of_command)) == set(
            re.findall(r"--[a-z-]+", help_of_study)
        )
        assert BUILT_IN[name].split()[0] in help_of_command


def test_a_study_file_without_a_scenario_says_what_it_lacks(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('runs = 2\n[vary]\n"leader.depth_m" = [5, 8]\n', encoding="utf-8")
    with pytest.raises(StudyError, match=r"mine\.toml: a study needs scenario = the name of"):
        study_of(str(file), {})
