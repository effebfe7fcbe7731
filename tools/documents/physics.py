"""Figures of `docs/physics.md`, computed by the same functions as the tests of the physics."""

import numpy as np
from matplotlib.figure import Figure

from reports.figures import Line
from reports.style import FRAME, MUTED, SERIES, Legend
from sim import attitude
from sim.water.ocean import Ocean
from sim.water.waves import Waves
from tests.sim.vehicle import test_remus as remus
from tests.sim.vehicle.tank import Tank, hull
from tests.sim.vehicle.test_hydrodynamics_kirchhoff import (
    SPHEROID_ADDED,
    SPHEROID_INERTIA,
    SPHEROID_MASS,
)
from tools.documents.drawing import draw_lines
from tools.documents.hull_trials import PUBLISHED_SPEED, PUBLISHED_TURN

Drawn = tuple[Figure, Legend]


def remus_speed() -> Drawn:
    """Speed from rest, with the published final speeds."""
    lines = []
    for i, (rpm, speed) in enumerate(PUBLISHED_SPEED.items()):
        _, history = remus.run(rpm, 25.0)
        lines.append(
            Line(
                x=np.linspace(0.0, 25.0, len(history), endpoint=False),
                y=history[:, 0],  # surge
                colour=SERIES[i],
                width=1.2,
            )
        )
        lines.append(
            Line(
                x=np.array([0.0, 25.0]), y=np.full(2, speed), colour=SERIES[i], width=0.8, dash=":"
            )
        )
    figure = draw_lines(
        lines, x_label="time [s]", y_label="speed [m/s]", title="REMUS 100, from rest"
    )
    for i, (rpm, speed) in enumerate(PUBLISHED_SPEED.items()):
        figure.axes[0].annotate(
            f"{rpm} rpm",
            (25, speed),
            xytext=(-2, 2),
            textcoords="offset points",
            ha="right",
            fontsize=7,
            color=SERIES[i].light,
        )
    return figure, [(FRAME, "dotted: published final speed")]


def remus_turn() -> Drawn:
    """Turn rate by rudder, with the published values."""
    lines = []
    rudders = np.linspace(0.0, 15.0, 13)
    for colour, (rpm, published) in zip(SERIES, PUBLISHED_TURN.items(), strict=False):
        ours = list[float]()
        for rudder in rudders:
            _, history = remus.run(rpm, 60.0, rudder_deg=rudder)
            # column 5 is the yaw rate [rad/s]
            ours.append(float(np.degrees(abs(history[-1, 5]))))
        lines.append(Line(x=rudders, y=np.array(ours), colour=colour, width=1.2))
        lines.append(
            Line(
                x=np.array([*published], dtype=float),
                y=np.array([*published.values()]),
                colour=colour,
                marker="o",
            )
        )
    figure = draw_lines(
        lines, x_label="rudder [°]", y_label="turn rate [°/s]", title="REMUS 100, steady turn"
    )
    return figure, [(SERIES[0], "1000 rpm"), (SERIES[1], "1525 rpm; dots: published")]


def pendulum() -> Drawn:
    """Pitch of a hull in ideal water that is let go at 1°, beside the closed form."""
    arm = 0.02  # from the centre of buoyancy down to that of gravity [m]
    dt = 0.002  # [s]
    duration = 45.0  # [s]
    tank = Tank(
        hull(SPHEROID_MASS, SPHEROID_INERTIA, cg=(0, 0, -arm), added_mass=SPHEROID_ADDED),
        Ocean(),
        dt,
    )
    tank.place(quaternion=attitude.from_euler(0.0, np.radians(1)))
    pitch = []
    for _ in range(round(duration / dt)):
        pitch.append(float(np.degrees(attitude.heading_pitch_roll(tank.pose[3:])[1])))
        tank.step()
    time = np.linspace(0.0, duration, len(pitch), endpoint=False)
    # the hull turns about its low centre of gravity, and its added mass surges with it
    inertia = SPHEROID_INERTIA[1] + SPHEROID_MASS * arm**2 + SPHEROID_ADDED[4, 4]
    inertia -= (SPHEROID_MASS * arm) ** 2 / (SPHEROID_MASS + SPHEROID_ADDED[0, 0])
    period = 2 * np.pi * np.sqrt(inertia / (SPHEROID_MASS * 9.81 * arm))
    dot_times = np.linspace(0.0, duration, 46)
    lines = [
        Line(x=time, y=np.array(pitch), colour=SERIES[0], width=1.2),
        Line(x=dot_times, y=np.cos(2 * np.pi * dot_times / period), colour=SERIES[1], marker="o"),
    ]
    figure = draw_lines(lines, x_label="time [s]", y_label="pitch [°]", title="Righting, no drag")
    return figure, [(SERIES[1], f"dots: closed form, period {period:.2f} s")]


def orbits() -> Drawn:
    """Paths of small neutral spheres in a wave, beside the ellipses of linear theory."""
    floor = 6.0  # depth [m]
    height = 0.5  # of the wave, from trough to crest [m]
    period = 4.0  # [s]
    radius = 0.02  # of a sphere [m]
    dt = 0.005  # [s]
    waves = Waves.regular(
        height_m=height, period_s=period, direction_rad=np.pi / 2, floor_depth_m=floor
    )
    ocean = Ocean(floor_depth_m=floor, waves=waves)
    displaced_mass = 1026 * 4 / 3 * np.pi * radius**3
    xml = hull(
        displaced_mass,
        np.full(3, 0.4 * displaced_mass * radius**2),
        hull_radius=radius,
        added_mass=np.diag([displaced_mass / 2] * 3 + [0.0] * 3),
    )
    k = float(np.hypot(*waves.wavenumber_1_m[0]))
    phase = np.linspace(0, 2 * np.pi, 200)
    lines = []
    for depth in (1.0, 2.0, 3.0, 4.0, 5.0):
        tank = Tank(xml, ocean, dt)
        start = np.array([0.0, 0.0, -depth])
        tank.place(start, twist=[*ocean.velocity(start[None], 0.0)[0], 0, 0, 0])
        path = []
        for _ in range(round(period / dt)):
            tank.step()
            path.append(tank.pose[[0, 2]])
        path_flown = np.array(path)
        half_width = height / 2 * np.cosh(k * (floor - depth)) / np.sinh(k * floor)
        half_height = height / 2 * np.sinh(k * (floor - depth)) / np.sinh(k * floor)
        lines.append(
            Line(
                x=half_width * np.cos(phase),
                y=-depth - half_height + half_height * np.sin(phase),
                colour=MUTED,
                width=2.4,
            )
        )
        lines.append(Line(x=path_flown[:, 0], y=path_flown[:, 1], colour=SERIES[0], width=1.0))
    figure = draw_lines(
        lines,
        x_label="along the wave [m]",
        y_label="height [m]",
        title="Orbits",
        equal_scales=True,
        height=4.0,
    )
    return figure, [
        (MUTED, "grey: first order in the height"),
        (SERIES[0], "neutral sphere, one period"),
    ]


def all_figures() -> dict[str, Drawn]:
    """Every figure by the name of its file."""
    return {
        "remus-speed": remus_speed(),
        "remus-turn": remus_turn(),
        "pendulum": pendulum(),
        "orbits": orbits(),
    }
