"""Labels of the film: where they are placed, and which comes first."""

import numpy as np
import pytest

from sim.film.canvas import Canvas
from sim.film.overlay import Label, place_labels
from tests.sim.film.filmed import WHITE, overlap


def crowded_labels(n: int, seed: int) -> list[Label]:
    """Labels of n vehicles at random pixels, preferably above and below them in turn."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform([300, 100], [1000, 600], size=(n, 2))
    return [
        Label(position, f"vehicle {i}", WHITE, (-1) ** i * 30.0)
        for i, position in enumerate(positions)
    ]


@pytest.mark.parametrize("seed", range(6))
def test_labels_keep_clear_of_each_other_markers_panels_and_edges(seed: int) -> None:
    frame, panels = Canvas(1280, 720), [(16.0, 16.0, 292.0, 258.0), (1032.0, 16.0, 232.0, 232.0)]
    labels = crowded_labels(25, seed)
    placed = place_labels(labels, panels, frame)
    areas = [area for _, area, _ in placed]
    assert len(placed) > 15
    markers = [(float(label.at[0]) - 5, float(label.at[1]) - 5, 10.0, 10.0) for label in labels]
    for i, area in enumerate(areas):
        left, top, width, height = area
        assert left >= 0
        assert top >= 0
        assert left + width <= 1280
        assert top + height <= 720
        assert not any(overlap(area, other) for other in (*areas[:i], *panels, *markers))


def test_the_first_label_has_the_first_choice() -> None:
    frame, marker = Canvas(1280, 720), np.array([640.0, 360.0])
    first, second = (
        Label(marker, "first", WHITE, -30.0),
        Label(marker + np.array([9.0, 1.0]), "second", WHITE, -30.0),
    )
    ((_, area_of_first_alone, line_end),) = place_labels([first], [], frame)
    assert line_end - marker == pytest.approx([16.0, -30.0])
    (_, area_of_first, _), (_, area_of_second, _) = place_labels([first, second], [], frame)
    assert area_of_first == area_of_first_alone
    ((_, area_of_second_alone, _),) = place_labels([second], [], frame)
    assert area_of_second != area_of_second_alone


def test_a_label_without_room_is_left_out() -> None:
    frame = Canvas(1280, 720)
    label = Label(np.array([640.0, 360.0]), "nowhere", WHITE, 30.0)
    assert place_labels([label], [(0.0, 0.0, 1280.0, 720.0)], frame) == []
