"""Settings of a navigator as formulas take them: numbers alone, so that compiled code can."""

from typing import NamedTuple, Self, TypeVar

import numpy as np

from laisn.settings import VARIANTS, NavigationSettings

GATE_OFF, GATE_MAX, GATE_MEASURED = range(3)

_VARIANTS: dict[str, int] = {variant: number for number, variant in enumerate(VARIANTS)}
_GATES = {"off": GATE_OFF, "v-max": GATE_MAX, "v-measured": GATE_MEASURED}
_SIDES = {"behind": False, "predicted": True}

Choice = TypeVar("Choice")


def _number(name: str, chosen: str, known: dict[str, Choice]) -> Choice:
    """What formulas know a choice as."""
    if chosen not in known:
        raise NotImplementedError(f"no formula knows the {name} {chosen!r}; there are: {', '.join(known)}")
    return known[chosen]


class Tuning(NamedTuple):
    """`NavigationSettings` as numbers; fields of the same name mean the same."""

    variant: int
    """Index in `VARIANTS`."""
    gate: int
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
        """Settings as numbers; NotImplementedError naming a choice that no formula knows."""
        return cls(
            variant=_number("variant", settings.variant, _VARIANTS),
            gate=_number("gate", settings.gate, _GATES),
            predicted_side=_number("side_rule", settings.side_rule, _SIDES),
            use_attitude=settings.use_attitude,
            transmitters=settings.transmitters,
            dt=settings.dt,
            baseline=settings.baseline,
            middle_offset=settings.middle_offset,
            hydrophone_height=settings.hydrophone_height,
            threshold=settings.threshold,
            beta=settings.beta,
            sigma_floor=settings.sigma_floor,
            alpha=settings.alpha,
            sigma_a0=settings.sigma_a0,
            speed_variance=settings.sigma_speed**2,
            heading_variance=settings.sigma_heading**2,
            position_variance0=settings.position_sigma0**2,
            velocity_variance0=settings.velocity_sigma0**2,
            leader_speed_max=settings.leader_speed_max,
            follower_speed_max=settings.follower_speed_max,
            sine_of_pitch=float(np.sin(settings.expected_pitch)),
        )
