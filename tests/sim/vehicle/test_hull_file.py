"""Hulls estimated by `laisn hull`: formulas by other means, and what is written flies."""

import numpy as np
import pytest
from scipy.integrate import quad
from typer.testing import CliRunner

from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim.control.autopilot import design, top_speed
from sim.control.stability import require_stable
from sim.scenario.routes import Route
from sim.simulation import simulate
from sim.vehicle import mjcf
from sim.vehicle.hull_file import from_dimensions, helmbold_slope, lamb_factors
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean
from tools.documents.hull_trials import PUBLISHED_HULLS, estimate_ratios
from tools.documents.route_keeping import tracking

DIMENSIONS = 1.8, 0.2, 50.0
"""Length and diameter [m], mass [kg]."""


def plant_of(mjcf_text: str, speed: float = 0.0, heading: float = 0.0) -> Plant:
    start = {"position_m": (0.0, 0.0, -10.0), "speed_m_s": speed, "heading_rad": heading}
    return Plant([VehicleSetup(name="own", model=mjcf_text, **start)], Ocean())  # type: ignore[arg-type]


def coefficients_of(mjcf_text: str) -> np.void:
    (coefficients,) = mjcf.read_coefficients(plant_of(mjcf_text).model, ["own"], 1026.0)
    return coefficients


@pytest.mark.parametrize("slenderness", [3.0, 9.0, 20.0])
def test_added_mass_is_that_of_lambs_integrals(slenderness: float) -> None:
    a, b = slenderness, 1.0
    alpha = a * b**2 * quad(lambda x: 1 / ((a**2 + x) ** 1.5 * (b**2 + x)), 0, np.inf)[0]
    beta = a * b**2 * quad(lambda x: 1 / ((a**2 + x) ** 0.5 * (b**2 + x) ** 2), 0, np.inf)[0]
    rotation_factor = (a**2 - b**2) ** 2 * (beta - alpha)
    rotation_factor /= (2 * (a**2 - b**2) + (a**2 + b**2) * (alpha - beta)) * (a**2 + b**2)
    expected = alpha / (2 - alpha), beta / (2 - beta), rotation_factor
    assert lamb_factors(2 * a, 2 * b) == pytest.approx(expected, rel=1e-6)


def test_slope_of_fins_has_the_limits_of_wing_theory() -> None:
    assert helmbold_slope(1e-4) == pytest.approx(np.pi / 2 * 1e-4, rel=1e-4)  # slender wing
    assert helmbold_slope(1e6) == pytest.approx(2 * np.pi, rel=1e-5)  # thin aerofoil
    assert helmbold_slope(2.6) == pytest.approx(3.09, abs=0.005)  # leader.xml


@pytest.mark.parametrize("fins", ["+", "x"])
def test_an_estimated_hull_flies(fins: str) -> None:
    text = from_dimensions(*DIMENSIONS, fins=fins, propeller=0.14).xml()  # type: ignore[arg-type]
    assert hull_errors(text, "follower") == hull_errors(text, "leader") == []
    plant = plant_of(text, speed=1.0, heading=np.pi / 2)
    autopilot = design(plant, (None,))
    require_stable(plant, autopilot, 2.0)
    # TOP_SPEED of hull_file, for which it chooses the propeller
    assert top_speed(autopilot[0]) == pytest.approx(2.5, abs=0.03)
    route = Route.at_speed("bend", [[0, 0], [50, 0], [100, 20], [150, 20]], 1.0, 10.0)
    report = tracking(simulate(plant, [route], 150.0, [None]), [route])[0]
    assert report.cross_track_rms < 0.5
    assert report.depth_error_rms < 0.2


def test_estimates_of_published_vehicles_have_no_bias() -> None:
    """Fins and inertia of REMUS 100, LAUV, Tethys and Sparus II: each within a factor of two of the
    published figure, and their geometric mean within a fifth.
    """
    ratios = {name: estimate_ratios(name) for name in PUBLISHED_HULLS}
    for quantity in (
        "inertia in roll",
        "inertia in yaw",
        "force of the rudders per angle",
        "force of the stern planes per angle",
    ):
        ratios_of_quantity = np.array(
            [
                vehicle_ratios[quantity]
                for vehicle_ratios in ratios.values()
                if quantity in vehicle_ratios
            ]
        )
        assert len(ratios_of_quantity) >= 3
        assert np.abs(np.log(ratios_of_quantity)).max() < np.log(2.0)
        assert abs(np.log(ratios_of_quantity).mean()) < np.log(1.2)


