"""`laisn score`: estimates in files and in navigators have the same scores, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark.tables import read_truth
from tests.experiments.benchmark.sample import SAMPLE, laisn, scores_of


def write_estimates(folder: Path, north_offset_m: float) -> None:
    """Write a folder with a file for each run of the sample: its true positions, and an offset to
    the north.
    """
    for path in sorted((SAMPLE / "truth").rglob("*.csv")):
        truth = read_truth(path)
        file = folder / path.relative_to(SAMPLE / "truth")
        file.parent.mkdir(parents=True)
        rows = np.column_stack([truth.time, truth.position + np.array([0.0, north_offset_m])])
        np.savetxt(
            file, rows, delimiter=",", header="time [s],east [m],north [m]", comments="", fmt="%.6f"
        )


def test_a_folder_and_a_file_with_labels_have_the_same_score(tmp_path: Path) -> None:
    write_estimates(tmp_path / "estimates", 0.25)
    laisn("score", tmp_path / "estimates", "--data", SAMPLE, "--out", tmp_path / "folder.csv")
    rows = ["mission,seed,follower,time_s,x_m,y_m"]
    for path in sorted((tmp_path / "estimates").rglob("*.csv")):
        mission, seed = path.relative_to(tmp_path / "estimates").parts[:2]
        rows += [
            f"{mission},{seed},{path.stem},{line}"
            for line in path.read_text("utf-8").splitlines()[1:]
        ]
    (tmp_path / "all.csv").write_text("\n".join(rows), encoding="utf-8")
    printed = laisn("score", tmp_path / "all.csv", "--data", SAMPLE, "--out", tmp_path / "file.csv")
    assert "geometric mean" in printed
    assert scores_of(tmp_path / "folder.csv") == scores_of(tmp_path / "file.csv")
    for row in scores_of(tmp_path / "file.csv"):
        assert float(row["e_p_mean_m"]) == pytest.approx(0.25, abs=1e-6)


@pytest.mark.system
def test_a_navigator_and_its_estimates_have_the_same_score(tmp_path: Path) -> None:
    """What `laisn replay` writes of an imported table is scored as the navigator itself."""
    folder = SAMPLE / "measurements" / "astern" / "01"
    laisn("log", "import", folder / "follower.csv", "--out", tmp_path / "run.mcap")
    task = SAMPLE / "tasks" / "astern.toml"
    states = tmp_path / "estimates" / "astern" / "01.csv"
    states.parent.mkdir(parents=True)
    laisn("replay", tmp_path / "run.mcap", "--scenario", task, "--out", states)
    mission_options = ("--data", SAMPLE, "--mission", "astern")
    laisn("score", tmp_path / "estimates", *mission_options, "--out", tmp_path / "file.csv")
    laisn("score", "--navigator", "tight", *mission_options, "--out", tmp_path / "navigator.csv")
    (file,) = scores_of(tmp_path / "file.csv")
    (navigator,) = scores_of(tmp_path / "navigator.csv")
    for name in ("e_p_mean_m", "e_p_max_m", "nees", "relative_10m_rms_m", "e_b_mean_deg"):
        assert float(file[name]) == pytest.approx(float(navigator[name]), rel=1e-9)
    assert float(navigator["step_us"]) > 0.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time_s,x_m\n1,2\n", "lacks column 'y_m'"),
        (
            "time_s,x_m,y_m\n1,2,3\n2,2,north\n",
            "column 'y_m', row 2 of the values: 'north'; expected a number",
        ),
        ("time_s,x_m,y_m\n2,0,0\n1,0,0\n", "goes from 2 to 1 s"),
        ("x,y\n", "lacks column"),
    ],
)
def test_bad_estimates_are_refused_with_file_and_column(
    tmp_path: Path, text: str, expected: str
) -> None:
    file = tmp_path / "astern" / "01" / "follower.csv"
    file.parent.mkdir(parents=True)
    file.write_text(text, encoding="utf-8")
    message = laisn("score", tmp_path, "--data", SAMPLE, code=2)
    assert expected in message
    assert "follower.csv" in message


@pytest.mark.parametrize("seed", ["1.5", "inf", "nan", "first"])
def test_a_seed_is_a_whole_number(tmp_path: Path, seed: str) -> None:
    file = tmp_path / "mine.csv"
    rows = f"mission,seed,follower,time_s,x_m,y_m\nastern,{seed},follower,1,0,0\n"
    file.write_text(rows, encoding="utf-8")
    message = laisn("score", file, "--data", SAMPLE, code=2)
    assert f"mine.csv: seed {seed!r}; expected a whole number" in message


def test_a_mission_that_does_not_exist_is_named(tmp_path: Path) -> None:
    write_estimates(tmp_path, 0.0)
    mission = next(path for path in tmp_path.iterdir() if path.is_dir())
    mission.rename(tmp_path / "astren")
    printed = laisn("score", tmp_path, "--data", SAMPLE, code=2)
    assert "estimates of astren, seed 1" in printed


def test_input_that_cannot_be_used_is_refused_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("time_s,x_m,y_m\n1,2,3\n", encoding="utf-8")
    assert "expected a column 'seed'" in laisn("score", tmp_path, "--data", SAMPLE, code=2)
    assert "no manifest" in laisn("score", tmp_path, "--data", tmp_path, code=2)
    assert "none of the benchmark" in laisn(
        "score", "--navigator", "tight", "--data", SAMPLE, "--mission", "T5", code=2
    )
    assert "--navigator NAME" in laisn("score", "--data", SAMPLE, code=2)
    # data are not generated into a folder with files of other programs
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "thesis.tex").write_text("", encoding="utf-8")
    assert "thesis.tex" in laisn("bench-data", tmp_path / "data", "--mission", "astern", code=2)
