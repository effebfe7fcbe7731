"""The hull file of a Gazebo model: all links as one rigid body with the forces of its plugins.

The origin of the body is that of the link of Hydrodynamics, where Gazebo applies its coefficients;
the axes are the model's, unless its nose points elsewhere.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.gazebo import body, buoyancy, fins, hydrodynamics, includes, thrusters
from sim.gazebo.document import (
    UUV_PLUGIN,
    Remarks,
    child_text,
    is_true,
    plugin_kind,
    read_document,
    uuv_advice,
)
from sim.gazebo.frames import SdfModel
from sim.vehicle.hull_file import EffectorPart, HullFile, SourcedValues
from sim.water.waves import GRAVITY

HYDRODYNAMICS = ("Hydrodynamics", hydrodynamics.TETHYS)
READ_PLUGINS = (*HYDRODYNAMICS, "Thruster", "LiftDrag")
# Gazebo's thrusters and joints have controllers and no lag of their own [s]
LAG = {"thruster": 0.2, "fin": 0.1}
SLENDER = 2.0  # length over width from which a hull's longest axis is taken for its own
DIGITS = 9  # of the numbers in a hull file, so that weight and buoyancy keep their difference
MIN_ASSUMED_THRUST = 50.0  # of a thruster without limits: that of a T200 at 16 V [N]
ASSUMED_SPEED = 1.5  # that thrusters without limits are to reach [m/s]
EXPANSION_ADVICE = (
    "gz sdf -p FILE > whole.sdf, run where Gazebo finds the models, puts them in place"
)


@dataclass(frozen=True)
class Placing:
    """The body in the model."""

    rotation: Floats  # 3×3, from the model's axes to the body's
    origin: Floats  # of the body in the model [m]

    def point(self, position: Floats) -> Floats:
        """A point of the model in the body [m]."""
        return np.asarray(self.rotation @ (position - self.origin))

    def direction(self, axis: Floats) -> Floats:
        """A direction of the model in the body."""
        return np.asarray(self.rotation @ axis)


def from_sdf(text: str, folder: Path | None = None) -> tuple[HullFile, list[str]]:
    """The hull of the first model with a Hydrodynamics plugin in an SDF file.

    Args:
        text: of the file.
        folder: of the file, where included models are looked for; None: they are not read.

    Returns:
        The hull file; what was assumed or left out, in sentences.

    Raises:
        LaisnError: it is no such file; the message names element and value.
    """
    remarks = Remarks()
    root = read_document(text)
    includes.put_in_place(root, folder, remarks)
    model = _chosen_model(root, remarks)
    for uri in _included(model.element):
        remarks.add_for_part(
            "<include> of", uri, f"not on this machine, so that it is missing; {EXPANSION_ADVICE}"
        )
    water = buoyancy.water_of(root, model, remarks)
    hull = body.hull_of(model, water, remarks)
    coefficients, munk_factor = hydrodynamics.coefficients_of(model, hull, remarks)
    gazebo_thrusters = thrusters.thrusters_of(model, remarks)
    if not gazebo_thrusters:
        raise LaisnError("has no Thruster plugin")
    origin = _reference(model)
    rotation = _rotation_to_body(hull, gazebo_thrusters, remarks)
    placing = Placing(rotation, origin)
    gazebo_fins = fins.fins_of(model, water.density, rotation[0], remarks)
    matrices = hydrodynamics.about_point(coefficients, rotation, origin)
    _remark_on_moved(coefficients, origin, rotation, remarks)
    _remark_on_unused(
        model,
        {thruster.joint for thruster in gazebo_thrusters},
        {fin.link for fin in gazebo_fins},
        remarks,
    )

    size = np.abs(rotation) @ hull.size
    length = max(float(size[0]), 0.1)
    diameter = max(float(np.sqrt(size[1] * size[2])), 0.05)
    if hull.has_unread_shape:
        remarks.add(f"length {length:.3g} m and diameter {diameter:.3g} m are without the meshes")
    numerics = _numerics(hull, water, matrices, munk_factor, placing, length, diameter, remarks)
    parts = [
        *_thruster_parts(
            gazebo_thrusters,
            placing,
            _default_thrust(gazebo_thrusters, matrices, rotation),
            remarks,
        ),
        *_fin_parts(gazebo_fins, placing),
    ]
    inertia = rotation @ hull.inertia @ rotation.T
    products = [inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return HullFile(
        name=_name(model.name or "hull"),
        about=f"Read by laisn hull from the SDF model {model.name!r}. Origin: that of the link of "
        "Hydrodynamics.",
        length=length,
        diameter=diameter,
        middle=placing.point(hull.buoyancy_centre),
        digits=DIGITS,
        mass=(hull.mass, "of all links"),
        inertia=(
            np.concatenate([np.diag(inertia), products]),
            "of all links about their common centre",
        ),
        centre=(placing.point(hull.centre), "of all links"),
        numerics=numerics,
        effectors=_with_unique_names(parts),
    ), remarks.sentences()


def _chosen_model(root: Element, remarks: Remarks) -> SdfModel:
    """The first model with a Hydrodynamics plugin; LaisnError if there is none, or it is fixed."""
    candidates = [*root.findall("model"), *root.findall("world/model")]
    with_plugin = [
        element
        for element in candidates
        if any(plugin_kind(plugin) in HYDRODYNAMICS for plugin in element.iter("plugin"))
        and next(element.iter("link"), None) is not None
    ]
    if not with_plugin:
        raise LaisnError(_no_model(root))
    if len(with_plugin) > 1:
        remarks.add(f"only the first of {len(with_plugin)} models is read")
    model = SdfModel(with_plugin[0])
    if is_true(child_text(with_plugin[0], "static")):
        raise LaisnError(f"model {model.name!r} is <static>: it does not move")
    return model


def _included(element: Element) -> list[str]:
    """URIs of models that were not put in place."""
    uris = [child_text(include, "uri") for include in element.iter("include")]
    return list(dict.fromkeys(uris))


def _no_model(root: Element) -> str:
    text = "has no <model> with links and a Hydrodynamics plugin"
    if missing := _included(root):
        uris = ", ".join(missing)
        return f"{text}; <include> of {uris} is not on this machine: {EXPANSION_ADVICE}"
    if any(UUV_PLUGIN in plugin.get("filename", "") for plugin in root.iter("plugin")):
        return f"{text}; {uuv_advice()}"
    return text


def _reference(model: SdfModel) -> Floats:
    """Origin of the link of the first Hydrodynamics plugin, in the model [m]."""
    for scope in model.all_models():
        for plugin in scope.element.findall("plugin"):
            if plugin_kind(plugin) in HYDRODYNAMICS:
                return scope.pose_of(child_text(plugin, "link_name"))[:3, 3]
    raise AssertionError("the model was chosen for its plugin")


def _rotation_to_body(
    hull: body.SdfHull, gazebo_thrusters: list[thrusters.GazeboThruster], remarks: Remarks
) -> Floats:
    """From the model's axes to the body's, whose x points to the nose.

    The nose is at +x, unless a slender hull lies along another axis, or all propellers that push
    along it stand ahead.
    """
    longest = int(np.argmax(hull.size))
    axis = np.eye(3)[longest]
    is_slender = hull.size[longest] > SLENDER * hull.size[0]
    if longest != 0 and is_slender and not thrusters.pushing_along(gazebo_thrusters, axis):
        remarks.add(
            f"the hull is longest along {'xyz'[longest]}, where no thruster pushes: its nose is "
            "taken to be at +x"
        )
    if longest != 0 and (not is_slender or not thrusters.pushing_along(gazebo_thrusters, axis)):
        axis = np.eye(3)[0]
    driving = thrusters.pushing_along(gazebo_thrusters, axis)
    extent = float(hull.size @ axis)
    ahead = [
        float((thruster.position - hull.buoyancy_centre) @ axis) > 0.25 * extent
        for thruster in driving
    ]
    name = "xyz"[int(np.argmax(axis))]
    is_backward = bool(ahead) and all(ahead) and len(driving) == 1
    if is_backward:
        axis = -axis
    nose = f"{'−' if is_backward else '+'}{name}"
    if name != "x":
        remarks.add(
            f"the hull lies along {name}, where its propeller pushes: the nose is taken to be at "
            f"{nose}, and the body turned"
        )
    elif is_backward:
        remarks.add(
            "the propeller stands at +x: the nose is taken to be at −x, and the body turned round"
        )
    # about z, or for a hull along z about y
    up = np.array([0.0, 0.0, 1.0]) if name != "z" else np.array([-float(axis[2]), 0.0, 0.0])
    return np.array([axis, np.cross(up, axis), up])


def _default_thrust(
    gazebo_thrusters: list[thrusters.GazeboThruster],
    matrices: hydrodynamics.Matrices,
    rotation: Floats,
) -> float:
    """Thrust of each thruster with which all together reach `ASSUMED_SPEED` ahead, within bounds
    [N].
    """
    load = matrices.linear[0, 0] * ASSUMED_SPEED + matrices.quadratic[0, 0] * ASSUMED_SPEED**2
    shares = sum(abs(float(rotation[0] @ thruster.axis)) for thruster in gazebo_thrusters)
    thrust = load / shares if shares > 0.1 else MIN_ASSUMED_THRUST
    return float(np.clip(thrust, MIN_ASSUMED_THRUST, thrusters.GAZEBO_LIMIT))


def _remark_on_moved(
    coefficients: list[hydrodynamics.LinkCoefficients],
    origin: Floats,
    rotation: Floats,
    remarks: Remarks,
) -> None:
    """Remark on coefficients that are moved or turned from their link to the axes of the hull."""
    for link in coefficients:
        arm = float(np.linalg.norm(link.frame[:3, 3] - origin))
        axes = np.abs(rotation @ link.frame[:3, :3])
        is_turned = not np.allclose(axes, np.round(axes), atol=1e-6)
        if arm < 1e-9 and not is_turned:
            continue
        changes = []
        if arm >= 1e-9:
            changes.append(f"moved by {arm:.3g} m")
        if is_turned:
            changes.append("turned")
        text = f"coefficients of a link are {' and '.join(changes)} to the axes of the hull"
        if link.quadratic.any():
            text += ": quadratic damping holds along or about one axis, between axes nearly"
        remarks.add(text)


def _remark_on_unused(
    model: SdfModel, thruster_joints: set[str], fin_links: set[str], remarks: Remarks
) -> None:
    """Remark on joints, links, sensors and plugins that are not used."""
    sensors = 0
    others: list[str] = []
    for scope in model.all_models():
        for name, joint in scope.joints.items():
            kind = joint.get("type", "")
            child = child_text(joint, "child").rpartition("::")[2]
            if child_text(joint, "parent") == "world":
                raise LaisnError(f"joint {name!r} fixes the model to the world")
            if kind != "fixed" and name not in thruster_joints and child not in fin_links:
                remarks.add_for_part(
                    "joint", name, f"{kind}, held where it is, as all links are one body"
                )
        sensors += sum(len(link.findall("sensor")) for link in scope.links.values())
        for plugin in scope.element.findall("plugin"):
            kind = plugin_kind(plugin)
            if kind not in READ_PLUGINS:
                others.append(kind.rpartition("::")[2] or plugin.get("filename", "?"))
            if kind == "BuoyancyEngine":
                remarks.add("BuoyancyEngine is not read: its volume is left out of the buoyancy")
    _remark_on_loose_links(model, remarks)
    if sensors:
        remarks.add(f"sensors of links ({sensors}) are not read: a scenario states its own")
    if others:
        names = ", ".join(dict.fromkeys(others))
        remarks.add(f"plugins that are not read: {names}")


def _remark_on_loose_links(model: SdfModel, remarks: Remarks) -> None:
    """Links that no joint holds, which Gazebo would let go."""
    joined: set[tuple[int, str]] = set()
    links: list[tuple[SdfModel, str]] = []
    for scope in model.all_models():
        links += [(scope, name) for name in scope.links]
        for joint in scope.joints.values():
            for end in ("parent", "child"):
                if (target := scope.find_link(child_text(joint, end))) is not None:
                    joined.add((id(target[0]), target[1]))
    loose = [name for scope, name in links if (id(scope), name) not in joined]
    if len(links) > 1 and loose:
        for name in loose:
            remarks.add_for_part("link", name, "no joint holds it; fixed to the hull here")


def _buoyancy(hull: body.SdfHull, water: buoyancy.FileWater, remarks: Remarks) -> tuple[float, str]:
    """Buoyancy [N] in water of the file's density, and where it comes from."""
    force = water.density * hull.volume * GRAVITY
    weight = hull.mass * GRAVITY
    if 0.9 < force / weight < 1.1:
        return force, f"[N]: volume of the collisions, water of {water.density:g} kg/m³"
    remarks.add(
        f"its collisions displace {force:.4g} N of water, it weighs {weight:.4g} N: the weight is "
        "taken for the buoyancy"
    )
    return weight, "[N]: the weight"


