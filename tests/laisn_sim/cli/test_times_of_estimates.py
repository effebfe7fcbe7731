"""Estimates of a replay are at the times of the log: merged with a path at its times, as a user
does, they have the errors that are printed.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from mcap_protobuf.writer import Writer
from typer.testing import CliRunner

from laisn.arrays import Floats
from laisn_sim.cli.main import app
from sim.log.schema import OWN_MOTION, RECEPTION

PLAZA = Path(__file__).resolve().parents[2] / "data" / "plaza"
STEP_S = 0.1
LATE_S = 30.0
NORTH_M = {"alpha": -20.0, "beta": -35.0}


def command(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    return str(result.output)


def columns(path: Path, *names: str) -> Floats:
    """Numbers of a table by the names of its columns, shape (n, len(names))."""
    with path.open(encoding="utf-8") as stream:
        rows = [[float(row[name]) for name in names] for row in csv.DictReader(stream)]
    return np.array(rows)


def scenario(folder: Path) -> Path:
    """A leader and two followers that swim east at 1 m/s; the place of beta is that at which its
    log begins.
    """
    lines = ["[leader]", "waypoints = [[0, 0, 0], [300, 300, 0]]", "baseline_m = 2.0"]
    for name, north in NORTH_M.items():
        lines += ["[[followers]]", f'name = "{name}"']
        east = LATE_S - STEP_S if name == "beta" else 0.0
        lines += [f"waypoints = [[0, {east}, {north}], [300, 329, {north}]]", "depth_m = 8.0"]
    path = folder / "mine.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def table(folder: Path, times: list[str], name: str = "time [s]") -> Path:
    """A vehicle east at 1 m/s, without noise, 20 m south of its leader; a message every second."""
    heads = "leader_east,leader_north,leader_heading_deg,leader_speed,leader_depth"
    rows = [f"{name},speed [m/s],heading_deg,depth [m],{heads},range_rear [m],range_front [m]"]
    slant = float(np.hypot(1.0, 20.0))
    for k, time in enumerate(times, start=1):
        heard = f"{STEP_S * k:.3f},0,90,1,8,{slant:.6f},{slant:.6f}" if k % 10 == 0 else ",,,,,,"
        rows.append(f"{time},1,90,8,{heard}")
    path = folder / "mine.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    return path


@pytest.mark.parametrize("begin_s", [0.1, 1000.47])
def test_estimates_of_a_table_are_at_its_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begin_s: float
) -> None:
    monkeypatch.chdir(tmp_path)
    times = [f"{begin_s + STEP_S * k:.2f}" for k in range(300)]
    command("log", "import", table(tmp_path, times), "--out", "a.mcap")
    text = scenario(tmp_path).read_text(encoding="utf-8").replace("alpha", "follower", 1)
    (tmp_path / "one.toml").write_text(text.partition('\n[[followers]]\nname = "beta"')[0])
    command("replay", "a.mcap", "--scenario", "one.toml", "--out", "a.csv")
    actual = columns(tmp_path / "a.csv", "time_s")[:, 0]
    assert actual.tolist() == [float(time) for time in times]
    # the same as those of the log's other tables
    command("log", "export", "a.mcap", "tables", "--format", "csv")
    assert columns(tmp_path / "tables" / "follower_motion.csv", "time_s")[:, 0].tolist() == [
        float(time) for time in times
    ]


def test_dates_count_from_the_first_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    times = [f"2024-05-01T00:{k // 600:02d}:{k % 600 / 10:04.1f}" for k in range(700)]
    command("log", "import", table(tmp_path, times, "time"), "--out", "a.mcap")
    text = scenario(tmp_path).read_text(encoding="utf-8").replace("alpha", "follower", 1)
    (tmp_path / "one.toml").write_text(text.partition('\n[[followers]]\nname = "beta"')[0])
    command("replay", "a.mcap", "--scenario", "one.toml", "--out", "a.csv")
    np.testing.assert_array_equal(
        columns(tmp_path / "a.csv", "time_s")[:, 0], [k / 10 for k in range(700)]
    )


def two_vehicles(path: Path, start_ns: int) -> None:
    """Both without noise; beta's log begins later."""
    slant = {name: float(np.hypot(1.0, north)) for name, north in NORTH_M.items()}
    with path.open("wb") as stream, Writer(stream) as writer:
        for k in range(1, 601):
            time_s = STEP_S * k
            time_ns = start_ns + round(1e9 * time_s)
            for name in NORTH_M:
                if name == "beta" and time_s < LATE_S:
                    continue
                own = OWN_MOTION.message_class(speed=1.0, heading=np.pi / 2, depth=8.0)
                writer.write_message(f"/{name}/motion", own, time_ns, time_ns)
                if k % 10 == 0:
                    heard = RECEPTION.message_class(
                        leader_timestamp=time_s,
                        leader_east=time_s,
                        leader_north=0.0,
                        leader_heading=np.pi / 2,
                        leader_speed=1.0,
                        leader_depth=8.0,
                        range_rear=slant[name],
                        range_front=slant[name],
                    )
                    writer.write_message(f"/{name}/reception", heard, time_ns, time_ns)


@pytest.mark.parametrize(
    ("start_ns", "first_s"), [(0, STEP_S), (1_700_000_000_000_000_000, 0.0)], ids=["own", "date"]
)
def test_vehicles_of_a_log_have_one_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, start_ns: int, first_s: float
) -> None:
    """At equal times both are as far apart as they swam."""
    monkeypatch.chdir(tmp_path)
    two_vehicles(tmp_path / "two.mcap", start_ns)
    words = ("--scenario", scenario(tmp_path), "--variant", "laisn-2", "--out", "two.csv")
    command("replay", "two.mcap", *words)
    with (tmp_path / "two.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    place = {(row["follower"], float(row["time_s"])): float(row["x_m"]) for row in rows}
    both = sorted(t for name, t in place if name == "beta")
    assert min(t for _, t in place) == first_s
    assert both[0] == pytest.approx(LATE_S - STEP_S + first_s)
    apart = [place["beta", t] - place["alpha", t] for t in both if t > LATE_S + 5.0]
    np.testing.assert_allclose(apart, 0.0, atol=0.2)


@pytest.mark.system
def test_estimates_merged_with_the_exported_path_have_the_printed_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log = ("--out", "plaza.mcap", "--beacons", "1,6")
    command("log", "import", PLAZA / "Plaza2.mat", *log)
    printed = command("replay", "plaza.mcap", "--variant", "tight", "--out", "e.csv")
    (line,) = (line for line in printed.splitlines() if line.startswith("tight, in air"))
    printed_mean, printed_rms = map(float, line.removeprefix("tight, in air").split()[:2])
    command("log", "export", "plaza.mcap", "tables", "--format", "csv")
    path = columns(
        tmp_path / "tables" / "vehicle_pose.csv", "time_s", "pose.position.x", "pose.position.y"
    )
    time, *estimated = columns(tmp_path / "e.csv", "time_s", "x_m", "y_m").T
    path = path[(path[:, 0] >= time[0]) & (path[:, 0] <= time[-1])]
    errors = np.hypot(
        *(np.interp(path[:, 0], time, estimated[k]) - path[:, k + 1] for k in range(2))
    )
    # printed with two decimals
    assert np.mean(errors) == pytest.approx(printed_mean, abs=0.0051)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(printed_rms, abs=0.0051)
