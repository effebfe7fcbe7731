"""The missions on which both navigators are compared, and the Cramér–Rao bound on them."""

import math
from functools import cache
from itertools import pairwise

import numpy as np

from experiments.campaign.bound import geometry_of, least_rms
from experiments.campaign.missions import mission_of, motion_of
from experiments.reproduction.stages import Setting, compass, scenario
from laisn.bound import TrueNoise
from laisn.tight.leader import CURRENT_SIGMA
from laisn.tight.model import model_of
from laisn.tight.settings import Assume, TightSettings
from sim.scenario.routes import Route, library_route
from sim.scenario.settings import Follower, Scenario
from sim.sensing.hearing import Hearing
from sim.sensing.observation import errors_of
from sim.sensing.sensor_errors import SensorErrors
from sim.sensing.truth import MissionTruth

MIDDLE_OFFSET = 0.1
"""H_T of missions, unless it is what is varied [m]."""
WEAVE, WEAVE_PERIOD = float(np.deg2rad(5.0)), 40.0
"""Angle of the legs with the route [rad], and period [s], of a leader that weaves."""


def _weaving(route: Route) -> tuple[tuple[float, float, float], ...]:
    """Waypoints (time, east, north) of legs that alternate by `WEAVE` about those of a route, its corners kept."""
    half = 0.5 * WEAVE_PERIOD
    points = []
    for k, (begin, end) in enumerate(pairwise(route.time.tolist())):
        here, way = route.waypoint[k], route.waypoint[k + 1] - route.waypoint[k]
        speed = float(np.hypot(*way)) / (end - begin)
        starboard = np.array([way[1], -way[0]]) / float(np.hypot(*way))
        points.append((begin, *here.tolist()))
        for i, time in enumerate(np.arange(begin + half, end - half, half).tolist()):
            aside = (-1.0) ** i * 0.5 * speed * half * np.tan(WEAVE)
            points.append((time, *(here + (time - begin) / (end - begin) * way + aside * starboard).tolist()))
    return (*points, (float(route.time[-1]), *route.waypoint[-1].tolist()))


@cache
def asked_for(route: str, interval: float, leader_heading_deg: float, middle_offset: float, weave: bool) -> Scenario:
    """The scenario of `mission`, with the same arguments."""
    setting = Setting(
        name="estimators", stage=1, table="text", title="estimators",
        keys={
            "timing.message_interval_s": interval,
            "leader.middle_offset_m": middle_offset,
            **compass(leader_heading_deg),
        },
    )  # fmt: skip
    asked = scenario(setting, Follower(route=route), route, variant="laisn-3-2", motion="kinematic", seed=1)
    if not weave:
        return asked
    leader = asked.leader.model_copy(update={"route": None, "waypoints": _weaving(library_route("L"))})
    return asked.model_copy(update={"leader": leader})


@cache
def mission(
    route: str, interval: float, leader_heading_deg: float, middle_offset: float = MIDDLE_OFFSET, weave: bool = False
) -> tuple[MissionTruth, SensorErrors]:
    """The paper's point motion on a route as three transmitters are heard, and the paper's sensors.

    Args:
        route: T2 … T9.
        interval: of messages [s].
        leader_heading_deg: mean error of the leader's compass.
        middle_offset: H_T [m].
        weave: the leader weaves about its route.
    """
    asked = asked_for(route, interval, leader_heading_deg, middle_offset, weave)
    _, truth = mission_of(motion_of(asked)).seen(asked, 0)
    return truth, errors_of(asked)


def noise_known(assume: Assume) -> TrueNoise:
    """The paper's noise to who knows all but what these assumptions leave open, and that drift is slow.

    With all given it is that of constant biases.
    """
    told = TightSettings(assume=assume)
    model = model_of(told)
    return TrueNoise(
        speed_walk=math.sqrt(model.log_walk[0]) if assume.drift else 0.0,
        heading_walk=math.sqrt(model.compass_walk[0]) if assume.drift else 0.0,
        leader_heading_bias=0.0 if assume.exact_leader else told.leader_heading_bias_sigma,
        current=told.current_sigma if assume.current else 0.0,
        current_walk=math.sqrt(model.current_walk) if assume.current else 0.0,
        clock_offset=told.clock_offset_sigma if assume.clock else 0.0,
        clock_drift=told.clock_drift_sigma if assume.clock else 0.0,
        clock_walk=math.sqrt(model.clock_walk) if assume.clock else 0.0,
        range_offset=told.offset_sigma if assume.offsets else 0.0,
        leader_way_sigma=CURRENT_SIGMA if assume.current or not assume.exact_leader else 0.0,
    )


@cache
def bound_rms(
    route: str,
    interval: float,
    transmitters: int,
    middle_offset: float = MIDDLE_OFFSET,
    weave: bool = False,
    assume: Assume | None = None,
    lag: float = 0.0,
) -> float:
    """Least RMS of E_P over a mission on which nothing is wrong [m], on average over all that its biases may be.

    Arguments as of `mission`, and what is taken as given; None: all. With a lag [s] messages of up to so much later are
    used too.
    """
    asked = asked_for(route, interval, 0.0, middle_offset, weave)
    trajectory, _ = mission_of(motion_of(asked)).seen(asked, 0)
    geometry = geometry_of(trajectory, Hearing.of(asked), transmitters=transmitters)
    return float(np.sqrt(np.mean(least_rms(geometry, noise_known(assume or Assume()), lag) ** 2)))
