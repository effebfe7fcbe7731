"""Verdicts on the paper's claims with other seeds: `python -m tools.documents.studies
claim-seeds`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

from experiments.campaign.campaign import ExecutionOptions
from experiments.studies.reproduce import findings as claims
from experiments.studies.reproduce.findings import CLAIMS, JUDGED_CELLS, MetricValues, Verdict
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import plan_of
from experiments.study.run import fly_further, fly_studies
from reports.findings import (
    RESULTS_FILE,
    Finding,
    Findings,
    interval_finding,
    plain_finding,
    record,
)
from reports.intervals import proportion

MODULES = ("experiments.studies.reproduce.findings", "experiments.study.run")
"""Modules that the record's numbers depend on, and that its version is of."""
SEEDS = range(101, 121)
"""Seeds 1 to 6 served to choose how many replications, and at what confidence, claims are judged
by.
"""


def findings_of(verdicts: Mapping[int, Sequence[Verdict]]) -> Findings:
    """The record of the verdicts on all claims, by seed."""
    commonest, seeds_alike = Counter(
        tuple(seed_verdicts) for seed_verdicts in verdicts.values()
    ).most_common(1)[0]
    findings: dict[str, Finding] = {
        "seeds": plain_finding(len(verdicts), "seeds"),
        "same": plain_finding(
            seeds_alike, "seeds whose verdicts on all claims are the commonest ones"
        ),
        "same share": interval_finding(
            proportion(seeds_alike, len(verdicts)), "their share of all seeds, 95 %"
        ),
    }
    for i, claim in enumerate(CLAIMS):
        findings[f"verdict {claim.number}"] = plain_finding(
            commonest[i], f"commonest verdict on claim {claim.number}"
        )
        agreements = sum(seed_verdicts[i] == commonest[i] for seed_verdicts in verdicts.values())
        findings[f"same {claim.number}"] = plain_finding(
            agreements, f"seeds with this verdict on claim {claim.number}"
        )
    return record("claim-seeds", "python -m tools.documents.studies claim-seeds", MODULES, findings)


def run(
    folder: Path,
    seeds: Sequence[int] = SEEDS,
    runs: int = 60,
    keys: Mapping[str, Any] | None = None,
    **options: Unpack[ExecutionOptions],
) -> None:
    """Judge the claims on physical missions with every seed, and write the record of their
    verdicts.

    `runs` are those of each replication, `keys` others of the study; folder and options as of
    `campaign.fly`.
    """
    verdicts = {}
    for seed in seeds:
        settings = {**(keys or {}), "seed": seed, "runs": runs}
        plans = {
            study_part: plan_of(study_of(str(file), settings))
            for study_part, file in built_in_files("reproduce").items()
        }
        table_plan = plans["tables"]
        judged = [
            entry
            for entry in table_plan.entries
            if f"{table_plan.points[entry.point]['case']} {entry.arm}" in JUDGED_CELLS
        ]
        plans["tables"] = table_plan.part(judged, runs)
        outcomes = dict(zip(plans, fly_studies([*plans.values()], folder, **options), strict=True))
        fly_further(outcomes, claims.further_runs, folder, **options)
        values = MetricValues.of(outcomes)
        claims_judged = claims.judge(values, claims.published())
        verdicts[seed] = [ours.verdict for _, ours, _ in claims_judged]
    findings_of(verdicts).write(folder / RESULTS_FILE)
