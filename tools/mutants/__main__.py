"""Mutation tests: change the sources one place at a time by operators of cosmic-ray and run the
tests that cover it.

`make mutants MUTANTS=60` draws 60 of each package; `python -m tools.mutants laisn/fix.py` tries all
of one file. Every process works in its own copy of the checkout. A mutant that no test kills is
either equivalent to the original, which `equivalent.toml` lists with the reason, or a gap in the
tests.
"""

import argparse
import multiprocessing
import os
import platform
import random
import re
import tempfile
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from pathlib import Path

from cosmic_ray.work_item import MutationSpec
from scipy.stats import binomtest

from reports.findings import Finding, Findings, plain_finding, read_findings, version_of
from tools import import_graph
from tools.documents.markers import RECORDS
from tools.import_graph import ROOT
from tools.mutants.cover import SOURCES, covering
from tools.mutants.trial import Tried, attempt, enter_copy, mutants_of, time_of

PACKAGES = {
    "laisn": r"laisn/.+",
    "sim": r"sim/((vehicle|sensing|control|water)/.+"
    r"|scenario/(point_motion|routes|formation)\.py"
    r"|(attitude|closed_loop|open_loop|flight|simulation|tracking|trajectory|leader|link_receiver"
    r"|estimated_route)\.py)",
    "experiments": r"experiments/(beacon_replay|pitch|benchmark/score|studies/\w+/findings"
    r"|campaign/(lane_flight|montecarlo)|study/(estimate|design|measure))\.py"
    r"|reports/(bound|findings|headline|intervals|range_budget|summary|tables|verdict)\.py"
    r"|tools/documents/(tables|hull_trials|flights)\.py",
}
"""Sources that are changed: navigation; physics, sensing and control; statistics, tables and
computed sentences.
"""


def draw(pattern: str, count: int | None, seed: int) -> tuple[list[MutationSpec], int]:
    """Mutants of the sources whose path matches, `count` of them at random or all; and how many
    there are.
    """
    files = sorted(
        str(path.relative_to(ROOT)) for path in import_graph.modules(packages=SOURCES).values()
    )
    candidates = [
        mutant for file in files if re.fullmatch(pattern, file) for mutant in mutants_of(file)
    ]
    chosen = candidates
    if count is not None:
        chosen = random.Random(seed).sample(candidates, min(count, len(candidates)))
    return chosen, len(candidates)


def summary(package: str, trials: list[Tried], candidates: int) -> str:
    """How many were killed, with Wilson's interval where they were drawn from more."""
    killed = sum(t.killed for t in trials)
    text = f"{package}: {killed} of {len(trials)} killed, {killed / len(trials):.0%}"
    if len(trials) < candidates:
        limits = binomtest(killed, len(trials)).proportion_ci(method="wilson")
        text += f" (95 %: {limits.low:.0%} to {limits.high:.0%}), drawn from {candidates}"
    timed_out = sum(t.timed_out for t in trials)
    equivalent = sum(bool(t.equivalent) and not t.killed for t in trials)
    others = f"{timed_out} timed out and {equivalent} are equivalent to the original"
    return f"{text}; of the others {others}"


def record(
    results: dict[str, tuple[list[Tried], int]], seed: int, before: Findings | None
) -> Findings:
    """What a draw found, for the documents.

    Args:
        results: mutants tried of each package, and how many there are.
        seed: of the draw.
        before: the former record; its findings of other packages are kept, and with them its
            version.
    """
    files = [
        str(path.relative_to(ROOT)) for path in import_graph.modules(packages=SOURCES).values()
    ]
    sources = (
        file
        for file in sorted(files)
        if any(re.fullmatch(pattern, file) for pattern in PACKAGES.values())
    )
    modules = tuple(
        file.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for file in sources
    )
    version = version_of(modules)
    others = (
        {n: f for n, f in before.findings.items() if n.rpartition(" ")[2] not in results}
        if before
        else {}
    )
    findings = dict(others)
    for package, (trials, candidates) in results.items():
        equivalent = sum(bool(t.equivalent) and not t.killed for t in trials)
        killed = sum(t.killed for t in trials)
        counted = len(trials) - equivalent
        limits = binomtest(killed, counted).proportion_ci(method="wilson")
        findings |= {
            f"noticed {package}": Finding(
                value=round(killed / counted, 4),
                low=round(limits.low, 4),
                high=round(limits.high, 4),
                what="share of the mutants drawn, without equivalent ones, that a test kills; "
                "Wilson, 95 %",
            ),
            f"drawn {package}": plain_finding(len(trials), f"mutants tried, of {candidates}"),
            f"nothing {package}": plain_finding(
                equivalent, "of these that are equivalent to the original"
            ),
            f"survived {package}": plain_finding(
                counted - killed, "of these that no test kills, or not in time"
            ),
            f"seed {package}": plain_finding(seed, "of the draw"),
            f"taken {package}": plain_finding(
                f"{date.today()}, version {version}", f"Python {platform.python_version()}"
            ),
        }
    # a record with findings of other sources stays stale
    version = before.version if before and others else version
    command = 'make mutants MUTANTS=60 MUTANTS_ARGS="PACKAGE --seed SEED --record"'
    return Findings(
        study="mutants", command=command, modules=modules, version=version, findings=findings
    )


def main() -> None:
    """Draw mutants, test them, print those that survive and the share that was killed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "where",
        nargs="*",
        help=f"sources, such as laisn/fix.py, or packages; default: {' '.join(PACKAGES)}",
    )
    parser.add_argument(
        "--count",
        type=int,
        help="how many to draw of each package (default: all, which takes a day)",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count(), help="how many to try at a time"
    )
    parser.add_argument(
        "--record", action="store_true", help="write the record that the documents quote"
    )
    arguments = parser.parse_args()
    patterns = {name: PACKAGES.get(name, re.escape(name)) for name in arguments.where} or PACKAGES
    drawn_mutants = {
        name: draw(pattern, arguments.count, arguments.seed) for name, pattern in patterns.items()
    }
    tests = sorted(
        {
            test
            for mutants, _ in drawn_mutants.values()
            for m in mutants
            for tests_of_place in covering(str(m.module_path))
            for test in tests_of_place
        }
    )
    results = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        spawn = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(arguments.jobs, spawn, enter_copy, (Path(folder),)) as pool:
            times = dict(zip(tests, pool.map(time_of, tests), strict=True))
            for package, (mutants, candidates) in drawn_mutants.items():
                trials = []
                for trial in pool.map(attempt, mutants, [times] * len(mutants)):
                    trials.append(trial)
                    if trial.killed:
                        print(".", end="", flush=True)
                    else:
                        ending = trial.equivalent or (
                            "TIMED OUT" if trial.timed_out else "SURVIVED"
                        )
                        print(
                            f"\n{trial.location}\n  - {trial.before}\n  + {trial.after}\n"
                            f"  {ending}",
                            flush=True,
                        )
                results[package] = trials, candidates
                print(f"\n{summary(package, *results[package])}", flush=True)
    if arguments.record:
        path = RECORDS / "mutants.json"
        record(results, arguments.seed, read_findings(path) if path.is_file() else None).write(path)


if __name__ == "__main__":
    main()