def _numerics(
    hull: body.SdfHull,
    water: buoyancy.FileWater,
    matrices: hydrodynamics.Matrices,
    munk_factor: float,
    placing: Placing,
    length: float,
    diameter: float,
    remarks: Remarks,
) -> dict[str, SourcedValues]:
    source = "gz-sim's Hydrodynamics"
    count = 10
    middle = placing.point(hull.buoyancy_centre)
    strip_x = middle[0] + length * ((np.arange(count) + 0.5) / count - 0.5)
    return {
        "added_mass": (
            _semidefinite(matrices.added_mass),
            f"6×6 by rows [kg], [kg m²]: −xDotU … of {source}, or fluid_added_mass",
        ),
        "munk_factor": (munk_factor, "[-]: share of the Coriolis terms"),
        "linear_damping": (matrices.linear, f"6×6 by rows [N s/m], [N m s]: {source}, −xU …"),
        "linear_damping_fade": (np.zeros(6), "[s/m]: does not fade"),
        "quadratic_damping": (
            matrices.quadratic,
            f"6×6 by rows [N s²/m²], [N m s²]: {source}, −xUabsU …",
        ),
        "buoyancy": _buoyancy(hull, water, remarks),
        "buoyancy_density": (water.density, f"[kg/m³]: {water.source}"),
        "buoyancy_centre": (middle, "[m]: of the collisions"),
        "displaced_inertia": (
            hull.mass * (length**2 + diameter**2) / 20.0,
            "[kg m²]: spheroid of its size",
        ),
        "hull_radius": (0.5 * diameter, "[m]: D / 2"),
        "hull_lift": (
            (0.7 * length * diameter, 0.0, 0.0),
            "area 0.7 L D [m²]; no drag, no lift beside the damping",
        ),
        "hull_lift_planes": ((1.0, 1.0), "[-]: both planes"),
        "cross_flow_drag": ((0.0, 0.0), "[-]: in the quadratic damping"),
        "strip_x": (strip_x, f"[m]: {count} equal lengths, which leave the water one by one"),
        "strip_area": (np.full(count, diameter * length / count), f"[m²]: D L / {count}"),
    }


