"""Whether the MJCF of a user's own hull has all that a vehicle needs; what it lacks is named, all
at once.

The text is checked before MuJoCo reads it: MuJoCo lays out a height field of a billion points,
repeats a part a million times, and warns in a file of its own where it leaves out a hull's options
of the sea. A hull needs none of that.
"""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from xml.etree import ElementTree

import mujoco
import numpy as np

import models
from sim.vehicle import effectors, mjcf
from sim.vehicle.effector_kinds import MAX_EFFECTORS
from sim.vehicle.mjcf import VehicleSetup, compose, resolve

# what in a text refers to other files, or to plugins of MuJoCo
_FILES = re.compile(
    r"<!DOCTYPE|<include\b|\b(?:file|file\w+|assetdir|meshdir|texturedir|plugin)\s*=", re.IGNORECASE
)
# elements that a hull may have
_ELEMENTS = {
    "mujoco",
    "compiler",
    "option",
    "default",
    "asset",
    "material",
    "mesh",
    "worldbody",
    "body",
    "freejoint",
    "joint",
    "inertial",
    "geom",
    "site",
    "camera",
    "light",
    "actuator",
    "general",
    "keyframe",
    "key",
    "custom",
    "numeric",
    "text",
}
_MAX_NUMBER = 1e9  # largest size of a number
_LIMITS = {("numeric", "size"): 1000, ("mesh", "params"): 64}
"""Largest value of an attribute by which MuJoCo reserves memory, by element and attribute: the
number of values of a numeric, of facets or subdivisions of a mesh.
"""
_MAX_ELEMENTS = {"mesh": 20, "geom": 200, "site": 200}
"""Largest number of elements of a kind: each mesh takes memory, and MuJoCo moves each site at
every step.
"""
_MAX_COORDINATE_M = 1000.0  # farthest site from the origin along an axis [m]
# a name of an actuator, which also names a column of the log
_NAME = re.compile("[A-Za-z][A-Za-z0-9_]{0,39}")
_SITES = {"depth_sensor": "where the pressure sensor sits", "cg": "the centre of gravity"}
_INSTRUMENTS = {
    "leader": dict.fromkeys(("tx_rear", "tx_front", "tx_middle"), "a transmitter"),
    "follower": {"hydrophone": "the hydrophone"},
}


def _within(text: str, largest: float) -> bool:
    """Whether all numbers in the value of an attribute are finite and not beyond a bound."""
    for word in text.split():
        with suppress(ValueError):
            # C also reads nan(1)
            if not abs(float(re.sub(r"\(\w*\)$", "", word))) <= largest:
                return False
    return True


def _unexpected(text: str) -> Iterator[str]:
    """A line for each thing that the text of a hull may not hold."""
    outside = _FILES.search(text)
    if outside:
        yield (
            f"names other files ({outside[0].strip()}): a hull is one file; looks are made of "
            "plain geoms"
        )
        return
    try:
        elements = list(ElementTree.fromstring(text).iter())
    except (ElementTree.ParseError, ValueError) as error:
        yield f"not valid MJCF: {error}"
        return
    if elements[0].tag in ("robot", "sdf"):
        kind = {"robot": "URDF (gz sdf -p model.urdf > model.sdf converts it)", "sdf": "SDF"}
        yield (
            f"{kind[elements[0].tag]}, not MJCF: laisn hull --sdf model.sdf > model.xml makes an "
            "MJCF of an SDF file"
        )
        return
    counts = Counter(element.tag for element in elements)
    for tag in sorted(set(counts) - _ELEMENTS):
        yield f"may not hold <{tag[:40]}>: a hull is one body, and its looks are plain geoms"
    for tag, largest in _MAX_ELEMENTS.items():
        if counts[tag] > largest:
            yield f"has {counts[tag]} elements <{tag}>, at most {largest}"
    sea_options = next(ElementTree.parse(models.path("ocean")).iter("option"))
    for element in elements:
        for name, value in element.items():
            quoted = f"<{element.tag} {name}={value[:40]!r}>"
            bound = _LIMITS.get((element.tag, name), _MAX_NUMBER)
            if not _within(value, bound):
                yield f"{quoted} must be finite and within ±{bound:g}"
            if element.tag == "option" and value.split() != sea_options.get(name, "").split():
                yield f"{quoted} is a property of the sea: {sea_options.get(name, 'leave it out')}"


def _faults(spec: mujoco.MjSpec, role: str) -> Iterator[str]:
    """A line for each part that is not there, has the wrong size, or may not be there."""
    yield from _site_faults(spec, role)
    yield from _actuator_faults(spec)
    yield from _numeric_faults(spec)
    yield from _body_faults(spec)


def _site_faults(spec: mujoco.MjSpec, role: str) -> Iterator[str]:
    for name, meaning in (_SITES | _INSTRUMENTS[role]).items():
        site = spec.site(name)
        if site is None:
            yield f"lacks <site name={name!r}>, {meaning}"
        elif site.parent.name != "hull":
            yield f"<site name={name!r}> must be fixed to the body 'hull'"
    for site in spec.sites:
        if np.abs(site.pos).max() > _MAX_COORDINATE_M:
            yield f"<site name={site.name[:40]!r}>: pos must be within ±{_MAX_COORDINATE_M:g} m"


