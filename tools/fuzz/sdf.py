"""Models of Gazebo with elements that are lost, doubled, renamed or absurd, for `laisn hull`."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

from tools.fuzz.case import FuzzCase
from tools.fuzz.values import WILD, number

MODELS = Path(__file__).resolve().parents[2] / "tests" / "data" / "gazebo"
_NUMBERS = re.compile(r"(?<=>)\s*[-+]?[\d.][-\d.eE+ ]*(?=<)")
_BLOCKS = re.compile(r"<(\w+)[^>]*>(?:(?!<\1).)*?</\1>", re.DOTALL)
_VECTORS = ("1 2", "0 0 0", "0 0 0 nan 0 0", "1 2 3 4 5 6 7", "1e200", "-1e200", "9" * 400)
_ENTITIES = (
    '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">'
    '<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>'
)


@cache
def _models() -> tuple[str, ...]:
    return tuple(path.read_text("utf-8") for path in sorted(MODELS.glob("*.sdf")))


def _pick(pattern: re.Pattern[str], text: str, random: Random) -> re.Match[str] | None:
    matches = list(pattern.finditer(text))
    return random.choice(matches) if matches else None


def _change_number(text: str, random: Random) -> str:
    match = _pick(_NUMBERS, text, random)
    value = random.choice((number(random), random.choice(WILD), random.choice(_VECTORS)))
    return text[: match.start()] + value + text[match.end() :] if match else text


def _change_lines(text: str, random: Random) -> str:
    lines = text.splitlines(keepends=True)
    index = random.randrange(len(lines))
    lines[index : index + 1] = random.choice(([], [lines[index]] * 2))
    return "".join(lines)


def _rename(text: str, random: Random) -> str:
    tags = re.findall(r"<([A-Za-z_]+)>", text)
    if not tags:
        return text
    other = random.choice([*tags, "x", "link", "model", "joint", "include", "frame"])
    return re.sub(
        rf"(</?){random.choice(tags)}>", rf"\1{other}>", text, count=random.choice((0, 2))
    )


def _change_letter(text: str, random: Random) -> str:
    position = random.randrange(len(text))
    return text[:position] + random.choice("<>&\"'\x01é ") + text[position + 1 :]


def _cut(text: str, random: Random) -> str:
    position = random.randrange(len(text))
    return text[:position] + text[position + random.randrange(200) :]


def _change_block(text: str, random: Random) -> str:
    match = _pick(_BLOCKS, text, random)
    if not match:
        return text
    block = match[0]
    tag = match[1]
    depth = random.choice((1, 2000))
    nested = f"<{tag}>" * depth + block + f"</{tag}>" * depth
    other = random.choice(("", block * 2, block * 300, nested))
    return text[: match.start()] + other + text[match.end() :]


def _expand_entities(text: str, random: Random) -> str:
    position = random.choice([match.end() for match in re.finditer(">", text)])
    return _ENTITIES + re.sub(r"<\?xml[^>]*>", "", text[:position]) + "&c;" + text[position:]


def _change_names(text: str, random: Random) -> str:
    name = random.choice(("", "a b", "../x", "<", "é", "x" * 3000))

    def other(match: re.Match[str]) -> str:
        return f'name="{name}"' if random.random() < 0.2 else match[0]

    return re.sub(r'name="[^"]*"', other, text)


CHANGES: tuple[Callable[[str, Random], str], ...] = (
    _change_number,
    _change_number,
    _change_number,
    _change_lines,
    _rename,
    _change_letter,
    _cut,
    _change_block,
    _expand_entities,
    _change_names,
)


def make(random: Random) -> FuzzCase:
    """A model with up to six changes."""
    text = random.choice(_models())
    for change in random.choices(CHANGES, k=random.choice((1, 1, 2, 3, 6))):
        text = change(text, random) or " "
    return FuzzCase(
        words=["hull", "--sdf", "in.sdf"], files={"in.sdf": text.encode("utf-8", "replace")}
    )
