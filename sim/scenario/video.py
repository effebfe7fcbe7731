"""What a user may set of the film of a mission."""

from typing import Annotated

from pydantic import AfterValidator, Field

from sim.scenario.section import Name, Positive, Section

CAMERAS = {
    "chase": "behind the follower, looking towards the leader; inset: the leader close by",
    "pip": "from above, both vehicles in one picture; insets: leader and follower close by",
    "top": "from above, all vehicles in one picture, north up",
    "side": "from the side at their depth, between surface and floor; inset: the follower close by",
    "follower": "what the follower would see, along its hull; inset: the leader close by",
    "leader": "the leader close by; inset: the follower close by",
    "profile": "the leader in profile, the follower beyond; inset: follower and estimate from above",
    "orbit": "around all vehicles, once in forty seconds of film",
}
"""Names of the cameras and what they show."""
_NAMES = list(CAMERAS)


def _known(name: str) -> str:
    if name not in CAMERAS:
        raise ValueError(f"unknown camera {name!r}; available: {', '.join(CAMERAS)}")
    return name


class Video(Section):
    """The film of the mission."""

    camera: Annotated[Name, AfterValidator(_known)] = Field(
        "chase", description=f"{', '.join(_NAMES[:-1])} or {_NAMES[-1]}"
    )
    width_px: Annotated[int, Field(ge=160, le=3840, multiple_of=2)] = 1280
    height_px: Annotated[int, Field(ge=120, le=2160, multiple_of=2)] = 720
    frame_rate_hz: Annotated[int, Field(ge=1, le=60)] = 30
    speed_up: Positive = Field(30.0, description="seconds of mission in a second of film")
    in_log: bool = Field(True, description="a rendered film also goes into the log, as channel /camera")
