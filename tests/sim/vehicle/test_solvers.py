"""The two solvers of the vehicles' motion: MuJoCo, which is the reference, and each hull's
equations alone.

They share the forces of the water, and nothing of what makes accelerations and motion of them.
"""

from dataclasses import replace

import numpy as np
import pytest

import models
from experiments.flight.library import load_scenario
from laisn.errors import LaisnError
from sim.scenario.vehicles import Vehicle
from sim.simulation import simulate_motion
from sim.trajectory import Trajectory
from sim.vehicle.hull_file import from_dimensions
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.vehicle.solvers import Engine, direct_solver_error
from sim.water.ocean import Ocean
from sim.water.waves import Waves

SHIPPED = ("leader", "follower", "remus100", "lauv", "bluerov2_heavy")
TOLERANCE = 1e-9
"""Of positions [m], of velocities [m/s] and of all other quantities in their units."""


def rough_sea() -> Ocean:
    waves = Waves.jonswap(np.random.default_rng(1), significant_height_m=0.5, peak_period_s=4.0)
    change = np.array([[0.0, 0.0, 0.0], [100.0, 0.2, -0.1]])
    return Ocean(
        current_speed_m_s=0.3,
        current_direction_rad=1.0,
        current_shear_1_s=0.01,
        added_current=change,
        waves=waves,
    )


def random_hull(rng: np.random.Generator) -> str:
    """MJCF of a torpedo whose inertia, added mass and centres lie on no axis."""
    length = rng.uniform(0.8, 4.0)
    diameter = length / rng.uniform(5.0, 12.0)
    mass = rng.uniform(0.6, 0.9) * 1026.0 * np.pi / 4.0 * diameter**2 * length
    hull = from_dimensions(length, diameter, mass, "x" if rng.random() < 0.5 else "+")
    principal = np.asarray(hull.inertia[0], dtype=np.float64)
    products = 0.05 * principal[0] * rng.uniform(-1.0, 1.0, 3)
    added = np.asarray(hull.numerics["added_mass"][0], dtype=np.float64)
    root = np.sqrt(np.outer(np.diag(added), np.diag(added)))
    coupling = np.triu(0.05 * rng.uniform(-1.0, 1.0, (6, 6)) * root, 1)
    damping = np.diag(np.asarray(hull.numerics["linear_damping"][0], dtype=np.float64))
    damping[1, 5] = damping[5, 1] = 0.1 * damping[5, 5]
    centre = diameter * np.array([0.02, 0.02, -0.1]) * rng.uniform(0.5, 1.5, 3)
    numerics = {
        "added_mass": (added + coupling + coupling.T, "random"),
        "linear_damping": (damping, "random"),
        "buoyancy_centre": (0.01 * diameter * rng.uniform(-1.0, 1.0, 3), "random"),
    }
    return replace(
        hull,
        inertia=((*principal, *products), "random"),
        centre=(centre, "random"),
        numerics=hull.numerics | numerics,
        digits=15,
    ).xml()


def steered_at_random(engine: Engine, hulls: list[str], depths: list[float], time: float) -> Plant:
    """Hulls in a rough sea, whose effectors get other commands every two seconds."""
    setups = [
        VehicleSetup(
            name=f"hull{i}",
            model=hull,
            position_m=(50.0 * i, 0.0, -depth),
            heading_rad=0.3 * i,
            speed_m_s=1.0,
            settings=Vehicle.model_construct(added_mass_scale=1.1, drag_scale=0.9),
        )
        for i, (hull, depth) in enumerate(zip(hulls, depths, strict=True))
    ]
    plant = Plant(setups, rough_sea(), 0.02, engine)
    rng = np.random.default_rng(3)
    limits = plant.effectors["limits"]
    for _ in range(round(time / 2.0)):
        relative_commands = rng.uniform(-0.15, 0.15, limits.shape[:2])
        relative_commands[:, 0] = rng.uniform(0.3, 0.8, len(hulls))
        plant.step(relative_commands * limits[..., 1], 100)
    return plant


def require_same_motion(hulls: list[str], depths: list[float], time: float) -> None:
    direct, mujoco = (
        steered_at_random(engine, hulls, depths, time) for engine in ("direct", "mujoco")
    )
    assert direct.time == mujoco.time
    assert np.linalg.norm(np.diff(mujoco.pose[:, :3], axis=0), axis=1).min() > 1.0
    np.testing.assert_allclose(direct.pose, mujoco.pose, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(direct.twist, mujoco.twist, rtol=0, atol=TOLERANCE)


def fly(engine: Engine, model: str, time: float, *settings: str) -> Trajectory:
    """Flight of T5 by autopilot, up to a time [s], with a hull as the follower's, or as the
    leader's if it is "leader".
    """
    keys = (
        f"duration_s={time}",
        f"timing.engine={engine}",
        f"{'leader' if model == 'leader' else 'followers.0'}.model={model}",
        "ocean.current_speed_m_s=0.2",
        "ocean.current_direction_deg=70",
        "ocean.current_shear_per_s=0.005",
        *settings,
    )
    return simulate_motion(load_scenario("T5", keys))


def require_same_flight(model: str, time: float, *settings: str) -> None:
    direct, mujoco = (fly(engine, model, time, *settings) for engine in ("direct", "mujoco"))
    for name in ("pose", "twist", "effector_states", "water_velocity"):
        by_direct = getattr(direct, name)
        np.testing.assert_allclose(by_direct, getattr(mujoco, name), rtol=0, atol=TOLERANCE)
    # the two solvers round differently: it is not one computation compared with itself
    assert not np.array_equal(direct.pose, mujoco.pose)


JONSWAP = ("ocean.waves.kind=jonswap", "ocean.waves.height_m=0.4", "ocean.waves.period_s=5")


@pytest.mark.system
@pytest.mark.parametrize("model", SHIPPED)
def test_every_shipped_vehicle_flies_alike_by_both_solvers(model: str) -> None:
    require_same_flight(model, 1000.0, *JONSWAP)


@pytest.mark.system
def test_random_hulls_move_alike_by_both_solvers() -> None:
    rng = np.random.default_rng(11)
    require_same_motion([random_hull(rng) for _ in range(20)], [12.0] * 20, 1000.0)


@pytest.mark.system
def test_hulls_that_leave_the_water_move_alike_by_both_solvers() -> None:
    """Their added mass is that of the immersed part."""
    hulls = [models.path(name).read_text("utf-8") for name in ("leader", "follower")]
    require_same_motion(hulls, [0.05, 0.1], 60.0)


def _with_attribute(text: str, tag: str, attribute: str) -> str:
    assert tag in text
    return text.replace(tag, f"{tag} {attribute}", 1)


@pytest.mark.parametrize(
    ("tag", "attribute", "reason"),
    [
        ("<freejoint", "", ""),
        ('<body name="hull"', 'gravcomp="0.5"', "gravcomp"),
        ("<joint type='free'", "armature='2'", "armature"),
    ],
)
def test_the_direct_solver_refuses_what_mujoco_alone_solves(
    tag: str, attribute: str, reason: str
) -> None:
    text = models.path("follower").read_text("utf-8")
    if tag.startswith("<joint"):
        text = text.replace("<freejoint", tag)
    hull = _with_attribute(text, tag, attribute)
    assert reason in direct_solver_error(hull)
    assert bool(reason) == bool(direct_solver_error(hull))
    if reason:
        setup = VehicleSetup(name="mine", model=hull, position_m=(0.0, 0.0, -10.0))
        with pytest.raises(LaisnError, match=f"mine: timing.engine = 'direct': .*{reason}"):
            Plant([setup], Ocean(), 0.02, "direct")
