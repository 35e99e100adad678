"""Executors on other machines: a Dask cluster by the address of its scheduler."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.processes.pools import Executor

PATIENCE = 10.0  # s, to reach a scheduler


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """The executor of a cluster, such as tcp://machine:8786.

    Raises InputError where Dask is not installed or the scheduler cannot be reached.
    """
    client = _client(address)
    try:
        yield client.get_executor(pure=False)
    finally:
        client.close(timeout=2)


def cluster_workers(address: str) -> int:
    """Threads of all workers of a cluster; raises as cluster_executor, and where there are no workers."""
    client = _client(address)
    try:
        threads = sum(worker["nthreads"] for worker in client.scheduler_info(n_workers=-1)["workers"].values())
    finally:
        client.close(timeout=2)
    if not threads:
        raise InputError("--scheduler", "must have workers (start them with `dask worker ADDRESS`)", address)
    return int(threads)


def _client(address: str) -> Any:
    if find_spec("distributed") is None:
        raise InputError("--scheduler", "needs the package distributed (pip install 'flexbeams[cluster]')")
    distributed: Any = import_module("distributed")
    for name in logging.root.manager.loggerDict:  # a lost connection is one line here
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError("--scheduler", f"cannot be reached: {reason}", address) from None
