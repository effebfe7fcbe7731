"""The study of formations: its conditions, and figures by hand."""

import numpy as np
import pytest

from experiments.formation import study
from experiments.formation.conditions import CONDITIONS
from experiments.formation.study import Run, findings_of, measure


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.name)
def test_every_condition_is_a_scenario_that_can_be_flown(condition: object) -> None:
    scenario = condition.scenario(3)  # type: ignore[attr-defined]
    assert scenario.run == 3
    assert all(follower.station for follower in scenario.followers)


def test_conditions_say_what_their_titles_say() -> None:
    by_name = {condition.name: condition for condition in CONDITIONS}
    assert by_name["two aside"].scenario(0).navigation.transmitters == 2
    ports = [f.station.port_m for f in by_name["two aside"].scenario(0).followers if f.station]
    assert min(abs(port) for port in ports) > 3.0
    speeds = [by_name["current"].scenario(run).ocean.current_speed_m_s for run in range(5)]
    assert sorted(speeds) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    # 40 % are lost: a burst begins with p = 2/15 and lasts 5 messages, so that p / (p + 1/5) of the time is one
    assert by_name["bursts"].scenario(0).acoustics.burst_chance == pytest.approx(2 / 15, abs=1e-4)
    assert not any(f.believes for f in by_name["truth"].scenario(0).followers)


def test_a_record_counts_what_runs_came_to() -> None:
    ones = np.ones(2)
    runs = [
        Run(rms=ones * (1 + i), p95=ones, largest=ones * 9 * (i + 1), turn=ones * i, leg=ones,
            lost=np.array([0.0, float(i > 0)]), error=ones * i, closest=5.0 - i, power=10.0)
        for i in range(3)
    ]  # fmt: skip
    found = findings_of({"calm": runs})
    assert found["median calm"].value == 2.0
    assert found["worst calm"].value == 3.0
    assert found["max calm"].value == 27.0
    assert (found["lost-runs calm"].value, found["closest calm"].value) == (2, 3.0)
    assert found["lost calm"].value == pytest.approx(2 / 6, rel=1e-5)
    assert found["runs"].value == 3


def test_a_short_run_keeps_its_stations() -> None:
    run = measure(study.CONDITIONS[0], 0, 30.0)
    assert run.rms.shape == (10,)
    assert run.largest.max() < 3.0
    assert run.closest > 4.0
    assert run.error.max() < 1.0
