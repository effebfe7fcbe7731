"""What a mission costs: physics with autopilot beside the bare solver, the log, and the film."""

import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np

from experiments.benchmarks.row import Row, least_time
from experiments.flight.fly import fly
from experiments.flight.library import load
from experiments.flight.summary import position_and_bearing_errors
from sim.assembly import ocean_of, routes_of, setups_of
from sim.film import graphics, render
from sim.fleet import TICK, fly_fleet
from sim.log import writer
from sim.scenario.settings import Follower, Scenario
from sim.vehicle.plant import Plant

FLEETS = (1, 10)


def _scenario(followers: int, duration: float) -> Scenario:
    swarm = tuple(Follower(name=f"follower{i}", route="T5", depth_m=9.0 + i) for i in range(followers))
    return load("T5", ()).model_copy(update={"duration_s": duration, "followers": swarm})


def physics() -> list[Row]:
    """A physics step of a fleet: the solver alone, with hydrodynamics, and with autopilot and recording too."""
    rows = []
    for followers in FLEETS:
        scenario = _scenario(followers, 200.0)
        routes = routes_of(scenario)
        fleet = f"leader + {followers}"

        def plant(scenario: Scenario = scenario) -> Plant:
            dt = scenario.timing.physics_step_s
            return Plant(setups_of(scenario, routes_of(scenario)), ocean_of(scenario), dt)

        bare, wet = plant(), plant()
        substeps = round(TICK / bare.dt)
        ticks = round(scenario.duration_s / TICK)
        steps = ticks * substeps
        thrust = np.zeros((followers + 1, 5))
        thrust[:, 0] = 10.0
        floor = least_time(lambda bare=bare, n=steps: mujoco.mj_step(bare.model, bare.data, n), 3) / steps * 1e6  # type: ignore[misc]

        def swim(wet: Plant = wet, n: int = ticks, k: int = substeps, thrust: np.ndarray = thrust) -> None:
            for _ in range(n):
                wet.step(thrust, k)

        with_water = least_time(swim, 3) / steps * 1e6
        fleets = [plant() for _ in range(4)]
        flown = least_time(lambda f=fleets, r=routes, d=scenario.duration_s: fly_fleet(f.pop(), r, d), 3)  # type: ignore[misc]
        per_step = flown / steps * 1e6
        rows += [
            Row(f"{fleet}: mj_step alone, no water", floor, "µs/step"),
            Row(f"{fleet}: with hydrodynamics", with_water, "µs/step", floor / with_water, "mj_step", floor),
            Row(f"{fleet}: with autopilot and recording", per_step, "µs/step", floor / per_step, "mj_step", floor),
            Row(f"{fleet}: real-time factor", scenario.duration_s / flown, "x"),
        ]
    return rows


def log() -> list[Row]:
    """Writing the log of a mission of 1000 s."""
    flight, _ = fly(load("T5", ()))
    errors = position_and_bearing_errors(flight)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        seconds = least_time(lambda: writer.write(flight, path, errors=errors), 3)
        statistics = writer.write(flight, path, errors=errors)
    return [
        Row("messages", statistics.messages / 1000, "k"),
        Row("writing", statistics.messages / seconds / 1000, "k/s", statistics.messages / seconds / 50_000, "50 k/s"),
        Row("size", statistics.size / 1e6, "MB"),
    ]


def film() -> list[Row]:
    """Rendering and encoding at 1280×720, by wall clock, on all cores."""
    if graphics.working() is None:
        return [Row(f"not measured: {graphics.INSTALL}", np.nan, "")]
    flight, _ = fly(load("T5", ()))
    errors = position_and_bearing_errors(flight)
    begin = time.perf_counter()
    speed = render.film_speed(flight, errors=errors)
    seconds = time.perf_counter() - begin
    return [
        Row("frames a second, once running", speed.frames_per_second, "1/s", speed.frames_per_second / 20, "20/s"),
        Row("until the first frame", speed.start_s, "s"),
        Row(f"{speed.frames} frames in all", seconds, "s"),
    ]
