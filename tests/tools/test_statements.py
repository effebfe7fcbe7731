"""Expressions that the linter has no rule for and that a reader has to unpack are statements."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("models", "laisn", "sim", "experiments", "laisn_sim", "tools")


def _is_conditional_list(node: ast.expr) -> bool:
    """Whether it is a list, or another one, by a condition: `[x] if condition else []`."""
    return isinstance(node, ast.IfExp) and isinstance(node.body, ast.List)


def _is_truth(node: ast.expr) -> bool:
    """Whether it is a comparison, a negation or a call of bool or isinstance."""
    is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    if is_call and node.func.id in ("bool", "isinstance"):  # type: ignore[attr-defined]
        return True
    return isinstance(node, ast.Compare | ast.BoolOp) or (
        isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    )


def packed_expressions(source: str) -> Iterator[str]:
    """A line for each packed expression of a source."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.IfExp):
            parts = (node.body, node.test, node.orelse)
            if any(isinstance(inner, ast.IfExp) for part in parts for inner in ast.walk(part)):
                yield f"{node.lineno}: a conditional expression within another"
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            operands = (node.left, node.right)
            if any(isinstance(o, ast.List) for o in operands) and any(map(_is_truth, operands)):
                yield f"{node.lineno}: a list times a truth value"
        elif isinstance(node, ast.Starred) and _is_conditional_list(node.value):
            yield f"{node.lineno}: items by a condition within a list"
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            inner_nodes = [inner for argument in node.args for inner in ast.walk(argument)]
            if node.func.id == "next" and any(isinstance(n, ast.NamedExpr) for n in inner_nodes):
                yield f"{node.lineno}: an assignment within next()"


@pytest.mark.parametrize("package", PACKAGES)
def test_no_expression_has_to_be_unpacked(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    lines = {
        str(path.relative_to(ROOT)): list(packed_expressions(path.read_text(encoding="utf-8")))
        for path in files
    }
    assert {name: of_file for name, of_file in lines.items() if of_file} == {}


@pytest.mark.parametrize(
    ("source", "n_packed"),
    [
        ("a if b else c if d else e", 1),
        ("a if b else c", 0),
        ("[a] * (b > c)", 1),
        ("[a] * bool(b)", 1),
        ("[a] * isinstance(b, int)", 1),
        ("[0.0] * 3", 0),
        ("[*([a] if b else []), c]", 1),
        ("[*a, c]", 0),
        ("next(b for a in c if (b := a))", 1),
        ("next(a for a in c)", 0),
    ],
)
def test_expressions_that_have_to_be_unpacked_are_found(source: str, n_packed: int) -> None:
    assert len(list(packed_expressions(source))) == n_packed
