"""A layout for Foxglove: panels and their topics, for the vehicles of a log."""

from collections.abc import Iterable, Sequence
from typing import Literal

from foxglove import layouts as fl

LEADER, FOLLOWER, ESTIMATE = "#ffad33", "#fff240", "#ff40d9"
"""Colours of the film."""


def _scene(leader: str, followers: Sequence[str]) -> fl.ThreeDeePanel:
    scenes = ("/scene/vehicles", "/scene/acoustics")
    axis = fl.BaseRendererPoseTopicSettings(visible=True, type="axis", axis_scale=1.5)
    shown = fl.BaseRendererSceneUpdateTopicSettings(visible=True)
    topics: dict[str, fl.BaseRendererTopicSettings] = dict.fromkeys(scenes, shown)
    topics |= {f"/{name}/estimate": axis for name in followers}
    grid = fl.BaseRendererGridLayerSettings(
        visible=True, label="Grid", size=1000, divisions=100, line_width=1, color="#ffffff22"
    )
    camera = fl.ThreeDeeCameraState(
        perspective=True, distance=120, phi=55, theta_offset=45, fovy=45, near=0.1, far=5000
    )
    transforms = fl.BaseRendererTransforms(show_label=False, axis_size=1)
    config = fl.ThreeDeeConfig(
        follow_tf=leader, follow_mode="follow-position", camera_state=camera, topics=topics, layers={"grid": grid},
        scene=fl.BaseRendererSceneSettings(background_color="#0b2a3a", transforms=transforms),
    )  # fmt: skip
    return fl.ThreeDeePanel(title="Scene", config=config)


def _map(leader: str, followers: Sequence[str]) -> fl.MapPanel:
    colours = {f"/{leader}/fix": LEADER} | {f"/{name}/fix": FOLLOWER for name in followers}
    colours |= {f"/{name}/estimate/fix": ESTIMATE for name in followers}
    config = fl.MapConfig(layer="map", zoom_level=15, follow_topic=f"/{leader}/fix", topic_colors=colours)
    return fl.MapPanel(title="Map", config=config)


def _plot(title: str, paths: Iterable[tuple[str, str]]) -> fl.PlotPanel:
    """Curves over time, each a message path and its label."""
    curves = [
        fl.PlotSeries(value=path, label=label, enabled=True, timestamp_method="receiveTime") for path, label in paths
    ]
    config = fl.PlotConfig(
        paths=curves, show_legend=True, legend_display="floating", is_synced=True, x_axis_val="timestamp"
    )
    return fl.PlotPanel(title=title, config=config)


def _split(direction: Literal["row", "column"], *parts: tuple[float, fl.Content]) -> fl.SplitContainer:
    """Parts beside ("row") or above one another ("column"), each with its share in percent."""
    items = [fl.SplitItem(proportion=share, content=content) for share, content in parts]
    return fl.SplitContainer(direction=direction, items=items)


def layout(names: Sequence[str]) -> str:
    """A layout for Foxglove, as JSON, for vehicles of these names, the leader first."""
    leader, *followers = names
    ranges = [
        (f"/{name}/reception.range_{transmitter}", f"{name}, {transmitter}" if len(followers) > 1 else transmitter)
        for name in followers
        for transmitter in ("rear", "front", "middle")
    ]
    distance = _plot("Position error E_P [m]", ((f"/{name}/error.position_error", name) for name in followers))
    bearing = _plot("Bearing error E_B [deg]", ((f"/{name}/error.bearing_error.@rad2deg", name) for name in followers))
    pitch = _plot("Pitch [deg]", ((f"/{name}/state.pitch.@rad2deg", name) for name in names))
    lines = fl.LogPanel(title="Log", config=fl.LogConfig(min_log_level=2, topic_to_render="/log"))
    camera = fl.ImageConfig(image_mode=fl.ImageModeConfig(image_topic="/camera"))
    views = _split("row", (50, fl.ImagePanel(title="Camera", config=camera)), (50, _map(leader, followers)))
    pictures = _split("column", (60, _scene(leader, followers)), (40, views))
    curves = _split(
        "column", (25, distance), (25, bearing), (20, _plot("Ranges [m]", ranges)), (13.5, pitch), (16.5, lines)
    )
    return fl.Layout(content=_split("row", (60, pictures), (40, curves))).to_json() + "\n"
