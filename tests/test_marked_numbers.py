"""Numbers of README and docs stand where words say whose they are: two that change places are noticed.

A number between markers is that of the finding which its marker names (`tests/test_docs.py`). Whether the marker itself
is at its place only the words about it can tell: where findings of a sentence differ in one part of their names, such
as the navigator, these parts are mentioned in the order of the numbers.
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import pytest

from tools.documents.markers import DOCUMENTS

MARKER = re.compile(r"<!--= (\S+) ((?:\S+ )*?)((?:(?:low|high) )?)([.,]?\d*[fdsg%]+(?: i)?) -->.*?<!--/-->", re.DOTALL)
END = re.compile(r"\n(?=[-*|] ?)|(?<=[.:!?])\s+(?=[A-Z(*])")
"""Where sentences, items of lists and rows of tables end."""

WORDS = {
    "laisn-2": "LAISN-2", "laisn-3-1": r"LAISN-3\(1\)", "laisn-3-2": r"LAISN-3\(2\)", "many-laisn-2": "LAISN-2 in #",
    "Plaza1": "Plaza 1", "Plaza2": "Plaza 2",
    "2": "Δz = 2 m|two transmitters|twice|each of the routes", "3": "three", "10": "at 10 m", "0.5": "Half|to 0.5 m",
    "5s": "equal errors",
    "asymmetric": "of LAISN-2's runs", "asymmetric-centred": "centred",
    "10s-beta10": "medians", "10s-slow-beta10": "at Δt = 1 s", "T8-plan": "point motion",
    "behind": "# m behind", "beside": "# m beside", "calm": "calm water", "current": "currents",
    "holds": "# holds? on", "depends": "# depend on", "does-not-hold": "# fail", "undecided": "# are undecided",
    "off-rms": "stray", "arrival": "reach waypoints", "pitch-max": "of pitch", "roll-max": "of roll",
    "tight-2": "# with two", "tight-3": "# with three", "off": "# m off its place",
    "error": "as printed|errs by #", "printed": "m, printed #",
    "real": "becomes|to #|real leader", "level": "instead of|from #|level one",
    "attitude-0": "exactly", "ahrs-0.5": "AHRS", "attitude-0.5": "0.5° off",
    "met": "meets", "missed": "misses", "harmed": "# missions", "open": "leaves it open|; on #", "beyond": "# of these",
    "inclinometer": "alone is wrong", "pitch": "hull pitches", "following-sea-ahrs": "following-sea-ahrs|gyros",
    "lost-runs": "loses #", "lost": "which is #|or #|at #", "drawn": "Of # faults", "noticed": "noticed #",
    "bound": "RMS error", "ratio": "mean error", "many-runs": "Of # runs", "many-captured": "mirror image in|three, #",
    "nees-most": "up to #", "captured": "# of the runs are captured",
    "scale": "too long", "sigma": "off by", "range_sigma": "σ of a range", "speed_sigma": "that of the log",
    "leader": "leader's compass", "echoes": "Echoes", "G7": r"\(G7\)", "G1": "instead of #|in G1",
    "unaware": "makes it #", "aware": "assumed #", "1": "every second|every 1 s", "5": "filtering in G1|every 5 s",
    "many": "at most #|share at #", "number": "# (hold|depend|fail|are)", "list": r"\((claims? )?#",
    "captures-removed": "removes #",
    "straight": "from # and", "weaving": "to # and",
}  # fmt: skip
"""What documents say for a part of a finding's name, where that is not the part itself; # is a number."""
RANGES = (
    ("low", "high"),
    ("least", "most"),
    ("nees-least", "nees-most"),
    ("least", "largest"),
    ("slowest", "quickest"),
)
"""Both ends of a range need no words: the first stands first, as documents write ranges."""
ENDS = {end for ends in RANGES for end in ends}

Name = tuple[str, ...]
"""Study, parts of the finding's name, and which limit, or nothing."""


class Sentence(NamedTuple):
    """A sentence with two numbers or more; # stands for each of them."""

    text: str
    before: tuple[str, ...]
    """Where its words are looked for: in itself, else in its paragraph until its end, else in the document."""
    names: list[Name]


