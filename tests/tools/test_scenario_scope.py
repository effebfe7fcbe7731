"""Stages take the parts that they read; a whole `Scenario` is for what reads, checks, assembles and
flies missions. A function that needs one more thing takes that, or a part of `sim.scenario.parts`
with it.
"""

import ast
from collections import Counter
from pathlib import Path

import pytest

import sim

ROOT = Path(sim.__file__).parents[1]
PACKAGES = ("laisn", "sim", "reports", "experiments", "laisn_sim")

# modules at the top, and how many of their functions may take a whole scenario
AT_THE_TOP = {
    # commands, and functions of users
    "laisn_sim/cli/fly.py": 3,
    "laisn_sim/simulation.py": 2,
    "laisn_sim/simulations.py": 1,
    "experiments/flight/library.py": 2,
    "experiments/flight/results.py": 1,
    "reports/sea_page.py": 1,
    # checks before a flight
    "sim/feasibility.py": 2,
    "sim/cautions.py": 2,
    "sim/trial.py": 2,
    "experiments/study/plan.py": 1,
    # flights, and what they are assembled of
    "experiments/flight/fly.py": 2,
    "sim/simulation.py": 2,
    "sim/closed_loop.py": 4,
    "sim/open_loop.py": 1,
    "sim/flight.py": 3,
    # missions and cells of campaigns
    "experiments/campaign/campaign.py": 1,
    "experiments/campaign/montecarlo.py": 4,
    "experiments/study/measure.py": 1,
    # a scenario taken apart
    "sim/scenario/parts.py": 7,
    "experiments/studies/formation/findings.py": 1,
}


def takes_scenario(annotation: ast.expr | None) -> bool:
    """Whether a parameter of this annotation is a scenario, perhaps among other types."""
    match annotation:
        case ast.Name(id="Scenario") | ast.Attribute(attr="Scenario"):
            return True
        case ast.Constant(value=str(text)):
            return takes_scenario(ast.parse(text, mode="eval").body)
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            return takes_scenario(left) or takes_scenario(right)
        case ast.Subscript(value=ast.Name(id="Annotated" | "Optional"), slice=inner):
            first = inner.elts[0] if isinstance(inner, ast.Tuple) else inner
            return takes_scenario(first)
    return False


def functions_with_scenario(source: str) -> list[str]:
    """Names of the functions of a module that take a scenario."""
    names = []
    # to parse a source takes long, and most do not name it
    for node in ast.walk(ast.parse(source)) if "Scenario" in source else ():
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = node.args
            parameters = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            if any(takes_scenario(parameter.annotation) for parameter in parameters):
                names.append(node.name)
    return names


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("def f(scenario: Scenario) -> None: ...", ["f"]),
        ("def f(*, source: str | Scenario | None = None) -> None: ...", ["f"]),
        ("def f(scenario: 'settings.Scenario', /) -> None: ...", ["f"]),
        ("class A:\n    async def g(self, s: Annotated[Scenario, 'help']) -> None: ...", ["g"]),
        ("def f(plan: MissionPlan, check: Callable[[Scenario], None]) -> Scenario: ...", []),
    ],
)
def test_functions_that_take_a_scenario_are_told_from_others(
    source: str, expected: list[str]
) -> None:
    assert functions_with_scenario(source) == expected


def test_only_what_is_at_the_top_takes_a_whole_scenario() -> None:
    count_by_module = Counter[str]()
    names: dict[str, list[str]] = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = path.relative_to(ROOT).as_posix()
            names[module] = functions_with_scenario(path.read_text("utf-8"))
            count_by_module[module] = len(names[module])
    too_many = {
        module: names[module]
        for module, count in count_by_module.items()
        if count > AT_THE_TOP.get(module, 0)
    }
    assert too_many == {}, "take what is read of a scenario, or a part of `sim.scenario.parts`"
    too_few = {
        module: allowed
        for module, allowed in AT_THE_TOP.items()
        if count_by_module[module] < allowed
    }
    assert too_few == {}, "lower these numbers, so that they do not grow again"
    assert count_by_module.total() <= 43
