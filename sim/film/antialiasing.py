"""Smooth edges without multisampling: compiled code, in a module that imports nothing of `sim`."""

import numpy as np
import numpy.typing as npt

from laisn.arrays import Bytes, Ints
from laisn.compiled import compiled, inlined

_CONTRAST = 20
"""Smallest difference of brightness, of 255, that counts as an edge: hulls against water do,
sand and sheen do not.
"""
_MAX_EDGE_PX = 16  # how far along an edge its ends are looked for, at most


@inlined
def _brightness(picture: Bytes, row: int, column: int) -> float:
    """Brightness of a pixel in [0, 255]."""
    return (
        2 * int(picture[row, column, 0])
        + 5 * int(picture[row, column, 1])
        + int(picture[row, column, 2])
    ) / 8.0


@compiled
def _edge_end(
    source: Bytes,
    row: int,
    column: int,
    step: tuple[int, int],
    step_across: tuple[int, int],
    mean: float,
    limit: float,
) -> tuple[int, float]:
    """Steps to the end of an edge, and there the mean brightness of the two rows that it separates,
    less `mean`.
    """
    height = source.shape[0]
    width = source.shape[1]
    difference = 0.0
    for n in range(1, _MAX_EDGE_PX + 1):
        i = row + n * step[0]
        j = column + n * step[1]
        if not (0 <= i < height and 0 <= j < width):
            return n, 0.0
        inner = _brightness(source, i, j)
        outer = _brightness(source, i + step_across[0], j + step_across[1])
        difference = (inner + outer) / 2.0 - mean
        if abs(difference) >= limit:
            return n, difference
    return _MAX_EDGE_PX, difference


@inlined
def _smooth_pixel(source: Bytes, target: Bytes, i: int, j: int) -> None:
    """Write a pixel mixed with its neighbour across the edge on which it lies."""
    # brightness of this pixel, m for the middle, and of its neighbours by directions of the compass
    m = _brightness(source, i, j)
    n = _brightness(source, i - 1, j)
    s = _brightness(source, i + 1, j)
    w = _brightness(source, i, j - 1)
    e = _brightness(source, i, j + 1)
    nw = _brightness(source, i - 1, j - 1)
    ne = _brightness(source, i - 1, j + 1)
    sw = _brightness(source, i + 1, j - 1)
    se = _brightness(source, i + 1, j + 1)
    horizontal_strength = abs(nw + sw - 2 * w) + 2 * abs(n + s - 2 * m) + abs(ne + se - 2 * e)
    vertical_strength = abs(nw + ne - 2 * n) + 2 * abs(w + e - 2 * m) + abs(sw + se - 2 * s)
    before, after = (n, s) if horizontal_strength >= vertical_strength else (w, e)
    # the edge runs between this pixel and that of its two neighbours which differs more
    side = -1 if abs(before - m) >= abs(after - m) else 1
    beyond = before if side < 0 else after
    step_across = (side, 0) if horizontal_strength >= vertical_strength else (0, side)
    mean = (m + beyond) / 2.0
    limit = abs(beyond - m) / 4.0
    step = (0, 1) if horizontal_strength >= vertical_strength else (1, 0)
    backward = (-step[0], -step[1])
    steps_back, difference_back = _edge_end(source, i, j, backward, step_across, mean, limit)
    steps_ahead, difference_ahead = _edge_end(source, i, j, step, step_across, mean, limit)
    nearest = min(steps_back, steps_ahead)
    difference = difference_back if steps_back < steps_ahead else difference_ahead
    # At the nearer end both rows take the brightness of one side. If it is this pixel's, the edge
    # steps away from it, and the pixel stays as it is.
    if (difference < 0) == (m < mean):
        return
    share = 0.5 - nearest / (steps_back + steps_ahead)
    for channel in range(3):
        value = float(source[i, j, channel])
        other = float(source[i + step_across[0], j + step_across[1], channel])
        target[i, j, channel] = np.uint8((1 - share) * value + share * other + 0.5)


@inlined
def _fill_brightness_x8(picture: Bytes, row: int, brightness_x8: npt.NDArray[np.int16]) -> None:
    """Eight times the brightness of the pixels of a row."""
    for j in range(picture.shape[1]):
        brightness_x8[j] = (
            2 * np.int16(picture[row, j, 0])
            + 5 * np.int16(picture[row, j, 1])
            + np.int16(picture[row, j, 2])
        )


@compiled
def smooth(source: Bytes, target: Bytes, areas: Ints) -> None:
    """Write the smoothed edges of some areas of a picture, in the manner of FXAA 3 (T. Lottes,
    NVIDIA, 2011).

    On a processor four samples a pixel cost as much again as the whole frame, this a hundredth.
    `target` is another array with the picture of `source`, shape (rows, columns, 3 or 4). Areas
    have left, top, width and height, shape (n, 4); they may overlap and reach beyond the picture.
    """
    rows = source.shape[0]
    columns = source.shape[1]
    # rows of which three are in use at a time: an array of the whole picture would be new memory
    # for every frame
    brightness_x8 = np.empty((3, columns), np.int16)
    is_candidate = np.empty(columns, np.uint8)
    filled = -1
    for i in range(1, rows - 1):
        is_candidate[:] = 0
        first = columns
        end = 0
        for a in range(len(areas)):
            left, top, width, height = areas[a]
            if top <= i < top + height:
                right = min(left + width, columns - 1)
                left = max(left, 1)
                is_candidate[left : max(left, right)] = 1
                first = min(first, left)
                end = max(end, right)
        if first >= end:
            continue
        for row in range(max(i - 1, filled + 1), i + 2):
            _fill_brightness_x8(source, row, brightness_x8[row % 3])
        filled = i + 1
        here = brightness_x8[i % 3]
        middle, above, below = (
            here[first:end],
            brightness_x8[(i - 1) % 3][first:end],
            brightness_x8[(i + 1) % 3][first:end],
        )
        west, east = here[first - 1 : end - 1], here[first + 1 : end + 1]
        marks = is_candidate[first:end]
        edges = np.uint8(0)
        for k in range(end - first):
            high = max(middle[k], above[k], below[k], west[k], east[k])
            low = min(middle[k], above[k], below[k], west[k], east[k])
            marks[k] &= high - low >= 8 * _CONTRAST
            edges |= marks[k]
        if edges:
            for k in range(end - first):
                if marks[k]:
                    _smooth_pixel(source, target, i, first + k)
