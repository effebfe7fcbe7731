"""Text and images into frames; compiled code stands apart, with no import but of `laisn`."""

import numpy as np
import numpy.typing as npt

from laisn.arrays import Bytes
from laisn.compiled import compiled

Singles = npt.NDArray[np.float32]


@compiled
def blend(
    frame: Bytes,
    mask: Bytes,
    left: int,
    top: int,
    red: float,
    green: float,
    blue: float,
    opacity: float,
) -> None:
    """Lay a colour, its channels and its opacity in [0, 1], over a frame, shape (rows, columns, 4),
    as far as a mask of values in [0, 255], shape (h, w), covers it.

    `left` and `top` are where the mask's corner lies in the frame [px]; what lies outside is left
    out.
    """
    colour = (255.0 * red, 255.0 * green, 255.0 * blue)
    for i in range(max(0, -top), min(mask.shape[0], frame.shape[0] - top)):
        for j in range(max(0, -left), min(mask.shape[1], frame.shape[1] - left)):
            if mask[i, j]:
                share = mask[i, j] / 255.0 * opacity
                for channel in range(3):
                    value = float(frame[top + i, left + j, channel])
                    frame[top + i, left + j, channel] = np.uint8(
                        value + share * (colour[channel] - value) + 0.5
                    )


@compiled
def lay(frame: Bytes, colour: Singles, share: Singles, left: int, top: int) -> None:
    """Add a layer's colour, shape (h, 4 w), to a share, of the same shape, of what a frame that
    holds the whole layer has there.
    """
    width = colour.shape[1]
    for i in range(colour.shape[0]):
        row = frame[top + i].reshape(-1)[4 * left : 4 * left + width]
        colours = colour[i]
        shares = share[i]
        for k in range(width):
            value = np.float32(colours[k] + np.float32(row[k]) * shares[k])
            row[k] = np.uint8(np.int32(value))