def _semidefinite(matrix: Floats) -> Floats:
    """The matrix as a file has it, to `DIGITS` digits.

    Where an eigenvalue is zero, a diagonal makes up for the rounding.
    """
    rounded = np.vectorize(lambda value: float(f"{value:.{DIGITS}g}"))(matrix)
    smallest = float(np.linalg.eigvalsh(rounded)[0])
    bound = 1e-6 * float(np.abs(matrix).max())
    return rounded + 2.0 * abs(smallest) * np.eye(6) if -bound < smallest < 0.0 else matrix


def _thruster_parts(
    gazebo_thrusters: list[thrusters.GazeboThruster],
    placing: Placing,
    default: float,
    remarks: Remarks,
) -> list[EffectorPart]:
    parts = []
    all_limits = thrusters.limits_of(gazebo_thrusters, default, remarks)
    for thruster, limits_in_file in zip(gazebo_thrusters, all_limits, strict=True):
        axis = placing.direction(thruster.axis)
        limits = limits_in_file
        if axis[0] <= -0.9:
            axis = -axis
            limits = (-limits[1], -limits[0])
            remarks.add_for_part(
                "thruster", thruster.joint, "positive thrust is ahead here, astern in Gazebo"
            )
        parts.append(
            EffectorPart(
                name=_name(thruster.joint),
                position=placing.point(thruster.position),
                axis=axis,
                limits=limits,
                lag=LAG["thruster"],
                source="thrust [N]; place of the joint's child link, axis of the joint; lag "
                f"{LAG['thruster']:g} s assumed",
            )
        )
    return parts


