"""Faults that are put into a source on purpose, one at a time, by operators of cosmic-ray and one of our own."""

import ast
import difflib
import re
from collections.abc import Iterator
from typing import NamedTuple

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider
from parso.tree import NodeOrLeaf, search_ancestor

from tools.import_graph import ROOT

SWAPS = (
    "ReplaceBinaryOperator_(Add_Sub|Sub_Add|Mul_Div|Div_Mul|Pow_Mul|FloorDiv_Mul|Mod_Mul|MatMul_Add|BitAnd_BitOr|BitOr_BitAnd"
    "|BitXor_BitOr|RShift_LShift|LShift_RShift)|ReplaceComparisonOperator_(Lt_LtE|LtE_Lt|Gt_GtE|GtE_Gt|Lt_Gt|Gt_Lt|LtE_GtE"
    "|GtE_LtE|Eq_NotEq|NotEq_Eq|Is_IsNot|IsNot_Is)|ReplaceUnaryOperator_Delete_.*|AddNot|Replace(True|False|And|Or|Break"
    "|Continue)With.*|NumberReplacer|ZeroIterationForLoop"
)
"""Operators of cosmic-ray; those are left out whose mutants seldom even compile."""


class ReturnReplacer(Operator):  # type: ignore[misc]
    """Doubles the number that a function returns, or denies the truth value."""

    def mutation_positions(self, node: NodeOrLeaf) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
        """Places of what is returned."""
        if self._becomes(node):
            yield node.start_pos, node.end_pos

    def mutate(self, node: NodeOrLeaf, _: int) -> NodeOrLeaf:
        """The statement with another value."""
        node.children[1] = parso.parse(self._becomes(node))
        return node

    @classmethod
    def examples(cls) -> tuple[()]:
        """Return the operator's examples for documentation, of which there are none."""
        return ()

    @staticmethod
    def _becomes(node: NodeOrLeaf) -> str:
        function = search_ancestor(node, "funcdef") if node.type == "return_stmt" else None
        given = "" if function is None or function.annotation is None else function.annotation.get_code().strip()
        value = node.children[1].get_code().strip() if given else ""
        if given == "bool":
            return f" not ({value})"
        return f" 2 * ({value})" if given in ("float", "int", "Floats", "npt.NDArray[np.float64]") else ""


OPERATORS = {name: OperatorProvider()[name] for name in OperatorProvider() if re.fullmatch(SWAPS, name)}
OPERATORS["ReturnReplacer"] = ReturnReplacer


class Mutant(NamedTuple):
    """A fault: which operator, applied to a source where it applies for the nth time."""

    file: str
    source: str
    line: int
    operator: str
    occurrence: int

    def text(self) -> str:
        """The source with the fault."""
        return str(mutate_code(self.source, OPERATORS[self.operator](), self.occurrence))

    def change(self) -> tuple[str, str]:
        """The lines that it takes away and the lines that it puts there."""
        changed = list(difflib.unified_diff(self.source.splitlines(), self.text().splitlines(), n=0, lineterm=""))[3:]
        old, new = ("\n".join(line[1:].strip() for line in changed if line[0] == sign) for sign in "-+")
        return old, new


def unread(source: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Places where no fault can be seen when the code runs: annotations, and zip's guard against unequal lengths."""
    found: list[ast.expr | None] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            found.append(node.returns)
        if isinstance(node, ast.arg | ast.AnnAssign):
            found.append(node.annotation)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "zip":
            found += [keyword.value for keyword in node.keywords]
    return [((n.lineno, n.col_offset), (n.end_lineno or 0, n.end_col_offset or 0)) for n in found if n is not None]


def mutants_of(file: str) -> Iterator[Mutant]:
    """All faults that the operators make in a source."""
    source = (ROOT / file).read_text(encoding="utf-8")
    nodes, hidden = list(ast_nodes(get_ast(source))), unread(source)
    for name, operator in OPERATORS.items():
        places = ((node, place) for node in nodes for place in operator().mutation_positions(node))
        for occurrence, (node, (start, end)) in enumerate(places):
            # the star between the parameters of a function multiplies nothing
            star = node.type == "operator" and node.parent.type in ("parameters", "lambdef")
            if not star and not any(first <= start and end <= last for first, last in hidden):
                yield Mutant(file, source, start[0], name, occurrence)
