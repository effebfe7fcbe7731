"""Factor graphs in the text format of PyFactorGraph (`.pyfg`): planar poses, odometry, ranges,
landmarks, priors.

A line is a kind and its fields. A pose is called by a letter for its robot and a number, a landmark
by L and a number; headings are anticlockwise from east. Noise is given as the upper triangle of a
covariance.

    VERTEX_SE2 time pose x y heading            VERTEX_XY landmark x y
    VERTEX_SE2:PRIOR time pose x y heading …    VERTEX_XY:PRIOR time landmark x y …
    EDGE_SE2 time pose pose ahead port turn …   EDGE_RANGE time one other range variance

Times are in s, or in ns where one is too large for s. Vertices of poses are the true path in
simulated graphs; in others they may be the file's own estimate, which no line states.
"""

import math
import re
from collections import Counter
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.geometry import place_transmitters
from laisn.messages import Measurements
from laisn.settings import TightSettings
from sim.datasets.range_data import (
    LARGEST_NUMBER,
    RangeData,
    compose,
    parse_numbers,
    require_unique,
    text_of,
)
from sim.system import atomic_write

_WORD_COUNTS = {
    "VERTEX_SE2": (1, 1, 3, 0),
    "VERTEX_XY": (0, 1, 2, 0),
    "VERTEX_SE2:PRIOR": (1, 1, 3, 6),
    "VERTEX_XY:PRIOR": (1, 1, 2, 3),
    "EDGE_SE2": (1, 2, 3, 6),
    "EDGE_RANGE": (1, 2, 1, 1),
    "EDGE_SE2_XY": (1, 2, 2, 3),
}
"""Of a line of each kind: number of time stamps, names, measured numbers and numbers of noise."""
# vertices within this share of the path's length of the composed odometry count as composed of it
_SAME_PATH = 1e-4
_POSE = re.compile(r"([A-KM-Za-km-z])([0-9]{1,15})")


class _Line(NamedTuple):
    """The words of a line after its kind, as of `_WORD_COUNTS`."""

    time: float  # 0 where it has none [s]
    names: list[str]
    values: list[float]
    noise: list[float]


def _parsed(text: str, source: str) -> dict[str, list[_Line]]:
    """Lines by their kind, with times in s; LaisnError naming the first that is invalid."""
    lines: dict[str, list[_Line]] = {kind: [] for kind in _WORD_COUNTS}
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        kind = words[0]
        where = f"{source}, line {number}: {kind[:40]!r}"
        if kind not in _WORD_COUNTS:
            raise LaisnError(
                f"{where} is no kind of line of a planar graph; known: {', '.join(_WORD_COUNTS)}"
            )
        times, names, values, noise = _WORD_COUNTS[kind]
        where = f"{source}, line {number}: {kind}"
        first = 1 + times + names
        expected = 1 + times + names + values + noise
        if len(words) != expected:
            raise LaisnError(f"{where} with {len(words)} words, expected {expected}")
        time = parse_numbers(words[1 : 1 + times], where, 1e9 * LARGEST_NUMBER).tolist()
        values_and_variances = parse_numbers(words[first:], where).tolist()
        if not np.all(np.isfinite([*time, *values_and_variances])):
            raise LaisnError(f"{where} holds a number that is not finite")
        lines[kind].append(
            _Line(
                time[0] if time else 0.0,
                words[1 + times : first],
                values_and_variances[:values],
                values_and_variances[values:],
            )
        )
    largest_time = max((abs(line.time) for kind in lines.values() for line in kind), default=0.0)
    if largest_time <= LARGEST_NUMBER:
        return lines
    return {
        kind: [line._replace(time=1e-9 * line.time) for line in lines_of_kind]
        for kind, lines_of_kind in lines.items()
    }


def _odometry(lines: list[_Line], pose_index: dict[str, int], source: str) -> tuple[Floats, Floats]:
    """Steps from each pose to the next, and variances of their three numbers: way ahead and to port
    [m], turn anticlockwise [rad]; both of shape (n, 3) for n + 1 poses.
    """
    steps, variances = np.full((2, len(pose_index) - 1, 3), np.nan)
    for line in lines:
        first, second = (pose_index.get(name) for name in line.names)
        if first is None or second != first + 1:
            continue
        if not np.isnan(steps[first, 0]):
            raise LaisnError(
                f"{source}: odometry (EDGE_SE2) from {' to '.join(line.names)} is given twice"
            )
        steps[first] = line.values
        # of the upper triangle xx, xy, xθ, yy, yθ, θθ
        variances[first] = line.noise[0], line.noise[3], line.noise[5]
    gaps = np.flatnonzero(np.isnan(steps[:, 0]))
    if gaps.size:
        names = list(pose_index)
        raise LaisnError(
            f"{source}: no odometry (EDGE_SE2) from {names[gaps[0]]} to {names[gaps[0] + 1]}, nor "
            f"in {gaps.size - 1} other places of {len(steps)}"
        )
    return steps, variances


