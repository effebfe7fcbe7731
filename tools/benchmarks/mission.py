"""What a mission costs: physics with autopilot beside the bare solver, in calm water and in waves,
the log, and the film beside a bare renderer.
"""

import resource
import tempfile
import time
from functools import partial
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np

from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from laisn.compiled import call_address, compiled
from laisn.simd import LANES
from sim.assembly import routes_of, setups_of
from sim.film import graphics, render
from sim.film.render import FilmJob
from sim.log import reader, writer
from sim.log.contents import Contents
from sim.scenario.parts import MissionPlan, MotionSettings, SeaSettings
from sim.scenario.settings import Follower, Scenario
from sim.side_by_side import fly_group
from sim.simulation import mission_for_lanes, new_mission, simulate
from sim.vehicle.mjcf import compose, spec_of
from sim.vehicle.mujoco_calls import NO_CONTACT, Calls, calls_of
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from tools.benchmarks.row import Goal, Row, least_time, least_times, time_of_command

FLEETS = {
    "leader + 1": (1, 1000.0),
    "leader + 10": (10, 400.0),
    "leader + 50": (50, 200.0),
    "leader + 200": (200, 60.0),
    "remus100 + 1": (1, 1000.0),
}
"""Followers, and how long they are flown [s]; in the last both vehicles have a propeller and
four fins.
"""
GOALS = {"leader + 1": 4500.0, "leader + 10": 1500.0, "leader + 50": 350.0, "leader + 200": 60.0}
"""Real-time factors that they are to reach on one core."""
FRONT = resources.files("experiments") / "studies" / "front" / "front.nc"
"""A current from a file."""
_ENGINES_S = 200.0  # length of the missions by which solvers are compared
_REPEATS = 3
MODEL_TIME_RATIO_GOAL = 5.0
"""A model of four times as many vehicles is to be made in at most so many times the time."""


def _scenario(followers: int, duration: float, model: str = "follower") -> Scenario:
    """T5 with so many followers on its route, each 1 m deeper than the one before, for a duration
    [s]; a model other than the follower's is the leader's, too.
    """
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
    """The functions of MuJoCo that a step of the plant calls, without anything between them."""
    stages, model, data = calls
    for _ in range(steps):
        for stage in stages:
            call_address(stage, model, data)


def physics() -> list[Row]:
    """A physics step of a fleet: the solver alone, with hydrodynamics, and with autopilot and
    recording too.

    The floor is the time of what a step calls of MuJoCo, alone.
    """
    rows = []
    for fleet, (followers, duration) in FLEETS.items():
        vehicle_model = "remus100" if fleet.startswith("remus100") else "follower"
        scenario = _scenario(followers, duration, vehicle_model)
        routes = routes_of(MissionPlan.of(scenario))
        dt = scenario.timing.physics_step_s
        setups = setups_of(MissionPlan.of(scenario), routes)
        ocean = ocean_of(SeaSettings.of(scenario))
        steps = round(duration / dt)
        commands = np.zeros((followers + 1, len(spec_of(vehicle_model).actuators)))
        # of the first effector: N of a thruster, 1/s of a propeller
        commands[:, 0] = 10.0

        spec = compose(setups, ocean.floor_depth_m)
        spec.option.timestep = dt
        spec.option.disableflags |= NO_CONTACT
        model = spec.compile()
        data = mujoco.MjData(model)
        # times of a step from here on [µs]
        bare = least_time(partial(mujoco.mj_step, model, data, steps), 3) / steps * 1e6
        # one for MuJoCo's stages alone, and one for whole steps, with hydrodynamics
        dry = Plant(setups, ocean, dt)
        wet = Plant(setups, ocean, dt)
        calls = calls_of(dry.model, dry.data)
        floor = least_time(partial(_stages, calls, steps), 3) / steps * 1e6
        with_water = least_time(partial(wet.step, commands, steps), 3) / steps * 1e6
        plants = [Plant(setups, ocean, dt) for _ in range(4)]
        seconds = least_time(lambda p=plants, r=routes, d=duration: simulate(p.pop(), r, d), 3)  # type: ignore[misc]
        per_step = seconds / steps * 1e6
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
        if fleet in GOALS:
            goal = Goal(GOALS[fleet], at_least=True)
            rows.append(Row(f"{fleet}: real-time factor", duration / seconds, "x", goal=goal))
    return rows


def engines() -> list[Row]:
    """A physics step of one vehicle of T5 by each solver, and of missions side by side, with
    autopilot and recording, in calm water, in a current from a file and in waves; and of eleven
    vehicles of one mission.
    """
    calm = _scenario(1, _ENGINES_S)
    rough = load_scenario("T5", (f"duration_s={_ENGINES_S}", "ocean.waves.kind=jonswap"))
    field = load_scenario("T5", (f"duration_s={_ENGINES_S}", f'ocean.current.file="{FRONT}"'))
    return [
        *_solvers(calm, "a vehicle"),
        *_solvers(field, "a vehicle in a field"),
        *_solvers(rough, "a vehicle in JONSWAP"),
        *_fleet(),
    ]


