"""Added mass and damping of gz-sim's Hydrodynamics plugin and of <fluid_added_mass>.

The plugin takes the velocity of its link's origin and applies its forces there, both in the link's
frame. Its names are those of SNAME (1950): <xDotU>, <xU>, <xUabsU> are derivatives of the force X,
negative where they add mass or damp; <xUU> goes with u u, of which |u| u is taken. Added mass of
<fluid_added_mass> is positive, as in Fossen's M_A.
"""

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.gazebo.body import SdfHull
from sim.gazebo.document import Parameters, Remarks, plugins_of
from sim.gazebo.frames import SdfModel

FORCES = "xyzkmn"
RATES = "UVWPQR"
TETHYS = "tethys::HydrodynamicsPlugin"
"""The plugin of MBARI's LRAUV, from which gz-sim's came."""
_TETHYS_DEFAULTS = {"xU": 20.0, "yV": 20.0, "zW": 20.0, "kP": 20.0, "mQ": 20.0, "nR": 20.0}


@dataclass(frozen=True)
class LinkCoefficients:
    """What the water does to one link, in its frame, about its origin.

    The wrench is −A ν' − C_A(ν) ν − D ν − Σ Q[i, j, k] |ν_k| ν_j.
    """

    frame: Floats  # of the link in the model
    added_mass: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    linear: Floats = field(default_factory=lambda: np.zeros((6, 6)))
    quadratic: Floats = field(default_factory=lambda: np.zeros((6, 6, 6)))


@dataclass(frozen=True)
class Matrices:
    """All links' coefficients about one point, along one set of axes: 6×6, D in −D ν and
    −D |ν| ν.
    """

    added_mass: Floats
    linear: Floats
    quadratic: Floats


def coefficients_of(
    model: SdfModel, hull: SdfHull, remarks: Remarks
) -> tuple[list[LinkCoefficients], float]:
    """Coefficients by link, and the factor of Coriolis and Munk terms, 0 or 1.

    LaisnError if a plugin's link is missing, a number cannot be read, or damping would drive the
    hull.
    """
    by_link = [
        LinkCoefficients(link.frame, link.added_mass)
        for link in hull.link_inertias
        if link.added_mass.any()
    ]
    has_fluid_added_mass = bool(by_link)
    coriolis_disabled = []
    for scope in model.all_models():
        plugins = [(plugin, False) for plugin in plugins_of(scope.element, "Hydrodynamics")]
        plugins += [(plugin, True) for plugin in plugins_of(scope.element, TETHYS)]
        for plugin, is_tethys in plugins:
            coefficients, has_coriolis = _read_plugin(scope, plugin, is_tethys, remarks)
            by_link.append(coefficients)
            if coefficients.added_mass.any():
                coriolis_disabled.append(not has_coriolis)
    if has_fluid_added_mass and coriolis_disabled:
        remarks.add(
            "added mass is in <fluid_added_mass> and in Hydrodynamics (<xDotU> …): as in Gazebo, "
            "both count"
        )
    if not any(link.added_mass.any() for link in by_link):
        remarks.add(
            "there is no added mass: take it from `laisn hull --length … --diameter … --mass …`"
        )
    return by_link, _coriolis_factor(has_fluid_added_mass, coriolis_disabled, remarks)


def _coriolis_factor(
    has_fluid_added_mass: bool, coriolis_disabled: list[bool], remarks: Remarks
) -> float:
    """Share of Coriolis and Munk terms, by what the plugins with added mass disable."""
    if any(not is_disabled for is_disabled in coriolis_disabled):
        remarks.add(
            "Coriolis and Munk terms of <xDotU> … have Fossen's sign, as those of "
            "<fluid_added_mass> in Gazebo; the Hydrodynamics plugin applies the opposite one"
        )
    if not any(coriolis_disabled):
        return 1.0
    if has_fluid_added_mass or not all(coriolis_disabled):
        remarks.add(
            "disable_coriolis is not used, as other added mass has Coriolis terms, which a hull "
            "has as a whole"
        )
        return 1.0
    remarks.add(
        "Coriolis terms are disabled: munk_factor is 0, which leaves those of the roll rate"
    )
    return 0.0


def _read_plugin(
    scope: SdfModel, plugin: Element, is_tethys: bool, remarks: Remarks
) -> tuple[LinkCoefficients, bool]:
    """Coefficients of one plugin, and whether it has Coriolis terms."""
    parameters = Parameters(plugin, "Hydrodynamics", remarks)
    link = parameters.text("link_name")
    if link not in scope.links:
        raise LaisnError(f"Hydrodynamics: model {scope.name!r} has no <link name={link!r}>")
    added = _derivatives(parameters, "{}Dot{}")
    linear = _derivatives(parameters, "{}{}")
    if is_tethys:
        for tag, value in _TETHYS_DEFAULTS.items():
            if tag not in parameters:
                linear[FORCES.index(tag[0]), RATES.index(tag[1])] = value
    _require_damping(linear, parameters)
    quadratic = _quadratic(parameters, is_tethys, remarks)
    _take_for_added_mass(added, remarks)
    has_coriolis = (
        parameters.flag("enable_coriolis", True)
        if is_tethys
        else not parameters.flag("disable_coriolis")
    )
    if parameters.flag("disable_added_mass") and added.any():
        _drop_added_mass(added, has_coriolis, remarks)
    if not np.allclose(added, added.T, rtol=1e-6, atol=1e-12):
        remarks.add("added mass is not symmetric: the mean with its transpose is taken")
    parameters.text("water_density")  # read with the water
    parameters.text("waterDensity")
    parameters.set_aside(["namespace"], "a topic of Gazebo")
    parameters.set_aside(
        ["default_current", "lookup_current_x", "lookup_current_y", "lookup_current_z"],
        "the current is the scenario's",
    )
    parameters.remark_unused()
    mean = -(added + added.T) / 2.0
    return LinkCoefficients(scope.pose_of(link), mean, -linear, quadratic), has_coriolis