class _Track(NamedTuple):
    """The way of another robot by its odometry."""

    beacon: int  # number of the beacon that it is
    pose_index: dict[str, int]  # row of `state` of each of its poses, by name
    state: Floats  # east, north [m], compass heading [rad] and speed [m/s] of each, shape (n, 4)
    # of its odometry's three numbers [m²/s, m²/s, rad²/s], shape (m, 3)
    variances_per_s: Floats


def _poses_of(lines: list[_Line], robot: str) -> list[_Line]:
    """Vertices of the poses of a robot, by its letter, in the order of their numbers."""
    poses = [line for line in lines if line.names[0].startswith(robot)]
    return sorted(
        (line for line in poses if _POSE.fullmatch(line.names[0])),
        key=lambda line: int(line.names[0][1:]),
    )


def _first_pose(lines: dict[str, list[_Line]], poses: list[_Line]) -> list[float]:
    """East, north [m] and heading [rad] of the first pose by its prior, or else by its vertex."""
    priors = (line for line in lines["VERTEX_SE2:PRIOR"] if line.names[0] == poses[0].names[0])
    return next(priors, poses[0]).values


def _track_of(lines: dict[str, list[_Line]], robot: str, beacon: int, source: str) -> _Track:
    """Odometry of a robot, summed up from the prior of its first pose, or else from its vertex.

    LaisnError: there is none between two of its poses.
    """
    poses = _poses_of(lines["VERTEX_SE2"], robot)
    pose_index = {line.names[0]: k for k, line in enumerate(poses)}
    steps, variances = _odometry(lines["EDGE_SE2"], pose_index, source)
    track = np.array(list(accumulate(steps, compose, initial=np.array(_first_pose(lines, poses)))))
    time = np.array([line.time for line in poses])
    if np.ptp(time) == 0.0:
        time = np.arange(time.size, dtype=np.float64)
    durations = np.diff(time)
    distances = np.hypot(*steps[:, :2].T) if len(steps) else np.zeros(0)
    speed = np.divide(distances, durations, out=np.zeros_like(distances), where=durations > 0.0)
    # a pose has the speed of the step that leads to it
    speed = np.concatenate([speed[:1], speed]) if speed.size else np.zeros(1)
    state = np.column_stack([track[:, :2], 0.5 * np.pi - track[:, 2], speed])
    return _Track(beacon, pose_index, state, _per_second(variances, durations))


def _per_second(variances: Floats, durations: Floats) -> Floats:
    """Variances per second of the steps that take time."""
    lasting = durations > 0.0
    return variances[lasting] / durations[lasting, None]


def _heard(lines: dict[str, list[_Line]], robot: str) -> set[str]:
    """Other robots that a robot has ranges to and whose odometry is whole."""
    heard_robots = set[str]()
    for line in lines["EDGE_RANGE"]:
        letters = {name[0] for name in line.names if _POSE.fullmatch(name)}
        if len(letters) == 2 and robot in letters:
            heard_robots |= letters - {robot}
    complete = set[str]()
    for other in heard_robots:
        poses = _poses_of(lines["VERTEX_SE2"], other)
        pose_index = {line.names[0]: k for k, line in enumerate(poses)}
        joined = {
            pose_index[line.names[0]]
            for line in lines["EDGE_SE2"]
            if line.names[0] in pose_index
            and pose_index.get(line.names[1]) == pose_index[line.names[0]] + 1
        }
        if len(poses) > 1 and len(joined) == len(poses) - 1:
            complete.add(other)
    return complete


