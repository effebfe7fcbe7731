"""A flight as a recording that Rerun draws: moving hulls, trails, rays, estimates with their uncertainty, and errors.

Rerun opens the MCAP log as well, but shows hulls and rays there as messages only.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from laisn.arrays import Floats
from sim.assembly import models_of
from sim.files import atomic_write
from sim.flight import Flight
from sim.log.file import LogError
from sim.log.hull import Shape, hull
from sim.log.layout import ESTIMATE, FOLLOWER, LEADER
from sim.log.scene import TRAIL_S, ellipse
from sim.trajectory import Trajectory

_TIMELINE = "mission"
_RAY = "#38bff2"
_TRANSMITTERS = ("tx_rear", "tx_front", "tx_middle")
_LINE_M = 0.03


def _rgba(colour: str, opacity: int = 255) -> list[int]:
    return [*(int(colour[i : i + 2], 16) for i in (1, 3, 5)), opacity]


def _log_hull(rr: Any, stream: Any, entity: str, model: str) -> None:
    """What is visible of a vehicle, in its body frame."""
    shapes = hull(model)

    def placed(kind: str) -> tuple[list[Shape], dict[str, Any]]:
        """Parts of a kind, and their positions, rotations and colours as Rerun takes them."""
        parts = [shape for shape in shapes if shape.kind == kind]
        return parts, {
            "centers": [part.position for part in parts],
            "quaternions": [part.quaternion[[1, 2, 3, 0]] for part in parts],
            "colors": [[round(255 * c) for c in part.rgba] for part in parts],
            "fill_mode": "solid",
        }

    cylinders, style = placed("cylinder")
    if cylinders:
        sizes = {"lengths": [c.size[2] for c in cylinders], "radii": [c.size[0] / 2 for c in cylinders]}
        stream.log(f"{entity}/cylinders", rr.Cylinders3D(**sizes, **style), static=True)
    for kind, name, archetype in (("ellipsoid", "spheres", rr.Ellipsoids3D), ("box", "boxes", rr.Boxes3D)):
        parts, style = placed(kind)
        if parts:
            stream.log(f"{entity}/{name}", archetype(half_sizes=[p.size / 2 for p in parts], **style), static=True)
    for number, mesh in enumerate(shape for shape in shapes if shape.kind == "mesh"):
        here = rr.Transform3D(translation=mesh.position, quaternion=mesh.quaternion[[1, 2, 3, 0]])
        stream.log(f"{entity}/mesh{number}", here, static=True)
        body = rr.Mesh3D(vertex_positions=mesh.vertices, triangle_indices=mesh.faces, albedo_factor=list(mesh.rgba))
        stream.log(f"{entity}/mesh{number}", body, static=True)


class _Recording:
    """Sends columns of one flight to one stream."""

    def __init__(self, rr: Any, stream: Any) -> None:
        self._rr, self._stream = rr, stream

    def send(self, entity: str, time: Floats, columns: Any) -> None:
        at = self._rr.TimeColumn(_TIMELINE, duration=time)
        self._rr.send_columns(entity, indexes=[at], columns=columns, recording=self._stream)

    def strips(self, entity: str, time: Floats, rows: Sequence[Sequence[Floats]], colour: str) -> None:
        """Lines of every instant, each of shape (n, 3)."""
        rr = self._rr
        style = rr.LineStrips3D.from_fields(colors=[_rgba(colour)], radii=[_LINE_M])
        self._stream.log(entity, style, static=True)
        flat = [strip for row in rows for strip in row]
        columns = rr.LineStrips3D.columns(strips=flat).partition([len(row) for row in rows])
        self.send(entity, time, columns)

    def trail(self, entity: str, time: Floats, track: Floats, colour: str) -> None:
        """The last part of a track, a point every second, shape (n, 3)."""
        rows = [[track[max(0, i - TRAIL_S) : i + 1]] for i in range(1, len(track))]
        self.strips(entity, time[1:], rows, colour)


def _seconds(truth: Trajectory) -> slice:
    return slice(None, None, max(1, round(1.0 / truth.dt)))


def _vehicle(rr: Any, to: _Recording, flight: Flight, v: int) -> None:
    truth, each = flight.trajectory, _seconds(flight.trajectory)
    name, turn = truth.names[v], truth.quaternion[:, v]
    to.send(
        f"world/{name}",
        truth.time,
        rr.Transform3D.columns(translation=truth.position[:, v], quaternion=turn[:, [1, 2, 3, 0]]),
    )
    to.trail(f"world/trails/{name}", truth.time[each], truth.position[each, v], FOLLOWER if v else LEADER)


def _follower(rr: Any, to: _Recording, flight: Flight, f: int) -> None:
    truth, measured, found = flight.trajectory, flight.measurements[f], flight.estimates[f]
    name, steps = truth.names[f + 1], flight.step_index()
    time, hydrophone = truth.time[steps], flight.hydrophone(f)
    to.send(
        f"errors/{name}/E_P", time, rr.Scalars.columns(scalars=np.hypot(*(found.state[:, :2] - hydrophone[:, :2]).T))
    )
    # a filter that left finite numbers has no ellipse
    each = np.arange(0, time.size, max(1, round(1.0 / measured.dt)))
    each = each[np.isfinite(found.covariance[each, :2, :2]).all(axis=(1, 2))]
    estimated = np.column_stack([found.state[each, :2], hydrophone[each, 2]])
    half_axes, direction = ellipse(found.covariance[each, :2, :2])
    half_turn = direction / 2
    nothing = np.zeros(each.size)
    to.send(
        f"world/estimates/{name}",
        time[each],
        rr.Ellipsoids3D.columns(
            centers=estimated,
            half_sizes=np.column_stack([half_axes, nothing + 0.01]),
            quaternions=np.column_stack([nothing, nothing, np.sin(half_turn), np.cos(half_turn)]),
            colors=[_rgba(ESTIMATE, 140)] * each.size,
        ),
    )
    to.trail(f"world/trails/{name}/estimate", time[each], estimated, ESTIMATE)
    ping = measured.message_step * flight.stride
    ends = truth.site_position[ping][:, [truth.site(f"{truth.names[0]}/{t}") for t in _TRANSMITTERS]]
    there = truth.site_position[ping, truth.site(f"{name}/hydrophone")]
    used = flight.scenario.navigation.transmitters
    rows = [
        [np.array([ends[m, j], there[m]]) for j in range(used) if np.isfinite(measured.ranges[m, j])]
        for m in range(ping.size)
    ]
    to.strips(f"world/rays/{name}", truth.time[ping], rows, _RAY)


def write_recording(flight: Flight, path: Path) -> Path:
    """Write a flight as one `.rrd` file for Rerun; the file appears when it is whole.

    Raises:
        LogError: Rerun's package is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise LogError("a recording needs Rerun's package; install it with: pip install rerun-sdk") from None
    scenario, names = flight.scenario, flight.trajectory.names
    with atomic_write(path) as part:
        stream = rr.RecordingStream("laisn-sim", recording_id=f"{scenario.name}-{scenario.seed}-{scenario.run}")
        stream.save(part)
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        to = _Recording(rr, stream)
        for v, model in enumerate(models_of(scenario)):
            _log_hull(rr, stream, f"world/{names[v]}/hull", model)
            _vehicle(rr, to, flight, v)
        for f in range(len(flight.estimates)):
            _follower(rr, to, flight, f)
        stream.flush()
        stream.disconnect()
    return path
