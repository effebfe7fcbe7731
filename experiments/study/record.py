"""What a study found, number by number, in the form of all studies' `results.json`."""

from experiments import findings
from experiments.campaign.version import code_version
from experiments.findings import Finding, Findings
from experiments.study.estimate import Place, Results
from experiments.study.metrics import METRICS
from experiments.study.plan import Plan


def unit_of(metric: str) -> str:
    """Unit of a metric, from its label; empty where it has none."""
    _, bracket, rest = METRICS[metric].label.partition("[")
    return rest.rstrip("]") if bracket else ""


def _name(place: Place) -> str:
    point, arm, follower = place
    return f"point {point}, arm {arm}, {follower}"


def record_of(plan: Plan, results: Results) -> Findings:
    """The metric of the report at every place, and the arms' differences from the first of them."""
    study, metric = plan.study, plan.study.report.metric
    unit, what, first = unit_of(metric), METRICS[metric].what, plan.arms[0]
    found: dict[str, Finding] = {}
    for place in results.rows:
        estimate = results.estimate(place, metric)
        point = ", ".join(f"{key} = {value}" for key, value in plan.points[place[0]].items())
        found[f"{metric}: {_name(place)}"] = findings.of(estimate, f"{what}; {point}" if point else what, unit)
        if place[1] != first and (place[0], first, place[2]) in results.rows:
            apart = results.difference(place, first, metric)
            found[f"{metric}: {_name(place)}, less {first}"] = findings.of(apart, f"paired difference: {what}", unit)
    return Findings(
        study=study.name,
        command=f"laisn study {study.source}",
        modules=("experiments.study.study",),
        version=code_version(),
        findings=found,
    )
