"""A hull from an SDF file: parameters of gz-sim's Hydrodynamics, Thruster and LiftDrag plugins.

The links become one rigid body, whose frame is Gazebo's (x forward, y port, z up) with the origin
in the centre of buoyancy. Where the only propeller stands at the front, the nose is taken to be at
−x and the body is turned round. Gazebo applies the coefficients in the frame of the link, so that
those between axes need no change of sign here; the diagonal has the signs of SNAME (1950):
derivatives of the force, negative where they damp or add mass.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from laisn.arrays import Floats
from laisn.failure import LaisnError
from sim.vehicle.hull_file import EffectorPart, HullFile, Number
from sim.water import GRAVITY

FORCES = "xyzkmn"
RATES = "UVWPQR"
THRUST = 50.0  # range of a thruster whose plugin has none [N]: a T200 at 16 V
# Gazebo's thrusters and joints have controllers and no lag of their own [s]
LAG = {"thruster": 0.2, "fin": 0.1}


class Body(NamedTuple):
    """All links as one body, in the model's frame."""

    mass: float
    centre: Floats
    inertia: Floats
    volume: float
    buoyancy_centre: Floats
    size: Floats  # of the box about all collisions


def _numbers(text: str | None, count: int, what: str) -> Floats:
    try:
        values = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        values = np.zeros(0)
    if values.size != count or not np.all(np.abs(values) < 1e12):
        raise LaisnError(
            f"{what}: expected {count} number{'s' if count > 1 else ''} (given: "
            f"{(text or '')[:40]!r})"
        )
    return values


def _number(parent: Element, name: str, default: float | str = "") -> float:
    return float(_numbers(parent.findtext(name, str(default)), 1, f"<{name}>")[0])


def _frame(element: Element, outer: Floats | None = None) -> Floats:
    """Pose of an element in the model, by that of what holds it, as a homogeneous 4×4 matrix."""
    pose = element.find("pose")
    frame = np.eye(4)
    if pose is not None:
        if pose.get("relative_to") or pose.get("rotation_format", "euler_rpy") != "euler_rpy":
            raise LaisnError(
                f"<pose> of {element.get('name')!r}: relative_to and quaternions are not read; gz "
                "sdf -p FILE prints a file without them"
            )
        values = _numbers(pose.text, 6, f"<pose> of {element.get('name')!r}")
        # fixed axes: roll, then pitch, then yaw
        turn = Rotation.from_euler("xyz", values[3:], degrees=pose.get("degrees") in ("1", "true"))
        frame[:3, :3] = turn.as_matrix()
        frame[:3, 3] = values[:3]
    return frame if outer is None else outer @ frame


def _solid(collision: Element) -> tuple[float, Floats]:
    """Volume [m³] and half extents [m] of a shape."""
    for shape in collision.iterfind("geometry/*"):
        if shape.tag in ("box", "ellipsoid"):
            name, share, volume = (
                ("size", 0.5, 1.0) if shape.tag == "box" else ("radii", 1.0, 4 / 3 * np.pi)
            )
            size = _numbers(shape.findtext(name), 3, f"<{name}>")
            return volume * float(np.prod(size)), share * size
        if shape.tag in ("sphere", "cylinder", "capsule"):
            radius = _number(shape, "radius")
            length = 0.0 if shape.tag == "sphere" else _number(shape, "length")
            ends = 0.0 if shape.tag == "cylinder" else radius
            volume = np.pi * radius**2 * (length + 4 / 3 * ends)
            return volume, np.array([radius, radius, length / 2 + ends])
    return 0.0, np.zeros(3)