def _derivatives(parameters: Parameters, form: str) -> Floats:
    """6×6 derivatives by their names, such as xU or xDotU."""
    return np.array(
        [[parameters.number(form.format(force, rate), 0.0) for rate in RATES] for force in FORCES]
    )


def _require_damping(linear: Floats, parameters: Parameters) -> None:
    for i in range(6):
        if linear[i, i] > 0.0:
            tag = f"{FORCES[i]}{RATES[i]}"
            origin = "given" if tag in parameters else f"not given, default of {TETHYS}"
            _refuse_driving(tag, linear[i, i], origin)


def _refuse_driving(tag: str, value: float, origin: str = "given") -> None:
    raise LaisnError(
        f"<{tag}> must not be positive, since it would drive the hull ({origin}: {value:g})"
    )


def _take_for_added_mass(added: Floats, remarks: Remarks) -> None:
    """Give the diagonal SNAME's sign, in place, with a remark."""
    for i in range(6):
        if added[i, i] > 0.0:
            remarks.add(
                f"<{FORCES[i]}Dot{RATES[i]}> is positive, where SNAME has minus the added mass: "
                "taken for the added mass"
            )
            added[i, i] = -added[i, i]


def _drop_added_mass(added: Floats, has_coriolis: bool, remarks: Remarks) -> None:
    text = "disable_added_mass: <xDotU> … are not used"
    if has_coriolis:
        text += ", also not for Coriolis terms, which Gazebo then still has"
    remarks.add(text)
    added[:] = 0.0


def _quadratic(parameters: Parameters, is_tethys: bool, remarks: Remarks) -> Floats:
    """Q[i, j, k] of −Q |ν_k| ν_j by names such as xUabsU and xUU; 0 where j ≠ k."""
    damping = np.zeros((6, 6, 6))
    plain_tags = []
    mixed_tags = []
    for i, j, k in np.ndindex(damping.shape):
        abs_tag = f"{FORCES[i]}{RATES[j]}abs{RATES[k]}"
        plain_tag = f"{FORCES[i]}{RATES[j]}{RATES[k]}"
        abs_value = parameters.number(abs_tag, 0.0)
        plain_value = parameters.number(plain_tag, 0.0)
        if j != k:
            values = ((plain_tag, plain_value), (abs_tag, abs_value))
            mixed_tags += [tag for tag, number in values if number]
            continue
        if i == j and abs_value + plain_value > 0.0:
            _refuse_driving(abs_tag if abs_value > 0.0 else plain_tag, abs_value + plain_value)
        if plain_value and not is_tethys:
            plain_tags.append(plain_tag)
        damping[i, j, k] = -abs_value - plain_value
    if plain_tags:
        tags = ", ".join(f"<{tag}>" for tag in plain_tags)
        remarks.add(
            f"{tags}: of u u in today's Gazebo, which drives a hull astern instead of damping, of "
            "|u| u in earlier ones; taken for |u| u (<xUabsU>)"
        )
    if mixed_tags:
        remarks.add(
            f"{', '.join(f'<{tag}>' for tag in mixed_tags)}: forces of products of two velocities "
            "are not modelled"
        )
    return damping


def about_point(coefficients: list[LinkCoefficients], rotation: Floats, point: Floats) -> Matrices:
    """The sum of all links' coefficients about one point.

    Added mass and linear damping are moved and turned exactly. Quadratic damping is that of motions
    along or about one axis each; between these, it is exact only for links with the same axes and
    origin.

    Args:
        coefficients: by link.
        rotation: 3×3, from the model's axes to the body's.
        point: origin of the body in the model [m].
    """
    added = np.zeros((6, 6))
    linear = np.zeros((6, 6))
    quadratic = np.zeros((6, 6))
    for link in coefficients:
        motion = motion_at(link.frame, rotation, point)
        added += motion.T @ link.added_mass @ motion
        linear += motion.T @ link.linear @ motion
        for j in range(6):
            velocity = motion[:, j]
            force = np.einsum("ijk,k,j->i", link.quadratic, np.abs(velocity), velocity)
            quadratic[:, j] += motion.T @ force
    return Matrices((added + added.T) / 2.0, linear, quadratic)


def motion_at(frame: Floats, rotation: Floats, point: Floats) -> Floats:
    """6×6 from the body's velocities about its origin to those of a frame's origin, along the
    frame's axes.
    """
    arm = rotation @ (frame[:3, 3] - point)
    axes = (rotation @ frame[:3, :3]).T
    cross = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
    motion = np.zeros((6, 6))
    motion[:3, :3] = motion[3:, 3:] = axes
    motion[:3, 3:] = -axes @ cross
    return motion
