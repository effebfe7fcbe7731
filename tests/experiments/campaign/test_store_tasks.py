"""Tasks: rows stored under a key of sources and input, resumed; failures reported by name."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.campaign import campaign, store
from experiments.campaign.campaign import CampaignResults
from experiments.campaign.jobs import Job, run_jobs
from experiments.campaign.pool import Pool
from experiments.campaign.store import Arrays, CampaignError, Result, Store, key_of
from reports.intervals import Interval
from sim.scenario.settings import Follower, Scenario

CALLS: list[int] = []


@pytest.fixture(autouse=True)
def sources(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tasks of this file, which is in none of the project's packages, count as of a module
    that is.
    """
    original = store._source
    monkeypatch.setattr(
        store,
        "_source",
        lambda module: original("sim.trajectory") if module == __name__ else original(module),
    )


def square(of: int, times: int = 1) -> list[dict[str, Any]]:
    """A task of so many rows, which notes its call in `CALLS`; it fails for negative numbers."""
    CALLS.append(of)
    if of < 0:
        raise CampaignError(f"no root of {of}\nand a second line")
    row = {"of": of, "limits": Interval(1.0, 0.5, 2.0), "missing": float("nan")}
    return [row | {"values": (of * of / 3.0,) * (k + 1)} for k in range(times)]


def another_task(of: int) -> list[dict[str, Any]]:
    return [{"of": of}]


def run_squares(folder: Path, *numbers: int, **options: Any) -> CampaignResults:
    """Run a task for each number, which is also its name."""
    tasks = {number: partial(square, number, times=2) for number in numbers}
    return campaign.fly([], tasks, folder, workers=1, quiet=True, **options)


def test_rows_are_returned_unchanged_in_the_requested_order(tmp_path: Path) -> None:
    actual = run_squares(tmp_path, 3, 2).tasks
    assert list(actual) == [3, 2]
    assert [row["values"] for row in actual[3]] == [[3.0], [3.0, 3.0]]
    assert actual[3][0]["limits"] == [1.0, 0.5, 2.0]
    assert np.isnan(actual[3][0]["missing"])


