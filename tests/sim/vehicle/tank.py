"""A test tank: one hull from any MJCF in a `Plant`, with five thrusters in place of its
effectors.
"""

import tempfile
from pathlib import Path
from unittest.mock import patch
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

import models
from laisn.arrays import Floats
from sim import attitude
from sim.vehicle import mjcf
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

AXES = np.eye(6)[[0, 1, 2, 4, 5]]
"""Thrusters that push ahead, to port and up and turn about port and up: force and moment about
the origin, (5, 6).
"""


class Tank:
    """The hull is the only vehicle of `plant`, named "hull"."""

    def __init__(
        self,
        xml: str,
        ocean: Ocean,
        dt: float,
        numerics: dict[str, npt.ArrayLike] | None = None,
        thrusters: Floats = AXES,
    ) -> None:
        """Put a hull into the tank, at rest 50 m deep, heading east.

        Args:
            xml: its MJCF.
            ocean: the water.
            dt: step [s].
            numerics: replace those of the MJCF, strips included.
            thrusters: force, a unit vector, and moment about the origin of a newton of each thrust,
                in the body, shape (5, 6).
        """
        root = ElementTree.fromstring(xml)
        for element in [*root.findall("actuator"), *root.findall("keyframe")]:
            root.remove(element)
        for name, value in (numerics or {}).items():
            numeric = root.find(f"custom/numeric[@name='{name}']")
            assert numeric is not None, name
            numeric.set("data", text(value))
        body = root.find("worldbody/body")
        assert body is not None
        ElementTree.SubElement(body, "site", name="origin")
        if body.find("site[@name='cg']") is None:
            ElementTree.SubElement(body, "site", name="cg")
        actuators = ElementTree.SubElement(root, "actuator")
        # the plant requires a lag; `_step` sets thrusts directly, without it
        lag = {
            "dyntype": "filterexact",
            "dynprm": "1",
            "ctrllimited": "true",
            "ctrlrange": "-1e6 1e6",
        }
        for i, gear in enumerate(thrusters):
            ElementTree.SubElement(
                actuators,
                "general",
                {"name": f"thruster_{i}", "site": "origin", "gear": text(gear), **lag},
            )
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "hull.xml"
            file.write_bytes(ElementTree.tostring(root))
            with patch(
                "models.path", side_effect={"hull": file, "ocean": models.path("ocean")}.get
            ):
                setup = VehicleSetup(
                    name="hull", model="hull", position_m=(0.0, 0.0, -50.0), heading_rad=np.pi / 2
                )
                self.plant = Plant([setup], ocean, dt)
        self.pose, self.twist, self.data = self.plant.pose[0], self.plant.twist[0], self.plant.data
        self.coefficients = mjcf.read_coefficients(self.plant.model, ["hull"], ocean.density_kg_m3)[
            0
        ]
        self._placed = True

    def place(
        self,
        position: npt.ArrayLike = (0.0, 0.0, -50.0),
        quaternion: npt.ArrayLike = (1.0, 0.0, 0.0, 0.0),
        twist: npt.ArrayLike = 0.0,
        time: float = 0.0,
    ) -> None:
        """Begin elsewhere: `twist` is velocity in the world and angular velocity in the body,
        shape (6,).
        """
        self.pose[:3], self.pose[3:], self.twist[:], self.data.time = (
            position,
            quaternion,
            twist,
            time,
        )
        self._placed = True

    def step(self, thrust: npt.ArrayLike = 0.0, n: int = 1) -> None:
        """Advance by n steps of `Plant.step` under thrusts that are there at once, shape (5,)."""
        if self._placed:
            # a step needs the acceleration of the step before; at the start it is that of the start
            self.acceleration(thrust)
            self._placed = False
        self._step(thrust, n)

    def acceleration(self, thrust: npt.ArrayLike = 0.0) -> Floats:
        """World acceleration of the origin and body angular acceleration, shape (6,), leaving
        the state as it is.
        """
        pose, twist, time = self.pose.copy(), self.twist.copy(), self.data.time
        # without a step before, velocities are those of the instant as they stand, unrounded
        self.data.qacc[:] = 0.0
        self._step(thrust, 1)
        self.pose[:], self.twist[:], self.data.time = pose, twist, time
        return np.array(self.data.qacc)

    def water_wrench(self) -> Floats:
        """What the water does to the hull, but for added mass times its acceleration: force in the
        world, moment in the body, shape (6,); buoyancy included.
        """
        self.acceleration()
        return np.array(self.data.qfrc_applied)

    def _step(self, thrust: npt.ArrayLike, n: int) -> None:
        self.plant.effector_states[0] = thrust
        self.plant.step(self.plant.effector_states.copy(), n)

    @property
    def rotation(self) -> Floats:
        """Body to world, shape (3, 3)."""
        return attitude.rotate(self.pose[None, 3:], np.eye(3)).T

    @property
    def body_velocity(self) -> Floats:
        """Velocity over ground and angular velocity, both in the body, shape (6,)."""
        return np.concatenate([self.rotation.T @ self.twist[:3], self.twist[3:]])


def text(value: npt.ArrayLike) -> str:
    """Numbers as MJCF has them, to the last digit."""
    return " ".join(repr(float(number)) for number in np.ravel(np.asarray(value, dtype=np.float64)))


def hull(
    mass: float,
    inertia: npt.ArrayLike,
    cg: npt.ArrayLike = (0, 0, 0),
    sites: str = "",
    **numerics: npt.ArrayLike,
) -> str:
    """MJCF of a hull without effectors that is neutral and has, unless `numerics` say otherwise, no
    added mass, damping, lift or cross-flow drag.
    """
    values: dict[str, npt.ArrayLike] = {
        "added_mass": np.zeros((6, 6)),
        "munk_factor": 1,
        "linear_damping": np.zeros(6),
        "linear_damping_fade": np.zeros(6),
        "quadratic_damping": np.zeros(6),
        "buoyancy": mass * 9.81,
        "displaced_inertia": 0,
        "hull_radius": 0.1,
        "hull_lift": np.zeros(3),
        "hull_lift_planes": [1, 1],
        "cross_flow_drag": [0, 0],
        "strip_x": 0,
        "strip_area": 1,
    }

    lines = [
        f'<numeric name="{name}" data="{text(value)}"/>'
        for name, value in (values | numerics).items()
    ]
    return f"""<mujoco><worldbody><body name="hull" simple="false"><freejoint/>
      <inertial pos="{text(cg)}" mass="{mass!r}" diaginertia="{text(inertia)}"/>{sites}
      </body></worldbody>
      <custom>{"".join(lines)}</custom></mujoco>"""