def _direct(scenario: Scenario) -> Scenario:
    """A scenario by the direct solver."""
    timing = scenario.timing.model_copy(update={"engine": "direct"})
    return scenario.model_copy(update={"timing": timing})


def _varied(scenario: Scenario, i: int) -> Scenario:
    """A scenario whose hulls have the drag of number i: missions with equal ones share motions."""
    scale = 1.0 + 0.01 * i
    vehicles = [scenario.leader, *scenario.followers]
    leader, *followers = (each.model_copy(update={"drag_scale": scale}) for each in vehicles)
    return scenario.model_copy(update={"leader": leader, "followers": tuple(followers)})


def _solvers(scenario: Scenario, name: str) -> list[Row]:
    """A physics step of one of two vehicles, by each solver and side by side."""
    steps = round(_ENGINES_S / scenario.timing.physics_step_s) * 2
    by_direct = _direct(scenario)
    rounds = range(_REPEATS + 1)
    of_mujoco = [new_mission(scenario) for _ in rounds]
    of_direct = [new_mission(by_direct) for _ in rounds]
    motions = [MotionSettings.of(_varied(by_direct, i)) for i in range(LANES)]
    groups = [[mission_for_lanes(motion) for motion in motions] for _ in rounds]
    mujoco, direct, lanes = least_times(
        [
            lambda: of_mujoco.pop().fly(),
            lambda: of_direct.pop().fly(),
            lambda: fly_group(groups.pop()),
        ],
        _REPEATS,
    )
    lanes /= LANES  # a group flies as many missions
    return [
        Row(f"{name}, by MuJoCo", mujoco / steps * 1e9, "ns/step"),
        Row(f"{name}, direct", direct / steps * 1e9, "ns/step", mujoco / direct, "MuJoCo"),
        Row(
            f"{name}, side by side in lanes",
            lanes / steps * 1e9,
            "ns/step",
            mujoco / lanes,
            "MuJoCo",
        ),
    ]


def _fleet() -> list[Row]:
    """A physics step of one of eleven vehicles with autopilots and recording, by MuJoCo and by the
    direct solver, which steps the vehicles side by side in lanes.
    """
    scenario = _scenario(10, _ENGINES_S)
    steps = round(_ENGINES_S / scenario.timing.physics_step_s) * 11
    rounds = range(_REPEATS + 1)
    of_mujoco = [new_mission(scenario) for _ in rounds]
    of_direct = [new_mission(_direct(scenario)) for _ in rounds]
    mujoco, direct = least_times(
        [lambda: of_mujoco.pop().fly(), lambda: of_direct.pop().fly()], _REPEATS
    )
    return [
        Row("one of eleven vehicles, by MuJoCo", mujoco / steps * 1e9, "ns/step"),
        Row(
            "one of eleven vehicles, side by side",
            direct / steps * 1e9,
            "ns/step",
            mujoco / direct,
            "MuJoCo",
        ),
    ]


def plant() -> list[Row]:
    """Making the model of a fleet, from its files to the first step."""
    times = {}
    for followers in (50, 200):
        scenario = _scenario(followers, 1.0)
        mission = MissionPlan.of(scenario)
        setups = setups_of(mission, routes_of(mission))
        ocean = ocean_of(SeaSettings.of(scenario))
        # each with another step: MuJoCo's model of a fleet is kept for the next one that is equal
        steps = iter(scenario.timing.physics_step_s + 1e-9 * np.arange(4))
        times[followers] = least_time(lambda s=setups, o=ocean, i=steps: Plant(s, o, next(i)), 3)  # type: ignore[misc]
    ratio = times[200] / times[50]
    return [
        *(Row(f"leader + {n}: model", seconds * 1e3, "ms") for n, seconds in times.items()),
        Row("leader + 200: model, over that of 50", ratio, "x", goal=Goal(MODEL_TIME_RATIO_GOAL)),
    ]


def waves() -> list[Row]:
    """A physics step of leader and one follower with autopilot and recording, by the sea."""
    rows = []
    for kind in ("none", "regular", "jonswap"):
        scenario = load_scenario("T5", (f"ocean.waves.kind={kind}",))
        mission = MissionPlan.of(scenario)
        routes = routes_of(mission)
        ocean = ocean_of(SeaSettings.of(scenario))
        step_s = scenario.timing.physics_step_s
        plants = [Plant(setups_of(mission, routes), ocean, step_s) for _ in range(4)]
        duration = scenario.duration_s
        seconds = least_time(lambda p=plants, r=routes, d=duration: simulate(p.pop(), r, d), 3)  # type: ignore[misc]
        per_step = seconds / round(duration / step_s) * 1e6
        name = "calm" if kind == "none" else kind
        rows += [
            Row(f"leader + 1, {name}", per_step, "µs/step"),
            Row(f"leader + 1, {name}: real-time factor", duration / seconds, "x"),
        ]
    return rows


