"""The workers that judge files: processes of this machine, Dask or Ray."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any, Final

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.commands.fleet_worker import FileRow

_WAIT: Final = 60
"""The seconds until a scheduler must have a worker."""


def check_packages(backend: str | None, paths: Sequence[str]) -> None:
    """Raise an error if a package of the cluster or of a URL is missing."""
    if backend is not None:
        try:
            import_module(_PACKAGES[backend])
        except ModuleNotFoundError as error:
            raise naming_extra(error, f"backend={backend!r}", backend) from None
    urls = {path.partition("://")[0] for path in paths if "://" in path}
    if not urls:
        return
    try:
        fsspec = import_module("fsspec")
    except ModuleNotFoundError as error:
        raise naming_extra(error, "a URL", "urls") from None
    for protocol in sorted({name for url in urls for name in url.split("::")}):
        try:
            fsspec.get_filesystem_class(protocol)
        except (ImportError, ValueError) as error:
            raise InputError(
                f"cannot open URLs with {protocol}:// ({error}). Install the package of this file "
                "system, or copy the files."
            ) from None


_PACKAGES: Final = {"dask": "distributed", "ray": "ray"}
"""The package of each backend."""


@contextmanager
def workers_of(
    backend: str | None, scheduler: str | None, processes: int
) -> Iterator[tuple[int, Callable[..., Any]]]:
    """Yield the number of workers, and a function that sends a task to one."""
    if backend is None:
        with ThreadPoolExecutor(processes) as pool:
            yield processes, pool.submit
        return
    if backend == "dask":
        yield from _dask(scheduler)
        return
    yield from _ray(scheduler)


def _dask(scheduler: str | None) -> Iterator[tuple[int, Callable[..., Any]]]:
    from distributed import Client

    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(
            f"cannot reach a Dask scheduler at {scheduler}: {error}. Start one with dask "
            "scheduler, and give its address, such as tcp://host:8786, as ",
            Argument("scheduler"),
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_WAIT)
        except TimeoutError:
            raise InputError(
                f"no worker has come to the scheduler {client.scheduler.address} in {_WAIT} s. "
                "Start workers with dask worker ADDRESS, and try again."
            ) from None
        count = sum(client.nthreads().values())
        yield count, partial(client.submit, pure=False)


def _ray(scheduler: str | None) -> Iterator[tuple[int, Callable[..., Any]]]:
    import ray

    try:
        if not ray.is_initialized():
            ray.init(scheduler, log_to_driver=False)
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise InputError(
            f"cannot reach Ray at {scheduler}: {error}. Start it with ray start --head, and give "
            "its address, such as host:6379, as ",
            Argument("scheduler"),
        ) from error
    remote = ray.remote(max_retries=0)(lambda run, batch: run(batch))
    count = max(1, int(ray.cluster_resources().get("CPU", 1)))
    yield count, lambda run, batch: _RayFuture(remote.remote(run, batch))


class _RayFuture:
    """A result of Ray with the methods of a future."""

    def __init__(self, reference: Any) -> None:  # noqa: ANN401 - Ray is optional
        self.reference = reference

    def hex(self) -> str:
        """Return the name of the result."""
        return str(self.reference.hex())

    def result(self) -> list[FileRow]:
        """Return the result, or raise its error."""
        import ray

        try:
            rows: list[FileRow] = ray.get(self.reference)
        except ray.exceptions.RayTaskError as error:
            raise error.cause from error
        return rows

    def cancel(self) -> None:
        """End the task."""
        import ray

        ray.cancel(self.reference, force=True)


def wait_for_any(futures: Sequence[Any]) -> Sequence[Any]:
    """Return futures that are done, and wait for one."""
    if hasattr(futures[0], "hex"):  # of Ray
        import ray

        done, _ = ray.wait([future.reference for future in futures], num_returns=1)
        return [future for future in futures if future.reference in done]
    if type(futures[0]).__module__.startswith("distributed"):
        import distributed

        return list(distributed.wait([*futures], return_when="FIRST_COMPLETED").done)
    return list(wait(futures, return_when=FIRST_COMPLETED).done)


def is_lost(error: Exception) -> bool:
    """Return whether an error means that the scheduler is lost."""
    return not _LOST.isdisjoint(kind.__name__ for kind in type(error).__mro__)


_LOST: Final = frozenset(
    ["CancelledError", "FutureCancelledError", "CommClosedError", "RaySystemError"]
)
"""The names of errors of Dask and Ray without a scheduler."""
