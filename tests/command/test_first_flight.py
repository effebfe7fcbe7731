"""What is compiled on another core while a first flight compiles its physics."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import typeof

from experiments.command import first_flight
from experiments.flight.library import load
from sim.film import antialiasing, canvas, pixels, studio
from sim.film.canvas import Canvas, Layer
from sim.scenario.settings import Video

Kinds = dict[str, set[tuple[Any, ...]]]


def keeping_kinds(name: str, kinds: Kinds) -> Callable[..., None]:
    """In place of a compiled function: it keeps the types that it would be compiled for."""
    return lambda *given: kinds.setdefault(name, set()).add(tuple(map(typeof, given)))


def test_what_is_compiled_ahead_is_what_frames_call(monkeypatch: pytest.MonkeyPatch) -> None:
    ahead: Kinds = {}
    for module, name in ((pixels, "upright"), (pixels, "lay"), (pixels, "to_yuv420"), (antialiasing, "smooth")):
        monkeypatch.setattr(module, name, keeping_kinds(name, ahead))
    studio.compile_ahead()
    called: Kinds = {"smooth": ahead["smooth"]}
    for module, name in ((canvas, "upright"), (canvas, "lay"), (pixels, "to_yuv420")):
        monkeypatch.setattr(module, name, keeping_kinds(name, called))
    frame, light = Canvas(320, 180), np.zeros((20, 30, 3), np.uint8)
    frame.load(np.zeros((180, 320, 3), np.uint8))
    frame.lay(Layer(5, 7, light, light))
    list(studio.encode(iter([frame.pixels]), Video(width_px=320, height_px=180)))
    assert called == ahead


def test_another_process_compiles_only_where_nothing_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def compile_with(scenario: Any, *, film: bool) -> None:
        (tmp_path / f"{scenario.name} {film}").touch()

    monkeypatch.setattr(first_flight, "compile_with", compile_with)
    for nothing in (False, True):
        monkeypatch.setattr(first_flight, "keeps_nothing", lambda nothing=nothing: nothing)
        with first_flight.compiling_beside(load("T5", ()), film=True) as beside:
            if nothing:
                with beside():
                    pass
    assert [path.name for path in tmp_path.iterdir()] == ["T5 True"]


def test_the_point_motion_stands_in_for_the_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that follows the motion is called with a flight that MuJoCo had no part in."""
    told = []
    monkeypatch.setattr(first_flight, "stray_events", told.append)
    first_flight.compile_with(load("T5", ()), film=False)
    (flight,) = told
    assert flight.trajectory.time[-1] == 2.0
    assert not flight.trajectory.thrust.any()
