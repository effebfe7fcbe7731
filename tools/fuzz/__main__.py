"""Look for inputs with faulty answers: `python -m tools.fuzz [KIND …] --count 1000`."""

import argparse
import secrets
import shutil
import sys
import tempfile
from pathlib import Path
from random import Random

from tools.fuzz import logs, plugins, sdf, studies, tables, vehicles
from tools.fuzz.case import TOO_LONG, Kind, answer_to, faults_of, report

KINDS: dict[str, Kind] = {
    "tables": tables.make,
    "vehicles": vehicles.make,
    "sdf": sdf.make,
    "studies": studies.make,
    "logs": logs.make,
    "plugins": plugins.make,
}
FOLDER = Path("out") / "fuzz"
"""Where the inputs of faults are kept."""


def search(kind: str, seed: int, count: int, folder: Path) -> int:
    """Try so many inputs of a kind, print what is wrong with answers and keep their inputs in a
    folder; returns how many inputs had faulty answers.
    """
    faulty = 0
    for k in range(count):
        case = KINDS[kind](Random(f"{kind} {seed} {k}"))
        with tempfile.TemporaryDirectory() as work:
            answer = answer_to(case, Path(work) / "in")
            if answer.code == TOO_LONG:
                # code that was compiled is stored now
                answer = answer_to(case, Path(work) / "in")
        faults = faults_of(case, answer)
        if not faults:
            continue
        faulty += 1
        case_folder = folder / f"{kind}-{seed}-{k}"
        shutil.rmtree(case_folder, ignore_errors=True)
        case_folder.mkdir(parents=True)
        for name, content in case.files.items():
            (case_folder / name).write_bytes(content)
        print(f"{case_folder}: {report(case, answer, faults)}", flush=True)
    return faulty


def main() -> int:
    """Exit code 1 if there is a fault."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("kinds", nargs="*", choices=[*KINDS, []], help="all if none is named")
    parser.add_argument("--count", type=int, default=1000, help="inputs of each kind")
    parser.add_argument("--seed", type=int, default=None, help="by chance if left out")
    arguments = parser.parse_args()
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    total = 0
    for kind in arguments.kinds or KINDS:
        faulty = search(kind, seed, arguments.count, FOLDER)
        print(f"{kind}: {arguments.count} inputs, seed {seed}: {faulty} faults", flush=True)
        total += faulty
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main())
