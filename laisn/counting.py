"""Which compiled functions count references to arrays: those that own some.

A caller keeps what it hands over, so that a function that only looks into arrays holds nothing that could end before it
does. Numba counts up and down all the same, atomically, for each view of an array. Where it fails to see that the two
cancel, that takes up to a sixth of all the time that a formation computes.
"""

from collections.abc import Iterator
from typing import Any

from numba.core import ir
from numba.core.compiler_machinery import AnalysisPass, register_pass

_VIEWS = {"getitem", "static_getitem", "getattr", "getiter", "iternext", "pair_first", "pair_second", "exhaust_iter",
          "build_tuple", "cast", "phi"}  # fmt: skip
"""Expressions that give parts of arrays, or arrays as they are, and never new ones."""


@register_pass(mutates_CFG=False, analysis_only=True)  # type: ignore[no-untyped-call]
class CountIfNeeded(AnalysisPass):
    """Have a function count references to arrays only if it makes some, or gets some from those that it calls."""

    _name = "count_if_needed"

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Choose the target for the function that is being compiled."""
        if not any(self._is_owner(state, statement) for statement in _statements(state.func_ir)):
            state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        return False

    def _is_owner(self, state: Any, statement: Any) -> bool:
        """Whether a statement may make an array, or own one."""
        if isinstance(statement, ir.SetItem | ir.StaticSetItem):
            # an array that is assigned to another may have to be copied first
            return any(_holds_arrays(state, kind) for kind in state.calltypes[statement].args[1:])
        if isinstance(statement, ir.Return):
            return _holds_arrays(state, state.return_type)
        if not isinstance(statement, ir.Assign) or not isinstance(statement.value, ir.Expr):
            return False
        made = statement.value
        if made.op == "getitem" and _holds_arrays(state, state.calltypes[made].args[1]):
            return True
        return made.op not in _VIEWS and _holds_arrays(state, state.typemap[statement.target.name])


def _statements(function: Any) -> Iterator[Any]:
    for block in function.blocks.values():
        yield from block.body


def _holds_arrays(state: Any, kind: Any) -> bool:
    return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())
