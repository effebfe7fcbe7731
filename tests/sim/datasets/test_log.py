"""Data sets of others: reading their files, and converting them to a log."""

import math
import struct
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat, savemat
from typer.testing import CliRunner

from experiments.beacon_replay import BeaconReplaySettings, _settings, navigate_among_beacons, score
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.datasets import range_data
from sim.datasets.log import (
    _times_and_transmitters,
    is_data_set,
    read_data_set,
    read_data_set_log,
    write_data_set,
)
from sim.datasets.range_data import RangeData
from sim.log.contents import LogError, recover
from tests.sim.log.damage import Parts

PLAZA = Path(__file__).resolve().parents[2] / "data" / "plaza"
NOISE = "0.01 0 0 0.01 0 0.0001"
GRAPH = f"""\
VERTEX_SE2 10.0 A0 1.0 2.0 0.0
VERTEX_SE2 11.0 A1 3.0 2.0 1.5707963267948966
VERTEX_SE2 13.0 A2 3.0 6.0 1.5707963267948966
VERTEX_SE2 10.0 B0 0.0 0.0 0.0

# a comment
VERTEX_XY L0 20.0 0.0
VERTEX_XY L1 0.0 30.0
VERTEX_SE2:PRIOR 10.0 A0 1.5 2.5 0.1 {NOISE}
VERTEX_XY:PRIOR 10.0 L1 0.5 30.5 0.01 0 0.01
EDGE_SE2 11.0 A0 A1 2.0 0.0 1.5707963267948966 {NOISE}
EDGE_SE2 13.0 A1 A2 4.0 0.5 0.0 {NOISE}
EDGE_SE2 13.0 A0 A2 4.0 2.0 1.57 {NOISE}
EDGE_SE2_XY 11.0 A1 L0 3.0 4.0 0.01 0 0.01
EDGE_RANGE 12.5 A2 L1 24.0 0.25
EDGE_RANGE 11.2 L0 A1 17.0 0.09
EDGE_RANGE 99.0 A2 L0 18.0 0.16
EDGE_RANGE 10.5 A0 B0 2.0 0.01
EDGE_RANGE 10.5 A0 L7 2.0 0.01
"""


def graph(folder: Path, text: str = GRAPH) -> Path:
    path = folder / "graph.pyfg"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_factor_graph_is_read_as_it_is_written(tmp_path: Path) -> None:
    data = read_data_set(graph(tmp_path))
    # the prior is the start; anticlockwise from east becomes clockwise from north
    np.testing.assert_allclose(data.start, [1.5, 2.5, math.pi / 2 - 0.1])
    assert data.time.tolist() == [10.0, 11.0, 13.0]
    np.testing.assert_allclose(data.odometry, [[2.0, 0.0, math.pi / 2], [4.0, 0.5, 0.0]])
    assert data.beacons == ("L0", "L1")
    assert data.places.tolist() == [[20.0, 0.0], [0.5, 30.5]]
    # the range of A2 at 99.0 s is not near its pose, and takes the pose's time, 13.0 s
    assert data.range_time.tolist() == [11.2, 12.5, 13.0]
    assert data.range_beacon.tolist() == [0, 1, 0]
    assert data.ranges.tolist() == [17.0, 24.0, 18.0]
    assert data.stated["range_sigma"] == pytest.approx(0.4)
    assert data.truth.tolist() == [[10.0, 1.0, 2.0], [11.0, 3.0, 2.0], [13.0, 3.0, 6.0]]
    assert data.remarks == (
        "of several robots A is taken; left out: B",
        "edges left out that are no steps of odometry: 1",
        "the path to compare with is that of the vertices, which may be the file's own estimate",
        "ranges left out that are not to a beacon of known place: 2",
    )
    # 0.01 m² in 1 s and in 2 s, along either axis; 1e-4 rad²
    assert data.stated["slip"] == pytest.approx(math.sqrt(0.0075))
    assert data.stated["heading_walk"] == pytest.approx(math.sqrt(0.75e-4))


def test_times_in_nanoseconds_are_read_in_seconds(tmp_path: Path) -> None:
    """As a clock counts them that began in 1970; poses and ranges alike."""
    lines = [line.split() for line in GRAPH.splitlines()]
    timed_lines = [words for words in lines if words and words[0] not in ("VERTEX_XY", "#")]
    for words in timed_lines:
        words[1] = f"{1_600_000_000 + float(words[1]):.1f}".replace(".", "") + "00000000"
    data = read_data_set(graph(tmp_path, "\n".join(" ".join(words) for words in lines)))
    np.testing.assert_allclose(data.time - 1.6e9, [10.0, 11.0, 13.0], rtol=0, atol=1e-6)
    np.testing.assert_allclose(data.range_time - 1.6e9, [11.2, 12.5, 13.0], rtol=0, atol=1e-6)
    assert data.stated["slip"] == pytest.approx(math.sqrt(0.0075), rel=1e-6)


def test_ranges_before_time_zero_keep_their_times() -> None:
    """Poses begin at 0 s or later, ranges when they may; the second to a beacon at one time is a
    microsecond later.
    """
    data = RangeData(
        source="early",
        start=np.zeros(3),
        time=np.arange(4.0),
        odometry=np.tile([1.0, 0.0, 0.0], (3, 1)),
        beacons=("a", "b"),
        places=np.array([[10.0, 0.0], [0.0, 10.0]]),
        range_time=np.array([-5.0, -3.0, -3.0, -3.0, 1.5]),
        range_beacon=np.array([0, 0, 1, 1, 1]),
        ranges=np.full(5, 10.0),
        truth=np.empty((0, 3)),
    )
    times, transmitters = _times_and_transmitters(data)
    assert times.tolist() == [-5.0, -3.0, -3.0, -3.0 + 1e-6, 1.5]
    assert transmitters.tolist() == [0, 0, 1, 1, 1]


