"""Functions that are compiled for their callers alone, and their number."""

from laisn.compiled import compiled
from laisn.nesting import count_nested
from sim.system import background_process


def compile_a_caller_of_one() -> None:
    """Compile a function of which Python calls one, and that alone the other."""

    @compiled
    def called(number: float) -> float:
        return number + 1.0

    @compiled
    def caller(number: float) -> float:
        return called(number)

    assert caller(1.0) == 2.0


def test_what_a_forked_process_compiles_is_counted_here_too() -> None:
    before = count_nested()
    compile_a_caller_of_one()
    assert count_nested() - before == 1
    with background_process() as process:
        process.submit(compile_a_caller_of_one).result()
    assert count_nested() - before == 2
