"""Damaged logs, for the commands that read one."""

import tempfile
from functools import cache
from pathlib import Path
from random import Random

from sim.log import writer
from tests.synthetic import make_flight
from tools.fuzz.case import FuzzCase
from tools.fuzz.values import damaged

COMMANDS = (
    ["log", "info", "in.mcap"],
    ["log", "recover", "in.mcap"],
    ["log", "export", "in.mcap", "tables"],
    ["log", "export", "in.mcap", "tables", "--format", "csv"],
    ["replay", "in.mcap"],
)


@cache
def _whole() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "whole.mcap"
        writer.write(make_flight(5.0), path)
        return path.read_bytes()


def make(random: Random) -> FuzzCase:
    """A log of a flight with some of its bytes changed."""
    content = damaged(_whole(), random, random.choice((1, 1, 2, 8)))
    return FuzzCase(words=list(random.choice(COMMANDS)), files={"in.mcap": content})
