"""Fins of gz-sim's LiftDrag, with its law of forces (the MJCF numeric NAME.foil), and their hinges.

LiftDrag acts at <cp> of its link: lift along <upward>, at the incidence of the flow on <forward>.
The link turns with its joint. A fin here turns so that a positive angle of the joint is a positive
state, which pushes along the fin's axis.
"""

from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.gazebo.document import Parameters, Remarks, child_number, child_text, plugins_of
from sim.gazebo.frames import SdfModel

AIR_DENSITY = 1.2041  # of LiftDrag without <air_density> [kg/m³]
ASSUMED_ANGLE = 0.35  # of a fin without limits, either way [rad]
LARGEST_ANGLE = 1.5  # a limit beyond is none [rad]
_MOVING = ("revolute", "continuous")


@dataclass(frozen=True)
class GazeboFin:
    """A fin in the model's frame."""

    link: str
    position: Floats  # of the centre of pressure [m]
    axis: Floats  # unit vector along which a positive state pushes
    limits: tuple[float, float] | None  # of the joint [rad]; None: it does not turn
    # of NAME.foil: area [m²], slope [1/rad], stall angle [rad], slope beyond, incidence at no
    # deflection [rad], drag per incidence [1/rad], beyond the stall angle, whether reversible
    parameters: tuple[float, ...]


def fins_of(model: SdfModel, density: float, nose: Floats, remarks: Remarks) -> list[GazeboFin]:
    """All fins of a model and of those nested in it.

    Args:
        model: the outermost.
        density: of the water in which the fins' forces are Gazebo's [kg/m³].
        nose: unit vector towards the nose, in the model.
        remarks: what is left out.

    Raises:
        LaisnError: a link is missing or a number cannot be read.
    """
    fins = []
    for scope in model.all_models():
        for plugin in plugins_of(scope.element, "LiftDrag"):
            parameters = Parameters(plugin, "LiftDrag", remarks)
            fin = _read_fin(scope, parameters, density, nose, remarks)
            parameters.remark_unused()
            if fin is not None:
                fins.append(fin)
    return fins


def _read_fin(
    scope: SdfModel, parameters: Parameters, density: float, nose: Floats, remarks: Remarks
) -> GazeboFin | None:
    name = parameters.text("link_name")
    target = scope.find_link(name)
    if target is None:
        raise LaisnError(f"LiftDrag: there is no <link name={name!r}>")
    model, link = target
    frame = model.pose_of(link)
    forward = frame[:3, :3] @ _unit(parameters.vector("forward", (1.0, 0.0, 0.0)), "forward")
    upward = frame[:3, :3] @ _unit(parameters.vector("upward", (0.0, 0.0, 1.0)), "upward")
    position = frame[:3, 3] + frame[:3, :3] @ parameters.vector("cp", (0.0, 0.0, 0.0))
    ahead = float(forward @ nose)
    slope = parameters.number("cla", 1.0)
    across = upward - nose * float(upward @ nose)
    area = parameters.number("area", 1.0)
    reason = ""
    if slope <= 0.0 or area <= 0.0:
        reason = f"cla is {slope:g} and its area {area:g} m²"
    elif abs(ahead) < 0.9:
        reason = "<forward> is not along the hull"
    elif not np.linalg.norm(across) > 0.9:
        reason = "<upward> is along the hull"
    if reason:
        remarks.add_for_part("LiftDrag of", name, f"left out, {reason}")
        parameters.set_aside(list(parameters), "the fin is left out")
        return None
    is_reversible = parameters.flag("reversible")
    if ahead < 0.0 and not is_reversible:
        remarks.add_for_part(
            "LiftDrag of",
            name,
            "<forward> points astern, with which Gazebo has no lift ahead; taken as pointing ahead",
        )
    upward = across / np.linalg.norm(across)
    sense, limits = _hinge(model, link, nose, upward, remarks)
    _remark_on_unmodelled(name, parameters, remarks)
    share = _fluid_share(name, parameters, density, remarks)
    at_rest = parameters.number("a0", 0.0) * (sense if ahead > 0.0 else -sense)
    law = (
        area * share,
        slope,
        min(parameters.number("alpha_stall", np.pi / 2.0), np.pi / 2.0),
        parameters.number("cla_stall", 0.0),
        at_rest,
        parameters.number("cda", 0.01),
        parameters.number("cda_stall", 1.0),
        float(is_reversible),
    )
    return GazeboFin(name, position, sense * upward, limits, law)


