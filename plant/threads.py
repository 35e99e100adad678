"""Linear algebra on one thread.

Matrices of a few hundred rows gain nothing from more, on a busy machine threads that wait for each other take ten times
as long, and results depend on their number in the last digits.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def one_thread() -> Iterator[None]:
    """Keeps BLAS and LAPACK on one thread."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield


def default_to_one_thread() -> None:
    """Keeps libraries that this process and its children load later on one thread, unless the user chose a number."""
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
