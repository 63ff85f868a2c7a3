"""`Elsewhere`: runs cases on several processes or machines."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, Self
from uuid import uuid4

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.campaigns.child import Making
from rtamt_gym.search.campaigns.chunks import Chunks, NumberedTrials
from rtamt_gym.search.campaigns.process import Setup, end_processes, run_chunk
from rtamt_gym.search.campaigns.recipe import Recipe
from rtamt_gym.search.runs.runner import CaseLike, Runner
from rtamt_gym.search.runs.trace import SimulatedTrace

if TYPE_CHECKING:  # joblib is optional
    from rtamt_gym.search.campaigns.workers import ClusterBackend

__all__ = ["Elsewhere", "check_workers"]


def check_workers(
    n_jobs: int | None, backend: ClusterBackend | None, timeout: float | None
) -> float | None:
    """Checks where runs are to be, as for `run_campaign`; gives the timeout.

    Raises:
        InputError: If one of them is wrong.
    """
    check_choice("backend", backend, (None, "dask", "ray"))
    if timeout is not None:
        timeout = check_number("timeout", timeout)
    if n_jobs is not None and (type(n_jobs) is not int or n_jobs == 0):
        raise InputError(
            "expected ",
            Argument("n_jobs"),
            f" as a whole number, or -1 for all cores, got {n_jobs!r}",
        )
    return timeout


class Elsewhere:
    """Runs cases on several processes or machines, to the rows that a runner here has for them.

    Args:
        runner: The runner. Other processes make it anew from what it was made of.
        n_jobs: As for `run_campaign`.
        backend: As for `run_campaign`.
        timeout: As for `run_campaign`.
        whole: Whether runs are judged once they are over, see `Whole`.

    Raises:
        InputError: If a worker imports a module that makes one: each would start workers again.
        InputTypeError: If the system cannot be sent to another process.
    """

    def __init__(
        self,
        runner: Runner,
        n_jobs: int | None,
        backend: ClusterBackend | None,
        timeout: float | None,
        *,
        whole: bool = False,
    ) -> None:
        try:
            from rtamt_gym.search.campaigns import workers
        except ModuleNotFoundError as error:
            raise naming_extra(error, "n_jobs=") from error
        if Making.now:
            raise InputError(
                "a module that workers import starts workers itself while it is imported; put the "
                'call below if __name__ == "__main__":'
            )
        self._workers = workers
        self._runner = runner
        self._n_jobs, self._backend, self._timeout = n_jobs, backend, timeout
        self._name = uuid4().hex
        recipe = Recipe(runner, whole=whole, fingerprint=runner.fingerprint())
        self._sent = recipe.pickled(runner.name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the processes; no more cases can be run."""
        end_processes(self._name)

    @property
    def takes_seeds(self) -> bool:
        """As `Runner.takes_seeds`."""
        return self._runner.takes_seeds

    def judge(self, name: str, trace: SimulatedTrace) -> float:
        """The robustness of a requirement on samples that were kept."""
        return self._runner.judge(name, trace)

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Trial]]:
        """Runs cases, as `Runner.run` does; who stops asking for rows ends the processes."""
        listed = [Case(case) for case in cases]
        given: Sequence[int | None] = [None] * len(listed) if seeds is None else seeds
        chunks = Chunks(list(zip(range(len(listed)), listed, given, strict=True)), self._runner)
        with self.spread(chunks, above) as over:
            for rows in over:
                chunks.learn(rows)
                yield from rows

    @contextmanager
    def spread(
        self, chunks: Chunks, above: Mapping[str, float] | None = None
    ) -> Iterator[Iterator[NumberedTrials]]:
        """Gives the rows of each chunk as soon as a worker has run it."""
        with self._workers.chosen(self._backend, self._n_jobs) as (count, threads):
            chunks.share(count)
            path, sent = tuple(sys.path), self._sent
            setup = Setup(self._name, sent, self._timeout, threads, path, above)
            made: Any = self._workers.spread(run_chunk, setup, chunks, count)
            with closing(made) as over:
                try:
                    yield over
                except BaseException:  # else the threads that watch them would wait for them
                    self.close()
                    raise
