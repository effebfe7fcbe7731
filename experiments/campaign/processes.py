"""Processes that compute: local ones, or the workers of a Dask cluster, behind one face."""

import asyncio
import importlib.util
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self, TypeVar

import joblib
from joblib.externals.loky import get_reusable_executor

from experiments.campaign.store import CampaignError
from experiments.campaign.version import code_version
from laisn.failure import LaisnError
from laisn.parent import end_with

Result = TypeVar("Result")

_CONNECT_S = 3


class WorkerDiedError(CampaignError):
    """A process that computed has died; everything it had reported is stored."""


def _died(where: str) -> WorkerDiedError:
    return WorkerDiedError(
        f"{where} died, most likely killed for want of memory; every finished cell is stored, "
        "and the same command goes on from there (fewer --workers need less memory)"
    )


class Pool:
    """A pool of processes; use it as a context.

    One local worker means no process at all: everything is computed here.
    """

    def __init__(self, workers: int, cluster: str | None = None) -> None:
        """Make a pool; nothing starts before it is entered.

        Args:
            workers: local processes.
            cluster: address of a Dask scheduler; its workers are used instead.

        Raises:
            LaisnError: there is no worker.
        """
        if workers < 1:
            raise LaisnError(f"workers is {workers}, expected at least 1")
        self.size = workers
        self._cluster = cluster
        self._stack = ExitStack()
        self._backend = "sequential" if workers == 1 else "loky"

    def __enter__(self) -> Self:
        """Start; LaisnError if the cluster cannot be used."""
        if self._cluster is not None:
            self.size = self._stack.enter_context(_Cluster(self._cluster)).workers
            self._backend = "dask"
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, trace: TracebackType | None) -> None:
        """Leave the cluster; local processes end with this one, or at once if something failed."""
        self._stack.close()
        if kind is not None and self._backend == "loky":
            get_reusable_executor().shutdown(kill_workers=True)

    def each(self, function: Callable[..., Result], arguments: Iterable[tuple[Any, ...]]) -> Iterator[Result]:
        """Results of a function over argument tuples, each as soon as it is there.

        Raises:
            WorkerDiedError: a process died.
        """
        # local processes must not outlive this one, even if it is killed
        ending = {"initializer": end_with, "initargs": (os.getpid(),)} if self._backend == "loky" else {}
        with joblib.parallel_config(backend=self._backend, n_jobs=self.size, **ending):
            parallel = joblib.Parallel(
                return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs", max_nbytes=None
            )
            try:
                yield from parallel(joblib.delayed(function)(*given) for given in arguments)
            except BrokenProcessPool as error:
                raise _died("a worker process") from error
            except Exception as error:
                if type(error).__name__ == "KilledWorker":
                    raise _died("a worker of the cluster") from error
                raise


def _require_scheduler(address: str) -> None:
    """Ask for a scheduler's name: a client would wait for ever at an address that accepts and says nothing.

    Raises LaisnError if none answers in time, or the address cannot be one.
    """
    # optional, for clusters alone
    import distributed

    async def ask() -> None:
        # certificates of tls:// come from Dask's configuration
        security: Callable[..., Any] = distributed.Security
        call: Callable[..., Any] = distributed.rpc
        async with call(address, connection_args=security().get_connection_args("client")) as scheduler:
            await scheduler.identity()

    try:
        asyncio.run(asyncio.wait_for(ask(), _CONNECT_S))
    except (OSError, ValueError, TypeError) as error:
        why = str(error) or f"nothing came within {_CONNECT_S} s"
        if address.startswith("tls:"):
            why += "; tls:// needs certificates, named under distributed.comm.tls in Dask's configuration"
        raise LaisnError(f"no Dask scheduler answers at {address}: {why}") from None


class _Cluster:
    """A connection to a Dask cluster whose workers have this very version."""

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise LaisnError("--cluster needs Dask: pip install laisn-sim[cluster]") from None
        _require_scheduler(address)
        connect: Callable[..., Any] = distributed.Client
        self._client = connect(address, timeout=_CONNECT_S)
        try:
            self.workers = self._check(address)
        except BaseException:
            self._client.close()
            raise

    def _check(self, address: str) -> int:
        """Number of threads of the cluster; LaisnError naming workers that cannot compute for us."""
        threads = {
            name: info["nthreads"] for name, info in self._client.scheduler_info(n_workers=-1)["workers"].items()
        }
        if not threads:
            raise LaisnError(f"the Dask scheduler at {address} has no workers")
        # Functions of the standard library alone: a worker without this package could not even take one of ours.
        found = self._client.run(importlib.util.find_spec, "experiments", on_error="return")
        lacking = sorted(name for name, spec in found.items() if spec is None or isinstance(spec, BaseException))
        if lacking:
            raise LaisnError(f"laisn-sim is not installed on these workers of {address}: {', '.join(lacking)}")
        versions = self._client.run(code_version, on_error="return")
        others = sorted(f"{name} ({found})" for name, found in versions.items() if found != code_version())
        if others:
            raise LaisnError(f"this is version {code_version()}, but workers of {address} have: {', '.join(others)}")
        return sum(threads.values())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, trace: TracebackType | None) -> None:
        self._client.close()
