"""Mutants: faults put into the code on purpose, one at a time, each of which some test should notice.

`make mutants MUTANTS=60` draws 60 of each package; `python -m tools.mutants laisn/fix.py` tries all of one file. Work
is done on copies, by processes that share a cache of compiled code: what a mutant can reach is compiled anew.
Survivors are faults that no test sees, or change nothing that anybody could see: those are argued in argued.toml.
"""

import argparse
import multiprocessing
import os
import platform
import random
import re
import tempfile
import tomllib
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from pathlib import Path
from typing import NamedTuple

from scipy.stats import binomtest

from experiments.campaign.version import code_version
from experiments.findings import Finding, Findings, plain, read
from tools import import_graph
from tools.import_graph import ROOT
from tools.mutants.cover import SOURCES, covering
from tools.mutants.faults import Mutant, mutants_of
from tools.mutants.trial import Outcome, attempt, control

PACKAGES = {
    "laisn": r"laisn/.+",
    "sim": r"sim/((geometry|water|vehicle|sensing|control)/.+|scenario/(point_motion|\w*routes|shapes)\.py"
    r"|(closed_loop|excerpt|flight|\w*fleet|motion|station_keeping|tracking|trajectory)\.py)",
    "experiments": r"experiments/(intervals|findings|campaign/(bound|cells|lane_\w+|montecarlo|tight_runs)"
    r"|pages/(account|bound_panel)|flight/(anatomy|separation|summary|swarm|tables?)"
    r"|(asymmetry|reproduction|estimators|closed_loop|route_keeping|real_ranges|formation|study)"
    r"/(?!\w*(page|chart|figure|film|report|example))\w+)\.py|tools/documents/(tables|hull_trials|flights)\.py",
}  # fmt: skip
"""Sources that are tried: navigation; physics, sensing and steering; statistics, tables and computed sentences."""
ARGUED = Path(__file__).with_name("argued.toml")


class Tried(NamedTuple):
    """What became of a mutant: whether a test noticed, else why nobody could, if that is argued."""

    mutant: Mutant
    noticed: bool
    why: str
    slow: bool = False
    """Its tests did not end in time, alone on the machine, which is not taken for noticing it."""


def argued() -> dict[tuple[str, str, str], str]:
    """Why a change of a file changes nothing that anybody could see."""
    entries = tomllib.loads(ARGUED.read_text(encoding="utf-8")).get("equivalent", [])
    return {(e["file"], e["was"], e["becomes"]): e["why"] for e in entries}


def drawn(pattern: str, count: int | None, seed: int) -> tuple[list[Mutant], int]:
    """Mutants of the sources whose path matches: all, or so many drawn at random; and how many there are."""
    files = sorted(str(path.relative_to(ROOT)) for path in import_graph.modules(packages=SOURCES).values())
    found = [mutant for file in files if re.fullmatch(pattern, file) for mutant in mutants_of(file)]
    return found if count is None else random.Random(seed).sample(found, min(count, len(found))), len(found)


def summary(package: str, tried: list[Tried], of: int) -> str:
    """How many were noticed, with Wilson's interval where they were drawn from more."""
    noticed = sum(t.noticed for t in tried)
    text = f"{package}: {noticed} of {len(tried)} noticed, {noticed / len(tried):.0%}"
    slow = sum(t.slow for t in tried)
    text += f", {slow} of the others take tests too long" if slow else ""
    if len(tried) < of:
        limits = binomtest(noticed, len(tried)).proportion_ci(method="wilson")
        text += f" (95 %: {limits.low:.0%} to {limits.high:.0%}), drawn from {of}"
    return f"{text}; {sum(bool(t.why) for t in tried)} of those left change nothing, as is argued"


