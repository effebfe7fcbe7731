"""A test tank: one hull from any MJCF, stepped with the water's forces and a wrench of the test's own."""

import mujoco
import numpy as np
import numpy.typing as npt

from sim.vehicle import coefficients, hydrodynamics
from sim.water.ocean import Ocean

Floats = npt.NDArray[np.float64]


class Tank:
    """The hull lies under the prefix "hull/"; `numerics` replace those of the MJCF, `strips` included.

    `twist` belongs to the instant and may be set at any time; MuJoCo's own lies half a step earlier.
    """

    def __init__(self, xml: str, ocean: Ocean, dt: float, numerics: dict[str, npt.ArrayLike] | None = None) -> None:
        child = mujoco.MjSpec.from_string(xml)
        for key in list(child.keys):
            child.delete(key)
        for name, value in (numerics or {}).items():
            child.delete(child.numeric(name))
            data = np.atleast_1d(np.asarray(value, dtype=np.float64)).ravel()
            child.add_numeric(name=name, data=data, size=data.size)
        child.option.timestep = dt
        spec = mujoco.MjSpec()
        spec.option.gravity = [0, 0, -9.81]
        spec.option.timestep = dt
        spec.attach(child, frame=spec.worldbody.add_frame(), prefix="hull/")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.coefficients = coefficients.read(self.model, ["hull"], ocean.density_kg_m3)
        self.water = ocean.water
        self.pose, self.twist = self.data.qpos.reshape(1, 7), self.data.qvel.reshape(1, 6)
        self._before: Floats | None = None

    def prepare(self, wrench: npt.ArrayLike = 0.0) -> None:
        """All of a step but its end: with `wrench` (force, moment about the origin), in the body, shape (6,)."""
        mujoco.mj_step1(self.model, self.data)
        applied = self.data.qfrc_applied.reshape(1, 6)
        rows = self.model.M_rowadr.astype(np.int64).reshape(1, 6)
        solver = (rows, self.data.M, applied)
        bad = hydrodynamics.apply(self.coefficients, self.pose, self.twist, self.data.time, self.water, solver)
        assert bad == -1
        own = np.zeros(6) + np.asarray(wrench, dtype=np.float64)
        applied[0, :3] += self.rotation @ own[:3]
        applied[0, 3:] += own[3:]
        mujoco.mj_factorM(self.model, self.data)

    def step(self, wrench: npt.ArrayLike = 0.0) -> None:
        """Advance by one step, to second order as `sim.vehicle.plant` does."""
        before = self.acceleration(wrench) if self._before is None else self._before
        half = self.model.opt.timestep / 2
        self.prepare(wrench)
        self.twist -= half * before
        mujoco.mj_step2(self.model, self.data)
        self._before = self.data.qacc.copy()
        self.twist += half * self._before

    def acceleration(self, wrench: npt.ArrayLike = 0.0) -> Floats:
        """World acceleration of the origin and body angular acceleration, shape (6,), leaving the state as it is."""
        pose, twist, time = self.pose.copy(), self.twist.copy(), self.data.time
        self.prepare(wrench)
        mujoco.mj_step2(self.model, self.data)
        self.pose[:], self.twist[:], self.data.time = pose, twist, time
        return self.data.qacc.copy()

    @property
    def rotation(self) -> Floats:
        """Body to world, shape (3, 3)."""
        out = np.empty(9)
        mujoco.mju_quat2Mat(out, self.pose[0, 3:])
        return out.reshape(3, 3)

    @property
    def body_velocity(self) -> Floats:
        """Velocity over ground and angular velocity, both in the body, shape (6,)."""
        return np.concatenate([self.rotation.T @ self.twist[0, :3], self.twist[0, 3:]])


def hull(mass: float, inertia: npt.ArrayLike, cg: npt.ArrayLike = (0, 0, 0), **numerics: npt.ArrayLike) -> str:
    """MJCF of a bare hull: neutral, ellipsoid-like strips of no area and no drag, unless `numerics` say otherwise."""
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
        "fin_x": 0,
        "fin_area": [0, 0],
        "fin_lift_slope": 0,
    }

    def text(value: npt.ArrayLike) -> str:
        return " ".join(repr(float(v)) for v in np.ravel(np.asarray(value, dtype=np.float64)))

    lines = [f'<numeric name="{k}" data="{text(v)}"/>' for k, v in (values | numerics).items()]
    return f"""<mujoco><worldbody><body name="hull" simple="false"><freejoint/>
      <inertial pos="{text(cg)}" mass="{mass!r}" diaginertia="{text(inertia)}"/></body></worldbody>
      <custom>{"".join(lines)}</custom></mujoco>"""