def test_milliseconds_taken_for_seconds_are_doubted(tmp_path: Path) -> None:
    """6.5 m in 3 s are a vehicle's way, in 3000 s they are not."""
    lines = [line.split() for line in GRAPH.splitlines()]
    for words in lines:
        if words and words[0] not in ("VERTEX_XY", "#"):
            words[1] = str(1000 * float(words[1]))
    text = "\n".join(" ".join(words) for words in lines)
    assert not [remark for remark in read_data_set(graph(tmp_path)).remarks if "seconds" in remark]
    assert (
        read_data_set(graph(tmp_path, text)).remarks[-1]
        == "a way of 6 m in 3000 s, 0.002 m/s: are the times in seconds?"
    )


def test_poses_of_one_time_are_joined(tmp_path: Path) -> None:
    """A1 is at the time of A0 or of A2: the path ends where it did with one step less. The range
    from A1, of 11.2 s, keeps its time if that is between the poses beside it, and is else dated by
    its pose.
    """
    for pose_time, range_time in (("10.0", "11.2"), ("13.0", "13.0")):
        text = GRAPH.replace("VERTEX_SE2 11.0 A1", f"VERTEX_SE2 {pose_time} A1") + (
            f"VERTEX_SE2 15.0 A3 3.0 9.0 1.57\nEDGE_SE2 15.0 A2 A3 1.0 0.0 0.2 {NOISE}\n"
        )
        data = read_data_set(graph(tmp_path, text))
        assert data.time.tolist() == [10.0, 13.0, 15.0]
        assert data.truth[:, 0].tolist() == [10.0, 13.0, 15.0]
        position, direction = 0j, 1.0 + 0j
        for ahead, port, rotation in data.odometry:
            position, direction = (
                position + direction * complex(ahead, port),
                direction * np.exp(1j * rotation),
            )
        # 2 m ahead, a quarter turn to port, then 4 m and ½ m to port, and 1 m more
        end = 2.0 + 1j * complex(4.0, 0.5) + 1j
        assert position == pytest.approx(end, abs=1e-9)
        assert range_time in [str(t) for t in data.range_time.tolist()]
        assert "poses at the time of the one before, joined to it: 1" in data.remarks


def test_vertices_composed_of_the_odometry_are_no_path_to_compare_with(tmp_path: Path) -> None:
    data = read_data_set(graph(tmp_path, GRAPH.replace("A2 3.0 6.0", "A2 2.5 6.0")))
    assert data.truth.shape == (0, 3)
    assert "vertices are composed of the odometry: there is no path to compare with" in data.remarks


def test_what_a_graph_states_of_its_noise_is_navigated_by_unless_a_user_sets_it(
    tmp_path: Path,
) -> None:
    """Standard deviations are the roots of the variances in the text, for steps of 1 s."""
    steps = [
        f"EDGE_SE2 {k}.0 A{k - 1} A{k} 1.0 0.0 0.0 0.0004 0 0 0.0004 0 0.000009"
        for k in range(1, 21)
    ]
    poses = [f"VERTEX_SE2 {k}.0 A{k} {k}.0 {0.1 * k} 0.0" for k in range(21)]
    text = "\n".join([*poses, *steps, "VERTEX_XY L0 20.0 9.0", "EDGE_RANGE 5.0 A5 L0 17.0 0.09"])
    write_data_set(read_data_set(graph(tmp_path, text)), tmp_path / "a.mcap")
    recorded = read_data_set_log(tmp_path / "a.mcap")
    settings = _settings(recorded, BeaconReplaySettings(), "water")
    assert (settings.range_sigma, settings.slip, settings.heading_walk) == pytest.approx(
        (0.3, 0.02, 0.003)
    )
    settings = _settings(
        recorded, BeaconReplaySettings(slip_m_sqrt_s=0.07, heading_walk_deg_sqrt_s=2.0), "water"
    )
    assert (settings.slip, settings.heading_walk) == pytest.approx((0.07, math.radians(2.0)))


@pytest.mark.parametrize(
    ("pose", "time", "time_used"),
    [
        ("A0", 9.5, 10.0),
        ("A0", 10.4, 10.4),
        ("A0", 11.0, 10.0),
        ("A1", 9.5, 11.0),
        ("A1", 10.4, 10.4),
        ("A1", 12.9, 12.9),
        ("A1", 13.0, 11.0),
        ("A2", 10.5, 13.0),
        ("A2", 11.5, 11.5),
        ("A2", 13.5, 13.0),
    ],
)
def test_the_time_of_a_range_is_used_between_its_neighbouring_poses(
    tmp_path: Path, pose: str, time: float, time_used: float
) -> None:
    text = "\n".join(line for line in GRAPH.splitlines() if not line.startswith("EDGE_RANGE"))
    data = read_data_set(graph(tmp_path, f"{text}\nEDGE_RANGE {time} {pose} L1 24.0 0.25\n"))
    assert data.range_time.tolist() == [time_used]


