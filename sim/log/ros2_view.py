"""A view of a bag for RViz: hulls, true and estimated ways, ellipses of the estimates, the film."""

import json
from collections.abc import Iterable, Sequence
from typing import Any

_PLUGINS = "rviz_default_plugins"
_TRUTH = "242; 158; 20"
_ESTIMATE = "217; 38; 191"
"""Colours of the log's scenes: red, green, blue."""
_TRAIL_ARROWS = 1000
_BETWEEN_ARROWS_M = 2.0
_DISTANCE_M = 60.0  # of the camera from the leader


def _topic(name: str, *, latched: bool = False) -> dict[str, Any]:
    return {
        "Depth": 5,
        "Durability Policy": "Transient Local" if latched else "Volatile",
        "History Policy": "Keep Last",
        "Reliability Policy": "Reliable",
        "Value": name,
    }


def _hull(name: str) -> dict[str, Any]:
    return {
        "Class": f"{_PLUGINS}/RobotModel",
        "Name": f"{name} hull",
        "Enabled": True,
        "Value": True,
        "Description Source": "Topic",
        "Description Topic": _topic(f"/{name}/robot_description", latched=True),
        "Visual Enabled": True,
    }


def _way(name: str, kind: str, color: str) -> dict[str, Any]:
    """Arrows along the odometry of a vehicle; those of estimates with ellipses."""
    return {
        "Class": f"{_PLUGINS}/Odometry",
        "Name": f"{name} {kind}",
        "Enabled": True,
        "Value": True,
        "Topic": _topic(f"/{name}/{kind}/odometry"),
        "Keep": _TRAIL_ARROWS,
        "Position Tolerance": _BETWEEN_ARROWS_M,
        "Angle Tolerance": 3.2,
        "Shape": {"Value": "Arrow", "Color": color, "Alpha": 1, "Shaft Length": 1},
        "Covariance": {
            "Value": kind == "estimate",
            "Position": {"Value": True, "Color": color, "Alpha": 0.3, "Scale": 1},
            # roll and pitch are not estimated
            "Orientation": {"Value": False},
        },
    }


def _displays(names: Sequence[str], topics: Iterable[str]) -> list[dict[str, Any]]:
    available = set(topics)
    displays: list[dict[str, Any]] = [
        {
            "Class": f"{_PLUGINS}/Grid",
            "Name": "surface",
            "Enabled": True,
            "Value": True,
            "Cell Size": 10,
            "Plane Cell Count": 60,
            "Reference Frame": "map",
        }
    ]
    for name in names:
        displays.append(_hull(name))
        displays.append(_way(name, "truth", _TRUTH))
        if f"/{name}/estimate/odometry" in available:
            displays.append(_way(name, "estimate", _ESTIMATE))
    if "/camera/compressed" in available:
        displays.append(
            {
                "Class": f"{_PLUGINS}/Image",
                "Name": "film",
                "Enabled": True,
                "Value": True,
                # the transport takes the rest of the name
                "Topic": _topic("/camera/compressed"),
            }
        )
    return displays


def rviz_view(names: Sequence[str], topics: Iterable[str]) -> str:
    """A configuration of RViz for vehicles of these names, the leader first, and the topics of
    their bag; as JSON, which is YAML.
    """
    camera = {
        "Class": f"{_PLUGINS}/Orbit",
        "Name": "Current View",
        "Target Frame": f"{names[0]}/base_link",
        "Distance": _DISTANCE_M,
        "Pitch": 0.6,
        "Yaw": 3.9,
    }
    view = {
        "Panels": [
            {"Class": "rviz_common/Displays", "Name": "Displays"},
            {"Class": "rviz_common/Views", "Name": "Views"},
            {"Class": "rviz_common/Time", "Name": "Time"},
        ],
        "Visualization Manager": {
            "Class": "",
            "Displays": _displays(names, topics),
            "Enabled": True,
            "Global Options": {
                "Background Color": "20; 40; 60",
                "Fixed Frame": "map",
                "Frame Rate": 30,
            },
            "Name": "root",
            "Tools": [
                {"Class": f"{_PLUGINS}/{tool}"}
                for tool in ("MoveCamera", "Select", "FocusCamera", "Measure")
            ],
            "Value": True,
            "Views": {"Current": camera, "Saved": None},
        },
    }
    return json.dumps(view, indent=1) + "\n"
