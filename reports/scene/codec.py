"""Arrays as compact text: integers of a unit, differenced along time, as varints, deflated, in
base64. `src/codec.js` reads them.
"""

import base64
import math
import zlib
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, kw_only=True)
class ArrayLayout:
    """Where an array lies among the bytes, column after column, and how it is read."""

    at: int  # its first byte
    rows: int
    columns: int
    order: int  # how often its columns are differenced along the rows
    unit: float  # of its integers


def varints(values: npt.NDArray[np.int64]) -> bytes:
    """Integers as zigzag varints: seven bits a byte, the lowest first; the high bit says that more
    follow.
    """
    zigzag = np.where(values < 0, -2 * values - 1, 2 * values).astype(np.uint64)
    largest = int(zigzag.max(initial=1))
    count = np.arange(1, -(-largest.bit_length() // 7) + 1)
    groups = np.stack(
        [(zigzag >> np.uint64(7 * (i - 1))) & np.uint64(127) for i in count.tolist()], axis=1
    )
    length = np.max(np.where(groups > 0, count, 1), axis=1)
    continuation = np.where(count < length[:, None], 128, 0).astype(np.uint64)
    text: bytes = (groups | continuation)[count <= length[:, None]].astype(np.uint8).tobytes()
    return text


def deflated(data: bytes) -> str:
    """Bytes, deflated without a header, as base64 text."""
    # higher levels take three times as long, for a hundredth of the size
    squeeze = zlib.compressobj(level=6, wbits=-15)
    return base64.b64encode(squeeze.compress(data) + squeeze.flush()).decode("ascii")


class Packer:
    """Arrays behind one another in one byte string, with the layout of each by its name."""

    def __init__(self) -> None:
        self.layouts: dict[str, ArrayLayout] = {}
        self._bytes = bytearray()

    def add(self, name: str, values: npt.ArrayLike, unit: float = 1.0, order: int = 2) -> None:
        """Add an array of shape (rows, …), rounded to multiples of `unit`; `order` as of
        `ArrayLayout`, 0 for what is not smooth. ValueError if the array is not finite.
        """
        table = np.asarray(values, dtype=np.float64)
        table = table.reshape(len(table), math.prod(table.shape[1:]))
        if not np.isfinite(table).all():
            raise ValueError(f"array {name!r} of a scene is not finite")
        rounded = np.rint(table / unit).astype(np.int64)
        for _ in range(order):
            rounded = np.diff(rounded, axis=0, prepend=np.zeros((1, rounded.shape[1]), np.int64))
        self.layouts[name] = ArrayLayout(
            at=len(self._bytes),
            rows=table.shape[0],
            columns=table.shape[1],
            order=order,
            unit=unit,
        )
        self._bytes += varints(rounded.T.ravel())

    def table(self) -> dict[str, dict[str, float]]:
        """The layouts, for JSON."""
        return {name: asdict(layout) for name, layout in self.layouts.items()}

    def text(self) -> str:
        """All bytes, deflated, in base64."""
        return deflated(bytes(self._bytes))