def test_a_graph_without_times_goes_by_the_second(tmp_path: Path) -> None:
    text = GRAPH.replace("VERTEX_SE2 11.0", "VERTEX_SE2 10.0").replace(
        "VERTEX_SE2 13.0", "VERTEX_SE2 10.0"
    )
    data = read_data_set(graph(tmp_path, text))
    assert data.time.tolist() == [0.0, 1.0, 2.0]
    assert "poses are taken to be a second apart" in data.remarks[1]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "VERTEX_XY L0 20.0",
            "VERTEX_XYZ L0 20.0",
            "line 7: 'VERTEX_XYZ' is no kind of line of a planar graph",
        ),
        (
            "VERTEX_SE2 10.0 A0",
            "VERTEX_SE3:QUAT 10.0 A0",
            "line 1: 'VERTEX_SE3:QUAT' is no kind of line",
        ),
        (
            "EDGE_RANGE 12.5",
            "EDGE_SONAR 12.5",
            "'EDGE_SONAR' is no kind of line of a planar graph; known: VERTEX_SE2, ",
        ),
        ("24.0 0.25", "24.0", "line 15: EDGE_RANGE with 5 words, expected 6"),
        ("24.0 0.25", "far 0.25", "line 15: EDGE_RANGE: 'far' is no number"),
        ("24.0 0.25", "nan 0.25", "line 15: EDGE_RANGE holds a number that is not finite"),
        ("EDGE_SE2 13.0 A1 A2 4.0", "EDGE_SE2 13.0 A2 A1 4.0", "no odometry .* from A1 to A2"),
        (
            "VERTEX_SE2 13.0 A2",
            "VERTEX_SE2 10.5 A2",
            "from 11.000000 s to 10.500000 s between poses 1 and 2",
        ),
        ("VERTEX_SE2 11.0 A1", "VERTEX_SE2 11.0 A0", "VERTEX_SE2 A0 is given twice"),
        ("VERTEX_XY L1", "VERTEX_XY L0", "VERTEX_XY L0 is given twice"),
        (
            "VERTEX_SE2:PRIOR",
            "VERTEX_XY:PRIOR 10.0 L1 9 9 0.01 0 0.01\nVERTEX_SE2:PRIOR",
            "VERTEX_XY:PRIOR L1 is given twice",
        ),
        (
            "EDGE_SE2 13.0 A0 A2",
            "EDGE_SE2 13.0 A1 A2",
            r"odometry \(EDGE_SE2\) from A1 to A2 is given twice",
        ),
        ("24.0 0.25", "1e300 0.25", r"line 15: EDGE_RANGE: 1e\+300 is not within"),
        ("24.0 0.25", "24.0 1e300", r"line 15: EDGE_RANGE: 1e\+300 is not within"),
        ("A2", "A²", "2 poses; odometry needs three"),
        ("VERTEX_SE2", "VERTEX_XY:PRIOR", "expected 8"),
    ],
)
def test_errors_of_a_graph_are_reported(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GRAPH
    with pytest.raises(LaisnError, match=words):
        read_data_set(graph(tmp_path, GRAPH.replace(old, new)))


@pytest.mark.parametrize("element_type", [19, 50, 100, 255, 1000, 70_000])
def test_a_file_that_crashes_the_library_is_damaged(tmp_path: Path, element_type: int) -> None:
    """SciPy reads beyond its table of types where an element of a file has an unknown type, and
    most often crashes.
    """
    path = tmp_path / "a.mat"
    savemat(path, {"DR": np.ones((4, 3))})
    path.write_bytes(
        path.read_bytes().replace(struct.pack("<II", 9, 96), struct.pack("<II", element_type, 96))
    )
    with pytest.raises(LaisnError, match=r"a\.mat: no MATLAB file of version 5, or damaged: "):
        read_data_set(path)


def test_errors_of_files_are_reported(tmp_path: Path) -> None:
    (tmp_path / "broken.mat").write_bytes(b"no matrix")
    (tmp_path / "binary.pyfg").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "empty.pyfg").write_text("")
    (tmp_path / "graph.json").write_text("{}")
    (tmp_path / "lonely_DR.txt").write_text("1 2 3\n2 3 4\n")
    for table, rows in (("DR", "1 2 3"), ("TL", "1 0 0"), ("TD", "1 0 1 5\n2 0 nan 5")):
        (tmp_path / f"odd_{table}.txt").write_text(f"{rows}\n")
    for name, words in (
        ("missing.pyfg", "No such file"),
        ("missing", "No such file"),
        ("graph.json", r"should end in \.csv .*, \.pyfg .*a \.mat or a _DR\.txt .*a ROS 2 bag"),
        ("broken.mat", "no MATLAB file"),
        ("binary.pyfg", "cannot be read: not UTF-8 text"),
        ("empty.pyfg", "no planar pose"),
        ("notes.txt", "name the table of odometry, such as Plaza1_DR.txt"),
        ("lonely_DR.txt", "lacks TD, TL; it has DR"),
        ("odd_DR.txt", "table TD, row 2: expected numbers within"),
    ):
        with pytest.raises(LaisnError, match=words):
            read_data_set(tmp_path / name)


@pytest.mark.parametrize(
    ("table", "row", "column", "value", "words"),
    [
        ("TL", 0, 0, 1.7, "table TL, row 1: .*whole ones for nodes"),
        ("TD", 2, 2, 1.5, "table TD, row 3: .*whole ones for nodes"),
        ("TL", 1, 0, 1.0, "table TL: node 1 is given twice"),
        ("TD", 1, 3, 1e300, "table TD, row 2: expected numbers within"),
        ("DR", 1, 1, math.nan, "table DR, row 2: expected numbers within"),
    ],
)
def test_errors_of_tables_are_reported(
    tmp_path: Path, table: str, row: int, column: int, value: float, words: str
) -> None:
    tables = {
        name: array
        for name, array in loadmat(PLAZA / "Plaza2.mat").items()
        if not name.startswith("_")
    }
    assert tables["TL"][0, 0] == 1
    tables[table][row, column] = value
    savemat(tmp_path / "odd.mat", tables)
    with pytest.raises(LaisnError, match=words):
        read_data_set(tmp_path / "odd.mat")


