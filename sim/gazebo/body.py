"""All links of a model as one rigid body, in the model's frame: mass, inertia, volume, size."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.gazebo.buoyancy import FileWater
from sim.gazebo.document import Remarks, child_number, child_text, is_true, numbers
from sim.gazebo.frames import SdfModel, local_pose

DEFAULT_DENSITY = 1000.0  # density of collisions of <inertial auto="true"> without any [kg/m³]


@dataclass(frozen=True)
class Solid:
    """The shape of a collision."""

    volume: float  # [m³]
    half_extents: Floats  # [m]
    unit_inertia: Floats  # 3×3, about its centre, of a mass of 1 kg [m²]


@dataclass(frozen=True)
class LinkInertia:
    """Mass and added mass of one link, in the model's frame but for the added mass."""

    mass: float  # [kg]
    centre: Floats  # of gravity [m]
    inertia: Floats  # 3×3, about the centre of gravity [kg m²]
    added_mass: Floats  # 6×6, about the link's origin, in its frame [kg], [kg m], [kg m²]
    frame: Floats  # 4×4, from the link to the model


@dataclass(frozen=True)
class SdfHull:
    """The links as one body."""

    link_inertias: list[LinkInertia]
    mass: float  # [kg]
    centre: Floats  # of gravity [m]
    inertia: Floats  # 3×3, about the centre of gravity [kg m²]
    volume: float  # of the collisions that displace water [m³]
    buoyancy_centre: Floats  # [m]
    size: Floats  # of the box about the collisions [m]
    has_unread_shape: bool  # of a collision: a mesh, or another of unknown volume


def hull_of(model: SdfModel, water: FileWater, remarks: Remarks) -> SdfHull:
    """The links of the outermost model and of those nested in it as one body.

    LaisnError if a number cannot be read, or the links have no mass.
    """
    link_inertias: list[LinkInertia] = []
    names: list[str] = []
    volumes: list[float] = []
    centres: list[Floats] = []
    corners: list[Floats] = []
    has_unread_shape = False
    for sdf_model in model.all_models():
        for name, link in sdf_model.links.items():
            names.append(name)
            link_inertias.append(_link_inertia(sdf_model, name, remarks))
            displaces = water.displaces(sdf_model, name)
            for collision in link.findall("collision"):
                solid = solid_of(collision)
                pose = sdf_model.pose_within(name, collision)
                if solid is None:
                    has_unread_shape = True
                    remarks.add_for_part("link", name, _unread_shape(collision))
                    # Gazebo takes the pose of a mesh for the centre of its volume
                    centres.append(pose[:3, 3])
                    volumes.append(0.0)
                    continue
                reach = np.abs(pose[:3, :3]) @ solid.half_extents
                centres.append(pose[:3, 3])
                volumes.append(solid.volume * displaces)
                corners.append(np.array([pose[:3, 3] - reach, pose[:3, 3] + reach]))
    hull = _joined(link_inertias, volumes, centres, corners, has_unread_shape)
    _require_possible(hull.inertia, names, link_inertias)
    return hull


def _is_possible(inertia: Floats) -> bool:
    """Whether a mass can have an inertia, 3×3: no principal moment is beyond the other two."""
    moments = np.linalg.eigvalsh(inertia)
    return bool(moments[0] > 0.0 and moments[2] <= (1.0 + 1e-6) * (moments[0] + moments[1]))


def _require_possible(inertia: Floats, names: list[str], links: list[LinkInertia]) -> None:
    """LaisnError, naming the links to blame, if no mass can have the inertia of a whole hull."""
    if _is_possible(inertia):
        return
    for name, link in zip(names, links, strict=True):
        if not _is_possible(link.inertia):
            moments = ", ".join(f"{moment:.4g}" for moment in np.linalg.eigvalsh(link.inertia))
            raise LaisnError(
                f"<inertia> of link {name!r}: no mass has principal moments {moments} kg m²; "
                "expected positive ones, none larger than the other two together"
            )


