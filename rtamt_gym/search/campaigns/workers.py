"""The workers that joblib has: threads here, each of which watches a process, or a cluster."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from typing import Any, Literal, TypeVar

import joblib

from rtamt import InputError

__all__ = ["ClusterBackend", "chosen", "spread"]

ClusterBackend = Literal["dask", "ray"]
"""The backends of joblib that have workers elsewhere."""

_S = TypeVar("_S")
_C = TypeVar("_C")
_R = TypeVar("_R")


@contextmanager
def chosen(backend: ClusterBackend | None, n_jobs: int | None) -> Iterator[tuple[int, int]]:
    """Chooses the backend of joblib for what is inside.

    Args:
        backend: Its name; None: threads of this process, each of which watches another.
        n_jobs: How many workers there are; None: all of a cluster, or one.

    Yields:
        The number of workers, and how many threads the libraries of each may start.

    Raises:
        InputError: If there is no such backend, or it has no workers.
    """
    if backend == "ray":
        _register_ray()
    jobs = n_jobs or (1 if backend is None else -1)
    try:
        config = joblib.parallel_config(backend=backend or "threading", n_jobs=jobs)
    except (ValueError, ImportError) as error:
        raise InputError(f"cannot use backend={backend!r}: {error}") from error
    with config:
        count = max(1, joblib.effective_n_jobs(jobs))
        yield count, max(1, joblib.cpu_count() // count) if backend is None else 1


def spread(
    function: Callable[[_S, _C], _R], setup: _S, chunks: Iterator[_C], count: int
) -> Generator[_R]:
    """Gives the results of ``function(setup, chunk)`` in the order in which they come."""
    parallel: Any = joblib.Parallel(
        n_jobs=count, batch_size=1, pre_dispatch="2*n_jobs", return_as="generator_unordered"
    )
    with warnings.catch_warnings():
        # After an interrupt joblib says that there are results that nobody has fetched.
        warnings.filterwarnings("ignore", category=UserWarning, module="joblib")
        yield from parallel(joblib.delayed(function)(setup, chunk) for chunk in chunks)


def _register_ray() -> None:
    """Makes Ray a backend of joblib, and starts it or connects to it, as its own variables say.

    Raises:
        InputError: If it is not installed.
    """
    try:
        import ray
        from ray.util.joblib.ray_backend import RayBackend
    except ModuleNotFoundError as error:
        raise InputError(f"cannot use backend='ray': {error}; pip install ray") from error

    class _Backend(RayBackend):  # type: ignore[misc]  # not typed
        # joblib says that a pool of processes cannot give results one by one, because one that dies
        # loses its task without a word; an actor of Ray that dies is an error.
        supports_return_generator = True

    joblib.register_parallel_backend("ray", _Backend)
    if not ray.is_initialized():
        ray.init()