def log() -> list[Row]:
    """Writing and reading the log of a mission of 1000 s."""
    flight, _ = fly(load_scenario("T5", ()))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        writing_s = least_time(lambda: writer.write(flight, path), 3)
        # selects no topic: the times of messages are enough
        messages = sum(
            len(channel.times) for channel in Contents(path, lambda topic, _: False).topics.values()
        )
        size = path.stat().st_size
        reading_s = least_time(partial(reader.read, path), 3)
    return [
        Row("messages", messages / 1000, "k"),
        Row("writing", messages / writing_s / 1000, "k/s", goal=Goal(50.0, at_least=True)),
        Row("reading, to a flight", messages / reading_s / 1000, "k/s"),
        Row("size", size / 1e6, "MB"),
    ]


# program of such a child process
_BARE = """
import sys
from tools.benchmarks.mission import render_bare

render_bare(int(sys.argv[1]))
"""
BARE_FRAMES = (30, 90)
"""Frames that each of two child processes renders: the difference of their times is free of what a
process costs by itself.
"""


def render_bare(frames: int) -> None:
    """Render a leader and a follower, above the floor of the ocean, as MuJoCo does without any of
    the film's own: what a camera 4 m away sees.
    """
    scenario = load_scenario("T5", ())
    video = scenario.video
    mission = MissionPlan.of(scenario)
    spec = compose(setups_of(mission, routes_of(mission)), scenario.ocean.floor_depth_m)
    spec.visual.global_.offwidth = video.width_px
    spec.visual.global_.offheight = video.height_px
    model = spec.compile()
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.distance = 4.0
    with mujoco.Renderer(model, video.height_px, video.width_px) as renderer:
        for frame in range(frames):
            data.qpos[0] += 0.1
            mujoco.mj_forward(model, data)
            camera.lookat[:] = data.qpos[:3]
            camera.azimuth = float(frame)
            renderer.update_scene(data, camera=camera)
            renderer.render()


def _bare_frame_s(backend: str) -> float:
    """Processor time of a frame of `render_bare` [s]."""
    times = []
    for frames in BARE_FRAMES:
        (_, *program), environment = graphics.child(_BARE, backend)
        times.append(time_of_command((*program, str(frames)), environment).processor_s)
    return (times[1] - times[0]) / (BARE_FRAMES[1] - BARE_FRAMES[0])


def _processor_s() -> float:
    """Processor time of all children that have ended [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def film() -> list[Row]:
    """Rendering and encoding at 1280×720, on all cores, beside a bare `mujoco.Renderer`."""
    backend = graphics.working()
    if backend is None:
        return [Row(f"not measured: {graphics.INSTALL}", np.nan, "")]
    flight, _ = fly(load_scenario("T5", ()))
    processor_s = {}  # by the number of frames
    # the first one compiles what is missing; the rows but for the processor time are of the longest
    # one, the last
    for number in (9, 90, 390):
        video = flight.scenario.video
        length = float(flight.trajectory.time[-1] - flight.trajectory.time[0])
        # frames spread over the whole mission
        paced = video.model_copy(update={"speed_up": length * video.frame_rate_hz / number})
        # clock [s] and share of the frames that is done, at each report of progress
        marks: list[tuple[float, float]] = []
        start_s = _processor_s()
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "film.mp4"
            job = FilmJob(flight=flight, video=paced)
            render.render(
                job,
                path,
                progress=lambda done, m=marks: m.append((time.perf_counter(), done)),  # type: ignore[misc]
            )
            size = path.stat().st_size  # [byte]
        processor_s[number] = _processor_s() - start_s
    seconds = time.perf_counter() - begin
    first, share_at_first = marks[0]
    last, _ = marks[-1]
    rate = number * (1.0 - share_at_first) / max(last - first, 1e-9)
    frame_s = (processor_s[390] - processor_s[90]) / 300
    bare_s = _bare_frame_s(backend.name)
    return [
        Row("frames a second, once running", rate, "1/s", goal=Goal(20.0, at_least=True)),
        Row("until the first group of frames", first - begin, "s"),
        Row(f"{number} frames in all", seconds, "s"),
        Row("processor time of a frame", frame_s * 1e3, "ms"),
        Row("processor time of a frame of a bare renderer", bare_s * 1e3, "ms"),
        Row("a frame, over that of a bare renderer", frame_s / bare_s, "x", goal=Goal(2.0)),
        Row("size of a frame", size / number / 1e3, "kB"),
    ]