def _joined(
    link_inertias: list[LinkInertia],
    volumes: list[float],
    centres: list[Floats],
    corners: list[Floats],
    has_unread_shape: bool,
) -> SdfHull:
    masses = np.array([link.mass for link in link_inertias])
    mass = float(masses.sum())
    if not mass > 0.0:
        raise LaisnError("its links have no mass")
    centre = np.average([link.centre for link in link_inertias], axis=0, weights=masses)
    inertia = np.zeros((3, 3))
    for link in link_inertias:
        arm = link.centre - centre
        inertia += link.inertia + link.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    volume = float(np.sum(volumes))
    if volume > 0.0:
        buoyancy_centre = np.average(centres, axis=0, weights=volumes)
    else:
        buoyancy_centre = np.mean(centres, axis=0) if centres else centre
    if corners:
        box = np.array(corners)
        size = box[:, 1].max(axis=0) - box[:, 0].min(axis=0)
    else:
        size = _size_of(mass, inertia)
    return SdfHull(
        link_inertias, mass, centre, inertia, volume, buoyancy_centre, size, has_unread_shape
    )


def _size_of(mass: float, inertia: Floats) -> Floats:
    """Edges of the homogeneous box of a mass and an inertia [m]."""
    moments = np.diag(inertia)
    squares = 6.0 * (moments.sum() - 2.0 * moments) / mass
    return np.asarray(np.sqrt(np.maximum(squares, 1e-4)))


def solid_of(collision: Element) -> Solid | None:
    """The shape of a collision; None: a mesh or another of which the volume is not known."""
    shape = next(collision.iterfind("geometry/*"), None)
    if shape is None:
        return None
    if shape.tag in ("plane", "empty"):
        return Solid(0.0, np.zeros(3), np.zeros((3, 3)))
    if shape.tag == "box":
        size = numbers(child_text(shape, "size") or "1 1 1", 3, "<size>")
        return Solid(float(np.prod(size)), size / 2.0, _moments(size**2 / 12.0))
    if shape.tag == "ellipsoid":
        radii = numbers(child_text(shape, "radii") or "1 1 1", 3, "<radii>")
        return Solid(float(4.0 / 3.0 * np.pi * np.prod(radii)), radii, _moments(radii**2 / 5.0))
    if shape.tag not in ("sphere", "cylinder", "capsule", "cone"):
        return None
    radius = child_number(shape, "radius", 1.0)
    if shape.tag == "sphere":
        radii = np.full(3, radius)
        return Solid(float(4.0 / 3.0 * np.pi * radius**3), radii, _moments(radii**2 / 5.0))
    length = child_number(shape, "length", 1.0)
    if shape.tag == "cone":
        mean_square_x = 3.0 / 20.0 * radius**2
        squares = np.array([mean_square_x, mean_square_x, 3.0 / 80.0 * length**2])
        half_size = np.array([radius, radius, length / 2.0])
        return Solid(np.pi * radius**2 * length / 3.0, half_size, _moments(squares))
    cylinder = np.pi * radius**2 * length
    ends = 4.0 / 3.0 * np.pi * radius**3 if shape.tag == "capsule" else 0.0
    volume = cylinder + ends
    # integrals of the squared coordinates over cylinder and both half spheres [m⁵]
    integral_z2 = cylinder * length**2 / 12.0
    integral_z2 += ends * (length**2 / 4.0 + 3.0 / 8.0 * length * radius + radius**2 / 5.0)
    integral_x2 = cylinder * radius**2 / 4.0 + ends * radius**2 / 5.0
    squares = np.array([integral_x2, integral_x2, integral_z2]) / max(volume, 1e-300)
    half_size = np.array([radius, radius, length / 2.0 + (radius if ends else 0.0)])
    return Solid(volume, half_size, _moments(squares))


def _moments(squares: Floats) -> Floats:
    """Moments of inertia by the mean squares of the coordinates, of a mass of 1."""
    return np.diag(squares.sum() - squares)


