"""One thread per solve: a pool with one process per core would otherwise fight itself.

This file imports nothing heavy, since the environment must be set before numpy is first imported.
"""

from collections.abc import Mapping

#: Read by the BLAS, OpenMP and numba run-times when they are loaded.
THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def single_threaded(environment: Mapping[str, str]) -> dict[str, str]:
    """Return an environment in which numerical libraries start with one thread."""
    return dict(environment) | dict.fromkeys(THREAD_VARIABLES, "1")


class ThreadError(RuntimeError):
    """A numerical library runs more threads than the one a solve may have."""


def require_one_thread() -> None:
    """Raise unless every loaded BLAS and OpenMP library runs one thread."""
    from threadpoolctl import threadpool_info

    for library in threadpool_info():
        if library["num_threads"] != 1:
            name = library.get("internal_api", "library")
            raise ThreadError(f"threads of {name}: expected 1, got {library['num_threads']}")