def test_a_small_file_of_large_tables_is_refused_before_they_are_read(tmp_path: Path) -> None:
    """Compressed zeros: 12 MB of bytes as 12 kB; other variables of a file are not read at all."""
    tables = {
        name: array
        for name, array in loadmat(PLAZA / "Plaza2.mat").items()
        if not name.startswith("_")
    }
    zeros = np.zeros((3_000_000, 4), dtype=np.int8)
    savemat(tmp_path / "bomb.mat", tables | {"GT": zeros}, do_compression=True)
    savemat(tmp_path / "more.mat", tables | {"map": zeros}, do_compression=True)
    assert (tmp_path / "bomb.mat").stat().st_size < 1_000_000
    with pytest.raises(
        LaisnError, match=r"bomb\.mat: its tables have 12,.* numbers, at most 10,000,000"
    ):
        read_data_set(tmp_path / "bomb.mat")
    assert (
        read_data_set(tmp_path / "more.mat").ranges.size
        == read_data_set(PLAZA / "Plaza2.mat").ranges.size
    )


def test_text_beyond_the_bounds_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, rows in (("DR", 300), ("TD", 300), ("TL", 3)):
        np.savetxt(tmp_path / f"many_{name}.txt", np.ones((rows, 4 if name == "TD" else 3)))
    monkeypatch.setattr(range_data, "_LARGEST_BYTES", 7000)
    with pytest.raises(
        LaisnError, match=r"many_DR\.txt: cannot be read: it has \d+ bytes, there may be 7000"
    ):
        read_data_set(tmp_path / "many_DR.txt")
    monkeypatch.setattr(range_data, "_LARGEST_BYTES", 500)
    with pytest.raises(
        LaisnError, match=r"graph\.pyfg: cannot be read: it has \d+ bytes, there may be 500"
    ):
        read_data_set(graph(tmp_path))


def graph_of_ranges(folder: Path, count: int) -> Path:
    lines = [
        f"EDGE_RANGE {10 + k * 3e-4:.4f} A{k % 3} L0 {17 + k * 1e-4:.4f} 0.09" for k in range(count)
    ]
    return graph(folder, GRAPH + "\n".join(lines))


def tables_of_ranges(folder: Path, count: int) -> Path:
    random = np.random.default_rng(1)
    ranges = [
        np.linspace(1, 9, count),
        np.zeros(count),
        random.integers(1, 3, count),
        random.uniform(9, 99, count),
    ]
    steps = np.column_stack([np.arange(1.0, 11.0), np.ones(10), np.zeros(10)])
    nodes = [[1, 0, 0], [2, 50, 9]]
    for name, table in {
        "DR": steps,
        "TL": nodes,
        "DRp": [[0, 0, 0, 0]],
        "TD": np.column_stack(ranges),
    }.items():
        np.savetxt(folder / f"many_{name}.txt", table)
    return folder / "many_DR.txt"


@pytest.mark.parametrize("write", [graph_of_ranges, tables_of_ranges])
def test_a_million_ranges_are_imported_in_1500_megabytes(
    tmp_path: Path, write: Callable[[Path, int], Path]
) -> None:
    """5,000 ranges take less than 1500 bytes each, after what is loaded once."""
    write_data_set(read_data_set(write(tmp_path, 9)), tmp_path / "a.mcap")
    path = write(tmp_path, 5000)
    tracemalloc.start()
    try:
        data = read_data_set(path)
        write_data_set(data, tmp_path / "a.mcap")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert data.ranges.size >= 5000
    assert peak < 5000 * 1500


@pytest.mark.parametrize("mark", ["\ufeff", ""])
def test_a_mark_of_the_byte_order_is_taken(tmp_path: Path, mark: str) -> None:
    assert read_data_set(graph(tmp_path, mark + GRAPH)).time.tolist() == [10.0, 11.0, 13.0]


def test_ranges_that_are_not_positive_are_left_out_with_a_remark(tmp_path: Path) -> None:
    data = read_data_set(graph(tmp_path, GRAPH.replace("A2 L1 24.0", "A2 L1 -24.0")))
    assert data.ranges.tolist() == [17.0, 18.0]
    assert "ranges left out that are not positive: 1" in data.remarks


@pytest.mark.parametrize("suffix", ["txt", "csv"])
def test_tables_in_text_are_those_of_the_matlab_file(tmp_path: Path, suffix: str) -> None:
    for name, table in loadmat(PLAZA / "Plaza2.mat").items():
        if not name.startswith("_"):
            np.savetxt(
                tmp_path / f"Plaza2_{name}.{suffix}",
                table,
                "%.17g",
                "," if suffix == "csv" else " ",
                encoding="utf-8-sig",
            )
    text, matlab = (
        read_data_set(tmp_path / f"Plaza2_DR.{suffix}"),
        read_data_set(PLAZA / "Plaza2.mat"),
    )
    for name in (
        "start",
        "time",
        "odometry",
        "places",
        "range_time",
        "range_beacon",
        "ranges",
        "truth",
    ):
        assert getattr(text, name).tolist() == getattr(matlab, name).tolist()


