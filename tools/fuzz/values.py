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
        position = random.randrange(len(data))
        match random.randrange(7):
            case 0:
                data[position] ^= 1 << random.randrange(8)
            case 1:
                del data[position:]
            case 2:
                data[position : position + 500] = bytes(len(data[position : position + 500]))
            case 3:
                data[position:position] = data[position : position + 1000]
            case 4:
                del data[position : position + random.choice((1, 8, 300))]
            case 5:
                data[position : position + 8] = b"\xff" * len(data[position : position + 8])
            case _:
                data[position:position] = random.randbytes(50)
    return bytes(data)