def _ranges(
    lines: list[_Line],
    pose_index: dict[str, int],
    time: Floats,
    landmarks: dict[str, list[float]],
    tracks: dict[str, _Track],
) -> tuple[list[list[float]], list[float]]:
    """Rows of time [s], beacon, range [m] and the beacon's state, sorted; beacon −1, and zeros for
    time and state, where a range joins no known pose and beacon. Also the variances [m²] of the
    other ranges, in the file's order.
    """
    beacon_of = {name: i for i, name in enumerate(landmarks)}
    landmark_state = {name: [*position, 0.0, 0.0] for name, position in landmarks.items()}
    rows = list[list[float]]()
    variances = list[float]()
    for line in lines:
        pose, other = line.names if line.names[0] in pose_index else line.names[::-1]
        track = tracks.get(other[:1])
        moves = track is not None and other in track.pose_index
        if pose not in pose_index or not (other in landmarks or moves):
            rows.append([0.0, -1, line.values[0], 0.0, 0.0, 0.0, 0.0])
            continue
        beacon = beacon_of.get(other, -1)
        state = landmark_state.get(other, [])
        if track is not None and moves:
            beacon = track.beacon
            state = track.state[track.pose_index[other]].tolist()
        k = pose_index[pose]
        # the time in the line if it lies between the poses beside its own, and otherwise its pose's
        low, high = time[max(k - 1, 0)], time[min(k + 1, time.size - 1)]
        when = line.time if low < line.time < high else float(time[k])
        rows.append([when, beacon, line.values[0], *state])
        variances.append(line.noise[0])
    return sorted(rows), variances


def _robot_with_most_poses(lines: dict[str, list[_Line]], source: str) -> tuple[str, set[str]]:
    """Letter of the robot with the most poses, and of all robots."""
    matches = (_POSE.fullmatch(line.names[0]) for line in lines["VERTEX_SE2"])
    robots = Counter(match[1] for match in matches if match)
    if not robots:
        raise LaisnError(
            f"{source}: no planar pose (VERTEX_SE2) of a robot, called by a letter and a number "
            "such as A0"
        )
    # of several with as many poses the first letter
    return max(robots, key=lambda letter: (robots[letter], -ord(letter))), set(robots)


def _robot_remarks(robot: str, robots: set[str], heard_robots: set[str]) -> list[str]:
    """Which robots of several are used, a sentence each."""
    remarks = [
        f"of several robots {robot} is taken; its ranges to {name} are to the path that {name}'s "
        "odometry gives"
        for name in sorted(heard_robots)
    ]
    unused = sorted(robots - heard_robots - {robot})
    if unused:
        remarks.append(f"of several robots {robot} is taken; left out: {', '.join(unused)}")
    return remarks


def _reference_path(
    time: Floats, vertices: Floats, odometry: Floats, durations: Floats
) -> tuple[Floats, str]:
    """Path to compare with, rows of time, east and north, and a sentence about it.

    Args:
        time: Time of each pose, shape (n + 1,), [s].
        vertices: East, north [m] and heading [rad] of each pose, shape (n + 1, 3).
        odometry: Steps between them, shape (n, 3).
        durations: How long each step took, shape (n,), [s].
    """
    composed = np.array(list(accumulate(odometry, compose, initial=vertices[0])))
    deviation = np.hypot(*(composed - vertices)[:, :2].T)
    length = np.hypot(*odometry[:, :2].T).sum()
    if deviation.max() <= _SAME_PATH * length:
        remark = "vertices are composed of the odometry: there is no path to compare with"
        return np.empty((0, 3)), remark
    remark = (
        "the path to compare with is that of the vertices, which may be the file's own estimate"
    )
    # of poses at one time the first stays
    first_at_time = np.append(True, durations != 0.0)
    return np.column_stack([time, vertices[:, :2]])[first_at_time], remark


def _stated_noise(
    variances_per_s: Floats, track_variances_per_s: Floats, range_variances: list[float]
) -> dict[str, float]:
    """Noise that the file states, as `RangeData.stated`: medians of what is positive.

    Args:
        variances_per_s: Of the three numbers of odometry in a second, shape (n, 3).
        track_variances_per_s: The same of other robots, shape (m, 3).
        range_variances: Of each range [m²].
    """
    samples = {"slip": variances_per_s[:, :2].mean(axis=1), "heading_walk": variances_per_s[:, 2]}
    samples |= {
        "track_slip": track_variances_per_s[:, :2].mean(axis=1),
        "track_heading_walk": track_variances_per_s[:, 2],
    }
    if range_variances and min(range_variances) > 0.0:
        samples["range_sigma"] = np.array(range_variances)
    medians = {name: np.median(values) for name, values in samples.items() if values.size}
    return {name: float(np.sqrt(median)) for name, median in medians.items() if median > 0.0}


