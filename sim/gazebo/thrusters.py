"""Thrusters of gz-sim: a force at the origin of the joint's child link, along the joint's axis."""

from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.gazebo.document import Parameters, Remarks, child_text, plugins_of
from sim.gazebo.frames import SdfModel

# of a command for which the file has no limit: ± so many N or rad/s
GAZEBO_LIMIT = 1000.0
_ROTATION = ("thrust_coefficient", "fluid_density", "propeller_diameter")
_CONTROL = ("velocity_control", "p_gain", "i_gain", "d_gain")
_OPEN_WATER = ("alpha_1", "alpha_2", "wake_fraction")


@dataclass(frozen=True)
class GazeboThruster:
    """A thruster in the model's frame."""

    joint: str
    position: Floats  # [m]
    axis: Floats  # unit vector of a positive thrust
    # least and largest thrust [N]; None: the file has no such limit
    least: float | None
    largest: float | None


def thrusters_of(model: SdfModel, remarks: Remarks) -> list[GazeboThruster]:
    """All thrusters of a model and of those nested in it; LaisnError if a joint is missing."""
    return [
        _read_thruster(scope, Parameters(plugin, "Thruster", remarks), remarks)
        for scope in model.all_models()
        for plugin in plugins_of(scope.element, "Thruster")
    ]


def _read_thruster(scope: SdfModel, parameters: Parameters, remarks: Remarks) -> GazeboThruster:
    name = parameters.text("joint_name")
    joint = scope.joints.get(name)
    target = None if joint is None else scope.find_link(child_text(joint, "child"))
    if target is None:
        raise LaisnError(f"Thruster: there is no <joint name={name!r}> with a child link")
    owner, link = target
    least, largest = _limits(name, parameters, remarks)
    band = parameters.number("deadband", 0.0)
    if band:
        remarks.add_for_part(
            "thruster",
            name,
            f"a deadband of {band:g} N, below which Gazebo gives no thrust, is not modelled",
        )
    parameters.set_aside(["namespace", "topic"], "topics of Gazebo")
    parameters.set_aside(_CONTROL, "the lag of the thrust is assumed instead")
    if not parameters.flag("use_angvel_cmd"):
        parameters.set_aside(_ROTATION, "of the propeller's rotation, not of the thrust")
    parameters.set_aside(
        _OPEN_WATER,
        "of the rotation; without thrust_coefficient and with use_angvel_cmd also of the thrust",
    )
    parameters.set_aside(["battery_name", "power_load"], "there is no battery")
    parameters.remark_unused()
    return GazeboThruster(name, owner.pose_of(link)[:3, 3], scope.joint_axis(name), least, largest)


def _limits(
    name: str, parameters: Parameters, remarks: Remarks
) -> tuple[float | None, float | None]:
    """Least and largest thrust [N]; None where the file has none."""
    least_command = parameters.number("min_thrust_cmd", -GAZEBO_LIMIT)
    largest_command = parameters.number("max_thrust_cmd", GAZEBO_LIMIT)
    has_least = "min_thrust_cmd" in parameters
    has_largest = "max_thrust_cmd" in parameters
    if largest_command < least_command:
        remarks.add_for_part(
            "thruster",
            name,
            "max_thrust_cmd is below min_thrust_cmd; as in Gazebo, neither is used",
        )
        has_least = has_largest = False
    if not parameters.flag("use_angvel_cmd"):
        return (least_command if has_least else None), (largest_command if has_largest else None)
    # thrust K_T ρ D⁴ ω|ω|, commanded by the rate ω [rad/s]
    coefficient = parameters.number("thrust_coefficient", 1.0)
    scale = parameters.number("fluid_density", 1000.0) * coefficient
    scale *= parameters.number("propeller_diameter", 0.02) ** 4
    remarks.add_for_part(
        "thruster",
        name,
        f"commanded in Gazebo by its rate of rotation, {scale:.4g} N per (rad/s)², here by its "
        "thrust",
    )
    least = scale * least_command * abs(least_command) if has_least else None
    largest = scale * largest_command * abs(largest_command) if has_largest else None
    return (largest, least) if scale < 0.0 else (least, largest)


def limits_of(
    thrusters: list[GazeboThruster], default: float, remarks: Remarks
) -> list[tuple[float, float]]:
    """Least and largest thrust [N] of each thruster; one that the file lacks mirrors the other, or
    is ±`default`.
    """
    limits = []
    for thruster in thrusters:
        least = thruster.least
        largest = thruster.largest
        assumed = []
        if largest is None:
            largest = -least if least is not None and least < 0.0 else default
            assumed.append(f"max_thrust_cmd {largest:.3g} N")
        if least is None:
            least = -largest if largest > 0.0 else -default
            assumed.append(f"min_thrust_cmd {least:.3g} N")
        if assumed:
            remarks.add_for_part(
                "thruster",
                thruster.joint,
                f"no limit in the file, assumed {' and '.join(assumed)} (Gazebo: "
                f"±{GAZEBO_LIMIT:g})",
            )
        if not least < largest:
            raise LaisnError(
                f"thruster {thruster.joint!r}: max_thrust_cmd must be above min_thrust_cmd (given: "
                f"{least:g} and {largest:g})"
            )
        limits.append((least, largest))
    return limits


def pushing_along(thrusters: list[GazeboThruster], axis: Floats) -> list[GazeboThruster]:
    """Thrusters that push along an axis of the model, either way."""
    return [thruster for thruster in thrusters if abs(float(np.dot(thruster.axis, axis))) > 0.9]
