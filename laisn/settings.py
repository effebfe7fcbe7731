"""Settings of navigators: what all of them are given, and every constant of the paper with its value as default."""

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np

from laisn.records import Offset, require_numbers, require_offsets

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
    """β: σp = β / sep [m²]."""
    sigma_floor: float = 0.0
    """Smallest σp that the filter is given [m]; the paper has none."""
    alpha: float = 8.0
    """α: process noise from manoeuvres [m/s²]."""
    sigma_a0: float = 60.0
    """σa0: process noise in steady motion [m/s²]."""
    sigma_speed: float = 0.2
    """σV of the speed update [m/s]."""
    sigma_heading: float = float(np.deg2rad(2.0))
    """σθ of the speed update [rad]."""
    position_sigma0: float = 0.0
    """p_pos_std of the start [m]."""
    velocity_sigma0: float = 0.0
    """p_vel_std of the start [m/s]."""
    leader_speed_max: float = 3.0
    """v_max of the leader in γv [m/s]."""
    follower_speed_max: float = 3.0
    """v_max of the follower in γv and in the gate [m/s]."""
    gate: GateRule = "v-max"
    """Gross-error gate (Section 2.4): travel since the last accepted fix at top or at measured speed, or none."""
    side_rule: SideRule = "behind"
    """Where a fix without two clear intersections goes: always behind (the paper), or to the predicted end."""
    expected_pitch: float = 0.0
    """Pitch that a level-leader follower must expect; adds Δz sin(…) to σp in squares [rad] (not in the paper)."""
    use_single_range: bool = False
    """Where one range alone arrived, move the prediction along its line of sight; the paper drops it."""

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
