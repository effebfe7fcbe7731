"""Whether the MJCF of a user's own hull has all that a vehicle needs; what it lacks is named, all at once."""

import re
from typing import Any

import mujoco

from sim.vehicle import coefficients, effectors
from sim.vehicle.hull_text import strange
from sim.vehicle.mjcf import VehicleSetup, compose, resolve

_NAME = re.compile("[A-Za-z][A-Za-z0-9_]{0,39}")
"""A name of an actuator, which also names a column of the log."""
_SITES = {
    "depth_sensor": "where the pressure sensor sits",
    "cg": "the centre of gravity",
}
_INSTRUMENTS = {
    "leader": dict.fromkeys(("tx_rear", "tx_front", "tx_middle"), "a transmitter"),
    "follower": {"hydrophone": "the hydrophone"},
}


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
    for name in coefficients.NUMERICS:
        numeric = spec.numeric(name)
        fault = coefficients.fault_of(name, None if numeric is None else int(numeric.size))
        lines += [fault] if fault else []
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
        effectors.read(model, [resolve(model, "hull")])
    except ValueError as error:
        return [str(error).splitlines()[0]]
    lines = []
    if model.na != model.nu:
        lines.append('every actuator must have a state of its own: <general dyntype="filterexact" dynprm="0.3"/>')
    if not model.actuator_ctrllimited.all():
        lines.append("every actuator must have a ctrlrange, its least and its largest thrust [N]")
    if model.body_simple[model.body("hull/hull").id]:
        lines.append("the body 'hull' must have simple=\"false\", so that the added mass fits into its inertia matrix")
    return lines


def faults_of(text: str, role: str) -> list[str]:
    """What the MJCF of a hull lacks to be a vehicle.

    Args:
        text: of the file.
        role: "leader" or "follower", which carry other instruments.

    Returns:
        A line for each site, actuator and coefficient that is missing or wrong; empty if there is none.
    """
    lines = strange(text)
    if lines:
        return lines
    try:
        spec = mujoco.MjSpec.from_string(text)
    except ValueError as error:
        return [f"not valid MJCF: {str(error).splitlines()[0]}"]
    if spec.body("hull") is None:
        return ["has no body 'hull'"]
    return _missing(spec, role) + _misbuilt(spec) or _compiled(text)
