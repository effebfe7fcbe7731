"""The shipped REMUS 100 against Fossen's published model with the same commands, for 100 s."""

import numpy as np
import pytest

from laisn.arrays import Floats
from tests.sim.vehicle import fossen_remus100 as fossen
from tools.documents.hull_trials import remus_flight

PLANE = np.radians(-5.0)


@pytest.mark.parametrize(
    ("rpm", "rudder", "plane", "quantity", "published"),
    [
        (1000, 5, 0, 11, np.radians(2.092)),
        (1525, 15, 0, 11, np.radians(7.767)),
        (1525, 0, -5, 4, np.radians(20.86)),
        (1525, 0, 0, 6, 2.5536),
    ],
)
def test_the_model_has_the_published_figures(
    rpm: float, rudder: float, plane: float, quantity: int, published: float
) -> None:
    command = np.radians(rudder), np.radians(plane), rpm
    _, states = fossen.fly(lambda _: command, 150.0, fossen.Terms())
    assert states[-1, quantity] == pytest.approx(published, rel=1e-3)


def difference(states: Floats, ours: Floats) -> tuple[float, float, float]:
    """Largest differences of position [m], surge [m/s] and turn rate [rad/s] in 100 s."""
    return (
        float(np.linalg.norm(states[:, :3] - ours[:, :3], axis=1).max()),
        float(np.abs(states[:, 6] - ours[:, 3]).max()),
        float(np.abs(states[:, 11] - ours[:, 4]).max()),
    )


@pytest.mark.system
def test_with_our_terms_his_model_moves_as_ours() -> None:
    """Propeller step, dive and turn at once: rudder 5°, stern plane −5° until 50 s, as in his
    `stepInput`.
    """
    ours = remus_flight(np.radians(5.0), PLANE, 1525.0, {50.0: (np.radians(5.0), 0.0, 1525.0)})

    def command(t: float) -> tuple[float, float, float]:
        return np.radians(5.0), PLANE if t < 50.0 else 0.0, 1525.0

    place, speed, turning = difference(fossen.fly(command, 100.0, fossen.OURS, (50.0,))[1], ours)
    assert place < 0.1
    assert speed < 2e-3
    assert turning < 1e-3
    # each term alone leaves more than that
    for terms in (
        fossen.Terms(),
        fossen.Terms(fin_incidence=True),
        fossen.Terms(hull_normal_force=True),
    ):
        assert difference(fossen.fly(command, 100.0, terms, (50.0,))[1], ours)[0] > 3 * place


@pytest.mark.parametrize(
    ("rpm", "published_deg_s"), [(1000, 4.644), (1525, 7.767)], ids=["1000 /min", "1525 /min"]
)
def test_the_shipped_remus_turns_as_published_at_full_rudder(
    rpm: float, published_deg_s: float
) -> None:
    """The slope of the rudders, one number, is fitted to both; smaller rudders turn it less."""
    last = remus_flight(np.radians(15.0), 0.0, rpm, {})[-1]
    assert abs(np.degrees(last[4])) == pytest.approx(published_deg_s, rel=0.025)


@pytest.mark.parametrize(
    ("rpm", "published_deg"), [(1000, 8.80), (1525, 20.86)], ids=["1000 /min", "1525 /min"]
)
def test_the_shipped_remus_pitches_as_published(rpm: float, published_deg: float) -> None:
    last = remus_flight(0.0, PLANE, rpm, {})[-1]
    assert np.degrees(last[5]) == pytest.approx(published_deg, rel=0.01)
