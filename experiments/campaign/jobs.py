"""Jobs of a campaign, which depend on each other, and the loop that computes what is ready."""

import random
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from experiments.campaign.pool import Pool
from experiments.campaign.progress import progress
from experiments.campaign.store import CampaignError, Result, Store
from laisn.plugins import plugins_version

Work = Callable[[], list[Result]]
"""What a process computes; CampaignError if it cannot."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """Work for a process, and the results that come of it."""

    key: Hashable  # of this job alone
    kind: str  # the name under which progress counts it, such as "missions"
    result_keys: Sequence[str]  # keys under which its results are stored
    run: Callable[[Store], Work]
    """Makes the work just before a process takes it, so that what it reads from the store does not
    wait in memory.
    """
    depends_on: Sequence[Hashable] = ()  # keys of jobs that are done before
    size: int = 1  # items that progress counts


def run_jobs(
    jobs: Iterable[Job], store: Store, pool: Pool, *, tolerant: bool = False, quiet: bool = False
) -> dict[Hashable, str]:
    """Compute jobs, each after those that it depends on, and store every result as it is done.

    Returns why jobs failed, by their keys; jobs that depend on these are left out. CampaignError:
    one has failed, unless `tolerant`. ValueError: jobs wait for each other.
    """
    waiting = list(jobs)
    failures = dict[Hashable, str]()
    lost = set[Hashable]()  # keys of jobs that failed, or were left out
    while waiting:
        unfinished = {job.key for job in waiting}
        ready = [job for job in waiting if unfinished.isdisjoint(job.depends_on)]
        if not ready:
            raise ValueError(f"jobs wait for each other: {sorted(map(str, unfinished))[:10]}")
        possible = [job for job in ready if lost.isdisjoint(job.depends_on)]
        for kind in dict.fromkeys(job.kind for job in possible):
            of_kind = [job for job in possible if job.kind == kind]
            failures |= _compute(kind, of_kind, store, pool, quiet)
            if failures and not tolerant:
                raise CampaignError("; ".join(sorted(set(failures.values()))))
        lost |= failures.keys()
        lost |= {job.key for job in ready if not lost.isdisjoint(job.depends_on)}
        done = {job.key for job in ready}
        waiting = [job for job in waiting if job.key not in done]
    return failures


def _require_plugins(version: str, *, refresh: bool) -> None:
    """CampaignError if this process has other plugins than the keys of the results were made of."""
    if plugins_version(refresh=refresh) != version:
        raise CampaignError(
            "a plugin, or a file that it reads, changed while the study ran; run it again; what "
            "was computed before is stored"
        )


class _Outcome(NamedTuple):
    """What came of a job."""

    key: Hashable
    failure: str = ""  # why it has no results; empty: it has
    stored: Sequence[str] = ()  # keys of results that are in the store
    results: Sequence[Result] = ()  # those that are not


def _attempt(key: Hashable, work: Work, store: Store | None, plugins: str) -> _Outcome:
    """What comes of a job by its key; a store that is given takes its results.

    `plugins` is the version of the plugins of which keys of results were made; CampaignError if
    there is another one before or after the work.
    """
    _require_plugins(plugins, refresh=True)
    try:
        results = work()
    except CampaignError as error:
        return _Outcome(key, failure=str(error).splitlines()[0])
    _require_plugins(plugins, refresh=False)
    if store is None:
        return _Outcome(key, results=results)
    for result in results:
        store.put(*result)
    return _Outcome(key, stored=[key_of_result for key_of_result, _, _ in results])


def _compute(
    kind: str, jobs: Sequence[Job], store: Store, pool: Pool, quiet: bool
) -> dict[Hashable, str]:
    """Compute jobs that are ready; returns why jobs failed, by their keys.

    The order is random, so that processes which share a folder share the work: a job whose results
    are stored meanwhile is left out.
    """
    by_key = {job.key: job for job in jobs}
    failures = dict[Hashable, str]()
    with progress(kind, sum(job.size for job in jobs), quiet=quiet) as advance:

        def missing() -> Iterator[tuple[Hashable, Work, Store | None, str]]:
            for job in random.sample(jobs, len(jobs)):
                if store.has(*job.result_keys):
                    advance(job.size)
                else:
                    # those of a cluster return their results, others store them themselves
                    shared = store if pool.cluster is None else None
                    yield job.key, job.run(store), shared, pool.plugins

        for outcome in pool.each(_attempt, missing()):
            if outcome.failure:
                failures[outcome.key] = outcome.failure
            for result in outcome.results:
                store.put(*result)
            store.written.update(outcome.stored)
            advance(by_key[outcome.key].size)
    return failures
