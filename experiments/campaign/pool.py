"""Processes that compute in parallel: of this machine, or the workers of a Dask cluster."""

import multiprocessing
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from typing import Any, Self, TypeVar

import joblib
from joblib.externals.loky import get_reusable_executor

from experiments.campaign.store import CampaignError
from laisn.errors import LaisnError
from laisn.plugins import PLUGINS_VARIABLE, plugin_errors, plugins_version
from reports.version import code_version
from sim.system import exit_with_parent

Made = TypeVar("Made")  # what the function of `Pool.each` returns
_CONNECT_S = 3  # longest wait for a scheduler [s]


def _with_version(function: Callable[..., Made], *arguments: Any) -> tuple[str, Made]:
    # an exception of a plugin may be one that no other process can read
    with plugin_errors():
        return code_version(), function(*arguments)


class Pool:
    """A pool of `size` local processes, or of the workers of the Dask scheduler at an address; use
    it as a context.

    `workers` None is one for each core. With one local worker everything is computed in this
    process. `plugins` is the version of the plugins of which the keys of results were made, by
    default of those that there are. LaisnError if there is no worker, or the cluster cannot be
    used.
    """

    def __init__(
        self, workers: int | None, cluster: str | None = None, *, plugins: str | None = None
    ) -> None:
        workers = len(os.sched_getaffinity(0)) if workers is None else workers
        if workers < 1:
            raise LaisnError(f"workers is {workers}, expected at least 1")
        self.size = workers
        self.cluster = cluster
        self.plugins = plugins_version(refresh=True) if plugins is None else plugins
        self._client: Any = None

    def __enter__(self) -> Self:
        if self.cluster is not None:
            self._client = _connect(self.cluster)
            self.size = sum(self._client.nthreads().values())
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # local processes end with this one, or at once if something failed
        if self._client is not None:
            self._client.close()
        elif kind is not None and self.size > 1:
            get_reusable_executor().shutdown(kill_workers=True)

    def each(
        self, function: Callable[..., Made], arguments: Iterable[tuple[Any, ...]]
    ) -> Iterator[Made]:
        """Results of a function in the order of completion; CampaignError if a process died or
        has other sources.
        """
        options: dict[str, Any] = {"backend": "sequential" if self._client is None else "dask"}
        if self._client is None and self.size > 1:
            # joblib starts new processes where the arguments differ from those before
            parent = os.getpid(), (PLUGINS_VARIABLE, os.environ.get(PLUGINS_VARIABLE, ""))
            options = {"backend": "loky", "initializer": exit_with_parent, "initargs": parent}
            # a process that has compiled holds the compiler's memory, which loky takes for a leak;
            # it gives the process's further calls to a new one, so that none is lost
            warnings.filterwarnings("ignore", message="A worker stopped while some jobs")
        calls = (joblib.delayed(_with_version)(function, *values) for values in arguments)
        with joblib.parallel_config(n_jobs=self.size, **options):
            parallel = joblib.Parallel(
                return_as="generator_unordered", batch_size=1, max_nbytes=None
            )
            try:
                for version, result in parallel(calls):
                    if version != code_version():
                        raise CampaignError(
                            f"a worker has version {version}, the campaign began with "
                            f"{code_version()}: the sources changed while it ran; run it again"
                        )
                    yield result
            except Exception as error:
                # Dask is optional, so its exception goes by its name
                if isinstance(error, BrokenProcessPool) or type(error).__name__ == "KilledWorker":
                    raise CampaignError(
                        "a worker process died, probably out of memory; every finished result is "
                        "stored, and the same command goes on from there (fewer --workers need "
                        "less memory)"
                    ) from error
                if isinstance(error, OSError):
                    # such as a full disk
                    error.add_note(
                        "finished results are stored, and the same command goes on from there"
                    )
                raise


def release_workers() -> None:
    """End local processes, so that drawing a page does not need memory beside theirs; a later
    pool starts others.
    """
    if multiprocessing.active_children():
        get_reusable_executor().shutdown()


def _connect(address: str) -> Any:
    """A client of a Dask cluster; LaisnError if it does not answer, or names workers that have
    not this version.
    """
    try:
        import distributed
    except ImportError:
        raise LaisnError("--cluster needs Dask: pip install laisn-sim[cluster]") from None
    dask: Any = distributed  # its types are incomplete
    try:
        client = dask.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:
        raise LaisnError(f"no Dask scheduler answers at {address}: {error}") from None

    def version_there() -> str:
        # sent by value: a worker without this package could not import a function of it
        return str(import_module("reports.version").code_version())

    versions = client.run(version_there, on_error="return")
    others = sorted(
        f"{name} ({version})" for name, version in versions.items() if version != code_version()
    )
    if versions and not others:
        return client
    client.close()
    if not versions:
        raise LaisnError(f"the Dask scheduler at {address} has no workers")
    raise LaisnError(
        f"laisn-sim {code_version()} is not installed on these workers of {address}: "
        f"{', '.join(others)}"
    )
