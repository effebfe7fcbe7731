"""Numbers of `docs/physics.md`: hulls set against published figures and closed forms, as the tests set them."""

from pathlib import Path

import numpy as np

from experiments.findings import FILE, Finding, Findings, plain, record
from sim.geometry import attitude
from sim.water.ocean import Ocean
from tests.vehicle import test_remus as remus
from tests.vehicle.tank import Tank, hull
from tests.vehicle.test_kirchhoff import SPHEROID_ADDED, SPHEROID_INERTIA, SPHEROID_MASS

COMMAND = "python -m tools.documents.studies hull-trials"
MODULES = ("tools.documents.hull_trials",)
PUBLISHED_SPEED = {300: 0.4860, 500: 0.8314, 750: 1.2542, 1000: 1.6741, 1250: 2.0930, 1525: 2.5536}
"""Final speed [m/s] of a REMUS 100 in Fossen's published code, by propeller speed [1/min]."""
PUBLISHED_TURN = {1000: {5: 2.092, 10: 3.488, 15: 4.644}, 1525: {5: 3.609, 10: 5.894, 15: 7.767}}
"""Turn rate [°/s] of a REMUS 100 in Fossen's published code, by propeller speed [1/min] and rudder [°]."""
STERN_PLANE_DEG = -5.0


def _remus() -> dict[str, Finding]:
    """Final speed and its rise, steady turns, and pitch under stern planes of a REMUS 100."""
    found, rises, rates, radii = {}, [], [], []
    for rpm, published in PUBLISHED_SPEED.items():
        speed = remus.run(rpm, 100.0)[1][:, 0]
        # to the digits of the published table, lest it be rounded twice
        found[f"speed {rpm}"] = plain(round(float(speed[-1]), 4), "final speed", "m/s")
        aim = (1.0 - np.exp(-1.0)) * published
        k = int(np.argmax(speed >= aim))
        rises.append(remus.DT * (k - (speed[k] - aim) / (speed[k] - speed[k - 1])))
    found["rise slowest"] = plain(float(max(rises)), "rise to 63 % of the final speed at 300 /min", "s")
    found["rise quickest"] = plain(float(min(rises)), "rise to 63 % of the final speed at 1525 /min", "s")
    for rpm, turns in PUBLISHED_TURN.items():
        for rudder, published in turns.items():
            last = remus.run(rpm, 200.0, rudder_deg=rudder)[1][-1]
            rates.append(abs(float(np.degrees(abs(last[5]))) / published - 1.0))
            radii.append(float(np.linalg.norm(last[:3]) / abs(last[5])))
    found["turn apart"] = plain(max(rates), "largest relative difference of turn rates from the published ones")
    found["radius largest"], found["radius least"] = plain(max(radii), "radius", "m"), plain(min(radii), "radius", "m")
    for rpm in PUBLISHED_TURN:
        tank, _ = remus.run(rpm, 200.0, stern_plane_deg=STERN_PLANE_DEG)
        pitch = abs(float(np.degrees(attitude.pitch(tank.pose[3:]))))
        found[f"pitch {rpm}"] = plain(pitch, f"pitch under {STERN_PLANE_DEG:g}° of stern plane", "°")
    return found


def _righting(dt: float) -> Finding:
    """Period of a hull in ideal water that is let go at 1°."""
    tank = Tank(hull(SPHEROID_MASS, SPHEROID_INERTIA, (0, 0, -0.02), added_mass=SPHEROID_ADDED), Ocean.calm(), dt)
    tank.place(quaternion=attitude.from_euler(0.0, np.radians(1)))
    crossings: list[float] = []
    before = 1.0
    while len(crossings) < 3:
        tank.step()
        pitch = float(attitude.pitch(tank.pose[3:]))
        if before > 0.0 >= pitch:
            crossings.append(tank.data.time - dt * pitch / (pitch - before))
        before = pitch
    return plain(float(np.diff(crossings).mean()), f"righting period at a step of {dt:g} s", "s")


def findings() -> Findings:
    """Set them in motion."""
    named = _remus() | {"righting": _righting(0.02)}
    return record("hull-trials", COMMAND, MODULES, named)


def run(folder: Path) -> None:
    """Set them in motion and write the record into a folder."""
    findings().write(folder / FILE)
