"""Studies, scenarios and settings with keys and values that are wrong, for `laisn check` and
`laisn study`.
"""

from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from sim.scenario.settings import Scenario
from tools.fuzz.case import FuzzCase
from tools.fuzz.values import WILD, number

_ROOT = Path(__file__).resolve().parents[2]
_ODD_KEYS = (
    "followers.*.depth_m",
    "followers.9.depth_m",
    "followers.-1.depth_m",
    "nosuch",
    "a.b.c.d",
    ".",
    "..",
    "",
    "leader..depth_m",
    "__class__",
    "followers",
    "navigation",
)
# strings as values
_WORDS = ("tight", "ekf", "laisn3(2)", "T5", "remus100", "mod:Class", "../../etc", "x:", "::")
# heads of tables that are none, or of the wrong kind
_TABLES = ("[followers]", "[[leader]]", "[[followers]]", "[factors]", "[draws]", "[[arms]]", "[x]")
_SHORT_STUDY = ["--set", "duration_s=1", "--set", "motion=kinematic"]


def _keys_of(table: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _keys_of(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


@cache
def _keys() -> tuple[str, ...]:
    return (*_keys_of(Scenario(followers=[{"route": "T5"}]).model_dump()), *_ODD_KEYS)


@cache
def _texts() -> tuple[str, ...]:
    """Scenarios and studies of the project."""
    paths = [*_ROOT.glob("experiments/**/*.toml"), *_ROOT.glob("examples/*.toml")]
    return tuple(path.read_text("utf-8") for path in sorted(paths))


def _value(random: Random) -> str:
    match random.randrange(7):
        case 0:
            return random.choice(WILD)
        case 1:
            return number(random)
        case 2:
            return "[" * random.choice((1, 50, 5000)) + "1" + "]" * random.choice((1, 50, 5000))
        case 3:
            return "{a=" * random.choice((1, 50, 3000)) + "1" + "}" * random.choice((1, 50, 3000))
        case 4:
            return "9" * random.choice((20, 400, 5000, 100_000))
        case 5:
            return random.choice(_WORDS)
        case _:
            return ",".join(random.choice(WILD) for _ in range(3))


def _draw(random: Random) -> str:
    low = _value(random)
    high = _value(random)
    return random.choice(
        (
            f"{{uniform=[{low},{high}]}}",
            f"{{normal=[{low},{high}]}}",
            f"{{choice=[{low},{high}]}}",
            f"{{{low}={high}}}",
            "{uniform=[1,0]}",
            "{normal=[0,-1]}",
            "{uniform=[-1e308,1e308]}",
            "{uniform=[0,1],normal=[0,1]}",
            low,
        )
    )


def _settings(random: Random) -> FuzzCase:
    """Settings on the command line."""
    if random.random() < 0.5:
        words = ["check", "T7"]
        options = ["--set"]
    else:
        words = ["study", random.choice(("T5", "T7", "T2")), "--dry-run", *_SHORT_STUDY]
        options = ["--set", "--vary", "--draw"]
    for _ in range(random.choice((1, 1, 3))):
        value = random.choice((_value, _draw))(random)
        words += [random.choice(options), f"{random.choice(_keys())}={value}"]
    return FuzzCase(words=words)


def _changed(text: str, random: Random) -> str:
    """A file with one line changed."""
    lines = text.splitlines(keepends=True)
    index = random.randrange(len(lines))
    match random.randrange(6):
        case 0:
            lines.pop(index)
        case 1:
            lines.insert(index, random.choice(lines))
        case 2:
            lines = lines[: index + 1]
        case 3:
            lines.insert(index, f"{random.choice(_keys())} = {_value(random)}\n")
        case 4:
            lines.insert(index, f"{random.choice(_TABLES)}\n")
        case _:
            key = lines[index].partition("=")[0]
            lines[index] = f"{key}= {random.choice((_value, _draw))(random)}\n"
    return "".join(lines) or "\n"


def _file(random: Random) -> FuzzCase:
    """A scenario or study with lines that are wrong."""
    text = random.choice(_texts())
    for _ in range(random.choice((1, 1, 2, 4))):
        text = _changed(text, random)
    words = random.choice((["check", "in.toml"], ["study", "in.toml", "--dry-run", *_SHORT_STUDY]))
    return FuzzCase(words=words, files={"in.toml": text.encode("utf-8", "surrogatepass")})


def make(random: Random) -> FuzzCase:
    """Wrong settings in words or in a file."""
    return random.choice((_settings, _file))(random)