@pytest.mark.parametrize("name", ["Plaza1", "Plaza2"])
def test_dead_reckoning_on_the_log_is_that_of_the_data_set(tmp_path: Path, name: str) -> None:
    """From the first row of the published path by odometry (DRp) on, steps of the table of odometry
    (DR) are composed as complex numbers.
    """
    tables = loadmat(PLAZA / f"{name}.mat")
    position, direction = complex(*tables["DRp"][0, 1:3]), tables["DRp"][0, 3]
    for _, step_length, rotation in tables["DR"]:
        position, direction = position + step_length * np.exp(1j * direction), direction + rotation
    data = read_data_set(PLAZA / f"{name}.mat")
    write_data_set(data, tmp_path / "a.mcap")
    measured = read_data_set_log(tmp_path / "a.mcap").measurements
    assert measured.durations is not None
    displacement = np.column_stack([np.sin(measured.heading), np.cos(measured.heading)]).T @ (
        measured.speed * measured.durations
    )
    np.testing.assert_allclose(
        data.start[:2] + displacement, [position.real, position.imag], atol=1e-5
    )
    assert measured.time[-1] - measured.dt == pytest.approx(
        tables["DR"][-1, 0] - tables["DRp"][0, 0], abs=1e-6
    )


def straight(**changes: object) -> RangeData:
    """Three steps north-east, with ranges to five beacons at 1.5 s and one more at 2 s."""
    base = RangeData(
        source="made",
        start=np.array([0.0, 0.0, math.pi / 4]),
        time=np.array([0.0, 1.0, 2.0, 3.0]),
        odometry=np.tile([1.0, 0.0, 0.0], (3, 1)),
        beacons=tuple("abcde"),
        places=np.arange(10.0).reshape(5, 2),
        range_time=np.array([1.5, 1.5, 1.5, 1.5, 1.5, 2.0]),
        range_beacon=np.array([0, 1, 2, 3, 4, 0]),
        ranges=np.array([10.0, 11.0, 12.0, 13.0, 14.0, 15.0]),
        stated={"range_sigma": 0.3},
        truth=np.empty((0, 3)),
    )
    return replace(base, **changes)  # type: ignore[arg-type]


def ranges_and_beacon_easts(path: Path) -> set[tuple[float, float]]:
    """Each range in a log with the east coordinate of its beacon, which tells beacons apart [m]."""
    measured = read_data_set_log(path).measurements
    assert measured.transmitters is not None
    return {
        (float(one_range), float(position[0]))
        for ranges, places in zip(measured.ranges, measured.transmitters, strict=True)
        for one_range, position in zip(ranges, places, strict=True)
        if np.isfinite(one_range)
    }


def test_no_range_is_lost_where_many_come_at_once(tmp_path: Path) -> None:
    write_data_set(straight(), tmp_path / "a.mcap")
    assert ranges_and_beacon_easts(tmp_path / "a.mcap") == {(10 + k, 2 * k) for k in range(5)} | {
        (15, 0)
    }
    twice = straight(range_beacon=np.array([0, 0, 1, 1, 1, 0])).with_beacons(["a", "b"])
    write_data_set(twice, tmp_path / "b.mcap")
    assert ranges_and_beacon_easts(tmp_path / "b.mcap") == {
        (10, 0),
        (11, 0),
        (12, 2),
        (13, 2),
        (14, 2),
        (15, 0),
    }
    assert not [
        remark for remark in read_data_set_log(tmp_path / "b.mcap").remarks if "left out" in remark
    ]


def test_two_beacons_are_the_ends_of_a_leader_at_rest(tmp_path: Path) -> None:
    write_data_set(straight().with_beacons(["d", "a"]), tmp_path / "a.mcap")
    recorded = read_data_set_log(tmp_path / "a.mcap")
    measured = recorded.measurements
    np.testing.assert_array_equal(measured.ranges, [[13.0, 10.0, np.nan], [np.nan, 15.0, np.nan]])
    assert measured.transmitters is not None
    assert measured.transmitters[0, :2].tolist() == [[6.0, 7.0, 0.0], [0.0, 1.0, 0.0]]
    # the range at 1.5 s has a step of its own, the first step ends where the data begin; the time
    # of the message is that at which it is received, from the beginning of the first step on
    assert measured.message[0].tolist()[:6] == [measured.time[2], 3.0, 4.0, 0.0, 0.0, 0.0]
    assert measured.time[2] - measured.time[0] == 1.5
    assert measured.durations is not None
    assert np.diff(measured.time).tolist() == pytest.approx([1.0, 0.5, 0.5, 1.0])
    assert measured.message_step.tolist() == [3, 4]
    assert measured.speed.tolist() == pytest.approx([0.0, 1.0, 1.0, 1.0, 1.0])
    assert recorded.stated == {"range_sigma": 0.3}
    assert recorded.start.tolist() == [0.0, 0.0, 0.0, 0.0]


ODOMETRY_STEP = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))