def _actuator_faults(spec: mujoco.MjSpec) -> Iterator[str]:
    count = len(spec.actuators)
    if not 1 <= count <= MAX_EFFECTORS:
        yield (
            f"has {count} actuators, expected 1 to {MAX_EFFECTORS}, each at a site of "
            "the body 'hull'"
        )
    for actuator in spec.actuators:
        if not _NAME.fullmatch(actuator.name):
            name = f"<general name={actuator.name[:40]!r}>"
            yield f"{name}: an actuator's name has letters, digits and _, the first a letter"
        if effectors.gear_length(np.asarray(actuator.gear)) == 0.0:
            name = f"<general name={actuator.name[:40]!r}>"
            yield f"{name}: gear must be a direction, as 1 0 0 0 0 0 ahead, and is zero"
    for actuator in spec.actuators:
        # attached to the sea, a hull would lose actuators without a site
        if actuator.trntype == mujoco.mjtTrn.mjTRN_SITE and spec.site(actuator.target) is None:
            yield (
                f"<general name={actuator.name[:40]!r}>: there is no <site "
                f"name={actuator.target[:40]!r}>"
            )


def _numeric_faults(spec: mujoco.MjSpec) -> Iterator[str]:
    for name in mjcf.NUMERICS:
        numeric = spec.numeric(name)
        size = None if numeric is None else int(numeric.size)
        fault = mjcf.numeric_error(name, size)
        if fault:
            yield fault
    for name in mjcf.OPTIONAL:
        numeric = spec.numeric(name)
        if numeric is not None and (fault := mjcf.numeric_error(name, int(numeric.size))):
            yield fault
    known_numerics = mjcf.NUMERICS | mjcf.OPTIONAL
    for numeric in spec.numerics:
        # those of effectors have a point: rudder.fin
        if numeric.name not in known_numerics and "." not in numeric.name:
            available = ", ".join(known_numerics)
            yield f"<numeric name={numeric.name[:40]!r}> has no meaning; available: {available}"


def _body_faults(spec: mujoco.MjSpec) -> Iterator[str]:
    hull = spec.body("hull")
    if not hull.explicitinertial or not hull.mass > 0:
        yield (
            "the body 'hull' lacks <inertial pos= mass= diaginertia=>; geoms are looks and have "
            "no mass"
        )
    if [joint.type for joint in spec.joints] != [mujoco.mjtJoint.mjJNT_FREE]:
        yield "the body 'hull' must have one <freejoint>, and there may be no other joint"
    if len(spec.bodies) != 2:
        yield "there may be no body beside 'hull'"


def _effector_faults(model: mujoco.MjModel) -> Iterator[str]:
    """A line for each actuator whose lag or range no effector can have."""
    for i in range(model.nu):
        name = f"<general name={model.actuator(i).name.removeprefix('hull/')[:40]!r}>"
        fault = mjcf.LAG_BOUNDS.fault(model.actuator_dynprm[i, 0])
        if fault:
            yield f"{name}: dynprm, its lag [s], {fault}"
        low, high = model.actuator_ctrlrange[i].tolist()
        if model.actuator_ctrllimited[i] and not low <= 0.0 <= high:
            yield (
                f"{name}: ctrlrange must hold 0, its state at rest and at the start "
                f"(given: {low:g} {high:g})"
            )


def _faults_when_compiled(text: str) -> Iterator[str]:
    """A line for each reason why a hull that has all parts cannot be simulated."""
    try:
        model = compose(
            [VehicleSetup(name="hull", model=text, position_m=(0.0, 0.0, -10.0))]
        ).compile()
        mjcf.read_coefficients(model, ["hull"], 1026.0)
        vehicles = resolve(model, ["hull"])
        effectors.read(model, vehicles)
        effectors.read_fixed(model, vehicles)
    except ValueError as error:
        yield ", ".join(str(error).splitlines()[:2])
        return
    if model.na != model.nu:
        yield (
            'every actuator must have a state of its own: <general dyntype="filterexact" '
            'dynprm="0.3"/>'
        )
    if not model.actuator_ctrllimited.all():
        yield "every actuator must have a ctrlrange, its least and its largest thrust [N]"
    yield from _effector_faults(model)
    if model.actuator_forcelimited.any():
        yield "no actuator may have a forcerange: ctrlrange limits the thrust"
    if model.body_simple[model.body("hull/hull").id]:
        yield (
            "the body 'hull' must have simple=\"false\", so that the added mass fits into its "
            "inertia matrix"
        )


def gear_remarks(text: str) -> list[str]:
    """A line for each actuator of a hull, by its MJCF, whose gear is no unit vector and is taken as
    the direction alone.
    """
    return [
        f"<general name={actuator.name!r}>: gear has the length {length:.4g}; it is taken as a "
        "direction, and ctrlrange as thrust [N]"
        for actuator in mjcf.spec_of(text, with_geoms=False).actuators
        if (length := effectors.gear_length(np.asarray(actuator.gear))) != 1.0
    ]


def hull_errors(text: str, role: str) -> list[str]:
    """A line for each site, actuator and coefficient that the MJCF of a hull lacks or has wrong.

    The role is "leader" or "follower", which carry other instruments.
    """
    lines = list(_unexpected(text))
    if lines:
        return lines
    try:
        spec = mujoco.MjSpec.from_string(text)
    except ValueError as error:
        return [f"not valid MJCF: {', '.join(str(error).splitlines()[:2])}"]
    if spec.body("hull") is None:
        return ["has no body 'hull'"]
    return list(_faults(spec, role)) or list(_faults_when_compiled(text))
