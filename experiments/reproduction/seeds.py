"""Whether the verdicts on the paper's claims depend on the seed: `python -m experiments.reproduction.seeds`.

Judges the claims with 20 seeds on physical missions, and writes `out/claim-seeds/results.json`. Missions are those of
`laisn reproduce`, which do not depend on the seed.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Unpack

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions
from experiments.findings import FILE, Finding, Findings, of, plain, record
from experiments.intervals import proportion
from experiments.reproduction import stages
from experiments.reproduction.claims import CLAIMS
from experiments.reproduction.record import followers_of_the_paper
from experiments.reproduction.replications import tasks
from experiments.reproduction.study import judge
from experiments.reproduction.verdict import Verdict

COMMAND = "python -m experiments.reproduction.seeds"
MODULES = ("experiments.reproduction.seeds",)
SEEDS = range(101, 121)
"""Seeds 1 to 6 served to choose how many replications, and at what confidence, claims are judged by."""
RUNS = 60


def findings_of(verdicts: Mapping[int, Sequence[Verdict]]) -> Findings:
    """The record of the verdicts on all claims, by seed."""
    together, same = Counter(tuple(found) for found in verdicts.values()).most_common(1)[0]
    named: dict[str, Finding] = {
        "seeds": plain(len(verdicts), "seeds"),
        "same": plain(same, "seeds whose verdicts on all claims are the commonest ones"),
        "same share": of(proportion(same, len(verdicts)), "their share of all seeds, 95 %"),
    }
    for i, claim in enumerate(CLAIMS):
        named[f"verdict {claim.number}"] = plain(together[i], f"commonest verdict on claim {claim.number}")
        alike = sum(found[i] == together[i] for found in verdicts.values())
        named[f"same {claim.number}"] = plain(alike, f"seeds with this verdict on claim {claim.number}")
    return record("claim-seeds", COMMAND, MODULES, named)


def run(folder: Path, seeds: Sequence[int] = SEEDS, runs: int = RUNS, **options: Unpack[ExecutionOptions]) -> None:
    """Judge the claims with every seed and write the record.

    Args:
        folder: for the record; made if it is not there.
        seeds: to judge with.
        runs: of each replication.
        options: as of `campaign.fly`.
    """
    followers, published = followers_of_the_paper(), stages.published()
    work = {
        (seed, *name): task
        for seed in seeds
        for name, task in tasks(stages.SETTINGS, followers, motion="physics", runs=runs, seed=seed).items()
    }
    flown = campaign.fly(Design(tasks=work, what="replications"), folder, **options).tasks
    verdicts = {}
    for seed in seeds:
        rows = [row for name, found in flown.items() if name[0] == seed for row in found]
        verdicts[seed] = [ours.verdict for _, ours, _ in judge(rows, published)]
    findings_of(verdicts).write(folder / FILE)


if __name__ == "__main__":
    run(Path("out") / "claim-seeds")