@given(
    st.lists(ODOMETRY_STEP, min_size=2, max_size=12),
    st.lists(st.floats(0.01, 1.99), min_size=1, max_size=5),
    ODOMETRY_STEP,
)
def test_legs_end_where_poses_composed_one_after_the_other_do(
    steps: list[tuple[float, float, float]], times: list[float], start: tuple[float, float, float]
) -> None:
    """Forwards, backwards and sideways, with any ranges in between; poses are complex numbers
    here.
    """
    data = straight(
        start=np.array(start),
        time=np.arange(len(steps) + 1.0),
        odometry=np.array(steps),
        range_time=np.sort(times),
        range_beacon=np.zeros(len(times), dtype=np.int64),
        ranges=np.full(len(times), 5.0),
    )
    position, direction = complex(start[0], start[1]), np.exp(1j * (math.pi / 2 - start[2]))
    for ahead, port, rotation in steps:
        position, direction = (
            position + direction * complex(ahead, port),
            direction * np.exp(1j * rotation),
        )
    leg_ends, speed, heading = data.legs()
    durations: Floats = np.diff(np.concatenate([[0.0], leg_ends]))
    displacement = np.column_stack([np.sin(heading), np.cos(heading)]).T @ (durations * speed)
    np.testing.assert_allclose(displacement + start[:2], [position.real, position.imag], atol=1e-9)
    assert leg_ends[-1] == len(steps)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"time": np.array([0.0, 1.0, 1.0, 3.0])},
            "from 1.000000 s to 1.000000 s between poses 1 and 2",
        ),
        ({"time": np.array([-5.0, 1.0, 2.0, 3.0])}, "times begin at -5 s, expected 0 s or later"),
        ({"ranges": np.full(6, np.inf)}, "ranges must be finite and within"),
        (
            {"ranges": np.empty(0), "range_time": np.empty(0), "range_beacon": np.empty(0)},
            "holds no range",
        ),
        (
            {"time": np.array([0.0, 1.0]), "odometry": np.ones((1, 3))},
            "2 poses; odometry needs three",
        ),
    ],
)
def test_data_that_make_no_mission_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(LaisnError, match=words):
        straight(**changes)


def test_a_damaged_log_is_refused_and_recovered_with_a_remark(tmp_path: Path) -> None:
    data = straight(
        time=np.arange(41.0),
        odometry=np.tile([1.0, 0.0, 0.0], (40, 1)),
        range_time=np.arange(1.5, 37.5, 6.0),
    )
    log = tmp_path / "a.mcap"
    write_data_set(data, log)
    log_bytes, original = log.read_bytes(), read_data_set_log(log)

    with_another_start = log_bytes.replace(
        b"start_east\x03\0\0\0000.0", b"start_east\x03\0\0\0009.0"
    )
    assert with_another_start != log_bytes
    log.write_bytes(with_another_start)
    with pytest.raises(LogError, match="the checksum of the data section"):
        read_data_set_log(log)
    # the end of the data section is cut off, with the checksum that covers the metadata
    log.write_bytes(log_bytes[: int.from_bytes(log_bytes[-28:-20], "little") - 5])
    printed: list[str] = []
    rescued = read_data_set_log(recover(log, printed.append))
    assert printed[0] == "metadata data set: no checksum, damage cannot be detected"
    np.testing.assert_array_equal(rescued.measurements.ranges, original.measurements.ranges)
    np.testing.assert_array_equal(rescued.start, original.start)


def test_a_log_that_another_program_rewrote_is_read_as_it_is(tmp_path: Path) -> None:
    data, log = straight(), tmp_path / "a.mcap"
    write_data_set(data, log)
    original = read_data_set_log(log)
    log.write_bytes(Parts.of(log.read_bytes()).written())
    again = read_data_set_log(log)
    np.testing.assert_array_equal(again.measurements.ranges, original.measurements.ranges)
    np.testing.assert_array_equal(again.measurements.speed, original.measurements.speed)
    assert again.remarks == original.remarks


