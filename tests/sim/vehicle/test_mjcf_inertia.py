"""One rigid body, its inertia written in several ways, is one vehicle."""

import re
from pathlib import Path

import numpy as np
import pytest

import laisn_sim
from laisn.arrays import Floats
from sim.control.autopilot import design
from sim.vehicle.mjcf import VehicleSetup, inertia_tensor
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

MOMENTS = (0.3, 4.02777, 4.2)
"""About the axes of the follower's body frame [kg m²], all different."""
PRODUCTS = (0.02, -0.05, 0.03)
"""xy, xz and yz of an asymmetric hull [kg m²]."""


def follower(inertia: str) -> str:
    """The project's follower with another inertia."""
    text, count = re.subn(r'diaginertia="[^"]*"', inertia, laisn_sim.hull("follower"))
    assert count == 1
    return text


def joined(components: Floats) -> str:
    return " ".join(repr(float(value)) for value in components)


def tensor_of(moments: tuple[float, ...], products: tuple[float, ...]) -> Floats:
    xy, xz, yz = products
    return np.array([[moments[0], xy, xz], [xy, moments[1], yz], [xz, yz, moments[2]]])


def principal_inertia(matrix: Floats) -> str:
    """Principal moments, and the attitude of their axes as columns of x and y."""
    moments, axes = np.linalg.eigh(matrix)
    if np.linalg.det(axes) < 0.0:
        axes = -axes
    # another order of the axes than that of `eigh`: it must not matter
    order = [1, 2, 0]
    frame = np.concatenate([axes[:, order[0]], axes[:, order[1]]])
    return f'diaginertia="{joined(moments[order])}" xyaxes="{joined(frame)}"'


def full_inertia(matrix: Floats) -> str:
    components = matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return f'fullinertia="{joined(components)}"'


ASYMMETRIC = tensor_of(MOMENTS, PRODUCTS)
INERTIAS = {
    "diagonal": (
        f'diaginertia="{joined(np.array(MOMENTS))}"',
        full_inertia(np.diag(MOMENTS)),
        principal_inertia(np.diag(MOMENTS)),
    ),
    "asymmetric": (principal_inertia(ASYMMETRIC), full_inertia(ASYMMETRIC)),
}
"""For each body, MJCF attributes that write its inertia in several ways."""


@pytest.mark.parametrize("body", INERTIAS)
def test_one_body_flies_alike_however_its_inertia_is_written(body: str, tmp_path: Path) -> None:
    """The positions of a curved, climbing flight, to a nanometre."""
    tracks = []
    for i, inertia in enumerate(INERTIAS[body]):
        file = tmp_path / f"hull{i}.xml"
        file.write_text(follower(inertia), encoding="utf-8")
        changes = {
            "followers.0.model": str(file),
            "followers.0.saw_tooth_amplitude_m": 1.0,
            "followers.0.waypoints": [[0, 0, 0], [20, 20, 0], [40, 20, 20]],
            "duration_s": 40,
        }
        tracks.append(laisn_sim.fly("T5", changes).trajectory.position[:, 1])
    for track in tracks[1:]:
        np.testing.assert_allclose(track, tracks[0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("inertia", INERTIAS["asymmetric"])
def test_autopilot_has_the_inertia_about_the_axes_of_the_body(inertia: str) -> None:
    setup = VehicleSetup(name="own", model=follower(inertia), position_m=(0.0, 0.0, -10.0))
    plant = Plant([setup], Ocean())
    body = plant.model.body("own/hull")
    np.testing.assert_allclose(inertia_tensor(plant.model, body.id), ASYMMETRIC, rtol=1e-9)
    (autopilot,) = design(plant, (None,))
    # Steiner: 31.0294 kg, 0.02 m below the origin; added inertia of the file
    assert autopilot["pitch_inertia"] == pytest.approx(4.02777 + 31.0294 * 0.02**2 + 3.42621)
    assert autopilot["yaw_inertia"] == pytest.approx(4.2 + 3.42621)
