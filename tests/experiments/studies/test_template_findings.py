"""Findings that the templates of studies name are in the recorded studies, or, of a study that has
grown since it was recorded, among those that it gives.
"""

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import jinja2
import pytest
from jinja2 import nodes

from reports.findings import read_findings
from tests.experiments.studies.rivals.test_findings import findings_without
from tools.documents.markers import RECORDS

STUDIES = Path(__file__).parents[3] / "experiments" / "studies"
# names of recorded studies, by the folder of the study
RECORD_OF = {
    **{name: name for name in ("asymmetry", "estimators", "formation", "front", "thermocline")},
    "reproduce": "reproduce-physics",
}
# functions of templates whose first argument is the name of a finding
LOOKUPS = ("n", "interval", "share", "limited")
ANYTHING = ".*"

Macros = dict[str, nodes.Macro]
Values = dict[str, str]


def pattern_of(expression: nodes.Node, values: Values) -> str:
    """Regular expression of the texts that an expression of a template may have."""
    match expression:
        case nodes.Const():
            return re.escape(str(expression.value))
        case nodes.Name():
            return values.get(expression.name, ANYTHING)
        case nodes.Concat():
            return "".join(pattern_of(node, values) for node in expression.nodes)
        case nodes.Add():
            return pattern_of(expression.left, values) + pattern_of(expression.right, values)
        case nodes.Mod(left=nodes.Const()):
            parts = re.split(r"%[.\d]*[sgdf]", str(expression.left.value))
            return ANYTHING.join(map(re.escape, parts))
        case nodes.CondExpr(expr2=nodes.Node()):
            branches = (expression.expr1, expression.expr2)
            return f"(?:{'|'.join(pattern_of(branch, values) for branch in branches)})"
    return ANYTHING


def arguments_of(call: nodes.Call, macro: nodes.Macro, values: Values) -> Values:
    """Patterns of a macro's arguments in a call of it."""
    names = [argument.name for argument in macro.args]
    patterns = dict(zip(names, (pattern_of(arg, values) for arg in call.args), strict=False))
    return dict.fromkeys(names, ANYTHING) | patterns


def patterns_of_variables(tree: nodes.Node) -> Values:
    """Patterns of variables that are set once in a template, to a text that is known in part."""
    targets: dict[str, list[str]] = {}
    for node in tree.find_all((nodes.Assign, nodes.For)):
        names = (
            [node.target]
            if isinstance(node.target, nodes.Name)
            else node.target.find_all(nodes.Name)
        )
        for name in names:
            text = pattern_of(node.node, {}) if isinstance(node, nodes.Assign) else ANYTHING
            targets.setdefault(name.name, []).append(text)
    return {name: texts[0] for name, texts in targets.items() if len(texts) == 1}


def looked_up(node: nodes.Node, macros: Macros, values: Values, depth: int = 0) -> set[str]:
    """Patterns of the findings that a part of a template looks up."""
    patterns = set[str]()
    for child in node.iter_child_nodes():
        if isinstance(child, nodes.Macro) and depth == 0:
            continue
        callee = child.node if isinstance(child, nodes.Call) else None
        if isinstance(callee, nodes.Name) and callee.name in macros and depth < 4:
            macro = macros[callee.name]
            inner_values = values | arguments_of(child, macro, values)
            patterns |= looked_up(nodes.Scope(macro.body), macros, inner_values, depth + 1)
        elif isinstance(callee, nodes.Name) and callee.name in LOOKUPS and child.args:
            if len(child.args) < 3 or callee.name != "n":  # a third argument stands for none
                patterns.add(pattern_of(child.args[0], values))
        elif (
            isinstance(child, nodes.Getitem)
            and isinstance(child.node, nodes.Name)
            and child.node.name == "found"
        ):
            patterns.add(pattern_of(child.arg, values))
        patterns |= looked_up(child, macros, values, depth)
    return patterns


def findings_named_in(text: str) -> set[str]:
    """Patterns of the findings that a template names."""
    tree = jinja2.Environment(autoescape=True).parse(text)
    macros: Any = {macro.name: macro for macro in tree.find_all(nodes.Macro)}
    return looked_up(tree, macros, patterns_of_variables(tree))


def names_of(study: str) -> Collection[str]:
    """Names of a study's findings."""
    if study == "rivals":
        return findings_without()
    return read_findings(RECORDS / f"{RECORD_OF[study]}.json").findings


@pytest.mark.parametrize("study", sorted(file.parent.name for file in STUDIES.glob("*/page.md.j2")))
def test_every_finding_that_a_template_names_exists(study: str) -> None:
    patterns = findings_named_in((STUDIES / study / "page.md.j2").read_text(encoding="utf-8"))
    assert len(patterns) > 3
    names = names_of(study)
    missing = [
        pattern
        for pattern in sorted(patterns)
        if not any(re.fullmatch(pattern, name) for name in names)
    ]
    assert not missing, f"{study}: there is no finding like {', '.join(missing)}"


def test_names_are_read_through_macros_loops_and_formats() -> None:
    template = """
{% macro m(name) %}{{ n("error " ~ name, ".2f") }}{% endmacro %}
{{ m("calm") }} {{ n("lost", "d") }} {{ n("spare", "d", "none") }}
{% for case in cases %}{% set key = "worst " ~ case %}{{ found[key ~ " way"].number }}{% endfor %}
{{ n("%s of %d" % (a, b), ".1f") }}
"""
    expected = ("error calm", "lost", "worst .* way", ".* of .*")
    assert findings_named_in(template) == {text.replace(" ", r"\ ") for text in expected}
