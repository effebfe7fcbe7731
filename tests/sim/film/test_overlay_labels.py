"""Labels of the film: where they find room, and which comes first."""

import numpy as np
import pytest

from sim.film.canvas import Canvas
from sim.film.overlay import Label, place_labels
from tests.sim.film.filmed import WHITE, overlap


def crowd(n: int, seed: int) -> list[Label]:
    rng = np.random.default_rng(seed)
    places = rng.uniform([300, 100], [1000, 600], size=(n, 2))
    return [Label(at, f"vehicle {i}", WHITE, (-1) ** i * 30.0) for i, at in enumerate(places)]


@pytest.mark.parametrize("seed", range(6))
def test_labels_keep_clear_of_everything(seed: int) -> None:
    frame, panels = Canvas(1280, 720), [(16.0, 16.0, 292.0, 258.0), (1032.0, 16.0, 232.0, 232.0)]
    expected = crowd(25, seed)
    placed = place_labels(expected, panels, frame)
    areas = [area for _, area, _ in placed]
    assert len(placed) > 15
    markers = [(float(label.at[0]) - 5, float(label.at[1]) - 5, 10.0, 10.0) for label in expected]
    for i, area in enumerate(areas):
        left, top, width, height = area
        assert left >= 0
        assert top >= 0
        assert left + width <= 1280
        assert top + height <= 720
        assert not any(overlap(area, other) for other in (*areas[:i], *panels, *markers))


def test_the_first_label_has_the_first_choice() -> None:
    frame, at = Canvas(1280, 720), np.array([640.0, 360.0])
    first, second = (
        Label(at, "first", WHITE, -30.0),
        Label(at + np.array([9.0, 1.0]), "second", WHITE, -30.0),
    )
    ((_, alone, end),) = place_labels([first], [], frame)
    assert end - at == pytest.approx([16.0, -30.0])
    (_, still, _), (_, other, _) = place_labels([first, second], [], frame)
    assert still == alone
    ((_, free, _),) = place_labels([second], [], frame)
    assert other != free


def test_a_label_without_room_is_left_out() -> None:
    frame = Canvas(1280, 720)
    label = Label(np.array([640.0, 360.0]), "nowhere", WHITE, 30.0)
    assert place_labels([label], [(0.0, 0.0, 1280.0, 720.0)], frame) == []
