"""The ways in which the pitch study flies a condition: behind which leader, and with which remedy.

A broadcast attitude is only as good as the sensor behind it. Three kinds of error of the same size are told apart: one
that each message has anew, one that stays, and what gyros leave of an inclinometer that is 0.5° off in each reading
and takes the accelerations of waves for tilt: an attitude and heading reference system (AHRS), as vehicles carry them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from laisn.settings import Variant


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One way to fly a condition."""

    key: str
    label: str
    short: str = ""
    """Label where there is little room."""
    leader: Literal["real", "level"] = "real"
    """Behind which leader: the one that pitches, or one that has its track and keeps level."""
    settings: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """What differs from the condition's scenario: the leader's attitude sensor, and whether the follower places the
    transmitters by the attitude that is broadcast."""
    expect_pitch: bool = False
    """The follower inflates σp by the root mean square pitch of the mission."""
    wanted: float = 0.9
    """Share of the pitch-driven error that the remedy should remove."""
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    """Flown in this arm."""


def _broadcast(**sensor: Any) -> dict[str, Any]:
    """The attitude is used, and comes from this sensor."""
    return {"navigation.use_attitude": True} | {f"sensors.leader_{key}": value for key, value in sensor.items()}


_TWO: tuple[Variant, ...] = ("laisn-2",)
LEVEL = Arm(key="level", label="level leader", leader="level")
REAL = Arm(key="real", label="real leader")
LEVEL_BROADCAST = Arm(
    key="level-0.5", label="level leader that broadcasts readings 0.5° off", leader="level",
    settings=_broadcast(attitude_sigma_deg=0.5), variants=_TWO,
)  # fmt: skip
EXACT = Arm(
    key="attitude-0", label="attitude broadcast, exact", short="attitude, exact", settings=_broadcast(), wanted=0.99,
)  # fmt: skip
STEADIED = Arm(
    key="ahrs-0.5", label="AHRS: inclinometer of 0.5°, gyros", short="AHRS of 0.5°",
    # gyros of 0.3°/√h, the default, as in small MEMS units
    settings=_broadcast(attitude_sigma_deg=0.5, attitude_feels_acceleration=True, gyro_time_constant_s=30.0),
)  # fmt: skip
READINGS = Arm(
    key="attitude-0.5", label="each message 0.5° off", short="each message 0.5°",
    settings=_broadcast(attitude_sigma_deg=0.5),
)  # fmt: skip
ROUGH = Arm(
    key="attitude-2", label="each message 2° off", short="each message 2°",
    settings=_broadcast(attitude_sigma_deg=2.0), variants=_TWO,
)  # fmt: skip
CROOKED = Arm(
    key="offset-0.5", label="a constant 0.5° off", short="constant 0.5°",
    settings=_broadcast(attitude_offset_sigma_deg=0.5), variants=_TWO,
)  # fmt: skip
INFLATED = Arm(
    key="expected", label="σp inflated by the expected pitch", short="σp inflated", expect_pitch=True, variants=_TWO
)
REMEDIES = (EXACT, STEADIED, READINGS, ROUGH, CROOKED, INFLATED)
ARMS = (LEVEL, REAL, LEVEL_BROADCAST, *REMEDIES)
ARM = {arm.key: arm for arm in ARMS}
