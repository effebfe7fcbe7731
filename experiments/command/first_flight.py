"""What a first flight compiles beside the physics, on another core: all that computes with a mission, and its film."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any

from experiments.flight.fly import fly
from experiments.flight.summary import capture_events, position_and_bearing_errors, stray_events, summarise
from laisn.code_cache import keeps_nothing
from laisn.parent import alongside
from sim.scenario.settings import Scenario


def compile_with(scenario: Scenario, *, film: bool) -> None:
    """Have compiled code kept of all that follows once the vehicles of a scenario have moved.

    The paper's point motion, which compiles nothing, stands in for the physics.

    Args:
        scenario: to be flown.
        film: whether a film of it will be rendered.
    """
    flight, _ = fly(scenario.first_messages.model_copy(update={"motion": "kinematic"}))
    capture_events(flight)
    stray_events(flight)
    summarise(flight, position_and_bearing_errors(flight))
    if film:
        from sim.film import studio

        studio.compile_ahead()


def compiling_beside(scenario: Scenario, *, film: bool) -> AbstractContextManager[Any]:
    """While the block runs, another process compiles as `compile_with`, if no compiled code is kept yet.

    What goes wrong there, as with a scenario that the point motion cannot fly, is left for the flight itself to tell.
    """

    def prepare() -> Callable[..., None]:
        compile_with(scenario, film=film)
        return partial(print, end="")

    return alongside(prepare) if keeps_nothing() else nullcontext()