def _link_inertia(model: SdfModel, name: str, remarks: Remarks) -> LinkInertia:
    link = model.links[name]
    frame = model.pose_of(name)
    inertial = link.find("inertial")
    if inertial is None:
        remarks.add_for_part(
            "link", name, "no <inertial>, thus as in Gazebo 1 kg and moments of 1 kg m²"
        )
        return LinkInertia(1.0, frame[:3, 3], np.eye(3), np.zeros((6, 6)), frame)
    if is_true(inertial.get("auto")):
        mass, centre, inertia = _automatic(model, name, inertial, remarks)
    else:
        inertial_frame = frame @ local_pose(inertial)
        mass = child_number(inertial, "mass", 1.0)
        centre = inertial_frame[:3, 3]
        inertia = (
            inertial_frame[:3, :3] @ _tensor(name, inertial, remarks) @ inertial_frame[:3, :3].T
        )
    if mass < 0.0:
        raise LaisnError(f"<mass> of link {name!r} must not be negative (given: {mass:g})")
    if child_text(link, "gravity").lower() in ("0", "false"):
        remarks.add_for_part("link", name, "<gravity> is off in Gazebo; its weight is counted here")
    added = inertial.find("fluid_added_mass")
    return LinkInertia(mass, centre, inertia, _fluid_added_mass(added), frame)


def _tensor(name: str, inertial: Element, remarks: Remarks) -> Floats:
    inertia = inertial.find("inertia")
    if inertia is None or inertia.find("ixx") is None:
        remarks.add_for_part("link", name, "no <ixx> …, thus as in Gazebo moments of 1 kg m²")
    if inertia is None:
        return np.eye(3)
    xx, yy, zz = (child_number(inertia, tag, 1.0) for tag in ("ixx", "iyy", "izz"))
    xy, xz, yz = (child_number(inertia, tag, 0.0) for tag in ("ixy", "ixz", "iyz"))
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _automatic(
    model: SdfModel, name: str, inertial: Element, remarks: Remarks
) -> tuple[float, Floats, Floats]:
    """Mass, centre and inertia of <inertial auto="true">: those of the collisions."""
    default = child_number(inertial, "density", DEFAULT_DENSITY)
    masses = []
    centres = []
    tensors = []
    for collision in model.links[name].findall("collision"):
        solid = solid_of(collision)
        if solid is None:
            remarks.add_for_part(
                "link", name, "<inertial auto> leaves out a collision that is not read"
            )
            continue
        pose = model.pose_within(name, collision)
        masses.append(child_number(collision, "density", default) * solid.volume)
        centres.append(pose[:3, 3])
        tensors.append(masses[-1] * pose[:3, :3] @ solid.unit_inertia @ pose[:3, :3].T)
    total = float(np.sum(masses))
    if not total > 0.0:
        raise LaisnError(
            f"link {name!r}: <inertial auto> needs a <collision> with a volume that is read"
        )
    centre = np.average(centres, axis=0, weights=masses)
    inertia = np.sum(tensors, axis=0)
    for mass, centre_of_part in zip(masses, centres, strict=True):
        arm = centre_of_part - centre
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    mass_of_link = child_number(inertial, "mass", total)
    return mass_of_link, centre, inertia * mass_of_link / total


def _fluid_added_mass(element: Element | None) -> Floats:
    """<fluid_added_mass>, 6×6: the fluid's inertia about the link's origin, positive."""
    matrix = np.zeros((6, 6))
    if element is None:
        return matrix
    axes = "xyzpqr"
    for i in range(6):
        for j in range(i, 6):
            matrix[i, j] = matrix[j, i] = child_number(element, axes[i] + axes[j], 0.0)
    return matrix


def _unread_shape(collision: Element) -> str:
    shape = next(collision.iterfind("geometry/*"), None)
    kind = "no shape" if shape is None else f"a <{shape.tag}>"
    return f"a collision is {kind}, whose volume is not read: size and buoyancy are without it"