def told(mutant: Mutant, outcome: Outcome) -> Tried:
    """Print a mutant if no test failed, else a dot."""
    noticed = outcome is Outcome.NOTICED
    why = "" if noticed else argued().get((mutant.file, *mutant.change()), "")
    tried = Tried(mutant, noticed, why, outcome is Outcome.SLOW)
    if noticed:
        print(".", end="", flush=True)
    else:
        was, becomes = mutant.change()
        print(
            f"\n{mutant.file}:{mutant.line}\n  - {was}\n  + {becomes}\n  {tried.why or outcome.value.upper()}",
            flush=True,
        )
    return tried


def record(found: dict[str, tuple[list[Tried], int]], seed: int, before: Mapping[str, Finding]) -> Findings:
    """What a draw came to, for the documents; it names the code that it tried, and does not age with it.

    Args:
        found: mutants tried of each package, and how many there are.
        seed: of the draw.
        before: what the record held; what other packages came to stays.
    """
    findings = {name: finding for name, finding in before.items() if name.rpartition(" ")[2] not in found}
    tried_on = f"version {code_version()}, Python {platform.python_version()}, {date.today()}"
    for package, (tried, of) in found.items():
        noticed, counted = sum(t.noticed for t in tried), len(tried) - sum(bool(t.why) for t in tried)
        limits = binomtest(noticed, counted).proportion_ci(method="wilson")
        findings |= {
            f"noticed {package}": Finding(
                value=round(noticed / counted, 4), low=round(limits.low, 4), high=round(limits.high, 4),
                what="share of the mutants drawn that a test notices, less those that change nothing; Wilson, 95 %",
            ),
            f"drawn {package}": plain(len(tried), f"mutants tried, of {of}"),
            f"nothing {package}": plain(sum(bool(t.why) for t in tried), "of these that change nothing, as is argued"),
            f"survived {package}": plain(counted - noticed, "of these that no test notices, or not in time"),
            f"seed {package}": plain(seed, f"of the draw, from {tried_on}"),
        }  # fmt: skip
    return Findings(
        study="mutants", command='make mutants MUTANTS=60 MUTANTS_ARGS="PACKAGE --seed SEED"', modules=(),
        version="each package has its own", findings=findings,
    )  # fmt: skip


def main() -> None:
    """Draw mutants, try them, list survivors and say what share was noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "where", nargs="*", help=f"sources, such as laisn/fix.py, or packages; default: {' '.join(PACKAGES)}"
    )
    parser.add_argument("--count", type=int, help="how many to draw of each package (default: all, which takes a day)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="how many to try at a time")
    parser.add_argument("--record", type=Path, help="write what it came to into this file, which keeps other packages")
    given = parser.parse_args()
    patterns = {place: PACKAGES.get(place, re.escape(place)) for place in given.where} or PACKAGES
    chosen = {name: drawn(pattern, given.count, given.seed) for name, pattern in patterns.items()}
    tests = sorted({test for mutants, _ in chosen.values() for m in mutants for test in covering(m.file)})
    # one thread in each process, which forks
    os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        folder = Path(name)
        (folder / "kept").mkdir()
        with ProcessPoolExecutor(given.jobs, multiprocessing.get_context("spawn")) as pool:
            times = pool.map(control, [folder] * len(tests), tests)
            took = dict(zip(tests, times, strict=True))
            found = {}
            for package, (mutants, of) in chosen.items():
                results = pool.map(attempt, [folder] * len(mutants), mutants, [took] * len(mutants))
                tried, slow = [], []
                for mutant, outcome in zip(mutants, results, strict=True):
                    if outcome is Outcome.SLOW:
                        slow.append(mutant)
                    else:
                        tried.append(told(mutant, outcome))
                # once more, with no other trial beside them
                tried += [told(mutant, pool.submit(attempt, folder, mutant, took).result()) for mutant in slow]
                found[package] = tried, of
                print(f"\n{summary(package, *found[package])}", flush=True)
    if given.record:
        before = read(given.record).findings if given.record.is_file() else {}
        record(found, given.seed, before).write(given.record)


if __name__ == "__main__":
    main()
