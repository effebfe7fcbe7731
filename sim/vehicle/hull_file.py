"""The MJCF of a hull, written from numbers with their formulas or sources, and a first hull from
its dimensions.

Coefficients of a slender body of revolution: Lamb, Hydrodynamics, 6th ed. 1932, articles 114 and
373; Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021, Section 8.4.2
and chapter 9; Hoerner, Fluid-Dynamic Drag, 1965; Anderson, Fundamentals of Aerodynamics; Allen,
Vorus and Prestero, OCEANS 2000 (REMUS 100). Sizes that follow from no formula are means of
published vehicles: Prestero, Verification of a Six-Degree of Freedom Simulation Model for the REMUS
Autonomous Underwater Vehicle, MIT and WHOI 2001; LAUV (lauv_gazebo); Tethys (osrf/lrauv); Sparus II
(University of Toulon). `docs/vehicles.md` compares what comes out with all four.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from typing import Literal
from xml.sax.saxutils import escape

import jinja2
import numpy as np
import numpy.typing as npt

from laisn.errors import LaisnError
from sim.water.waves import GRAVITY

DENSITY = 1026.0  # of sea water, where nothing else is given [kg/m³]
SourcedValues = tuple[npt.ArrayLike, str]  # values, and their formula or source


@dataclass(frozen=True, kw_only=True)
class EffectorPart:
    """One actuator or fixed fin at a site of its own; see `sim.vehicle.effectors` for its kinds."""

    name: str
    position: npt.ArrayLike  # in the body frame [m]
    axis: npt.ArrayLike  # unit vector along which a positive state pushes
    limits: tuple[float, float] | None = None  # of the state; None: a fixed fin, without actuator
    lag: float = 0.0  # time constant of the state [s]
    source: str  # of limits, lag and parameters
    # of its numeric: "curve", "propeller", "fin", "foil"; empty: a thruster, of thrust [N]
    suffix: str = ""
    parameters: tuple[float, ...] = ()  # values of the numeric, in the order of its kind
    # half chord and half span of the box that shows a fin [m]
    blade: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class HullFile:
    """A hull; x forward, y port, z up, the origin in the reference point of the coefficients."""

    name: str
    about: str  # where it comes from, for the head of the file
    length: float  # for looks and places of instruments [m]
    diameter: float  # likewise [m]
    mass: SourcedValues  # [kg]
    inertia: SourcedValues  # about the centre of gravity: xx, yy, zz, or with xy, xz, yz [kg m²]
    centre: SourcedValues  # of gravity, in the body frame [m]
    numerics: dict[str, SourcedValues]  # by the names of `sim.vehicle.mjcf.NUMERICS`
    effectors: Sequence[EffectorPart]
    # place about which looks and instruments are laid out, in the body frame [m]
    middle: npt.ArrayLike = (0.0, 0.0, 0.0)
    digits: int = 6  # of the numbers in the file

    def xml(self) -> str:
        """Text of the file."""
        radius = 0.5 * self.diameter
        half_length = 0.5 * self.length
        x, y, z = np.asarray(self.middle, dtype=np.float64)
        sites = {
            "tx_rear": (x - half_length, y, z),
            "tx_front": (x + half_length, y, z),
            "tx_middle": (x, y + radius, z),
            "hydrophone": (x, y, z + radius),
            "depth_sensor": (x, y, z),
            "cg": self.centre[0],
        }
        template = resources.files("sim.vehicle").joinpath("hull.xml.j2").read_text("utf-8")
        environment = jinja2.Environment(
            trim_blocks=True, keep_trailing_newline=True, undefined=jinja2.StrictUndefined
        )
        environment.filters |= {
            "numbers": partial(numbers, digits=self.digits),
            "comment": lambda text: escape(text).replace("--", "‐‐"),
        }
        capsule = radius, max(half_length - radius, 0.01)
        return environment.from_string(template).render(hull=self, sites=sites, capsule=capsule)


def numbers(values: npt.ArrayLike, digits: int = 6) -> str:
    """Numbers as MJCF has them, to so many digits."""
    flat = np.ravel(np.asarray(values, dtype=np.float64))
    return " ".join(f"{0.0 if abs(value) < 1e-12 else value:.{digits}g}" for value in flat)


TOP_SPEED = 2.5  # speed that the propeller is geared for [m/s]
# least and largest mass, as a share of the water in the cylinder of length and diameter
FULLNESS = (0.45, 1.0)
LENGTHS_M = (0.1, 30.0)  # shortest and longest hull
SLENDERNESS = (3.0, 50.0)  # least and largest length over diameter
PROPELLERS = (0.2, 2.0)  # smallest and largest propeller, over the diameter of the hull
FIN_ASPECT = 1.3  # span over chord of one fin; the hull mirrors it
# lift slope of a pair of fins [m²/rad] over length times diameter: geometric mean of the rudders of
# REMUS 100 (0.074), LAUV (0.237) and Tethys (0.144)
FIN_SIZE = 0.136
# roll inertia over mass times radius squared: geometric mean of REMUS 100 (0.64), LAUV (0.5),
# Tethys (0.88) and Sparus II (0.61); a cylinder has 0.5, a tube 1
ROLL_INERTIA = 0.64
# drag coefficients: of the hull on its frontal area, of a cylinder and of a plate across the flow
_DRAG = 0.42
_CROSS_FLOW = 1.1
_PLATE = 1.2
# thrust and torque coefficient of the propeller: at J = 0, and the slope over J
_K_T = (0.4566, -0.41737)
_K_Q = (0.0700, -0.058504)
_WAKE = 0.056  # wake fraction
_DEDUCTION = 0.1  # thrust deduction


def lamb_factors(length: float, diameter: float) -> tuple[float, float, float]:
    """Added mass along and across a prolate spheroid over its displaced mass, and of inertia
    (Lamb 1932): k_1 = α / (2 − α), k_2 = β / (2 − β), and
    k' = e⁴ (β − α) / ((2 − e²) (2 e² − (2 − e²) (β − α))) with the eccentricity e.
    """
    e = np.sqrt(1.0 - (diameter / length) ** 2)
    log = np.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e**2) / e**3 * (0.5 * log - e)
    beta = 1.0 / e**2 - (1.0 - e**2) / (2.0 * e**3) * log
    turning = e**4 * (beta - alpha) / ((2.0 - e**2) * (2.0 * e**2 - (2.0 - e**2) * (beta - alpha)))
    return float(alpha / (2.0 - alpha)), float(beta / (2.0 - beta)), float(turning)


def helmbold_slope(aspect: float) -> float:
    """Lift slope of a wing of small aspect ratio [1/rad] (Helmbold; Anderson)."""
    return float(2.0 * np.pi * aspect / (2.0 + np.sqrt(4.0 + aspect**2)))


def _require_dimensions(
    length: float, diameter: float, mass: float, propeller_diameter: float
) -> None:
    """LaisnError unless they are those of a slender neutral hull and its propeller [m], [kg]."""
    for name, value in (
        ("length", length),
        ("diameter", diameter),
        ("mass", mass),
        ("propeller", propeller_diameter),
    ):
        if not 0.0 < value < np.inf:
            raise LaisnError(f"{name}: expected a positive number (given: {value:g})")
    shortest, longest = LENGTHS_M
    if not shortest <= length <= longest:
        raise LaisnError(
            f"length {length:g} m: the formulas are those of hulls of {shortest:g} to {longest:g} m"
        )
    shortest_ratio, largest = SLENDERNESS
    if not shortest_ratio * diameter <= length <= largest * diameter:
        raise LaisnError(
            f"length {length:g} m, diameter {diameter:g} m: the formulas are those of slender "
            f"hulls, at least three times as long as thick, and at most {largest:g} times"
        )
    # mass of the water in the cylinder of length and diameter [kg]
    cylinder = DENSITY * np.pi * diameter**2 / 4.0 * length
    if not FULLNESS[0] <= mass / cylinder <= FULLNESS[1]:
        low, high = (share * cylinder for share in FULLNESS)
        raise LaisnError(
            f"mass {mass:g} kg: a neutral hull of {length:g} m and {diameter:g} m has {low:.3g} to "
            f"{high:.3g} kg"
        )
    smallest, widest = (share * diameter for share in PROPELLERS)
    if propeller_diameter > widest:
        raise LaisnError(
            f"propeller {propeller_diameter:g} m: at most twice the diameter of the hull, "
            f"{widest:g} m"
        )
    if propeller_diameter < smallest:
        raise LaisnError(
            f"propeller {propeller_diameter:g} m: at least {PROPELLERS[0]:g} of the diameter of "
            f"the hull, {smallest:g} m"
        )


def _transverse_share(fullness: float) -> float:
    """Transverse inertia over m (a² + b²), a half the length, b half the diameter: from 1/5, of a
    spheroid, which fills 2/3 of its cylinder, to 1/3, of the cylinder. `fullness` is the mass over
    that of the water in the cylinder.
    """
    excess = max(fullness - 2.0 / 3.0, 0.0) * 3.0
    return 0.2 + (1.0 / 3.0 - 0.2) * excess


def from_dimensions(
    length: float,
    diameter: float,
    mass: float,
    fins: Literal["x", "+"] = "+",
    propeller: float | None = None,
) -> HullFile:
    """A neutral torpedo with four moving tail fins and one propeller.

    Args:
        length: of the hull [m].
        diameter: largest [m].
        mass: with all that floods [kg].
        fins: two upright and two level ones, or four at 45°.
        propeller: diameter [m]; None: 0.7 of the hull's.

    Raises:
        LaisnError: the dimensions are not those of a slender neutral hull.
    """
    propeller_diameter = 0.7 * diameter if propeller is None else propeller
    _require_dimensions(length, diameter, mass, propeller_diameter)
    cylinder = DENSITY * np.pi * diameter**2 / 4.0 * length
    a = length / 2
    b = diameter / 2
    roll_inertia = ROLL_INERTIA * mass * b**2
    inertia = _transverse_share(mass / cylinder) * mass * (a**2 + b**2)
    surge_factor, sway_factor, yaw_factor = lamb_factors(length, diameter)
    added = np.array(
        [
            surge_factor * mass,
            sway_factor * mass,
            sway_factor * mass,
            0.3 * roll_inertia,
            yaw_factor * inertia,
            yaw_factor * inertia,
        ]
    )
    drop = 0.1 * diameter  # of the centre of gravity below that of buoyancy [m]
    area = 0.7 * length * diameter  # reference area of the hull's drag and lift [m²]
    rigid = [mass, mass, mass, roll_inertia + mass * drop**2, inertia + mass * drop**2, inertia]
    total_inertia = added + np.array(rigid)
    weight = mass * GRAVITY
    roll_rate, pitch_rate = np.sqrt(weight * drop / total_inertia[3:5])
    linear_damping = total_inertia * [
        1 / 20,
        1 / 20,
        1 / 20,
        2 * 0.3 * roll_rate,
        2 * 0.8 * pitch_rate,
        1.0,
    ]
    drag_coefficient = _DRAG * np.pi * b**2 / area
    aspect = diameter**2 / area
    lift_slope = np.pi * aspect / (1.0 + np.sqrt(1.0 + (aspect / 2.0) ** 2))

    n = 10
    ends = np.linspace(-1.0, 1.0, n + 1)
    side = np.diff(ends * np.sqrt(1.0 - ends**2) + np.arcsin(ends)) * a * b  # of the spheroid
    fin_slope = helmbold_slope(2.0 * FIN_ASPECT)
    fin_x = -0.45 * length
    pair_area = FIN_SIZE * length * diameter / fin_slope  # of two fins [m²]
    span = float(np.sqrt(FIN_ASPECT * pair_area / 2.0))
    mid_span = 0.6 * b + span / 2.0  # distance of the middle of a fin from the axis [m]
    roll_damping = 4 * 0.5 * DENSITY * _PLATE * pair_area / 2.0 * mid_span**3

    numerics: dict[str, SourcedValues] = {
        "added_mass": (
            np.diag(added),
            "6×6 by rows [kg], [kg m²]: Lamb's factors of the spheroid of L and D, times mass and "
            "inertia (Lamb 1932; "
            "Fossen 2021, 8.4.2); in roll 0.3 of the inertia (Fossen's remus100)",
        ),
        "munk_factor": (1.0, "[-]: all Coriolis and Munk terms, as of potential flow"),
        "linear_damping": (
            linear_damping,
            "[N s/m], [N m s]: time constants 20 s in surge, sway, heave, 1 s in yaw; relative "
            "damping 0.3 in roll, 0.8 in pitch (low speeds; Fossen's remus100)",
        ),
        "linear_damping_fade": (
            (3, 3, 3, 0, 0, 0),
            "[s/m]: fades as exp(−3 U), where drag and lift take over",
        ),
        "quadratic_damping": (
            (0, 0, 0, roll_damping, 0, 0),
            "[N m s²]: fins as plates across the flow of roll, coefficient 1.2 (Hoerner 1965), at "
            "mid span",
        ),
        "buoyancy": (weight, "[N]: the weight, m g, in water of buoyancy_density"),
        "buoyancy_density": (DENSITY, "[kg/m³]: sea water"),
        "displaced_inertia": (inertia, "[kg m²]: displaced water, as that of the hull"),
        "hull_radius": (b, "[m]: D / 2"),
        "hull_lift": (
            (area, drag_coefficient, lift_slope),
            "area 0.7 L D [m²]; drag 0.42 on the frontal area (Allen et al. 2000); slope π A / (1 "
            "+ √(1 + A²/4)) [1/rad], A = D² / area (Beard and McLain 2012)",
        ),
        "hull_lift_planes": ((1.0, 1.0), "[-]: both planes"),
        "cross_flow_drag": ((_CROSS_FLOW, _CROSS_FLOW), "[-]: circular cylinder (Hoerner 1965)"),
        "strip_x": (a * (ends[1:] + ends[:-1]) / 2.0, f"[m]: middles of {n} equal lengths"),
        "strip_area": (side, "[m²]: side view of the spheroid, length by length"),
    }
    drag = 0.5 * DENSITY * area * drag_coefficient * TOP_SPEED**2

    # thrust quadratic n² + linear n of the propeller at the top speed equals the drag
    quadratic = (1.0 - _DEDUCTION) * DENSITY * propeller_diameter**4 * _K_T[0]
    inflow = (1.0 - _WAKE) * TOP_SPEED
    linear = (1.0 - _DEDUCTION) * DENSITY * propeller_diameter**3 * _K_T[1] * inflow
    root = float(np.sqrt(linear**2 + 4.0 * quadratic * drag))
    rate = (root - linear) / (2.0 * quadratic)
    parts = [
        EffectorPart(
            name="propeller",
            position=(-a, 0.0, 0.0),
            axis=(1.0, 0.0, 0.0),
            limits=(-rate, rate),
            lag=1.0,
            suffix="propeller",
            parameters=(propeller_diameter, *_K_T, *_K_Q, _WAKE, _DEDUCTION, 1.0),
            source=f"state [1/s], up to that for {TOP_SPEED:g} m/s; diameter [m], K_T and K_Q "
            "falling linearly with J "
            "(Wageningen B, 3 blades, as in Fossen's remus100), wake fraction 0.056 (Allen et al. "
            "2000), thrust "
            "deduction 0.1, all of the torque on the hull; lag 1 s (remus100)",
        )
    ]
    first_angle = 45.0 if fins == "x" else 0.0  # of the port fin, from port upwards [°]
    for name, angle in zip(
        ("port", "top", "starboard", "bottom"),
        np.deg2rad(first_angle + 90.0 * np.arange(4)),
        strict=True,
    ):
        # the fins of a pair push the same way
        push = angle + np.pi / 2.0 if name in ("port", "bottom") else angle - np.pi / 2.0
        parts.append(
            EffectorPart(
                name=f"fin_{name}",
                position=(fin_x, mid_span * float(np.cos(angle)), mid_span * float(np.sin(angle))),
                axis=(0.0, float(np.cos(push)), float(np.sin(push))),
                limits=(-0.35, 0.35),
                lag=0.1,
                suffix="fin",
                parameters=(pair_area / 2.0, fin_slope, 0.44, 0.01),
                blade=(span / FIN_ASPECT / 2.0, span / 2.0),
                source=f"state [rad]; area [m²]: the pair has a lift slope of {FIN_SIZE:g} L D, "
                "the mean of three published vehicles; slope "
                f"[1/rad]: Helmbold at twice the aspect ratio {FIN_ASPECT:g}; stall 0.44 rad, "
                "±0.35 rad and lag 0.1 s "
                "assumed; drag 0.01 of a thin profile (Hoerner 1965)",
            )
        )
    return HullFile(
        name="hull",
        about=f"Estimated: laisn hull, length {length:g} m, diameter {diameter:g} m, mass {mass:g} "
        f"kg, fins {fins}, propeller {propeller_diameter:g} m. Each number has its formula; "
        "replace it by a measured one.",
        length=length,
        diameter=diameter,
        mass=(mass, "as given; neutral in sea water"),
        inertia=(
            (roll_inertia, inertia, inertia),
            f"in roll {ROLL_INERTIA:g} m b², the mean of four published vehicles; else m (a² + b²) "
            "times 1/5 (spheroid) to 1/3 (cylinder), by the share of the cylinder of L and D that "
            "its mass fills",
        ),
        centre=((0.0, 0.0, -drop), "0.1 D below the centre of buoyancy (REMUS 100 has 0.02 m)"),
        numerics=numerics,
        effectors=parts,
    )
