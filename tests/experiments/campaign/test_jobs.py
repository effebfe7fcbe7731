"""Jobs: each runs after those that it depends on; what depends on a failed one does not run."""

from collections.abc import Hashable, Sequence
from functools import partial
from pathlib import Path

import pytest

from experiments.campaign.jobs import Job, run_jobs
from experiments.campaign.pool import Pool
from experiments.campaign.store import CampaignError, Result, Store


def _results(name: str, fails: bool) -> list[Result]:
    if fails:
        raise CampaignError(f"{name} failed")
    return [(name, [], {})]


class Jobs:
    """Makes jobs with these names, each of which must find the results of those that it depends
    on; `begun` has the names in the order in which they were started.
    """

    def __init__(self) -> None:
        self.begun: list[str] = []

    def __call__(self, name: str, *depends_on: Hashable, fails: bool = False) -> Job:
        def work(store: Store) -> partial[list[Result]]:
            for other in depends_on:
                assert store.has(str(other)), f"{name} before {other}"
            self.begun.append(name)
            return partial(_results, name, fails)

        return Job(key=name, kind="jobs", result_keys=[name], run=work, depends_on=depends_on)


def _run(jobs: Sequence[Job], folder: Path, **options: bool) -> dict[Hashable, str]:
    return run_jobs(jobs, Store(folder), Pool(1), quiet=True, **options)


def test_a_job_runs_after_all_that_it_depends_on(tmp_path: Path) -> None:
    make_job = Jobs()
    graph = [
        make_job("d", "b", "c"),
        make_job("b", "a"),
        make_job("c", "a"),
        make_job("a"),
        make_job("alone"),
    ]
    assert _run(graph, tmp_path) == {}
    assert sorted(make_job.begun) == ["a", "alone", "b", "c", "d"]
    assert make_job.begun[-1] == "d"


def test_a_job_that_fails_is_named_and_what_depends_on_it_is_left_out(tmp_path: Path) -> None:
    make_job = Jobs()
    graph = [make_job("a", fails=True), make_job("b", "a"), make_job("c", "b"), make_job("d")]
    assert _run(graph, tmp_path, tolerant=True) == {"a": "a failed"}
    assert sorted(make_job.begun) == ["a", "d"]
    assert not Store(tmp_path).has("b")
    with pytest.raises(CampaignError, match="a failed"):
        _run(graph, tmp_path)


def test_jobs_that_wait_for_each_other_are_refused(tmp_path: Path) -> None:
    make_job = Jobs()
    with pytest.raises(ValueError, match=r"wait for each other: \['a', 'b'\]"):
        _run([make_job("a", "b"), make_job("b", "a"), make_job("c")], tmp_path)
    assert make_job.begun == ["c"]
