"""Values that no setting, cell or number of a file is ready for."""

from random import Random

WILD = (
    "",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e400",
    "9" * 5000,
    "-0",
    "0x10",
    "1_000",
    "١٢",
    "1,5",
    "abc",
    "\x00",
    "é",
    "1e-320",
    "2026-05-01T12:00:00Z",
    "99999999999999999999",
    "true",
    "[1]",
    "{}",
    " 3 ",
    "-8",
    "°",
    '"',
    "'",
    "\t",
    "\ud800",
    "💥",
)


def number(random: Random) -> str:
    """A number, or nearly."""
    return repr(random.choice((0, 1, -1, 0.5, 1e3, 1e9, -1e9, 1e-9, random.uniform(-100, 100))))


def damaged(content: bytes, random: Random, changes: int) -> bytes:
    """Bytes with bits turned, pieces lost, doubled, zeroed or put in between."""
    data = bytearray(content)
    for _ in range(changes):
        if not data:
            break
        at = random.randrange(len(data))
        match random.randrange(7):
            case 0:
                data[at] ^= 1 << random.randrange(8)
            case 1:
                del data[at:]
            case 2:
                data[at : at + 500] = bytes(len(data[at : at + 500]))
            case 3:
                data[at:at] = data[at : at + 1000]
            case 4:
                del data[at : at + random.choice((1, 8, 300))]
            case 5:
                data[at : at + 8] = b"\xff" * len(data[at : at + 8])
            case _:
                data[at:at] = random.randbytes(50)
    return bytes(data)
