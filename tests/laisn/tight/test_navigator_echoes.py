"""What a tightly coupled navigator makes of messages that come by a reflection as a whole."""

import numpy as np
import pytest

import laisn_sim


@pytest.mark.system
@pytest.mark.parametrize("transmitters", [2, 3])
def test_a_fifth_of_echoes_neither_moves_the_estimate_nor_locks_it_on_the_mirror_image(
    transmitters: int,
) -> None:
    """Echoes off the surface and the floor are some 3 and 14 m longer than the direct way: an
    estimate that follows one of them, or a ring about it, is tens of metres off.
    """
    echoing = {
        "motion": "kinematic",
        "acoustics.common_echoes": True,
        "acoustics.surface_echo_probability": 0.1,
        "acoustics.bottom_echo_probability": 0.1,
        "navigation.variant": "tight",
        "navigation.assume.transmitters": transmitters,
    }
    for run in range(5):
        flight = laisn_sim.fly("T3", {**echoing, "run": run})
        direct = laisn_sim.fly(
            "T3",
            {
                **echoing,
                "run": run,
                "acoustics.surface_echo_probability": 0.0,
                "acoustics.bottom_echo_probability": 0.0,
            },
        )
        excess_m = flight.measurements[0].ranges - direct.measurements[0].ranges
        reflected_share = np.mean(np.nanmax(excess_m, axis=1) > 2.0)
        assert 0.15 < reflected_share < 0.25
        errors = laisn_sim.errors(flight)
        assert np.max(errors["e_p_m"]) < 2.0
        assert np.mean(errors["e_p_m"]) < 0.3
        assert not np.any(errors["mirror_locked"])
