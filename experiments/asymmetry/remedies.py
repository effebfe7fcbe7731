"""The ways in which the pitch study flies a condition: behind which leader, and with which remedy.

A broadcast attitude is only as good as the sensor behind it. Three kinds of error of the same size are told apart: one
that each message has anew, one that stays, and what gyros leave of an inclinometer that is 0.5° off in each reading
and takes the accelerations of waves for tilt: an attitude and heading reference system (AHRS), as vehicles carry them.
"""

from dataclasses import dataclass, field
from typing import Literal

from laisn.settings import Variant
from sim.scenario.settings import Sensors

AHRS = Sensors(leader_attitude_sigma_deg=0.5, leader_attitude_feels_acceleration=True, leader_gyro_time_constant_s=30.0)
"""An inclinometer of 0.5° that feels accelerations, steadied by gyros of 0.3°/√h as in small MEMS units."""


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One way to fly a condition."""

    key: str
    label: str
    short: str = ""
    """Label where there is little room."""
    seen: Literal["real", "level", "ahrs"] = "real"
    """What the follower's sensors see: field of `Sensed`."""
    use_attitude: bool = False
    """The leader broadcasts pitch and roll, and the follower places the transmitters by them."""
    sensors: Sensors = field(default_factory=Sensors)
    """The leader's attitude sensor; no other of these errors is used."""
    expect_pitch: bool = False
    """The follower inflates σp by the root mean square pitch of the mission."""
    wanted: float = 0.9
    """Share of the pitch-driven error that the remedy should remove."""
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    """Flown in this arm."""


_TWO: tuple[Variant, ...] = ("laisn-2",)
_HALF_DEGREE = Sensors(leader_attitude_sigma_deg=0.5)
LEVEL = Arm(key="level", label="level leader", seen="level")
REAL = Arm(key="real", label="real leader")
LEVEL_BROADCAST = Arm(
    key="level-0.5", label="level leader that broadcasts readings 0.5° off", seen="level", use_attitude=True,
    sensors=_HALF_DEGREE, variants=_TWO,
)  # fmt: skip
EXACT = Arm(
    key="attitude-0", label="attitude broadcast, exact", short="attitude, exact", use_attitude=True, wanted=0.99,
)  # fmt: skip
STEADIED = Arm(
    key="ahrs-0.5", label="AHRS: inclinometer of 0.5°, gyros", short="AHRS of 0.5°", seen="ahrs", use_attitude=True,
    sensors=AHRS,
)  # fmt: skip
READINGS = Arm(
    key="attitude-0.5", label="each message 0.5° off", short="each message 0.5°", use_attitude=True,
    sensors=_HALF_DEGREE,
)  # fmt: skip
ROUGH = Arm(
    key="attitude-2", label="each message 2° off", short="each message 2°", use_attitude=True,
    sensors=Sensors(leader_attitude_sigma_deg=2.0), variants=_TWO,
)  # fmt: skip
CROOKED = Arm(
    key="offset-0.5", label="a constant 0.5° off", short="constant 0.5°", use_attitude=True,
    sensors=Sensors(leader_attitude_offset_sigma_deg=0.5), variants=_TWO,
)  # fmt: skip
INFLATED = Arm(
    key="expected", label="σp inflated by the expected pitch", short="σp inflated", expect_pitch=True, variants=_TWO
)
REMEDIES = (EXACT, STEADIED, READINGS, ROUGH, CROOKED, INFLATED)
ARMS = (LEVEL, REAL, LEVEL_BROADCAST, *REMEDIES)
ARM = {arm.key: arm for arm in ARMS}
