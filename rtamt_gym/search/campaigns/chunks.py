"""`Chunks`: how many tasks a worker gets at once."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from rtamt_gym.results.trial import Trial
from rtamt_gym.search.campaigns.process import SearchTask
from rtamt_gym.search.runs.runner import Runner

__all__ = ["Chunks", "NumberedTrials"]

NumberedTrials = list[tuple[int, Trial]]
"""Trials with the numbers of their tasks."""

_SECONDS: Final = 1.0
"""About how long a chunk should take: a kill loses that much, and its file is written in less."""

_MOST: Final = 1000
"""The most tasks of a chunk."""


class Chunks(Iterator[list[SearchTask]]):
    """Deals tasks out, in chunks that grow until they take about a second.

    Where cases run side by side, a chunk is what runs at once.

    Args:
        tasks: The tasks.
        runner: What runs them.
    """

    def __init__(self, tasks: Sequence[SearchTask], runner: Runner) -> None:
        self._tasks = tasks
        self._batch = runner.batch
        self._workers = 1
        self._begin = 0
        self._finished = 0
        self._wall = 0.0

    def share(self, workers: int) -> None:
        """Makes chunks small enough for so many workers."""
        self._workers = workers

    def learn(self, rows: NumberedTrials) -> None:
        """Learns from finished tasks how long one takes."""
        self._finished += len(rows)
        self._wall += sum(row.wall for _, row in rows)

    def __len__(self) -> int:
        """The number of tasks that are left."""
        return len(self._tasks) - self._begin

    def __next__(self) -> list[SearchTask]:
        if not len(self):
            raise StopIteration
        size = self._batch
        if self._batch == 1 and self._finished:
            size = min(_MOST, max(1, int(_SECONDS * self._finished / max(self._wall, 1e-9))))
        size = max(1, min(size, math.ceil(len(self) / self._workers)))
        self._begin += size
        return list(self._tasks[self._begin - size : self._begin])
