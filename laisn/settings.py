"""Settings of navigators: what all of them are given, and every constant of the paper with its value as default.

`Tuning` has the settings of LAISN as formulas take them: numbers alone, so that compiled code can.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np

from laisn.arrays import Offset, require_numbers, require_offsets

Variant = Literal["laisn-2", "laisn-3-1", "laisn-3-2", "laisn-best", "laisn-main"]
GateRule = Literal["off", "v-max", "v-measured"]
SideRule = Literal["behind", "predicted"]

VARIANTS: tuple[Variant, ...] = get_args(Variant)


def transmitters_of(variant: str) -> int:
    """N_T: how many of the leader's transmitters a variant uses, rear and front first (paper, Sections 2.2, 2.3)."""
    return 2 if variant == "laisn-2" else 3


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every navigator is given: its filter step, and where transmitters and hydrophone are.

    The settings of a navigator derive from it. Raises ValueError naming the field if a value is out of its range.
    """

    POSITIVE: ClassVar[frozenset[str]] = frozenset({"dt", "baseline"})
    """Numbers that must not be zero."""
    SIGNED: ClassVar[frozenset[str]] = frozenset({"hydrophone_height", "middle_offset"})
    """Numbers that may be negative."""

    dt: float = 0.1
    """Filter step Δt [s]."""
    baseline: float = 2.0
    """L, distance between rear and front transmitter [m]."""
    middle_offset: float = 0.1
    """H_T, sideways offset of the middle transmitter, to port [m]."""
    transmitter_offsets: tuple[Offset, ...] = ()
    """Offsets (forward, port, up) of rear, front and perhaps middle transmitter from the leader's position [m].

    They replace `baseline` and `middle_offset`, and may be as long as a harbour. Empty: on the leader's hull.
    """
    hydrophone_height: float = 0.0
    """Height of the follower's hydrophone above its depth sensor when level [m]."""
    use_attitude: bool = False
    """Place the transmitters by the broadcast pitch and roll instead of assuming a level leader (not in the paper)."""

    @property
    def transmitters(self) -> int:
        """How many of the leader's transmitters are used, rear and front first."""
        return 3

    @property
    def known_start(self) -> bool:
        """Whether the start is given; otherwise the first messages give it."""
        return True

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of the navigator's own sensors, named as in `TrueNoise`."""
        return frozenset()

    def __post_init__(self) -> None:
        require_offsets("transmitter_offsets", self.transmitter_offsets)
        require_numbers(self, positive=self.POSITIVE, signed=self.SIGNED)


@dataclass(frozen=True, kw_only=True)
class NavigationSettings(Settings):
    """Settings of LAISN (paper, Section 3.1, unless another source is named)."""

    POSITIVE = Settings.POSITIVE | {"leader_speed_max", "follower_speed_max"}

    variant: Variant = "laisn-2"
    threshold: float = 0.1
    """T: two intersections closer than this count as one, on the leader's axis [m]."""
    beta: float = 0.1
    """β: σp = β / distance between the intersections [m²]."""
    sigma_floor: float = 0.0
    """Minimum σp [m]; paper: none."""
    alpha: float = 8.0
    """α: process noise in manoeuvres [m/s²]."""
    sigma_a0: float = 60.0
    """σa0: process noise in steady motion [m/s²]."""
    sigma_speed: float = 0.2
    """σV of the speed update [m/s]."""
    sigma_heading: float = float(np.deg2rad(2.0))
    """σθ of the speed update [rad]."""
    position_sigma0: float = 0.0
    """p_pos_std: σ of the initial position along each axis [m]."""
    velocity_sigma0: float = 0.0
    """p_vel_std: σ of the initial velocity [m/s]."""
    leader_speed_max: float = 3.0
    """v_max of the leader in γv [m/s]."""
    follower_speed_max: float = 3.0
    """v_max of the follower in γv and in the gate [m/s]."""
    gate: GateRule = "v-max"
    """Gross-error gate (Section 2.4), by maximum or measured speed since the last accepted fix."""
    side_rule: SideRule = "behind"
    """Side of a fix without two clear intersections: behind (paper) or at the predicted end."""
    expected_pitch: float = 0.0
    """Pitch that inflates σp of a level leader by Δz sin(…), root sum of squares [rad] (not in the paper)."""
    use_single_range: bool = False
    """Use a single received range along its line of sight; paper: dropped. Default in the replay of a vehicle's log:
    true."""

    @property
    def transmitters(self) -> int:
        """N_T: how many of the leader's transmitters the variant uses, rear and front first (Sections 2.2, 2.3)."""
        return transmitters_of(self.variant)

    def __post_init__(self) -> None:
        choices = {"variant": VARIANTS, "gate": get_args(GateRule), "side_rule": get_args(SideRule)}
        for name, allowed in choices.items():
            value = getattr(self, name)
            if value not in allowed:
                raise ValueError(f"{name} is {value!r}; available: {', '.join(allowed)}")
        super().__post_init__()


GATES: tuple[GateRule, ...] = get_args(GateRule)
GATE_OFF, GATE_MEASURED = GATES.index("off"), GATES.index("v-measured")
"""Gate rules as formulas hold them."""


class Tuning(NamedTuple):
    """`NavigationSettings` as numbers; fields of the same name mean the same."""

    variant: int
    """Index in `VARIANTS`."""
    gate: int
    """Index in `GATES`."""
    predicted_side: bool
    use_attitude: bool
    transmitters: int
    """N_T."""
    dt: float
    baseline: float
    middle_offset: float
    hydrophone_height: float
    threshold: float
    beta: float
    sigma_floor: float
    alpha: float
    sigma_a0: float
    speed_variance: float
    heading_variance: float
    position_variance0: float
    velocity_variance0: float
    leader_speed_max: float
    follower_speed_max: float
    sine_of_pitch: float
    """Sine of the pitch that must be expected."""

    @classmethod
    def of(cls, settings: NavigationSettings) -> Self:
        """Settings as numbers."""
        same = {name: getattr(settings, name) for name in cls._fields if hasattr(settings, name)}
        derived = {
            "variant": VARIANTS.index(settings.variant),
            "gate": GATES.index(settings.gate),
            "predicted_side": settings.side_rule == "predicted",
            "speed_variance": settings.sigma_speed**2,
            "heading_variance": settings.sigma_heading**2,
            "position_variance0": settings.position_sigma0**2,
            "velocity_variance0": settings.velocity_sigma0**2,
            "sine_of_pitch": float(np.sin(settings.expected_pitch)),
        }
        return cls(**same | derived)
