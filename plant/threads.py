"""Linear algebra on one thread."""

from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import threadpool_limits


@contextmanager
def one_thread() -> Iterator[None]:
    """Keeps BLAS and LAPACK on one thread.

    Matrices of a few hundred rows gain nothing from more, on a busy machine threads that wait for each other take ten
    times as long, and results depend on their number in the last digits.
    """
    with threadpool_limits(1):
        yield