def _body(links: dict[str, tuple[Element, Floats]]) -> Body:
    masses = []
    centres = []
    tensors = []
    volumes = []
    corners = []
    for link, frame in links.values():
        if (inertial := link.find("inertial")) is not None:
            own = _frame(inertial, frame)
            i = inertial.find("inertia")
            i = Element("inertia") if i is None else i
            xx, yy, zz = (_number(i, name, 1.0) for name in ("ixx", "iyy", "izz"))
            xy, xz, yz = (_number(i, name, 0.0) for name in ("ixy", "ixz", "iyz"))
            masses.append(_number(inertial, "mass", 1.0))
            centres.append(own[:3, 3])
            tensors.append(
                own[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ own[:3, :3].T
            )
        for collision in link.iter("collision"):
            at = _frame(collision, frame)
            volume, half = _solid(collision)
            reach = np.abs(at[:3, :3]) @ half
            volumes.append(volume)
            corners.append((at[:3, 3] - reach, at[:3, 3] + reach))
    mass = float(np.sum(masses))
    volume = float(np.sum(volumes))
    if not mass > 0.0:
        raise LaisnError("its links have no mass")
    centre = np.average(centres, axis=0, weights=masses)
    arms = np.array(centres) - centre
    inertia = np.sum(tensors, axis=0)
    for m, arm in zip(masses, arms, strict=True):
        inertia += m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    box = np.array(corners) if corners else np.zeros((1, 2, 3))
    middle = np.average(box.mean(axis=1), axis=0, weights=volumes) if volume > 0.0 else centre
    return Body(
        mass, centre, inertia, volume, middle, box[:, 1].max(axis=0) - box[:, 0].min(axis=0)
    )


def _plugins(model: Element, kind: str) -> Iterator[Element]:
    return (one for one in model.iter("plugin") if one.get("name", "").split("::")[-1] == kind)


def _coefficients(plugin: Element, remarks: list[str]) -> dict[str, Floats]:
    """Added mass and damping as 6×6 matrices of A and of D in −D ν and −D |ν| ν."""
    damping = "quadratic_damping"
    forms = {"Dot{}": "added_mass", "{}": "linear_damping", "{0}abs{0}": damping, "{0}{0}": damping}
    found = {kind: np.zeros((6, 6)) for kind in forms.values()}
    known = {
        "link_name",
        "namespace",
        "water_density",
        "waterDensity",
        "default_current",
        "disable_added_mass",
        "disable_coriolis",
        "lookup_current_x",
        "lookup_current_y",
        "lookup_current_z",
    }
    names = {
        f"{force}{form.format(rate)}": (kind, i, j)
        for i, force in enumerate(FORCES)
        for j, rate in enumerate(RATES)
        for form, kind in forms.items()
    }
    for child in plugin:
        if child.tag not in {*names, *known}:
            remarks.append(f"<{child.tag}> of Hydrodynamics is not read")
        if child.tag not in names:
            continue
        kind, i, j = names[child.tag]
        value = float(_numbers(child.text, 1, f"<{child.tag}>")[0])
        if kind == "added_mass" and i == j and value > 0.0:
            remarks.append(
                f"<{child.tag}> is positive, where SNAME has minus the added mass: taken for the "
                "added mass"
            )
            value = -value
        if kind != "added_mass" and i == j and value > 0.0:
            raise LaisnError(
                f"<{child.tag}> must not be positive, since it would drive the hull (given: "
                f"{value:g})"
            )
        found[kind][i, j] -= value
    added = found["added_mass"]
    if not np.allclose(added, added.T, rtol=1e-6, atol=1e-12):
        remarks.append("added mass is not symmetric: the mean with its transpose is taken")
    found["added_mass"] = (added + added.T) / 2
    if not added.any():
        remarks.append(
            "there is no added mass: take it from `laisn hull --length … --diameter … --mass …`"
        )
    return found


def _thrusters(
    model: Element, links: dict[str, tuple[Element, Floats]], remarks: list[str]
) -> Iterator[EffectorPart]:
    joints = {joint.get("name", ""): joint for joint in model.iter("joint")}
    for plugin in _plugins(model, "Thruster"):
        name = plugin.findtext("joint_name", "").strip()
        child = joints[name].findtext("child", "").strip() if name in joints else None
        if child not in links:
            raise LaisnError(f"Thruster: there is no <joint name={name!r}> with a child link")
        frame = links[child][1]
        axis = frame[:3, :3] @ _numbers(
            joints[name].findtext("axis/xyz", "0 0 1"), 3, f"<axis> of joint {name!r}"
        )
        limits = (
            _number(plugin, "min_thrust_cmd", -THRUST),
            _number(plugin, "max_thrust_cmd", THRUST),
        )
        if plugin.find("max_thrust_cmd") is None:
            remarks.append(
                f"thruster {name!r} has no max_thrust_cmd (Gazebo: 1000 N): ±{THRUST:g} N"
            )
        yield EffectorPart(
            name=_name(name),
            place=frame[:3, 3],
            axis=axis / np.linalg.norm(axis),
            limits=limits,
            lag=LAG["thruster"],
            source=f"thrust [N]; place and axis of the joint's child link; lag {LAG['thruster']:g} "
            "s assumed",
        )


def _fins(
    model: Element, links: dict[str, tuple[Element, Floats]], remarks: list[str]
) -> Iterator[EffectorPart]:
    """Fins, which lift across the hull, in the model's frame."""
    children = {joint.findtext("child", "").split("::")[-1]: joint for joint in model.iter("joint")}
    for plugin in _plugins(model, "LiftDrag"):
        link = plugin.findtext("link_name", "").strip()
        if link not in links:
            raise LaisnError(f"LiftDrag: there is no <link name={link!r}>")
        name = _name(link)
        frame = links[link][1]
        joint = children.get(link)
        limits: tuple[float, float] | None = None
        if joint is not None and joint.get("type") == "revolute":
            limit = joint.find("axis/limit")
            limits = (
                (-0.35, 0.35)
                if limit is None
                else (_number(limit, "lower", -0.35), _number(limit, "upper", 0.35))
            )
        axis = frame[:3, :3] @ _numbers(plugin.findtext("upward", "0 0 1"), 3, "<upward>")
        axis[0] = 0.0
        if not np.linalg.norm(axis) > 0.9:
            remarks.append(f"LiftDrag of {name!r} lifts along the hull and is left out")
            continue
        area = _number(plugin, "area", 1.0)
        slope = _number(plugin, "cla", 1.0)
        span = float(np.sqrt(area))
        yield EffectorPart(
            name=name,
            place=frame[:3, :3] @ _numbers(plugin.findtext("cp", "0 0 0"), 3, "<cp>")
            + frame[:3, 3],
            axis=axis / np.linalg.norm(axis),
            limits=limits,
            lag=0.0 if limits is None else LAG["fin"],
            suffix="fin",
            parameters=(area, slope, min(_number(plugin, "alpha_stall", 0.44), 1.5), 0.0),
            blade=(span / 2, span / 2),
            source="area [m²], cla [1/rad], alpha_stall [rad]; no drag at no incidence, as cda is "
            "a slope; "
            + (
                "fixed"
                if limits is None
                else f"state [rad], limits of the joint; lag {LAG['fin']:g} s assumed"
            ),
        )


def _name(text: str) -> str:
    """A name for an effector: letters, digits and _."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).removesuffix("_joint")[:40]
    return name if re.match("[A-Za-z]", name) else f"e_{name}"[:40]


def from_sdf(text: str) -> tuple[HullFile, list[str]]:
    """The hull of the first model with a Hydrodynamics plugin in the text of an SDF file; what was
    assumed or left out.

    LaisnError if it is no such file; names element and value.
    """
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise LaisnError(f"no valid SDF: {error}") from None
    models = [
        model
        for model in root.iter("model")
        if next(_plugins(model, "Hydrodynamics"), None) is not None
    ]
    if not models or models[0].find("link") is None:
        raise LaisnError(
            "has no <model> with links and a Hydrodynamics plugin; gz sdf -p FILE resolves "
            "<include>"
        )
    model = models[0]
    remarks = []
    if len(models) > 1:
        remarks.append(f"only the first of {len(models)} models is read")
    links = {link.get("name", ""): (link, _frame(link)) for link in model.findall("link")}
    body = _body(links)
    plugin = next(_plugins(model, "Hydrodynamics"))
    thrusters = list(_thrusters(model, links, remarks))
    fins = list(_fins(model, links, remarks))
    if not thrusters:
        raise LaisnError("has no Thruster plugin")
    hydrodynamic = links.get(plugin.findtext("link_name", "").strip())
    if hydrodynamic is None:
        raise LaisnError(
            f"Hydrodynamics: there is no <link name={plugin.findtext('link_name', '')!r}>"
        )
    if not np.allclose(hydrodynamic[1][:3, :3], np.eye(3)):
        raise LaisnError("the link of Hydrodynamics must not be turned in the model")

    offset = float(np.linalg.norm(body.buoyancy_centre - hydrodynamic[1][:3, 3]))
    if offset > 0.01:
        remarks.append(
            "coefficients about the link's origin are taken about the centre of buoyancy, "
            f"{offset:.2g} m away"
        )
    # the only thruster along the hull stands at the stern
    ahead = [np.asarray(one.place)[0] for one in thrusters if abs(np.asarray(one.axis)[0]) > 0.9]
    backwards = len(ahead) == 1 and ahead[0] > body.buoyancy_centre[0] + 0.25 * body.size[0]
    if backwards:
        remarks.append(
            "the propeller stands at +x: the nose is taken to be at −x, and the body turned round"
        )
    flip = np.diag([-1.0, -1.0, 1.0]) if backwards else np.eye(3)
    six = np.kron(np.eye(2), flip)
    origin = body.buoyancy_centre
    length = max(body.size[0], 0.1)
    diameter = max(float(np.sqrt(body.size[1] * body.size[2])), 0.05)
    density = _number(plugin, "water_density", _number(plugin, "waterDensity", 998.0))
    buoyancy = density * body.volume * GRAVITY
    if not 0.9 < buoyancy / (body.mass * GRAVITY) < 1.1:
        remarks.append(
            f"its collisions displace {buoyancy:.4g} N of water, it weighs "
            f"{body.mass * GRAVITY:.4g} N: the weight is taken for the buoyancy"
        )
        buoyancy = body.mass * GRAVITY
    matrices = {name: six @ matrix @ six for name, matrix in _coefficients(plugin, remarks).items()}

    def placed(part: EffectorPart) -> EffectorPart:
        """The part in the body frame; of a propeller that pushes astern, positive thrust is
        ahead.
        """
        place = flip @ (np.asarray(part.place) - origin)
        axis = flip @ np.asarray(part.axis)
        limits = part.limits
        if limits and not part.suffix and axis[0] <= -0.9:
            axis = -axis
            limits = (-limits[1], -limits[0])
        return replace(part, place=place, axis=axis, limits=limits)

    known = "gz-sim Hydrodynamics"
    n = 10
    strips = length * ((np.arange(n) + 0.5) / n - 0.5)
    numerics: dict[str, Number] = {
        "added_mass": (matrices["added_mass"], f"6×6 by rows [kg], [kg m²]: {known}, −xDotU …"),
        "munk_factor": (1.0, "[-]: all Coriolis terms, as in gz-sim"),
        "linear_damping": (
            matrices["linear_damping"],
            f"6×6 by rows [N s/m], [N m s]: {known}, −xU …",
        ),
        "linear_damping_fade": (np.zeros(6), "[s/m]: does not fade"),
        "quadratic_damping": (
            matrices["quadratic_damping"],
            f"6×6 by rows [N s²/m²], [N m s²]: {known}, −xUabsU …",
        ),
        "buoyancy": (
            buoyancy,
            f"[N]: volume of the collisions, water of {density:g} kg/m³, or the weight",
        ),
        "displaced_inertia": (
            body.mass * (length**2 + diameter**2) / 20.0,
            "[kg m²]: spheroid of its size",
        ),
        "hull_radius": (0.5 * diameter, "[m]: D / 2"),
        "hull_lift": (
            (0.7 * length * diameter, 0.0, 0.0),
            "area 0.7 L D [m²]; no drag, no lift beside the damping",
        ),
        "hull_lift_planes": ((1.0, 1.0), "[-]: both planes"),
        "cross_flow_drag": ((0.0, 0.0), "[-]: in the quadratic damping"),
        "strip_x": (strips, f"[m]: {n} equal lengths, which leave the water one by one"),
        "strip_area": (np.full(n, diameter * length / n), f"[m²]: D L / {n}"),
    }
    principal = flip @ body.inertia @ flip
    inertia = np.concatenate(
        [np.diag(principal), [principal[0, 1], principal[0, 2], principal[1, 2]]]
    )
    return HullFile(
        name=_name(model.get("name", "hull")),
        about=f"Read by laisn hull from the SDF model {model.get('name', '')!r}. Origin: the "
        "centre of buoyancy.",
        length=length,
        diameter=diameter,
        mass=(body.mass, "of all links"),
        inertia=(inertia, "of all links about their common centre"),
        centre=(flip @ (body.centre - origin), "of all links"),
        numerics=numerics,
        effectors=[placed(part) for part in (*thrusters, *fins)],
    ), remarks
