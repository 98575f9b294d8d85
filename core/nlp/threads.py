"""One thread for a solve, whoever asks for it."""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold the numerical libraries of this process to one thread.

    The matrices of a solve are small: more threads make it three times slower, and give other last bits.
    """
    # Before the limit is set: a library that is loaded later begins with as many threads as there are cores.
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        yield
