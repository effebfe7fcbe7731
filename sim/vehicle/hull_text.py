"""What may stand in the text of a hull, looked at before MuJoCo reads it.

MuJoCo does as a file says: it lays out a height field of a billion points, repeats a part a million times, and warns in
a file of its own where it leaves out what a hull says of the sea. A hull needs none of that.
"""

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import models

_FILES = re.compile(r"<!DOCTYPE|<include\b|\b(?:file|file\w+|assetdir|meshdir|texturedir|plugin)\s*=", re.IGNORECASE)
_ELEMENTS = {
    "mujoco", "compiler", "option", "default", "asset", "material", "mesh", "worldbody", "body", "freejoint", "joint",
    "inertial", "geom", "site", "camera", "light", "actuator", "general", "keyframe", "key", "custom", "numeric",
    "text",
}  # fmt: skip
_MOST_VALUES = 1000
"""Of a numeric; MuJoCo makes room for as many as the file says."""
_FINEST = 64
"""Largest parameter of a mesh that MuJoCo builds: facets, or subdivisions."""
_MOST_ELEMENTS = {"mesh": 20, "geom": 200, "site": 200}
"""Largest number of elements of a kind: each mesh takes memory, and MuJoCo moves each site at every step."""
_LARGEST = 1e9
"""Largest size of a number."""
_NOT_FINITE = re.compile(r"[+-]?(nan(\(\w*\))?|inf(inity)?)", re.IGNORECASE)
"""Numbers as C reads them that are not finite."""


def _numbers(text: str) -> Iterator[float]:
    """The numbers in the value of an attribute."""
    for word in text.split():
        if _NOT_FINITE.fullmatch(word):
            yield math.nan
        with suppress(ValueError):
            yield float(word)


def _told(element: Element, name: str) -> str:
    return f"<{element.tag} {name}={element.get(name, '')[:40]!r}>"


def _excesses(root: Element) -> Iterator[str]:
    """Numbers that are not finite, or larger than those of any hull, and too many elements."""
    for tag, most in _MOST_ELEMENTS.items():
        count = sum(1 for _ in root.iter(tag))
        if count > most:
            yield f"has {count} elements <{tag}>, at most {most}"
    for element in root.iter():
        for name, value in element.items():
            if not all(abs(number) <= _LARGEST for number in _numbers(value)):
                yield f"{_told(element, name)} must be finite and within ±{_LARGEST:g}"
    for element, name, most in chain(
        ((numeric, "size", _MOST_VALUES) for numeric in root.iter("numeric")),
        ((mesh, "params", _FINEST) for mesh in root.iter("mesh")),
    ):
        if max(_numbers(element.get(name, "")), default=0.0) > most:
            yield f"{_told(element, name)} may be {most} at most"


def _of_the_sea(root: Element) -> Iterator[str]:
    """Options that are not those under which all vehicles swim."""
    sea = ElementTree.parse(models.path("ocean")).getroot().find("option")
    assert sea is not None
    for option in root.iter("option"):
        for name, value in option.items():
            if value.split() != sea.get(name, "").split():
                yield f"{_told(option, name)} is the sea's to say: {sea.get(name, 'leave it out')}"


def strange(text: str) -> list[str]:
    """What a hull may not hold.

    Args:
        text: of its file.

    Returns:
        A line for each thing that has no place there; empty if there is none.
    """
    outside = _FILES.search(text)
    if outside:
        return [f"names other files ({outside[0].strip()}): a hull is one file; looks are made of plain geoms"]
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        return [f"not valid MJCF: {error}"]
    unknown = sorted({element.tag for element in root.iter()} - _ELEMENTS)
    lines = [f"may not hold <{tag[:40]}>: a hull is one body, and its looks are plain geoms" for tag in unknown]
    return [*lines, *_excesses(root), *_of_the_sea(root)]