def read_factor_graph(path: Path) -> RangeData:
    """The odometry and ranges of one robot in a planar factor graph: that with the most poses.

    Other robots that it has ranges to are beacons that move, each along its own odometry.

    Places of landmarks are those of their priors, or else of their vertices. The path to compare
    with is that of the poses' vertices, unless these are only composed of the odometry. The start
    is that of the first pose's prior, or else of its vertex. `slip` and `heading_walk` are medians
    per second of the odometry's covariances; `track_slip` and `track_heading_walk` are those of the
    other robots' odometry. LaisnError, naming the line, if the file cannot be read, is no planar
    graph, or lacks odometry or ranges.
    """
    source = str(path)
    lines = _parsed(text_of(path), source)
    robot, robots = _robot_with_most_poses(lines, source)
    heard_robots = _heard(lines, robot)
    remarks = _robot_remarks(robot, robots, heard_robots)
    poses = _poses_of(lines["VERTEX_SE2"], robot)
    for kind in ("VERTEX_SE2", "VERTEX_XY", "VERTEX_XY:PRIOR"):
        require_unique((line.names[0] for line in lines[kind]), f"{source}: {kind}")
    pose_index = {line.names[0]: k for k, line in enumerate(poses)}
    time = np.array([line.time for line in poses])
    if np.ptp(time) == 0.0:
        time = np.arange(time.size, dtype=np.float64)
        remarks.append(f"{source} has no times: poses are taken to be a second apart")
    odometry, variances = _odometry(lines["EDGE_SE2"], pose_index, source)
    candidate_edges = [line for line in lines["EDGE_SE2"] if line.names[0][0] not in heard_robots]
    if len(candidate_edges) != len(odometry):
        number = len(candidate_edges) - len(odometry)
        remarks.append(f"edges left out that are no steps of odometry: {number}")
    durations = np.diff(time)
    vertices = np.array([line.values for line in poses])
    truth, remark = _reference_path(time, vertices, odometry, durations)
    remarks.append(remark)
    # priors replace vertices
    landmarks = {
        line.names[0]: line.values
        for kind in ("VERTEX_XY", "VERTEX_XY:PRIOR")
        for line in lines[kind]
    }
    tracks = {
        name: _track_of(lines, name, len(landmarks) + i, source)
        for i, name in enumerate(sorted(heard_robots))
    }
    ranges, range_variances = _ranges(lines["EDGE_RANGE"], pose_index, time, landmarks, tracks)
    track_variances_per_s = np.vstack(
        [np.empty((0, 3)), *(track.variances_per_s for track in tracks.values())]
    )
    track_starts = [track.state[0, :2].tolist() for track in tracks.values()]
    east, north, heading = _first_pose(lines, poses)
    return RangeData.collect(
        source=source,
        start=np.array([east, north, 0.5 * np.pi - heading]),
        time=time,
        odometry=odometry,
        beacons=(*landmarks, *tracks),
        places=np.array([*landmarks.values(), *track_starts], dtype=np.float64).reshape(-1, 2),
        ranges=ranges,
        moving=tuple(tracks),
        stated=_stated_noise(
            _per_second(variances, durations), track_variances_per_s, range_variances
        ),
        truth=truth,
        remarks=remarks,
    )


def _line_text(*words: object) -> str:
    return (
        " ".join(f"{word:.10g}" if isinstance(word, float) else str(word) for word in words) + "\n"
    )


def _triangle(*variances: float) -> list[float]:
    """Upper triangle, row by row, of a diagonal covariance."""
    matrix = np.diag(variances)
    return [float(v) for v in matrix[np.triu_indices(len(variances))]]


def _horizontal(slant_range: float, depth_difference: float, sigma: float) -> tuple[float, float]:
    """A slant range reduced to the plane, and its standard deviation [m].

    With h² = r² − d², errors of r are r/h times as large in h. Where h is no larger than √(r σ),
    that is its error.

    Args:
        slant_range: r [m].
        depth_difference: d, of both ends [m].
        sigma: standard deviation of the slant range, σ [m].
    """
    horizontal_range = math.sqrt(max(slant_range**2 - depth_difference**2, 0.0))
    error_of_half_square = max(slant_range, sigma) * sigma
    return horizontal_range, error_of_half_square / max(
        horizontal_range, math.sqrt(error_of_half_square)
    )


