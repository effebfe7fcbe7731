"""Pixels on their way from the renderer to the canvas, and from the canvas to the encoder."""

from laisn.arrays import Bytes
from laisn.compiled import compiled

_BITS = 16
_HALF = 1 << (_BITS - 1)
# ITU-R BT.709: luma coefficients of red, green and blue; 219 levels of luma from 16 on, 224 of chroma about 128
_RED, _GREEN, _BLUE = 0.2126, 0.7152, 0.0722
_LUMA = tuple(round(219 / 255 * share * (1 << _BITS)) for share in (_RED, _GREEN, _BLUE))
_CB = tuple(round(224 / 255 * share * (1 << _BITS)) for share in
            (-_RED / (2 - 2 * _BLUE), -_GREEN / (2 - 2 * _BLUE), 0.5))  # fmt: skip
_CR = tuple(round(224 / 255 * share * (1 << _BITS)) for share in
            (0.5, -_GREEN / (2 - 2 * _RED), -_BLUE / (2 - 2 * _RED)))  # fmt: skip
_Y0, _Y1, _Y2 = _LUMA
_B0, _B1, _B2 = _CB
_R0, _R1, _R2 = _CR


@compiled
def upright(source: Bytes, target: Bytes) -> None:
    """Turn a picture from OpenGL, bottom row first, shape (h, w, 3), into one from the top, opaque, shape (h, w, 4)."""
    height, width = source.shape[0], source.shape[1]
    for i in range(height):
        row, out = source[height - 1 - i], target[i]
        for j in range(width):
            out[j, 0] = row[j, 0]
            out[j, 1] = row[j, 1]
            out[j, 2] = row[j, 2]
            out[j, 3] = 255


@compiled
def lay(target: Bytes, light: Bytes, shine: Bytes) -> None:
    """Lay over a part of a picture, shape (h, w, 4), light that lets so many parts in 255 of it through, (h, w, 3)."""
    for i in range(light.shape[0]):
        for j in range(light.shape[1]):
            for channel in range(3):
                below = (int(target[i, j, channel]) * int(shine[i, j, channel]) + 127) // 255
                target[i, j, channel] = min(255, below + int(light[i, j, channel]))


@compiled
def to_yuv420(source: Bytes, planes: Bytes) -> None:
    """Turn RGB into Y'CbCr after ITU-R BT.709, limited range, with half the chroma each way (ITU-T H.264, Annex E).

    Chroma lies as H.264 expects it unless told otherwise: at the even columns, and between two rows.

    Args:
        source: shape (h, w, 4), h and w even; the fourth channel is not read.
        planes: filled with luma and then both chroma planes, shape (h · 3/2, w), as PyAV's `from_ndarray` takes them.
    """
    height, width = source.shape[0], source.shape[1]
    flat = planes.reshape(planes.size)
    for i in range(height):
        row, luma = source[i], flat[width * i : width * (i + 1)]
        for j in range(width):
            weighted = _Y0 * int(row[j, 0]) + _Y1 * int(row[j, 1]) + _Y2 * int(row[j, 2])
            luma[j] = 16 + ((weighted + _HALF) >> _BITS)
    half = width // 2
    for i in range(height // 2):
        upper, lower = source[2 * i], source[2 * i + 1]
        start = height * width + half * i
        blue, red = flat[start : start + half], flat[start + height * width // 4 : start + height * width // 4 + half]
        for j in range(half):
            at = 2 * j
            left, right = max(at - 1, 0), at + 1
            r = g = b = 0
            for line in (upper, lower):
                r += int(line[left, 0]) + 2 * int(line[at, 0]) + int(line[right, 0])
                g += int(line[left, 1]) + 2 * int(line[at, 1]) + int(line[right, 1])
                b += int(line[left, 2]) + 2 * int(line[at, 2]) + int(line[right, 2])
            blue[j] = 128 + ((_B0 * r + _B1 * g + _B2 * b + (_HALF << 3)) >> (_BITS + 3))
            red[j] = 128 + ((_R0 * r + _R1 * g + _R2 * b + (_HALF << 3)) >> (_BITS + 3))
