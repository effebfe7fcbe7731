"""What a mission costs: physics with autopilot beside the bare solver, the log, the film, and
the whole command.
"""

import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from laisn.compiled import call_address, compiled
from sim.assembly import routes_of, setups_of
from sim.film import graphics, render
from sim.film.render import FilmJob
from sim.log import writer
from sim.log.contents import Contents
from sim.scenario.parts import MissionPlan, SeaSettings
from sim.scenario.settings import Follower, Scenario
from sim.simulation import simulate
from sim.vehicle.mjcf import compose, spec_of
from sim.vehicle.mujoco_calls import NO_CONTACT, Calls, calls_of
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from tools.benchmarks.row import Row, least_time

FLEETS = {
    "leader + 1": (1, 1000.0),
    "leader + 10": (10, 400.0),
    "leader + 50": (50, 200.0),
    "remus100 + 1": (1, 1000.0),
}
"""Followers, and how long they are flown [s]; in the last both vehicles have a propeller and
four fins.
"""
AIMS = {"leader + 1": 4500.0, "leader + 10": 1500.0, "leader + 50": 350.0}
"""Real-time factors that they are to reach on one core."""


def _scenario(followers: int, duration: float, model: str = "follower") -> Scenario:
    swarm = tuple(
        Follower(name=f"follower{i}", route="T5", depth_m=9.0 + i, model=model)
        for i in range(followers)
    )
    scenario = load_scenario("T5", ())
    leader = (
        scenario.leader
        if model == "follower"
        else scenario.leader.model_copy(update={"model": model})
    )
    return scenario.model_copy(
        update={"duration_s": duration, "followers": swarm, "leader": leader}
    )


@compiled
def _stages(calls: Calls, steps: int) -> None:
    stages, model, data = calls
    for _ in range(steps):
        for stage in stages:
            call_address(stage, model, data)


def physics() -> list[Row]:
    """A physics step of a fleet: the solver alone, with hydrodynamics, and with autopilot and
    recording too.

    The floor is what a step calls of MuJoCo, and nothing else.
    """
    rows = []
    for fleet, (followers, duration) in FLEETS.items():
        kind = "remus100" if fleet.startswith("remus100") else "follower"
        scenario = _scenario(followers, duration, kind)
        routes = routes_of(MissionPlan.of(scenario))
        dt = scenario.timing.physics_step_s
        setups = setups_of(MissionPlan.of(scenario), routes)
        ocean = ocean_of(SeaSettings.of(scenario))
        steps = round(duration / dt)
        thrust = np.zeros((followers + 1, len(spec_of(kind).actuators)))
        # N of a thruster, 1/s of a propeller
        thrust[:, 0] = 10.0

        spec = compose(setups, ocean.floor_depth_m)
        spec.option.timestep = dt
        spec.option.disableflags |= NO_CONTACT
        model = spec.compile()
        data = mujoco.MjData(model)
        bare = least_time(partial(mujoco.mj_step, model, data, steps), 3) / steps * 1e6
        dry = Plant(setups, ocean, dt)
        wet = Plant(setups, ocean, dt)
        calls = calls_of(dry.model, dry.data)
        floor = least_time(partial(_stages, calls, steps), 3) / steps * 1e6
        with_water = least_time(partial(wet.step, thrust, steps), 3) / steps * 1e6
        fleets = [Plant(setups, ocean, dt) for _ in range(4)]
        flown = least_time(lambda f=fleets, r=routes, d=duration: simulate(f.pop(), r, d), 3)  # type: ignore[misc]
        per_step = flown / steps * 1e6
        rows += [
            Row(f"{fleet}: mj_step alone, no water", bare, "µs/step"),
            Row(
                f"{fleet}: with hydrodynamics",
                with_water,
                "µs/step",
                bare / with_water,
                "mj_step",
                floor,
            ),
            Row(
                f"{fleet}: with autopilot and recording",
                per_step,
                "µs/step",
                bare / per_step,
                "mj_step",
                floor,
            ),
        ]
        if fleet in AIMS:
            rows.append(
                Row(
                    f"{fleet}: real-time factor",
                    duration / flown,
                    "x",
                    duration / flown / AIMS[fleet],
                    "aim",
                )
            )
    return rows


def log() -> list[Row]:
    """Writing the log of a mission of 1000 s."""
    flight, _ = fly(load_scenario("T5", ()))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        seconds = least_time(lambda: writer.write(flight, path), 3)
        messages = sum(
            len(channel.times) for channel in Contents(path, lambda topic, _: False).topics.values()
        )
        size = path.stat().st_size
    return [
        Row("messages", messages / 1000, "k"),
        Row("writing", messages / seconds / 1000, "k/s", messages / seconds / 50_000, "50 k/s"),
        Row("size", size / 1e6, "MB"),
    ]


def film() -> list[Row]:
    """Rendering and encoding at 1280×720, by wall clock, on all cores."""
    if graphics.working() is None:
        return [Row(f"not measured: {graphics.INSTALL}", np.nan, "")]
    flight, _ = fly(load_scenario("T5", ()))
    # 300 frames spread over the whole mission
    frames = 300
    video = flight.scenario.video
    length = float(flight.trajectory.time[-1] - flight.trajectory.time[0])
    paced = video.model_copy(update={"speed_up": length * video.frame_rate_hz / frames})
    marks: list[tuple[float, float]] = []
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        job = FilmJob(flight=flight, video=paced)
        render.render(job, path, progress=lambda done: marks.append((time.perf_counter(), done)))
    seconds = time.perf_counter() - begin
    first, already = marks[0]
    last, _ = marks[-1]
    rate = frames * (1.0 - already) / max(last - first, 1e-9)
    return [
        Row("frames a second, once running", rate, "1/s", rate / 20, "20/s"),
        Row("until the first group of frames", first - begin, "s"),
        Row(f"{frames} frames in all", seconds, "s"),
    ]


def command() -> list[Row]:
    """`laisn fly T5 --no-video` from its start to its end, by wall clock, on all cores, with
    compiled code at hand.
    """
    with tempfile.TemporaryDirectory() as folder:
        call = [
            sys.executable,
            "-m",
            "laisn_sim.cli.main",
            "fly",
            "T5",
            "--no-video",
            "--out",
            folder,
        ]
        durations = []
        for _ in range(4):
            begin = time.perf_counter()
            subprocess.run(call, check=True, stdout=subprocess.DEVNULL)
            durations.append(time.perf_counter() - begin)
    # the first one compiles what is missing
    return [Row("laisn fly T5 --no-video", min(durations[1:]), "s")]