def _remark_on_unmodelled(name: str, parameters: Parameters, remarks: Remarks) -> None:
    if joint := parameters.text("control_joint_name"):
        remarks.add_for_part(
            "LiftDrag of",
            name,
            f"lift by the angle of joint {joint!r} (control_joint_name) is not modelled",
        )
    if parameters.flag("radial_symmetry"):
        remarks.add_for_part(
            "LiftDrag of", name, "radial_symmetry is not used, it lifts along <upward>"
        )
    parameters.set_aside(["control_joint_rad_to_cl"], "lift by another joint is not modelled")
    parameters.set_aside(
        ["cma", "cma_stall", "cm_delta"], "the moment about the centre of pressure is not modelled"
    )


def _fluid_share(name: str, parameters: Parameters, density: float, remarks: Remarks) -> float:
    """Density of the plugin over that of the water."""
    fluid = parameters.number("air_density", AIR_DENSITY)
    share = fluid / density
    if not 0.9 < share < 1.1:
        text = "air_density is" if "air_density" in parameters else "no air_density, thus"
        remarks.add_for_part(
            "LiftDrag of",
            name,
            f"{text} {fluid:g} kg/m³ as in Gazebo; forces are {share:.3g} of those in water of "
            f"{density:g} kg/m³",
        )
    return share


def _unit(vector: Floats, name: str) -> Floats:
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise LaisnError(f"LiftDrag: <{name}> must not be zero")
    return vector / length


def _hinge(
    model: SdfModel, link: str, nose: Floats, upward: Floats, remarks: Remarks
) -> tuple[float, tuple[float, float] | None]:
    """The sense in which a positive angle pushes along `upward`, and the limits of the joint."""
    scopes = [model]
    if model.parent is not None:
        scopes.append(model.parent)
    for scope in scopes:
        for name, joint in scope.joints.items():
            turns = joint.get("type") in _MOVING
            if not turns or scope.find_link(child_text(joint, "child")) != (model, link):
                continue
            rise = float(np.cross(scope.joint_axis(name), nose) @ upward)
            if abs(rise) < 0.9:
                remarks.add_for_part(
                    "fin",
                    link,
                    f"joint {name!r} does not turn it about its span; taken as if it did",
                )
            return (-1.0 if rise < 0.0 else 1.0), _limits(scope, name, remarks)
    return 1.0, None


def _limits(model: SdfModel, name: str, remarks: Remarks) -> tuple[float, float]:
    limit = model.joints[name].find("axis/limit")
    low = -np.inf if limit is None else child_number(limit, "lower", -np.inf, np.inf)
    high = np.inf if limit is None else child_number(limit, "upper", np.inf, np.inf)
    if limit is not None:
        tags = [child.tag for child in limit if child.tag not in ("lower", "upper")]
        remarks.add_unused("joints of fins", tags, "the lag of fins is assumed instead")
    if low < -LARGEST_ANGLE or high > LARGEST_ANGLE:
        remarks.add_for_part(
            "joint", name, f"no limit of the fin's angle; ±{ASSUMED_ANGLE:g} rad is assumed"
        )
        low = -ASSUMED_ANGLE if low < -LARGEST_ANGLE else low
        high = ASSUMED_ANGLE if high > LARGEST_ANGLE else high
    if not low < high:
        raise LaisnError(
            f"<limit> of joint {name!r}: upper must be above lower (given: {low:g} and {high:g})"
        )
    return low, high
