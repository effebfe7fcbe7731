"""Whether the MJCF of a user's own hull has all that a vehicle needs; what it lacks is named, all at once.

MuJoCo warns in a file of its own where it leaves out a hull's options of the sea, so that these are checked before.
"""

import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import mujoco

import models
from sim.vehicle import coefficients, effectors
from sim.vehicle.mjcf import VehicleSetup, compose, resolve

_FILES = re.compile(r"<!DOCTYPE|<include\b|\b(?:file|file\w+|assetdir|meshdir|texturedir|plugin)\s*=", re.IGNORECASE)
_ELEMENTS = {
    "mujoco", "compiler", "option", "default", "asset", "material", "mesh", "worldbody", "body", "freejoint", "joint",
    "inertial", "geom", "site", "camera", "light", "actuator", "general", "keyframe", "key", "custom", "numeric",
    "text",
}  # fmt: skip
_NAME = re.compile("[A-Za-z][A-Za-z0-9_]{0,39}")  # a name of an actuator, which also names a column of the log
_SITES = {"depth_sensor": "where the pressure sensor sits", "cg": "the centre of gravity"}
_INSTRUMENTS = {
    "leader": dict.fromkeys(("tx_rear", "tx_front", "tx_middle"), "a transmitter"),
    "follower": {"hydrophone": "the hydrophone"},
}


def _unexpected(text: str) -> Iterator[str]:
    """A line for each thing that the text of a hull may not hold."""
    if outside := _FILES.search(text):
        yield f"names other files ({outside[0].strip()}): a hull is one file; looks are made of plain geoms"
        return
    try:
        elements = list(ElementTree.fromstring(text).iter())
    except (ElementTree.ParseError, ValueError) as error:
        yield f"not valid MJCF: {error}"
        return
    for tag in sorted({element.tag for element in elements} - _ELEMENTS):
        yield f"may not hold <{tag[:40]}>: a hull is one body, and its looks are plain geoms"
    sea = next(ElementTree.parse(models.path("ocean")).iter("option"))
    options = (item for element in elements if element.tag == "option" for item in element.items())
    for name, value in options:
        if value.split() != sea.get(name, "").split():
            yield f"<option {name}={value[:40]!r}> is a property of the sea: {sea.get(name, 'leave it out')}"


def _missing(spec: Any, role: str) -> list[str]:
    """What is not there, or has the wrong size."""
    lines = []
    for name, what in (_SITES | _INSTRUMENTS[role]).items():
        site = spec.site(name)
        if site is None:
            lines.append(f"lacks <site name={name!r}>, {what}")
        elif site.parent.name != "hull":
            lines.append(f"<site name={name!r}> must be fixed to the body 'hull'")
    count = len(spec.actuators)
    if not 1 <= count <= effectors.MOST:
        lines.append(f"has {count} actuators, expected 1 to {effectors.MOST}, each at a site of the body 'hull'")
    lines += [
        f"<general name={actuator.name[:40]!r}>: an actuator's name has letters, digits and _, the first a letter"
        for actuator in spec.actuators
        if not _NAME.fullmatch(actuator.name)
    ]
    # attached to the sea, a hull would lose actuators without a site
    lines += [
        f"<general name={actuator.name[:40]!r}>: there is no <site name={actuator.target[:40]!r}>"
        for actuator in spec.actuators
        if actuator.trntype == mujoco.mjtTrn.mjTRN_SITE and spec.site(actuator.target) is None
    ]
    for name in coefficients.NUMERICS:
        numeric = spec.numeric(name)
        fault = coefficients.numeric_error(name, None if numeric is None else int(numeric.size))
        lines += [fault] if fault else []
    # those of effectors have a point: rudder.fin
    lines += [
        f"<numeric name={numeric.name[:40]!r}> has no meaning; available: {', '.join(coefficients.NUMERICS)}"
        for numeric in spec.numerics
        if numeric.name not in coefficients.NUMERICS and "." not in numeric.name
    ]
    return lines


def _misbuilt(spec: Any) -> list[str]:
    hull = spec.body("hull")
    lines = []
    if not hull.explicitinertial or not hull.mass > 0:
        lines.append("the body 'hull' lacks <inertial pos= mass= diaginertia=>; geoms are looks and have no mass")
    joints = [joint.type for joint in spec.joints]
    if joints != [mujoco.mjtJoint.mjJNT_FREE]:
        lines.append("the body 'hull' must have one <freejoint>, and there may be no other joint")
    if len(spec.bodies) != 2:
        lines.append("there may be no body beside 'hull'")
    return lines


def _compiled(text: str) -> list[str]:
    """What keeps a hull that has all parts from swimming."""
    try:
        model = compose([VehicleSetup(name="hull", model=text, position_m=(0.0, 0.0, -10.0))]).compile()
        coefficients.read(model, ["hull"], 1026.0)
        vehicles = [resolve(model, "hull")]
        effectors.read(model, vehicles)
        effectors.read_fixed(model, vehicles)
    except ValueError as error:
        return [", ".join(str(error).splitlines()[:2])]
    lines = []
    if model.na != model.nu:
        lines.append('every actuator must have a state of its own: <general dyntype="filterexact" dynprm="0.3"/>')
    if not model.actuator_ctrllimited.all():
        lines.append("every actuator must have a ctrlrange, its least and its largest thrust [N]")
    if model.actuator_forcelimited.any():
        lines.append("no actuator may have a forcerange: ctrlrange limits the thrust")
    if model.body_simple[model.body("hull/hull").id]:
        lines.append("the body 'hull' must have simple=\"false\", so that the added mass fits into its inertia matrix")
    return lines


def hull_errors(text: str, role: str) -> list[str]:
    """A line for each thing that the MJCF of a hull lacks or has wrong for the role of "leader" or "follower"."""
    if lines := list(_unexpected(text)):
        return lines
    try:
        spec = mujoco.MjSpec.from_string(text)
    except ValueError as error:
        return [f"not valid MJCF: {', '.join(str(error).splitlines()[:2])}"]
    if spec.body("hull") is None:
        return ["has no body 'hull'"]
    return _missing(spec, role) + _misbuilt(spec) or _compiled(text)
