"""What the study says of the gate, counted once more with the readable engine."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.studies.asymmetry import paper
from experiments.studies.asymmetry.conditions import CALM, QUICK, SEED
from laisn.estimates import FixKind
from laisn.navigator import Navigator
from sim.flight import navigation_settings
from sim.motion import simulate_motion
from sim.sensing.errors import errors_of
from sim.sensing.observation import measure, observe


def test_the_gate_is_counted_as_the_readable_engine_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A message has an echo if rear or front range is another one than with the same noise and no echoes."""
    runs, duration, route, offset = 3, 120.0, "T5", 2.0
    monkeypatch.setattr(paper, "_GATE_RUNS", runs)
    monkeypatch.setattr(paper, "INTERVALS_S", (1.0,))
    rows = paper.fly_gates(replace(QUICK, routes=(route,), duration_s=duration))
    assert [(row.route, row.rule, row.interval_s) for row in rows] == [(route, rule, 1.0) for rule in paper.RULES]

    both = simulate_motion(CALM.fleet((route,), offset, duration))
    one = CALM.scenario(route, offset, duration)
    echoes = one.acoustics.model_copy(update={"surface_echo_probability": 0.05, "bottom_echo_probability": 0.02})
    one = one.model_copy(update={"acoustics": echoes})
    truth, errors = observe(both, one), errors_of(one)
    silent = errors._replace(surface_echo_probability=0.0, bottom_echo_probability=0.0)
    for row in rows:
        told = replace(navigation_settings(one, both, 0), gate=row.rule)
        counts, off, off_without = np.zeros((2, 2)), [], []
        for run in range(CALM.first_run(route, offset), CALM.first_run(route, offset) + runs):
            heard, quiet = (
                measure(truth, e, seed=SEED, run=run, transmitters=told.transmitters) for e in (errors, silent)
            )
            echoed = ~np.isclose(heard.ranges, quiet.ranges, rtol=0.0, atol=0.0, equal_nan=True)[:, :2].all(axis=1)
            loud, still = (Navigator(told, truth.start).run(measured) for measured in (heard, quiet))
            np.add.at(counts, (echoed.astype(int), (loud.fix_kind == FixKind.GATED).astype(int)), 1)
            for estimates, found in ((loud, off), (still, off_without)):
                found.append(np.linalg.norm(estimates.state[:, :2] - truth.hydrophone, axis=1).mean())
        assert counts[1].sum() > 20
        assert row.detected.value == pytest.approx(counts[1, 1] / counts[1].sum())
        assert row.false_alarms.value == pytest.approx(counts[0, 1] / counts[0].sum())
        assert row.e_p_mean_m.value == pytest.approx(np.mean(off))
        assert row.e_p_mean_without_echoes_m.value == pytest.approx(np.mean(off_without))
        assert (row.detected.value == 0.0) == (row.rule == "off")