def test_what_killed_workers_left_half_written_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        (tmp_path / "store" / ".a.zip.1234.part").touch()
        raise KeyboardInterrupt

    monkeypatch.setattr(campaign, "run_jobs", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_squares(tmp_path, 2)
    assert [*(tmp_path / "store").iterdir()] == []
    (tmp_path / "store" / ".b.zip.1234.part").touch()
    Store(tmp_path)
    assert [*(tmp_path / "store").iterdir()] == []


def test_what_is_stored_is_not_computed_again_unless_forced(tmp_path: Path) -> None:
    run_squares(tmp_path, 2)
    CALLS.clear()
    run_squares(tmp_path, 2, 3)
    assert CALLS == [3]
    run_squares(tmp_path, 2, force=True)
    assert CALLS == [3, 2]


def test_a_failure_is_raised_once_other_results_are_stored_or_is_returned_if_tolerated(
    tmp_path: Path,
) -> None:
    with pytest.raises(CampaignError, match=r"^no root of -1$"):
        run_squares(tmp_path, -1, 2)
    CALLS.clear()
    actual = run_squares(tmp_path, -1, 2, tolerant=True)
    assert (CALLS, list(actual.tasks), actual.failures) == ([-1], [2], {-1: "no root of -1"})


def test_the_key_depends_on_the_sources_and_on_all_arguments(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    on_t5, on_t6 = (
        Scenario(name="one", followers=(Follower(route=route),)) for route in ("T5", "T6")
    )
    keys = [
        key_of(square, on_t5, 1),
        key_of(square, on_t6, 1),
        key_of(square, on_t5, 2),
        key_of(another_task, on_t5, 1),
    ]
    assert len(set(keys)) == 4
    assert key_of(square, range(3)) != key_of(square, range(1, 3))
    with pytest.raises(TypeError, match="depends on object, of which no key"):
        key_of(square, object())
    monkeypatch.setattr(store, "_source", lambda module: f"{module} edited")
    assert key_of(square, on_t5, 1) not in keys


def note(file: Path, line: str) -> None:
    """Add a line to a file; processes that compile share no memory with the test."""
    with file.open("a") as lines:
        lines.write(f"{line}\n")


def noting_compilers(file: Path) -> campaign.FlightCompilers:
    """Compilers that note what they are for."""
    return campaign.FlightCompilers(
        partial(note, file, "alone"), partial(note, file, "side by side")
    )


def test_compiling_ahead_is_done_once_and_only_if_something_is_missing(tmp_path: Path) -> None:
    notes = tmp_path / "notes"
    for _ in range(2):
        campaign.fly(
            [],
            {2: partial(square, 2)},
            tmp_path / "results",
            compilers=noting_compilers(notes),
            workers=1,
        )
    assert notes.read_text().splitlines() == ["alone"]


def numbers_together(tasks: Sequence[campaign.Task]) -> list[list[dict[str, Any]] | None]:
    """Of each how many it lies beside; nothing of 5."""
    numbers = [task.args[0] for task in tasks]
    return [None if n == 5 else [{"of": n, "beside": len(numbers)}] for n in numbers]


def test_many_tasks_are_computed_together_and_those_left_out_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three at a time, of those without a result; few are all computed alone."""
    tasks = {n: partial(another_task, n) for n in range(8)}
    group = campaign.SideBySide(names=range(1, 8), compute=numbers_together, most=3)
    notes = tmp_path / "notes"

    def fly(names: Iterable[int], folder: str) -> dict[int, Any]:
        chosen = {name: tasks[name] for name in names}
        results = campaign.fly(
            [],
            chosen,
            tmp_path / folder,
            together=[group],
            compilers=noting_compilers(notes),
            workers=1,
            quiet=False,
        )
        return {name: rows[0] for name, rows in results.tasks.items()}

    alone = {n: {"of": n} for n in tasks}
    assert fly(tasks, "few") == alone
    monkeypatch.setattr(campaign, "_MANY_TASKS", 6)
    rows = fly([1], "many")
    assert rows == {1: alone[1]}
    rows = fly(tasks, "many")
    assert {n: rows[n] for n in (0, 1, 5)} == {n: alone[n] for n in (0, 1, 5)}
    together = {n: {"of": n, "beside": 3} for n in (2, 3, 4, 6, 7)}
    assert {n: rows[n] for n in together} == together
    assert notes.read_text().splitlines() == ["alone", "alone", "alone", "side by side"]


class PretendingStore(Store):
    """A store of which a test decides which of the keys 0 to 99 have results."""

    def __init__(self, folder: Path, is_stored: Callable[[int], bool]) -> None:
        super().__init__(folder)
        self._is_stored = is_stored

    def get(self, key: str) -> tuple[Any, Arrays] | None:
        return (None, {}) if self._is_stored(int(key)) else None


def take_100_jobs(folder: Path, is_stored: Callable[[int], bool], computed: list[int]) -> None:
    """Run 100 jobs, which compute nothing, in this process; `computed` gets the numbers of those
    that were not stored, in the order in which they were taken.
    """

    def work(number: int, _: Store) -> Callable[[], list[Result]]:
        computed.append(number)
        return list

    jobs = [
        Job(key=number, kind="results", result_keys=[str(number)], run=partial(work, number))
        for number in range(100)
    ]
    run_jobs(jobs, PretendingStore(folder, is_stored), Pool(1), quiet=True)


def test_what_another_process_stores_meanwhile_is_skipped(tmp_path: Path) -> None:
    stored, skipped, computed = set[int](), list[int](), list[int]()

    def is_stored(number: int) -> bool:
        # the other process has stored the result that follows each one computed here
        stored.update((number_before + 1) % 100 for number_before in computed)
        if number in stored:
            skipped.append(number)
        return number in stored

    take_100_jobs(tmp_path, is_stored, computed)
    assert sorted(computed + skipped) == list(range(100))
    assert skipped


def test_processes_take_work_in_different_orders(tmp_path: Path) -> None:
    orders: list[list[int]] = [[], []]
    for computed in orders:
        take_100_jobs(tmp_path, lambda _: False, computed)
    assert orders[0] != orders[1]
    assert sorted(orders[0]) == sorted(orders[1]) == list(range(100))
