"""Processes that compute: local ones of joblib, or the workers of a Dask cluster."""

import asyncio
import importlib.util
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Self, TypeVar

import joblib
from joblib.externals.loky import get_reusable_executor

from experiments.campaign.store import CampaignError
from experiments.campaign.version import code_version
from laisn.failure import LaisnError
from laisn.plugins import VARIABLE
from sim.system import exit_with_parent

Result = TypeVar("Result")

_CONNECT_S = 3


class WorkerDiedError(CampaignError):
    """A process that computed has died; everything it had reported is stored."""


def _begin_worker(parent: int, plugins: str) -> None:
    """Prepare a local process; joblib starts new ones where the arguments differ from those before."""
    os.environ[VARIABLE] = plugins
    exit_with_parent(parent)


def _with_version(function: Callable[..., Result], *arguments: Any) -> tuple[str, Result]:
    return code_version(), function(*arguments)


class Pool:
    """A pool of `size` processes; use it as a context. With one local worker everything is computed in this process."""

    def __init__(self, workers: int, cluster: str | None = None) -> None:
        """Prepare local processes, which start with the first work, or the address of a Dask scheduler in their place.

        Raises LaisnError if there is no worker.
        """
        if workers < 1:
            raise LaisnError(f"workers is {workers}, expected at least 1")
        self.size = workers
        self._cluster = cluster
        self._client: Any = None

    def __enter__(self) -> Self:
        """Connect to the cluster, if there is one; LaisnError if it cannot be used."""
        if self._cluster is not None:
            self._client = _connect(self._cluster)
            self.size = sum(self._client.nthreads().values())
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Leave the cluster; local processes end with this one, or at once if something failed."""
        if self._client is not None:
            self._client.close()
        elif kind is not None and self.size > 1:
            get_reusable_executor().shutdown(kill_workers=True)

    def each(self, function: Callable[..., Result], arguments: Iterable[tuple[Any, ...]]) -> Iterator[Result]:
        """Results of a function over argument tuples, in the order of completion.

        Raises:
            WorkerDiedError: a process died.
            CampaignError: a process has other sources.
        """
        options: dict[str, Any] = {"backend": "dask" if self._client is not None else "sequential"}
        if self._client is None and self.size > 1:
            begin = os.getpid(), os.environ.get(VARIABLE, "")
            options = {"backend": "loky", "initializer": _begin_worker, "initargs": begin}
        with joblib.parallel_config(n_jobs=self.size, **options):
            parallel = joblib.Parallel(
                return_as="generator_unordered", batch_size=1, pre_dispatch="2*n_jobs", max_nbytes=None
            )
            try:
                for version, result in parallel(joblib.delayed(_with_version)(function, *given) for given in arguments):
                    if version != code_version():
                        raise CampaignError(
                            f"a worker has version {version}, the campaign began with {code_version()}: "
                            "the sources changed while it ran; run it again"
                        )
                    yield result
            except Exception as error:
                # Dask is optional, so its exception goes by its name
                if isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker":
                    raise WorkerDiedError(
                        "a worker process died, probably out of memory; every finished result is stored, "
                        "and the same command goes on from there (fewer --workers need less memory)"
                    ) from error
                raise


def _connect(address: str) -> Any:
    """A client of a Dask cluster all of whose workers have this version; LaisnError names those that have not."""
    try:
        import distributed
    except ImportError:
        raise LaisnError("--cluster needs Dask: pip install laisn-sim[cluster]") from None
    # its types are incomplete
    dask: Any = distributed

    async def ask() -> None:
        # certificates of tls:// come from Dask's configuration
        arguments = dask.Security().get_connection_args("client")
        async with dask.rpc(address, connection_args=arguments) as scheduler:
            await scheduler.identity()

    try:
        # a client would wait for ever at an address that accepts connections and never answers
        asyncio.run(asyncio.wait_for(ask(), _CONNECT_S))
    except (OSError, ValueError, TypeError) as error:
        why = str(error) or f"nothing came within {_CONNECT_S} s"
        if address.startswith("tls:"):
            why += "; tls:// needs certificates, named under distributed.comm.tls in Dask's configuration"
        raise LaisnError(f"no Dask scheduler answers at {address}: {why}") from None
    client = dask.Client(address, timeout=_CONNECT_S)
    try:
        # a function of the standard library: a worker without this package could not even take one of ours
        specs = client.run(importlib.util.find_spec, "experiments", on_error="return")
        lacking = sorted(name for name, spec in specs.items() if spec is None or isinstance(spec, BaseException))
        if lacking or not specs:
            where = f"on these workers of {address}: {', '.join(lacking)}"
            none = f"the Dask scheduler at {address} has no workers"
            raise LaisnError(f"laisn-sim is not installed {where}" if lacking else none)
        versions = client.run(code_version, on_error="return")
        others = sorted(f"{name} ({version})" for name, version in versions.items() if version != code_version())
        if others:
            raise LaisnError(f"this is version {code_version()}, but workers of {address} have: {', '.join(others)}")
    except BaseException:
        client.close()
        raise
    return client
