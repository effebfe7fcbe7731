"""Sentences and figures of the pitch study's page, for missions and a message made by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from experiments.asymmetry import missions_page, question_page, report
from experiments.asymmetry.added_error import ComparedMission, Mission, paired
from experiments.asymmetry.conditions import QUICK_CONDITIONS
from experiments.asymmetry.example import EVERYTHING
from experiments.asymmetry.missions import Plan
from experiments.asymmetry.missions_page import Results
from experiments.flight.range_budget import Cause
from experiments.pages.page import Figures, Page, Text
from experiments.pages.template import page_of
from tests.asymmetry.test_added_error import row


def missions(*added: float, **changes: Any) -> dict[Mission, ComparedMission]:
    """A mission for each error that pitch adds [m], on T2, T3, …; an AHRS leaves a tenth of it."""
    rows = []
    for i, error in enumerate(added):
        where = {"route": f"T{i + 2}", **changes}
        rows += [row("level", 0.5, **where), row("real", 0.5 + error + 0.01 * np.cos(np.arange(64.0)), **where)]
        rows += [row("attitude-0", 0.5, **where), row("ahrs-0.5", 0.5 + 0.1 * error, **where)]
    return paired(rows)


def page(**values: Any) -> Page:
    """The page's template with some of its values, and nothing in place of the others."""
    blank: dict[str, Any] = dict.fromkeys(
        ("geometry", "first_minutes", "shares", "one_mission", "film", "maps", "excess", "offsets", "missions",
         "commands", "stage_4", "removed", "remedies", "undecided", "captures", "split", "by_route", "shortfalls",
         "planner", "gates"), ())  # fmt: skip
    blank |= dict.fromkeys(("points", "closed_form_m", "third_median_m", "third_p95_m", "missed_paired"), 0)
    blank |= {"everything": EVERYTHING, "abeam": np.zeros(1), "inflated": "", "open_paired": 0}
    return page_of("experiments.asymmetry", [], blank | report.answer({}) | values)


def text_of(made: Page) -> str:
    """All paragraphs of a page."""
    return " ".join(block.text for section in made.sections for block in section.blocks if isinstance(block, Text))


def test_the_summary_names_the_mission_to_which_pitch_adds_most() -> None:
    found = missions(1.0, 4.0, 2.0)
    steep = missions(0.3, depth_offset_m=10.0, depth_offset_rms_m=10.0, pitch_rms_deg=9.0)
    said = page(**report.answer(found | steep)).summary
    assert "On 4 missions this adds up to 4.0 m to the mean error (route T3, 5 m below, 5.0° rms)" in said
    assert "removes that error: 100 % (" in said
    assert "exactly, 90 % (" in said
    unmoved = {key: replace(e, level=replace(e.level, fix_error_m=0.0)) for key, e in found.items()}
    assert "moves no fix" in page(**report.answer(unmoved)).summary


def test_figures_of_missions_are_levers_parts_and_medians(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three missions: pitch adds 1, 4 and 2 m with a lever of 5 m sin 5°; the median error is 2.5 m."""
    drawing = Mock()
    monkeypatch.setattr(missions_page, "drawing", drawing)
    monkeypatch.setattr(missions_page, "svg", lambda *_: "")
    monkeypatch.setattr(missions_page, "mission_table", lambda *_: (Figures(panels=[]), ""))
    monkeypatch.setattr(missions_page, "stage_4_table", Mock())
    monkeypatch.setattr(missions_page, "CAUSES", {"trim": "trim"})
    results: Any = SimpleNamespace(plan=Plan(offsets_m=(5.0,)), conditions=(), curves=None)
    given: Results = results
    missions_page.on_missions(given, missions(1.0, 4.0, 2.0))
    ((groups, _), _) = drawing.excess_over_lever.call_args
    ((levers, parts, _),) = groups
    assert levers == pytest.approx(np.full(3, 5.0 * np.sin(np.deg2rad(5.0))))
    assert parts == pytest.approx([1.0, 4.0, 2.0], abs=0.01)
    ((curves, title), _) = drawing.over_offset.call_args
    assert title == "trim, median mission"
    assert [curve[1] for curve in curves] == [[0.5], pytest.approx([2.5], abs=0.01), pytest.approx([0.7])]


def test_a_message_is_told_with_its_pitch_and_the_error_of_its_fix(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fix 3 m ahead of the hydrophone and 4 m aside, at a pitch of −5°."""
    time = np.array([0.0, 100.0, 300.0])
    message = SimpleNamespace(fix=np.array([13.0, 24.0]), hydrophone=np.array([10.0, 20.0, -8.0]), pitch=-np.pi / 36)
    drawing = Mock(Message=lambda *_: message)
    for name, put in (("drawing", drawing), ("svg", lambda *_: ""), ("share_table", lambda _: Figures(panels=[])),
                      ("asymmetry_over_time", Mock())):  # fmt: skip
        monkeypatch.setattr(question_page, name, put)
    flight = SimpleNamespace(trajectory=SimpleNamespace(time=time, pitch=np.full((3, 2), -np.pi / 36)))
    shares = np.zeros((3, len(Cause)))
    shares[:, Cause.LEVER_ARM], shares[:, Cause.RANDOM], shares[:, Cause.MOTION] = 0.02, [0.03, -0.04, 9.0], 0.01
    budget = SimpleNamespace(time=time, asymmetry=shares)
    example: Any = SimpleNamespace(condition=QUICK_CONDITIONS[0], flight=flight, telling=1, budget=budget)
    values = question_page.one_message(example)
    first = values["geometry"]
    assert "route T6, follower 10 m below: a message sent at a pitch of -5.0°" in first.caption
    assert "the fix is 5.00 m off" in first.caption
    drawn = values["first_minutes"]
    assert "pings 0.05 s apart" in text_of(page(**values)).replace(str(EVERYTHING["acoustics.ping_slot_s"]), "0.05")
    # of the first 200 s alone
    assert drawn.caption.endswith("RMS: lever arm 2.0 cm, random error 3.5 cm, travel time and motion 1.0 cm.")
    ((shown, pitch, _), _) = drawing.pitch_over_time.call_args
    assert (shown.tolist(), pitch.tolist()) == ([0.0, 100.0], pytest.approx([-5.0] * 2))