def _fin_parts(gazebo_fins: list[fins.GazeboFin], placing: Placing) -> list[EffectorPart]:
    parts = []
    for fin in gazebo_fins:
        span = float(np.sqrt(fin.parameters[0]))
        axis = placing.direction(fin.axis)
        axis[np.abs(axis) < 1e-9] = 0.0
        state = (
            "fixed"
            if fin.limits is None
            else f"state [rad], limits of the joint; lag {LAG['fin']:g} s assumed"
        )
        parts.append(
            EffectorPart(
                name=_name(fin.link),
                position=placing.point(fin.position),
                axis=axis / np.linalg.norm(axis),
                limits=fin.limits,
                lag=0.0 if fin.limits is None else LAG["fin"],
                suffix="foil",
                parameters=fin.parameters,
                blade=(span / 2.0, span / 2.0),
                source="area [m²], in proportion to air_density, cla [1/rad], alpha_stall [rad], "
                f"cla_stall, a0 [rad], cda, cda_stall [1/rad], reversible; {state}",
            )
        )
    return parts


def _name(text: str) -> str:
    """A name for an effector: letters, digits and _."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).removesuffix("_joint")[:36]
    return name if re.match("[A-Za-z]", name) else f"e_{name}"[:36]


def _with_unique_names(parts: Iterable[EffectorPart]) -> list[EffectorPart]:
    """The parts, with a number after a name that another has."""
    unique: list[EffectorPart] = []
    for effector in parts:
        names = {other.name for other in unique}
        name = effector.name
        number = 2
        while name in names:
            name = f"{effector.name}_{number}"
            number += 1
        unique.append(replace(effector, name=name))
    return unique