def run(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"})
    assert result.exit_code in (0, 2), result.output
    return str(result.output)


@pytest.mark.system
def test_the_command_imports_and_replays(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    printed = run("log", "import", PLAZA / "Plaza2.mat", "--out", log, "--beacons", "1,6")
    assert "beacon 6 at -37.58 m east, 69.23 m north: 432 ranges" in printed
    assert is_data_set(log)
    printed = run("replay", log, "--variant", "tight", "--out", tmp_path / "e.csv")
    assert "mean error [m]" in printed
    assert "tight, in air" in printed
    lines = (tmp_path / "e.csv").read_text().splitlines()
    assert lines[0] == "follower,time_s,x_m,y_m,vx_m_s,vy_m_s,xx_m2,xy_m2,yy_m2"
    assert len(lines) == 1 + read_data_set_log(log).measurements.speed.size
    assert "laisn-2" in run("replay", log)


def test_the_command_names_what_it_cannot_do(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    assert "no beacon 9; available: 1, 6, 0, 5" in run(
        "log", "import", PLAZA / "Plaza2.mat", "--out", log, "--beacons", "9"
    )
    assert "ends in .mcap" in run(
        "log", "import", PLAZA / "Plaza2.mat", "--out", tmp_path / "a.log"
    )
    write_data_set(straight(), log)
    tight = ("replay", log, "--variant", "tight", "--set")
    assert "beacons.slip: Extra inputs are not permitted; known: medium, " in run(
        *tight, "beacons.slip=1"
    )
    assert "Input should be 'auto', 'air' or 'water'" in run(*tight, "beacons.medium=mud")
    assert "expected beacons.… for the variant tight" in run(*tight, "navigation.threshold_m=1")
    assert "expected beacons.… for the variant tight" in run(*tight, "sensors.speed_bias_m_s=1")
    assert "expected navigation.… for the variant laisn-2" in run(
        "replay", log, "--set", "beacons.medium=air"
    )
    with pytest.raises(LogError, match="no log of a data set"):
        read_log_of_a_simulation(tmp_path)


def read_log_of_a_simulation(folder: Path) -> None:
    from tests.sim.log.test_reader_replay import motion_at, reception_at, write_messages

    read_data_set_log(
        write_messages(folder / "b.mcap", motion_at(0.1 * np.arange(30)), [reception_at(1.0)])
    )


def test_ranges_to_another_robot_are_to_where_its_odometry_puts_it(tmp_path: Path) -> None:
    """B goes north from (50, 10) at 0.2 m/s, A east from the origin at 1 m/s; ranges are exact.

    The replay stays within 2 m of A's true place although its odometry is 10 % too fast.
    """
    noise = "0.01 0 0 0.01 0 0.0001"
    poses = 120
    lines = []
    for k in range(poses):
        lines.append(f"VERTEX_SE2 {k}.0 A{k} {k}.0 0.0 0.0")
        lines.append(f"VERTEX_SE2 {k}.0 B{k} 0.0 0.0 0.0")
        if k:
            lines.append(f"EDGE_SE2 {k}.0 A{k - 1} A{k} 1.1 0.0 0.0 {noise}")
            lines.append(f"EDGE_SE2 {k}.0 B{k - 1} B{k} 0.2 0.0 0.0 {noise}")
            distance = math.hypot(50.0 - k, 10.0 + 0.2 * k)
            names = f"A{k} B{k}" if k % 2 else f"B{k} A{k}"
            lines.append(f"EDGE_RANGE {k}.0 {names} {distance} 0.01")
    lines.append(f"VERTEX_SE2:PRIOR 0.0 B0 50.0 10.0 {math.pi / 2} {noise}")
    lines.append("VERTEX_SE2 120.0 A120 120.0 0.0 0.0")
    lines.append(f"EDGE_SE2 120.0 A119 A120 1.1 0.0 0.0 {noise}")
    data = read_data_set(graph(tmp_path, "\n".join(lines)))
    assert data.beacons == data.moving == ("B",)
    assert any(
        "its ranges to B are to the path that B's odometry gives" in line for line in data.remarks
    )
    assert data.ranges.size == poses - 1
    expected = [[50.0, 10.0 + 0.2 * k, 0.0, 0.2] for k in range(1, poses)]
    np.testing.assert_allclose(data.range_track, expected, atol=1e-9)
    write_data_set(data, tmp_path / "a.mcap")
    recorded = read_data_set_log(tmp_path / "a.mcap")
    message = recorded.measurements.message
    np.testing.assert_allclose(message[:, 1:5], expected, atol=1e-9)
    assert recorded.measurements.transmitters is not None
    np.testing.assert_allclose(
        recorded.measurements.transmitters[:, 0, :2], np.array(expected)[:, :2], atol=1e-9
    )
    # 10 % are three times the default standard deviation of the odometry's scale
    estimates, _ = navigate_among_beacons(
        recorded, BeaconReplaySettings(medium="air", speed_scale_sigma=0.1)
    )
    true_east = recorded.measurements.time - recorded.measurements.time[0]
    east_error = estimates.state[:poses, 0] - true_east[:poses]
    # dead reckoning is 12 m off at the end
    assert abs(east_error[100:poses]).max() < 2.0


def test_the_command_replays_ranges_to_several_robots_and_a_landmark(tmp_path: Path) -> None:
    """A goes east at 1 m/s past the landmark, three robots north at other speeds; all ranges of a
    second come at once, and they are exact. A's odometry is 5 % too fast. The estimate is within
    0.5 m of A's true place from 20 s on.
    """
    noise = "0.01 0 0 0.01 0 0.0001"
    robots = {"B": (30.0, 10.0, 0.3), "C": (60.0, -31.0, 0.5), "D": (90.0, 20.0, 0.2)}
    poses = 121
    lines = ["VERTEX_XY L0 50.0 -20.0"]
    for name, (east, north, _) in robots.items():
        lines.append(f"VERTEX_SE2:PRIOR 0.0 {name}0 {east} {north} {math.pi / 2} {noise}")
    for k in range(poses):
        lines.append(f"VERTEX_SE2 {k}.0 A{k} {k}.0 0.0 0.0")
        lines += [f"VERTEX_SE2 {k}.0 {name}{k} 0.0 0.0 0.0" for name in robots if k < poses - 1]
        if k == 0:
            continue
        lines.append(f"EDGE_SE2 {k}.0 A{k - 1} A{k} 1.05 0.0 0.0 {noise}")
        if k == poses - 1:
            break
        lines.append(f"EDGE_RANGE {k}.0 A{k} L0 {math.hypot(50.0 - k, 20.0)} 0.01")
        for name, (east, north, speed) in robots.items():
            lines.append(f"EDGE_SE2 {k}.0 {name}{k - 1} {name}{k} {speed} 0.0 0.0 {noise}")
            distance = math.hypot(east - k, north + speed * k)
            lines.append(f"EDGE_RANGE {k}.0 A{k} {name}{k} {distance} 0.01")
    source = graph(tmp_path, "\n".join(lines))
    log = tmp_path / "a.mcap"
    run("log", "import", source, "--out", log)
    estimates_path = tmp_path / "e.csv"
    # four errors of beacons, not one for each place; the ranges of a robot keep its own
    printed = run("replay", log, "--variant", "tight", "--out", estimates_path)
    assert "mean error [m]" in printed
    table = np.loadtxt(estimates_path, delimiter=",", skiprows=1, usecols=(1, 2, 3))
    settled = table[table[:, 0] > table[0, 0] + 20.0]
    error = np.hypot(settled[:, 1] - (settled[:, 0] - table[0, 0]), settled[:, 2])
    assert error[:-2].max() < 0.5
    recorded = read_data_set_log(log).measurements
    assert recorded.transmitters is not None
    for name, (east, north, speed) in robots.items():
        # each robot's ranges come with a message that is its own
        messages_of_robot = np.flatnonzero(
            np.isclose(recorded.message[:, 1], east, rtol=0.0, atol=1e-6)
        )
        assert messages_of_robot.size == poses - 2, name
        np.testing.assert_allclose(recorded.message[messages_of_robot, 4], speed, atol=1e-9)
        assert recorded.message[messages_of_robot, 2].min() > north


COVARIANCE_OF_STEP = "0.0009 0 0 0.0009 0 0.0004"
"""Upper triangle, of a second of odometry: σ of 0.03 m along either axis and 1.15° of heading."""


def graph_of_robots(robots: int, seed: int, heading_walk: float = 0.02) -> str:
    """A circles in two minutes, as do other robots around it, for 240 s; true headings walk off
    those of the odometry by so much [rad/√s]. Ranges from A have σ = 0.1 m and come each second to
    B, every second one to C, every third to D …. From 101 to 123 s there are neither poses nor
    ranges.
    """
    rng = np.random.default_rng(seed)
    seconds = 240
    names = "ABCDEFG"[: robots + 1]
    pose = {name: np.array([0.0, 0.0, 0.5 * i]) for i, name in enumerate(names)}
    for i, name in enumerate(names[1:]):
        pose[name][:2] = 15.0 * np.cos(1.9 * i), 15.0 * np.sin(1.9 * i)
    lines = []
    count = 0
    for k in range(seconds):
        silent = 100 < k < 124
        for name, pose_of_robot in pose.items():
            if k:
                rotation = 2.0 * np.pi / 120.0
                pose_of_robot[:2] += 0.5 * np.array(
                    [np.cos(pose_of_robot[2]), np.sin(pose_of_robot[2])]
                )
                pose_of_robot[2] += rotation + heading_walk * rng.standard_normal()
            if not silent:
                values = " ".join(map(str, pose_of_robot.tolist()))
                lines.append(f"VERTEX_SE2 {k}.0 {name}{count} {values}")
                steps = k - (100 if k == 124 else k - 1)
                if k:
                    step_pose = np.array([0.0, 0.0, 0.0])
                    for _ in range(steps):
                        sine, cosine = np.sin(step_pose[2]), np.cos(step_pose[2])
                        step_pose += [0.5 * cosine, 0.5 * sine, 2.0 * np.pi / 120.0]
                    step = " ".join(map(str, step_pose.tolist()))
                    edge = f"{name}{count - 1} {name}{count}"
                    lines.append(f"EDGE_SE2 {k}.0 {edge} {step} {COVARIANCE_OF_STEP}")
        for i, name in enumerate(names[1:]):
            if 0 < k < seconds - 1 and not silent and (k + i) % (1 + i) == 0:
                distance = math.hypot(*(pose[name] - pose["A"])[:2]) + 0.1 * rng.standard_normal()
                lines.append(f"EDGE_RANGE {k}.0 A{count} {name}{count} {distance} 0.01")
        count += not silent
    return "\n".join(lines)


@pytest.mark.system
def test_robots_whose_odometry_drifts_are_navigated_by_consistently(tmp_path: Path) -> None:
    """Each robot's heading is 18° off after four minutes (0.02 rad/√s · √240 s). A mean NEES of 2,
    the number of coordinates, is right; where drift is set to zero, so that the error of a robot's
    place is constant, it is beyond 10.

    The step of 24 s in which nothing was recorded is not taken for missing readings.
    """
    scores_with_drift = []
    scores_without_drift = []
    for seed in range(4):
        data = read_data_set(graph(tmp_path, graph_of_robots(3, seed)))
        assert data.moving == ("B", "C", "D")
        assert data.stated["track_slip"] == pytest.approx(0.03)
        assert data.stated["track_heading_walk"] == pytest.approx(0.02)
        write_data_set(data, tmp_path / "a.mcap")
        recorded = read_data_set_log(tmp_path / "a.mcap")
        for results, settings in (
            (scores_with_drift, {}),
            (
                scores_without_drift,
                {"track_slip_m_sqrt_s": 0.0, "track_heading_walk_deg_sqrt_s": 0.0},
            ),
        ):
            estimates, _ = navigate_among_beacons(
                recorded, BeaconReplaySettings(medium="air", **settings)
            )
            results.append(score(estimates, recorded.measurements, recorded.truth))
    assert 0.7 < np.mean([each.nees for each in scores_with_drift]) < 3.0
    assert np.mean([each.nees for each in scores_without_drift]) > 10.0


def test_of_many_robots_three_with_the_most_ranges_are_taken(tmp_path: Path) -> None:
    data = read_data_set(graph(tmp_path, graph_of_robots(5, 1)))
    assert data.moving == ("B", "C", "D", "E", "F")
    log = tmp_path / "a.mcap"
    printed = run("log", "import", tmp_path / "graph.pyfg", "--out", log)
    assert "ranges to E, F left out" in " ".join(printed.split())
    measured = read_data_set_log(log).measurements
    counts = [np.count_nonzero(data.range_beacon == i) for i in range(5)]
    assert np.count_nonzero(np.isfinite(measured.ranges)) == sum(counts[:3])
