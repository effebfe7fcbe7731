"""Mutants: faults put into the code on purpose, one at a time, each of which some test should notice.

`make mutants MUTANTS=60` draws 60 of each package; `python -m tests.mutants laisn/fix.py` tries all of one file. Work
is done on copies, which share a cache of their own of compiled code: what a mutant can reach is compiled anew.
Survivors are faults that no test sees, or change nothing that anybody could see: those are argued in argued.toml.
"""

import argparse
import os
import random
import re
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from time import monotonic
from typing import NamedTuple

from scipy.stats import binomtest

from experiments.gallery import house
from experiments.gallery.house import ROOT
from tests.mutants.cover import covering
from tests.mutants.faults import Mutant, mutants_of
from tests.mutants.trial import Copy

PACKAGES = {
    "laisn": r"laisn/.+",
    "sim": r"sim/(geometry|water|vehicle|sensing)/.+",
    "experiments": r"experiments/(intervals|findings|campaign/lane_\w+|campaign/montecarlo"
    r"|(asymmetry|reproduction|estimators|closed_loop|route_keeping|study)/(?!\w*(page|chart|figure|film|gallery|report|example))\w+)\.py",
}  # fmt: skip
"""Sources that are tried: navigation; physics and sensing; statistics and tables."""
ARGUED = Path(__file__).with_name("argued.toml")


class Tried(NamedTuple):
    """What became of a mutant: whether a test noticed, else why nobody could, if that is argued."""

    mutant: Mutant
    noticed: bool
    why: str


def argued() -> dict[tuple[str, str, str], str]:
    """Why a change of a file changes nothing that anybody could see."""
    entries = tomllib.loads(ARGUED.read_text(encoding="utf-8")).get("equivalent", [])
    return {(e["file"], e["was"], e["becomes"]): e["why"] for e in entries}


def drawn(pattern: str, count: int | None, seed: int) -> tuple[list[Mutant], int]:
    """Mutants of the sources whose path matches: all, or so many drawn at random; and how many there are."""
    files = sorted(str(path.relative_to(ROOT)) for path in house.modules().values())
    found = [mutant for file in files if re.fullmatch(pattern, file) for mutant in mutants_of(file)]
    return found if count is None else random.Random(seed).sample(found, min(count, len(found))), len(found)


def summary(package: str, tried: list[Tried], of: int) -> str:
    """How many were noticed, with Wilson's interval where they were drawn from more."""
    noticed = sum(t.noticed for t in tried)
    text = f"{package}: {noticed} of {len(tried)} noticed, {noticed / len(tried):.0%}"
    if len(tried) < of:
        limits = binomtest(noticed, len(tried)).proportion_ci(method="wilson")
        text += f" (95 %: {limits.low:.0%} to {limits.high:.0%}), drawn from {of}"
    return f"{text}; {sum(bool(t.why) for t in tried)} of those left change nothing, as is argued"


@contextmanager
def borrowed(copies: "SimpleQueue[Copy]") -> Iterator[Copy]:
    """A copy that nobody else uses meanwhile."""
    copy = copies.get()
    try:
        yield copy
    finally:
        copies.put(copy)


def attempt(copies: "SimpleQueue[Copy]", mutant: Mutant, took: Mapping[str, float]) -> Tried:
    """Try a mutant, and print it if it survives; one whose tests take far longer than they `took` runs for ever."""
    with borrowed(copies) as copy:
        noticed = copy.notices(mutant, 60.0 + 5.0 * sum(took[test] for test in covering(mutant.file)))
    was, becomes = mutant.change()
    why = "" if noticed else argued().get((mutant.file, was, becomes), "")
    if noticed:
        print(".", end="", flush=True)
    else:
        print(f"\n{mutant.file}:{mutant.line}\n  - {was}\n  + {becomes}\n  {why or 'SURVIVES'}", flush=True)
    return Tried(mutant, noticed, why)


def control(copies: "SimpleQueue[Copy]", test: str) -> float:
    """How long a test file takes without any mutant, code compiled anew [s].

    Raises:
        SystemExit: it fails.
    """
    with borrowed(copies) as copy:
        began = monotonic()
        said = copy.control(test)
    if said:
        raise SystemExit(f"{said}\n{test} fails without any mutant")
    return monotonic() - began


def main() -> None:
    """Draw mutants, try them, list survivors and say what share was noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "where", nargs="*", help=f"sources, such as laisn/fix.py, or packages; default: {' '.join(PACKAGES)}"
    )
    parser.add_argument("--count", type=int, help="how many to draw of each package (default: all, which takes days)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="how many to try at a time")
    given = parser.parse_args()
    patterns = {place: PACKAGES.get(place, re.escape(place)) for place in given.where} or PACKAGES
    chosen = {name: drawn(pattern, given.count, given.seed) for name, pattern in patterns.items()}
    tests = sorted({test for mutants, _ in chosen.values() for m in mutants for test in covering(m.file)})
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder, ThreadPoolExecutor(given.jobs) as pool:
        copies: SimpleQueue[Copy] = SimpleQueue()
        kept = Path(folder) / "kept"
        kept.mkdir()
        for job in range(given.jobs):
            copies.put(Copy(Path(folder) / str(job), kept))
        took = dict(zip(tests, pool.map(lambda test: control(copies, test), tests), strict=True))
        for package, (mutants, of) in chosen.items():
            tried = list(pool.map(lambda mutant: attempt(copies, mutant, took), mutants))
            print(f"\n{summary(package, tried, of)}", flush=True)


if __name__ == "__main__":
    main()
