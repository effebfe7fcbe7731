"""What is seen of a vehicle: its geoms, moving fins and main propellers, for JSON.

Positions `at` [m], attitudes `turn` (w, x, y, z) and axes are in the hull's frame; `effector` is
the index of an actuator.
"""

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from sim import attitude
from sim.vehicle.effectors import MovingFins, has_fin, unit_gear
from sim.vehicle.mjcf import numeric, spec_of

_KINDS = {
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}
_USUAL_SHINE = 0.2  # specular, 0 … 1, of geoms without a material
_MIN_PUSH_ALONG = (
    0.99  # least share of an effector's push along the hull that makes it a main propeller
)
_ASTERN_M = -0.3  # a main propeller is abaft of this
_NOZZLE = "nozzle_main"
_USUAL_NOZZLE_M = (0.06, 0.03)  # radius and half length where the model shows none
_RADIUS_RATIO = 1.45  # radius of the propeller over that of the nozzle, as the film has it
_BEHIND_M = 0.015  # from the nozzle's end to the propeller


def _numbers(values: npt.ArrayLike, digits: int) -> list[float]:
    return [float(value) for value in np.asarray(values, dtype=np.float64).round(digits).ravel()]


def _part(model: mujoco.MjModel, geom: int) -> dict[str, Any] | None:
    """A geom, its `size` as MuJoCo has it [m], `points` [m] and `faces` those of a mesh; None for
    one of a kind that no hull has.
    """
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind not in _KINDS:
        return None
    material = model.geom_matid[geom]
    colour = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    shine = float(model.mat_specular[material]) if material >= 0 else _USUAL_SHINE
    geom_record: dict[str, Any] = {
        "name": model.geom(geom).name,
        "kind": _KINDS[kind],
        "size": _numbers(model.geom_size[geom], 5),
        "at": _numbers(model.geom_pos[geom], 5),
        "turn": _numbers(model.geom_quat[geom], 6),
        "rgb": _numbers(colour[:3], 3),
        "shine": round(shine, 2),
    }
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        point = model.mesh_vertadr[mesh]
        face = model.mesh_faceadr[mesh]
        points = model.mesh_vert[point : point + model.mesh_vertnum[mesh]]
        faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
        geom_record["points"] = _numbers(points, 4)
        geom_record["faces"] = faces.ravel().tolist()
    return geom_record


def _propellers(model: mujoco.MjModel) -> list[dict[str, Any]]:
    """Main propellers: effectors abaft that push along the hull. MJCFs show their nozzles alone."""
    nozzle = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, _NOZZLE)
    radius, half_length = model.geom_size[nozzle][:2] if nozzle >= 0 else _USUAL_NOZZLE_M
    propellers = []
    for i in range(model.nu):
        name = model.actuator(i).name
        site = model.actuator_trnid[i, 0]
        gear = unit_gear(model.actuator_gear[i])
        push = attitude.rotate(model.site_quat[site], gear[:3])
        is_fin = has_fin(model, name)
        if is_fin or abs(push[0]) < _MIN_PUSH_ALONG or model.site_pos[site][0] > _ASTERN_M:
            continue
        propellers.append(
            {
                "effector": i,
                "at": _numbers(model.site_pos[site] - [half_length + _BEHIND_M, 0.0, 0.0], 4),
                "radius": round(_RADIUS_RATIO * float(radius), 4),
                # its state is revolutions per second, else thrust [N]
                "spins": numeric(model, f"{name}.propeller") is not None,
            }
        )
    return propellers


def hull(path: str) -> dict[str, Any]:
    """Parts, fins and propellers of the vehicle of an MJCF, by its path."""
    model = spec_of(path).compile()
    parts = [piece for geom in range(model.ngeom) if (piece := _part(model, geom)) is not None]
    fins = [
        {
            "part": model.geom(hinge.geom).name,
            "effector": hinge.effector,
            "axis": _numbers(hinge.axis, 5),
        }
        for hinge in MovingFins(model).hinges
    ]
    return {"parts": parts, "fins": fins, "propellers": _propellers(model)}
