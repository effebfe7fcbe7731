"""The shipped REMUS 100 against Fossen's published model with the same commands, for 100 s."""

import numpy as np
import pytest

from laisn.arrays import Floats
from tests.sim.vehicle import fossen_remus100 as fossen
from tools.documents.hull_trials import remus_flight

STERN_PLANE = np.radians(-5.0)
"""Deflection of his published pitch [rad]."""
SURGE, PITCH, TURN_RATE = 6, 4, 11
"""Where they are in a state of his model."""


@pytest.mark.parametrize(
    ("rpm", "rudder_deg", "plane_deg", "state_index", "published"),
    [
        (1000, 5, 0, TURN_RATE, np.radians(2.092)),
        (1525, 15, 0, TURN_RATE, np.radians(7.767)),
        (1525, 0, -5, PITCH, np.radians(20.86)),
        (1525, 0, 0, SURGE, 2.5536),
    ],
)
def test_fossens_model_written_anew_has_his_published_figures(
    rpm: float, rudder_deg: float, plane_deg: float, state_index: int, published: float
) -> None:
    command = np.radians(rudder_deg), np.radians(plane_deg), rpm
    _, states = fossen.fly(lambda _: command, 150.0, fossen.Terms())
    assert states[-1, state_index] == pytest.approx(published, rel=1e-3)


def largest_differences(his_states: Floats, ours: Floats) -> tuple[float, float, float]:
    """Largest differences of position [m], surge [m/s] and turn rate [rad/s] in 100 s, between the
    states of his model and what `remus_flight` returns.
    """
    return (
        float(np.linalg.norm(his_states[:, :3] - ours[:, :3], axis=1).max()),
        float(np.abs(his_states[:, SURGE] - ours[:, 3]).max()),
        float(np.abs(his_states[:, TURN_RATE] - ours[:, 4]).max()),
    )


@pytest.mark.system
def test_with_our_terms_his_model_moves_as_ours() -> None:
    """Propeller step, dive and turn at once: rudder 5°, stern plane −5° until 50 s, as in his
    `stepInput`.
    """
    ours = remus_flight(
        np.radians(5.0), STERN_PLANE, 1525.0, {50.0: (np.radians(5.0), 0.0, 1525.0)}
    )

    def command(t: float) -> tuple[float, float, float]:
        return np.radians(5.0), STERN_PLANE if t < 50.0 else 0.0, 1525.0

    position_difference, surge_difference, turn_rate_difference = largest_differences(
        fossen.fly(command, 100.0, fossen.OURS, (50.0,))[1], ours
    )
    assert position_difference < 0.1
    assert surge_difference < 2e-3
    assert turn_rate_difference < 1e-3
    # with none or with one of our terms alone the difference is larger
    for terms in (
        fossen.Terms(),
        fossen.Terms(fin_incidence=True),
        fossen.Terms(hull_normal_force=True),
    ):
        assert (
            largest_differences(fossen.fly(command, 100.0, terms, (50.0,))[1], ours)[0]
            > 3 * position_difference
        )


@pytest.mark.parametrize(
    ("rpm", "published_deg_s"), [(1000, 4.644), (1525, 7.767)], ids=["1000 /min", "1525 /min"]
)
def test_the_shipped_remus_turns_as_published_at_full_rudder(
    rpm: float, published_deg_s: float
) -> None:
    """One lift slope of the rudders is fitted to both figures. With smaller deflections the shipped
    hull turns slower than published.
    """
    last = remus_flight(np.radians(15.0), 0.0, rpm, {})[-1]
    assert abs(np.degrees(last[4])) == pytest.approx(published_deg_s, rel=0.025)


@pytest.mark.parametrize(
    ("rpm", "published_deg"), [(1000, 8.80), (1525, 20.86)], ids=["1000 /min", "1525 /min"]
)
def test_the_shipped_remus_pitches_as_published(rpm: float, published_deg: float) -> None:
    last = remus_flight(0.0, STERN_PLANE, rpm, {})[-1]
    assert np.degrees(last[5]) == pytest.approx(published_deg, rel=0.01)
