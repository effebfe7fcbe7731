"""What is flown: arms of navigators, conditions and message intervals, as tables of the study engine."""

from collections.abc import Iterable, Mapping
from itertools import product
from typing import Any

import numpy as np

from experiments.study.file import FOLDER

Arm = dict[str, Any]
NAVIGATORS = {
    "laisn-2": "LAISN-2",
    "laisn-3-1": "LAISN-3(1)",
    "laisn-3-2": "LAISN-3(2)",
    "tight": "tightly coupled",
    "dead-reckoning": "dead reckoning",
    "geodetic": "geodetic adjustment",
    "owtt": "one-way travel time",
    "ekf": "EKF on ranges",
    "particle": "particle filter",
    "factor-graph": "factor graph",
    "inverted-usbl": "inverted USBL",
}
"""Titles by the names of the registry."""
OURS = ("laisn-2", "laisn-3-1", "laisn-3-2", "tight")
SLOW = "factor-graph"
"""Flown in fewer runs, and with messages every second in calm water alone."""
_CURRENT = {"ocean.current_speed_m_s": 0.2, "ocean.current_direction_deg": 60.0, "navigation.assume.current": True}
CONDITIONS: dict[str, tuple[str, Mapping[str, Any]]] = {
    "calm": ("calm water", {}),
    "current": ("a current of 0.2 m/s", _CURRENT),
    "loss": ("half of all messages lost", {"acoustics.loss_probability": 0.5}),
    "bias": ("a compass bias of 10°", {"sensors.heading_bias_deg": 10.0}),
}
"""Titles and settings; calm water has the biases of the paper, 5° and 0.2 m/s. Filters estimate the current."""
INTERVALS = (1.0, 5.0, 10.0)
"""Of messages [s]."""
USUAL = 5.0
FURTHER = (2.0, 20.0, 50.0)
"""Intervals of channels that many share [s]."""
SHARING = ("laisn-3-2", "tight", "ekf")
"""Navigators on such channels."""

RANGES_M, BIASES_DEG, BASELINES_M = (20.0, 50.0, 100.0, 200.0), (0.0, 5.0, 10.0), (0.5, 1.0, 2.0)
"""Factors of the map of LAISN-3(2) and inverted USBL."""
MAPPED = ("laisn-3-2", "inverted-usbl")

VEHICLES, REACHES_M = (1, 2, 5, 10, 20, 50), (50.0, 150.0, 500.0)
"""Factors of the map of a channel that vehicles share."""
PING_S, SOUND_M_S = 0.1, 1500.0


def shared_interval_s(vehicles: int, reach_m: float) -> float:
    """Interval at which each of n vehicles gets its range when they interrogate in turn: n (ping + 2 r / c) [s]."""
    return vehicles * (PING_S + 2.0 * reach_m / SOUND_M_S)


def arm_name(navigator: str, condition: str, interval: float) -> str:
    """Name of an arm on the routes."""
    return f"{navigator} {condition} {interval:g}"


def _on_routes(
    navigators: Iterable[str], conditions: Iterable[str], intervals: Iterable[float]
) -> list[dict[str, Any]]:
    return [
        {
            "name": arm_name(navigator, condition, interval),
            "navigation.variant": navigator,
            "timing.message_interval_s": interval,
            **CONDITIONS[condition][1],
        }
        for navigator, condition, interval in product(navigators, conditions, intervals)
    ]


def _table(name: str, arms: list[Arm], runs: int, settings: Mapping[str, Any]) -> dict[str, Any]:
    scenario = str(FOLDER / "scenarios" / "routes.toml")
    return {"name": name, "scenario": scenario, "runs": runs, "arm": arms, "set": dict(settings)}


def open_loop(runs: int, settings: Mapping[str, Any]) -> dict[str, Any]:
    """All navigators but the slow one on estimates that do not steer."""
    quick = [name for name in NAVIGATORS if name != SLOW]
    arms = _on_routes(quick, CONDITIONS, INTERVALS) + _on_routes(SHARING, ["calm"], FURTHER)
    return _table("rivals-open", arms, runs, settings)


def slow(runs: int, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The slow navigator."""
    arms = _on_routes([SLOW], CONDITIONS, INTERVALS[1:]) + _on_routes([SLOW], ["calm"], INTERVALS[:1])
    return _table("rivals-slow", arms, runs, settings)


def closed_loop(runs: int, settings: Mapping[str, Any]) -> dict[str, Any]:
    """All navigators, steering by their estimates in calm water."""
    arms = _on_routes(NAVIGATORS, ["calm"], [USUAL])
    steering = {"followers.*.guidance_position": "estimate"}
    return _table("rivals-closed", arms, runs, {**settings, **steering})


def usbl_map(runs: int, settings: Mapping[str, Any]) -> dict[str, Any]:
    """A follower on the quarter of a leader that goes straight, by point motion, for five minutes."""
    arms = []
    for name, reach, bias, baseline in product(MAPPED, RANGES_M, BIASES_DEG, BASELINES_M):
        east, north = reach * np.sqrt(0.5), -reach * np.sqrt(0.5)
        path = [[0.0, float(east), float(north)], [300.0, float(east), float(north + 300.0)]]
        arms.append({
            "name": map_name(name, reach, bias, baseline), "navigation.variant": name, "followers.0.waypoints": path,
            "sensors.heading_bias_deg": bias, "leader.baseline_m": baseline,
        })  # fmt: skip
    fixed = {"motion": "kinematic", "duration_s": 300.0, "leader.waypoints": [[0.0, 0.0, 0.0], [300.0, 0.0, 300.0]]}
    return _table("rivals-map", arms, runs, {**fixed, **settings}) | {"scenario": "T5"}


def map_name(navigator: str, reach: float, bias: float, baseline: float) -> str:
    """Name of an arm of the map."""
    return f"map {navigator} {reach:g} {bias:g} {baseline:g}"
