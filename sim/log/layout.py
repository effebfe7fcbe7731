"""A layout for Foxglove: what to draw of a log, and where on the screen, for the log's own vehicles."""

import json
from collections.abc import Iterable, Sequence
from typing import Any

LEADER, FOLLOWER, ESTIMATE = "#ffad33", "#fff240", "#ff40d9"
"""Colours of the film."""

Panel = dict[str, Any]


def _scene(leader: str, followers: Sequence[str]) -> Panel:
    estimates = {f"/{name}/estimate": {"visible": True, "type": "axis", "axisScale": 1.5} for name in followers}
    camera = {
        "perspective": True, "distance": 120, "phi": 55, "thetaOffset": 45, "fovy": 45, "near": 0.1, "far": 5000,
        "target": [0, 0, 0], "targetOffset": [0, 0, 0], "targetOrientation": [0, 0, 0, 1],
    }  # fmt: skip
    grid = {
        "instanceId": "grid", "layerId": "foxglove.Grid", "label": "Grid", "visible": True, "frameLocked": True,
        "size": 1000, "divisions": 100, "lineWidth": 1, "color": "#ffffff22", "position": [0, 0, 0],
        "rotation": [0, 0, 0], "order": 1,
    }  # fmt: skip
    return {
        "foxglovePanelTitle": "Scene",
        "followTf": leader,
        "followMode": "follow-position",
        "cameraState": camera,
        "scene": {
            "backgroundColor": "#0b2a3a",
            "transforms": {"labelSize": 0.05, "axisScale": 1, "showLabel": False},
        },
        "topics": {"/scene/vehicles": {"visible": True}, "/scene/acoustics": {"visible": True}} | estimates,
        "transforms": {},
        "layers": {"grid": grid},
        "publish": {},
        "imageMode": {},
    }


def _camera() -> Panel:
    empty: Panel = {key: {} for key in ("cameraState", "scene", "transforms", "topics", "layers", "publish")}
    return {"foxglovePanelTitle": "Camera", "imageMode": {"imageTopic": "/camera"}} | empty


def _map(leader: str, followers: Sequence[str]) -> Panel:
    truth = {f"/{name}/fix": FOLLOWER for name in followers}
    belief = {f"/{name}/estimate/fix": ESTIMATE for name in followers}
    return {
        "foxglovePanelTitle": "Map",
        "layer": "map",
        "customTileUrl": "",
        "zoomLevel": 15,
        "followTopic": f"/{leader}/fix",
        "disabledTopics": [],
        "topicColors": {f"/{leader}/fix": LEADER} | truth | belief,
        "topicConfig": {},
    }


def _plot(title: str, paths: Iterable[tuple[str, str]]) -> Panel:
    """Curves over time, each a message path and its label."""
    return {
        "foxglovePanelTitle": title,
        "paths": [
            {"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime"} for path, label in paths
        ],
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "showPlotValuesInLegend": False,
        "isSynced": True,
        "xAxisVal": "timestamp",
        "sidebarDimension": 240,
    }


def _split(direction: str, first: Any, second: Any, percentage: int = 50) -> Panel:
    return {"direction": direction, "splitPercentage": percentage, "first": first, "second": second}


def layout(names: Sequence[str]) -> str:
    """A layout to be imported into Foxglove, as JSON.

    Args:
        names: of the vehicles in the log, the leader first.
    """
    leader, *followers = names
    ranges = [
        (f"/{name}/reception.range_{transmitter}", f"{name}, {transmitter}" if len(followers) > 1 else transmitter)
        for name in followers
        for transmitter in ("rear", "front", "middle")
    ]
    panels = {
        "3D!scene": _scene(leader, followers),
        "Image!camera": _camera(),
        "map!position": _map(leader, followers),
        "Plot!position_error": _plot(
            "Position error E_P [m]", ((f"/{name}/error.position_error", name) for name in followers)
        ),
        "Plot!bearing_error": _plot(
            "Bearing error E_B [deg]", ((f"/{name}/error.bearing_error.@rad2deg", name) for name in followers)
        ),
        "Plot!ranges": _plot("Ranges [m]", ranges),
        "Plot!pitch": _plot("Pitch [deg]", ((f"/{name}/state.pitch.@rad2deg", name) for name in names)),
        "RosOut!log": {"foxglovePanelTitle": "Log", "searchTerms": [], "minLogLevel": 2, "topicToRender": "/log"},
    }
    pictures = _split("column", "3D!scene", _split("row", "Image!camera", "map!position"), 60)
    errors = _split("column", "Plot!position_error", "Plot!bearing_error")
    rest = _split("column", "Plot!ranges", _split("column", "Plot!pitch", "RosOut!log", 45), 40)
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 5},
        "layout": _split("row", pictures, _split("column", errors, rest), 60),
    }
    return json.dumps(whole, indent=2) + "\n"
