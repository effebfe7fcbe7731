"""The MJCF of a hull, written from numbers: each coefficient with the formula or source that it comes from."""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats

GRAVITY = 9.81
"""Of the sea's MJCF [m/s²]."""
DENSITY = 1026.0
"""Of sea water, where nothing else is given [kg/m³]."""
Number = tuple[npt.ArrayLike, str]
"""Values, and where they come from."""


@dataclass(frozen=True, kw_only=True)
class EffectorPart:
    """One actuator or fixed fin at a site of its own; see `sim.vehicle.effectors` for its kinds."""

    name: str
    place: tuple[float, float, float]
    """In the body frame [m]."""
    axis: tuple[float, float, float]
    """Unit vector along which a positive state pushes."""
    limits: tuple[float, float] | None = None
    """Of the state; None: a fixed fin, without actuator."""
    lag: float = 0.0
    """Time constant of the state [s]."""
    source: str
    """Of limits, lag and parameters."""
    suffix: str = ""
    """Of the numeric with its parameters: "curve", "propeller", "fin"; empty: a thruster, of thrust [N]."""
    parameters: tuple[float, ...] = ()
    blade: tuple[float, float] = (0.0, 0.0)
    """Half chord and half span of the box that shows a fin [m]."""


@dataclass(frozen=True, kw_only=True)
class HullFile:
    """A hull with the origin of its body frame in the centre of buoyancy; x forward, y port, z up."""

    name: str
    about: str
    """Where it comes from, for the head of the file."""
    length: float
    """For looks and places of instruments [m]."""
    diameter: float
    mass: Number
    """[kg]."""
    inertia: Number
    """About the centre of gravity: xx, yy, zz, or with xy, xz, yz [kg m²]."""
    centre: Number
    """Of gravity, in the body frame [m]."""
    numerics: dict[str, Number]
    """By the names of `sim.vehicle.coefficients.NUMERICS`."""
    effectors: Sequence[EffectorPart]

    def xml(self) -> str:
        """Text of the file."""
        radius, half, (mass, mass_source) = 0.5 * self.diameter, 0.5 * self.length, self.mass
        sites = {
            "tx_rear": (-half, 0, 0),
            "tx_front": (half, 0, 0),
            "tx_middle": (0, radius, 0),
            "hydrophone": (0, 0, radius),
            "depth_sensor": (0, 0, 0),
            "cg": self.centre[0],
        }
        inertia = np.ravel(np.asarray(self.inertia[0], dtype=np.float64))
        lines = [
            "<mujoco>",
            f"  <!-- {_comment(self.about)} -->",
            '  <compiler angle="radian" autolimits="true"/>',
            '  <option timestep="0.02" integrator="Euler" density="0" viscosity="0" gravity="0 0 -9.81"/>',
            "  <worldbody>",
            '    <body name="hull" simple="false">',
            '      <freejoint name="free"/>',
            *_remark(f"mass [kg]: {mass_source}", 6),
            *_remark(f"inertia [kg m²]: {self.inertia[1]}", 6),
            *_remark(f"centre of gravity [m]: {self.centre[1]}", 6),
            f'      <inertial pos="{numbers(self.centre[0])}" mass="{numbers(mass)}" '
            f'{"diaginertia" if inertia.size == 3 else "fullinertia"}="{numbers(inertia)}"/>',
            f'      <geom name="looks" type="capsule" size="{numbers([radius, max(half - radius, 0.01)])}" '
            'zaxis="1 0 0" mass="0" contype="0" conaffinity="0" rgba="0.93 0.80 0.12 1"/>',
        ]
        lines += [
            f'      <geom name="{part.name}" type="box" size="{numbers([*part.blade, 0.004])}" '
            f'pos="{numbers(part.place)}" zaxis="{numbers(part.axis)}" mass="0" contype="0" conaffinity="0" '
            'rgba="0.85 0.20 0.12 1"/>'
            for part in self.effectors
            if part.suffix == "fin"
        ]
        lines += [f'      <site name="{name}" pos="{numbers(place)}"/>' for name, place in sites.items()]
        for part in self.effectors:
            axis = "" if part.limits else f' zaxis="{numbers(part.axis)}"'
            lines.append(f'      <site name="{part.name}" pos="{numbers(part.place)}"{axis}/>')
        lines += ["    </body>", "  </worldbody>", "  <actuator>"]
        for part in self.effectors:
            if part.limits is None:
                continue
            gain = ' gainprm="0"' if part.suffix else ""
            lines.append(
                f'    <general name="{part.name}" site="{part.name}" gear="{numbers(part.axis)} 0 0 0" '
                f'dyntype="filterexact" dynprm="{numbers(part.lag)}"{gain} ctrlrange="{numbers(part.limits)}"/>'
            )
        lines += ["  </actuator>", "  <custom>"]
        for name, (values, source) in self.numerics.items():
            lines += [*_remark(source, 4), f'    <numeric name="{name}" data="{numbers(values)}"/>']
        for part in self.effectors:
            lines += _remark(f"{part.name}: {part.source}", 4)
            if part.suffix:
                lines.append(f'    <numeric name="{part.name}.{part.suffix}" data="{numbers(part.parameters)}"/>')
        return "\n".join([*lines, "  </custom>", "</mujoco>", ""])


def _comment(text: str) -> str:
    return escape(text).replace("--", "‐‐")


def _remark(text: str, indent: int) -> list[str]:
    return [f"{' ' * indent}<!-- {_comment(text)} -->"]


def numbers(values: npt.ArrayLike) -> str:
    """Numbers as MJCF has them, to six digits."""
    flat = np.ravel(np.asarray(values, dtype=np.float64))
    return " ".join(f"{0.0 if abs(value) < 1e-12 else value:.6g}" for value in flat)


def still_water_numerics(length: float, diameter: float) -> dict[str, Number]:
    """Coefficients by which a hull leaves the water, and that it has no lift besides."""
    n = 10
    x = length * ((np.arange(n) + 0.5) / n - 0.5)
    return {
        "hull_radius": (0.5 * diameter, "[m]: D / 2"),
        "hull_lift": ((0.7 * length * diameter, 0.0, 0.0), "area 0.7 L D [m²]; no drag, no lift beside the damping"),
        "hull_lift_planes": ((1.0, 1.0), "[-]: both planes"),
        "cross_flow_drag": ((0.0, 0.0), "[-]: in the quadratic damping"),
        "strip_x": (x, f"[m]: {n} equal lengths, which leave the water one by one"),
        "strip_area": (np.full(n, diameter * length / n), f"[m²]: D L / {n}"),
    }


def diagonal(values: npt.ArrayLike) -> Floats:
    """The 6×6 matrix with these six values on its diagonal."""
    return np.diag(np.asarray(values, dtype=np.float64))