@pytest.mark.parametrize(
    "size",
    [(0.1, 0.1 / 3, 0.08), (30.0, 10.0, 2e6), (30.0, 0.6, 5000.0), (0.1, 0.002, 2.5e-4)],
    ids=["short", "thick", "long", "thin"],
)
@pytest.mark.parametrize("propeller_to_hull_diameter", [0.2, 2.0])
def test_hulls_at_the_bounds_are_complete(
    size: tuple[float, float, float], propeller_to_hull_diameter: float
) -> None:
    text = from_dimensions(*size, propeller=propeller_to_hull_diameter * size[1]).xml()
    assert hull_errors(text, "leader") == hull_errors(text, "follower") == []


def test_estimated_strips_and_buoyancy_are_those_of_the_hull() -> None:
    coefficients = coefficients_of(from_dimensions(*DIMENSIONS).xml())
    n_strips = coefficients["n_strips"]
    # side view of the spheroid: π times both half axes
    assert coefficients["strip_area"][:n_strips].sum() == pytest.approx(np.pi * 0.9 * 0.1, rel=1e-5)
    assert coefficients["buoyancy"] == pytest.approx(50.0 * 9.81)
    # drag coefficient 0.42 on the frontal area (Allen et al. 2000)
    area, drag, _ = coefficients["hull_lift"]
    assert area * drag == pytest.approx(0.42 * np.pi * 0.1**2, rel=1e-5)


@pytest.mark.parametrize(
    ("dimensions", "message"),
    [
        ((1.8, 0.7, 50.0), "at least three times as long as thick"),
        ((1.8, 0.2, 500.0), r"mass 500 kg: a neutral hull of 1\.8 m and 0\.2 m has 26\.1 to 58 kg"),
        ((-1.8, 0.2, 50.0), r"length: expected a positive number \(given: -1\.8\)"),
        ((1.8, float("nan"), 50.0), "diameter: expected a positive number"),
        ((1.8, 0.2, 50.0, "x", 0.5), r"propeller 0\.5 m: at most twice the diameter"),
        ((1.8, 0.2, 50.0, "x", 0.001), r"propeller 0\.001 m: at least 0\.2 of the diameter"),
        ((1.8, 0.2, 50.0, "x", 0.0), r"propeller: expected a positive number \(given: 0\)"),
        ((1.8, 0.2, 50.0, "x", float("inf")), "propeller: expected a positive number"),
        ((500.0, 10.0, 2e7), r"length 500 m: the formulas are those of hulls of 0\.1 to 30 m"),
        ((20.0, 0.1, 100.0), "and at most 50 times"),
        ((1.8, 0.2, float("inf")), "mass: expected a positive number"),
    ],
)
def test_dimensions_that_no_hull_has_are_refused(
    dimensions: tuple[float, ...], message: str
) -> None:
    with pytest.raises(LaisnError, match=message):
        from_dimensions(*dimensions)  # type: ignore[arg-type]


@pytest.mark.parametrize("propeller_m", ["0", "0.001", "1e9", "-1", "nan", "inf"])
def test_the_command_names_the_propeller_that_it_refuses(propeller_m: str) -> None:
    size = ["--length", "1.8", "--diameter", "0.2", "--mass", "50"]
    result = CliRunner().invoke(app, ["hull", *size, "--propeller", propeller_m])
    assert isinstance(result.exception, SystemExit | LaisnError)
    assert "propeller" in f"{result.output} {result.exception}"


def test_the_command_prints_a_hull() -> None:
    options = "--length 1.8 --diameter 0.2 --mass 50 --fins x --propeller 0.14"
    result = CliRunner().invoke(app, ["hull", *options.split()])
    assert result.exit_code == 0, result.output
    assert hull_errors(result.stdout, "follower") == []
    assert from_dimensions(1.8, 0.2, 50.0, "x", 0.14).xml() == result.stdout
