"""Plans of studies that several processes make."""

from pathlib import Path
from typing import Any

import pytest

from experiments.study import plan
from experiments.study.file import Study, StudyError, study_from_table
from experiments.study.plan import plan_of
from laisn.errors import LaisnWarning

TABLE: dict[str, Any] = {
    "scenario": "T5",
    "runs": 1,
    "realizations": 3,
    "set": {"duration_s": 60.0},
    "draw": {"followers.0.drag_scale": {"uniform": [0.8, 1.2]}},
    "vary": {"timing.message_interval_s": [1.0, 5.0]},
    "arm": [
        {"name": "plain"},
        {"name": "slow", "followers.0.start_speed_m_s": 0.5},
        {"name": "tight", "navigation.variant": "tight"},
    ],
}


@pytest.fixture
def divided(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let other processes plan all scenarios but the first four, five by five."""
    monkeypatch.setattr(plan, "_PARALLEL_FROM", 5)
    monkeypatch.setattr(plan, "_BATCH", 4)


def study(**changes: Any) -> Study:
    return study_from_table(TABLE | changes, "mine.toml", "mine")


@pytest.mark.usefixtures("divided")
def test_a_plan_does_not_depend_on_the_number_of_processes() -> None:
    alone, beside = plan_of(study(), workers=1), plan_of(study(), workers=2)
    assert beside.entries == alone.entries
    assert [(e.point, e.arm, e.realization) for e in beside.entries] == [
        (point, arm, realization)
        for point in (0, 1)
        for arm in ("plain", "slow", "tight")
        for realization in (0, 1, 2)
    ]
    # sections that scenarios have in common are one object, wherever they were planned
    assert len({id(entry.scenario.ocean) for entry in beside.entries}) == 1


@pytest.mark.usefixtures("divided")
def test_errors_have_the_same_text_wherever_they_are_found() -> None:
    arms = [*TABLE["arm"], {"name": "wrong", "followers.0.start_speed_m_s": -1.0}]
    texts = []
    for workers in (1, 2):
        with pytest.raises(StudyError) as caught:
            plan_of(study(arm=arms), workers=workers)
        texts.append(str(caught.value))
    assert texts[0] == texts[1]
    assert "in 6 of 24 scenarios, first at timing.message_interval_s = 1.0, arm wrong" in texts[0]


@pytest.mark.usefixtures("divided")
def test_notes_of_other_processes_reach_the_user(tmp_path: Path) -> None:
    """The fifth arm has a key by its old name; this process plans the first four alone."""
    scenario = tmp_path / "mine.toml"
    text = '[[followers]]\nroute = "T5"\n[[sensors.custom]]\nsensor = "gyros"\n'
    scenario.write_text(text, "utf-8")
    arms = [{"name": f"speed {i}", "followers.0.start_speed_m_s": 0.1 * i} for i in range(1, 5)]
    arms.append({"name": "old", "sensors.own.0.sensor": "inclinometer"})
    changes = {"scenario": str(scenario), "arm": arms, "vary": {}, "draw": {}, "realizations": 1}
    with pytest.warns(LaisnWarning, match=r"sensors\.own is now called sensors\.custom"):
        plan_of(study(**changes), workers=2)