def write_factor_graph(
    measurements: Measurements, settings: TightSettings, start: Floats, truth: Floats, path: Path
) -> Path:
    """Write what a follower measured as a factor graph, with a pose A… at the start and at each
    message.

    Odometry is that of log and compass in the frame of the pose before; the compass gives turns
    alone, so that its bias is the error of the first pose's heading. Each transmitter of a message
    is a landmark at the place that the message gives it. Ranges are reduced to the plane by the
    depths; their variance holds all errors of a range, as they are in the plane.

    `start` is x, y [m] at step 0, shape (2,) or more; `truth` of each step from 0 on: time [s],
    east, north of the hydrophone [m] and heading [rad], shape (n + 1, 4).
    """
    speed, heading = (
        np.concatenate([values[:1], values])
        for values in (measurements.speed, measurements.heading)
    )
    dt = np.diff(truth[:, 0])
    direction = np.column_stack([np.sin(heading), np.cos(heading)])
    velocity = speed[:, None] * direction
    yaw = 0.5 * np.pi - heading
    way = np.vstack(
        [np.zeros(2), np.cumsum(0.5 * dt[:, None] * (velocity[:-1] + velocity[1:]), axis=0)]
    )
    steps = [0, *measurements.message_step.tolist()]
    lines = [
        _line_text(
            "VERTEX_SE2",
            float(truth[k, 0]),
            f"A{i}",
            *truth[k, 1:3].tolist(),
            float(0.5 * np.pi - truth[k, 3]),
        )
        for i, k in enumerate(steps)
    ]
    prior = (
        settings.start_sigma**2,
        settings.start_sigma**2,
        settings.heading_bias_sigma**2 + settings.heading_sigma**2,
    )
    first = float(truth[0, 0]), "A0", float(start[0]), float(start[1]), float(yaw[0])
    lines.append(_line_text("VERTEX_SE2:PRIOR", *first, *_triangle(*prior)))
    range_sigma = math.hypot(
        settings.range_sigma, settings.range_scale_sigma, settings.range_scale_bias_sigma
    )
    for i, (last_step, k) in enumerate(pairwise(steps)):
        time = float(truth[k, 0])
        sine, cosine = (np.sin(yaw[last_step]), np.cos(yaw[last_step]))
        ahead, port = np.array([[cosine, sine], [-sine, cosine]]) @ (way[k] - way[last_step])
        durations = dt[last_step:k]
        step_count = k - last_step
        along_variance = (settings.speed_sigma**2 * np.sum(durations**2)) + (
            settings.speed_bias_sigma * np.sum(durations)
        ) ** 2
        across_variance = (
            settings.heading_sigma * np.mean(speed[last_step + 1 : k + 1])
        ) ** 2 * np.sum(durations**2)
        noise = _triangle(
            float(along_variance),
            float(across_variance),
            # a turn is the difference of two readings, 2 σ². Successive turns share a reading, so
            # that their sum has no more, but a graph takes edges as independent and adds up their
            # variances: the division by the number of steps makes up for that in part. 1e-8 keeps
            # the covariance regular where σ is 0
            2.0 * settings.heading_sigma**2 / step_count + 1e-8,
        )
        turn = float(np.arctan2(np.sin(yaw[k] - yaw[last_step]), np.cos(yaw[k] - yaw[last_step])))
        lines.append(
            _line_text(
                "EDGE_SE2", time, f"A{i}", f"A{i + 1}", float(ahead), float(port), turn, *noise
            )
        )
        reception = measurements.reception(i)
        hydrophone_depth = measurements.last_depth[k - 1] - settings.hydrophone_height
        places = place_transmitters(reception, settings)
        for j in np.flatnonzero(
            np.isfinite(places).all(axis=1) & np.isfinite(reception.ranges)
        ).tolist():
            landmark = f"L{3 * i + j}"
            position = places[j, :2].tolist()
            horizontal_range, horizontal_sigma = _horizontal(
                float(reception.ranges[j]), float(hydrophone_depth - places[j, 2]), range_sigma
            )
            lines.append(_line_text("VERTEX_XY", landmark, *position))
            lines.append(
                _line_text("VERTEX_XY:PRIOR", time, landmark, *position, *_triangle(1e-6, 1e-6))
            )
            lines.append(
                _line_text(
                    "EDGE_RANGE",
                    time,
                    f"A{i + 1}",
                    landmark,
                    horizontal_range,
                    horizontal_sigma**2,
                )
            )
    with atomic_write(path) as part_file:
        part_file.write_text("".join(lines), encoding="utf-8")
    return path
