"""The search for inputs with faulty answers: none today, and what it would say of one."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sim.gazebo import buoyancy
from sim.log.frames import Damage, Salvage
from tests.sim.gazebo.imported import PROBE, changed
from tools.fuzz.__main__ import KINDS, search
from tools.fuzz.case import (
    DONE,
    INTERRUPTED,
    LONGEST_S,
    REFUSED,
    CommandResult,
    FuzzCase,
    answer_to,
    faults_of,
)


@pytest.mark.system
@pytest.mark.usefixtures("no_plugins")
@pytest.mark.parametrize("kind", KINDS)
def test_no_input_gets_a_faulty_answer(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    n_faulty = search(kind, 1, 4, tmp_path)
    assert n_faulty == 0, capsys.readouterr().out


NO_WATER = FuzzCase(
    words=["hull", "--sdf", "a.sdf"],
    files={
        "a.sdf": changed(
            PROBE,
            (
                "<uniform_fluid_density>1000</uniform_fluid_density>",
                "<uniform_fluid_density>-1000</uniform_fluid_density>",
            ),
        ).encode()
    },
)
"""A density that no fluid has."""


def test_a_bug_in_the_program_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as an exception that is no fault of the user, where a density is compared."""
    assert faults_of(NO_WATER, answer_to(NO_WATER, tmp_path / "a")) == []
    monkeypatch.setattr(buoyancy, "MIN_DENSITY", "a number")
    answer = answer_to(NO_WATER, tmp_path / "a")
    assert faults_of(NO_WATER, answer) == ["exit code 1", "a bug in the program"]


def test_a_command_that_goes_on_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.fuzz.case.LONGEST_S", 0.2)

    def for_ever(*_: object) -> None:
        while True:
            pass

    monkeypatch.setattr("sim.gazebo.hull.from_sdf", for_ever)
    answer = answer_to(NO_WATER, tmp_path / "a")
    assert faults_of(NO_WATER, answer) == ["exit code -1"]
    assert LONGEST_S > 0.2


@pytest.mark.system
def test_a_wrong_unit_and_a_clock_that_is_sorted_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As tables were read before: radians where nothing is said, and rows in order of time."""
    monkeypatch.setattr("sim.datasets.table_units._unrefuted", lambda _, choices: (choices[:1], []))
    monkeypatch.setattr("sim.datasets.table_units._require_fit", lambda *_: None)
    assert search("vehicles", 1, 20, tmp_path) > 0
    assert " differs by " in capsys.readouterr().out
    monkeypatch.undo()
    monkeypatch.setattr("sim.datasets.vehicle_table.correct_steps_back", lambda _: None)
    assert search("vehicles", 1, 20, tmp_path) > 0
    assert "rows are left" in capsys.readouterr().out


class UpToTheFirstDamage(Salvage):
    """Ends where something is damaged."""

    def __iter__(self) -> Iterator[Any]:
        for item in super().__iter__():
            yield item
            if isinstance(item, Damage):
                return


@pytest.mark.system
def test_chunks_that_are_given_up_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a recovery that ends at the first broken chunk."""
    assert search("logs", 1, 20, tmp_path) == 0
    monkeypatch.setattr("sim.log.contents.Salvage", UpToTheFirstDamage)
    assert search("logs", 1, 20, tmp_path) > 0
    assert "messages that are intact" in capsys.readouterr().out


def command_result(
    code: int, output: str = "a.csv: 1 error", files: tuple[str, ...] = ()
) -> CommandResult:
    return CommandResult(code, output, frozenset(files), 0.1)


@pytest.mark.parametrize(
    ("answer", "faults"),
    [
        (command_result(DONE, "done", ("out.mcap",)), []),
        (command_result(DONE, "done"), ["did not write out.mcap"]),
        (command_result(REFUSED), []),
        (command_result(REFUSED, "no"), ["names none of a.csv"]),
        (command_result(REFUSED, "a.csv\n" * 61), ["a page of text"]),
        (command_result(REFUSED, "a.csv" * 500), ["a page of text"]),
        (command_result(REFUSED, files=("out.mcap",)), ["half-written out.mcap"]),
        (command_result(REFUSED, "  \n"), ["silent", "names none of a.csv"]),
        (command_result(DONE, "done", ("out.mcap", "b.tmp")), ["left b.tmp"]),
        (command_result(INTERRUPTED), ["exit code 130"]),
    ],
)
def test_faults_of_answers(answer: CommandResult, faults: list[str]) -> None:
    case = FuzzCase(words=["log", "import", "a.csv"], written=("out.mcap",), named=("a.csv",))
    assert faults_of(case, answer) == faults


def test_an_input_that_has_to_be_refused_may_not_succeed() -> None:
    assert faults_of(FuzzCase(words=["x"], must_be_refused=True), command_result(DONE, "done")) == [
        "accepted"
    ]
    assert faults_of(FuzzCase(words=["x"], may_interrupt=True), command_result(INTERRUPTED)) == []