def sentences(document: str) -> Iterator[Sentence]:
    prose = re.sub(r"^```.*?^```", "", document, flags=re.DOTALL | re.MULTILINE).replace("#", "")
    read = ""
    for paragraph in re.split(r"\n\s*\n", prose):
        told = ""
        for sentence in END.split(paragraph):
            text = re.sub(r"\s+", " ", MARKER.sub("#", sentence))
            told, read = f"{told} {text}", f"{read} {text}"
            names = [named(*match.groups()) for match in MARKER.finditer(sentence)]
            if len(names) > 1:
                yield Sentence(text, (text, told, read), names)


def named(study: str, key: str, limit: str, _: str) -> Name:
    parts = key.strip().replace("does not hold", "does-not-hold").split()
    parts += ["list"] if parts[0] == "our" and parts[-1] != "number" else []
    return (study, *parts, limit.strip())


def mention(part: str, text: str) -> tuple[int, str]:
    """Where a part of a name is mentioned first, and in which words; -1 if it is not."""
    found = re.search(WORDS.get(part, re.escape(part)), text)
    return (found.start(), found[0]) if found else (-1, "")


def disordered(sentence: Sentence, names: list[Name]) -> Iterator[str]:
    """Parts in which names differ that are not mentioned in the order of the numbers."""
    groups: dict[tuple[int, int, Name], list[str]] = defaultdict(list)
    for name in names:
        for i, part in enumerate(name):
            groups[len(name), i, (*name[:i], *name[i + 1 :])] += [part] if part else []
    for parts in groups.values():
        for first, second in combinations(dict.fromkeys(parts), 2):
            if (second, first) in RANGES:
                yield f"{second!r} does not stand before {first!r}"
            if {first, second} & ENDS:
                continue
            both = ([mention(part, text)[0] for part in (first, second)] for text in sentence.before)
            here, there = next((places for places in both if min(places) >= 0), (0, 0))
            if here >= there:
                yield f"{first!r} is not mentioned before {second!r}"


def misplaced(sentence: Sentence, names: list[Name]) -> Iterator[str]:
    """Numbers that stand before the words for them, and not in the same clause."""
    numbers = [match.start() for match in re.finditer("#", sentence.text)]
    kinds: dict[tuple[str, int, int], set[str]] = defaultdict(set)
    for name in names:
        for i, part in enumerate(name):
            kinds[name[0], i, len(name) if i > 1 else 0].add(part)
    for name, number in zip(names, numbers, strict=True):
        for i, part in enumerate(name):
            if len(kinds[name[0], i, len(name) if i > 1 else 0]) == 1 or part in ENDS | {""}:
                continue
            mentioned, words = mention(part, sentence.text)
            if mentioned > number and ("#" in words or re.search("[;,]", sentence.text[number:mentioned])):
                yield f"{' '.join(name)} stands before any word for {part!r}"


def fault(sentence: Sentence, names: list[Name]) -> str:
    """What is wrong with numbers of these names in a sentence; empty: nothing."""
    wrong = [*disordered(sentence, names), *misplaced(sentence, names)]
    return f"{'; '.join(wrong)} (WORDS has what counts as a mention): {sentence.text}" if wrong else ""


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.stem)
def test_numbers_stand_in_the_order_of_the_words_for_them(document: Path) -> None:
    for sentence in sentences(document.read_text(encoding="utf-8")):
        assert not fault(sentence, sentence.names)


def test_two_numbers_that_change_places_are_noticed() -> None:
    """But for a few that are next to each other and have no words between them, such as the ends of two ranges."""
    swapped, unnoticed = 0, []
    for document in DOCUMENTS:
        for sentence in sentences(document.read_text(encoding="utf-8")):
            for i, j in combinations(range(len(sentence.names)), 2):
                names = sentence.names.copy()
                names[i], names[j] = names[j], names[i]
                swapped += 1
                unnoticed += [] if fault(sentence, names) else [(sentence.names[i], sentence.names[j])]
    assert swapped > 200
    assert len(unnoticed) <= 0.02 * swapped, unnoticed
