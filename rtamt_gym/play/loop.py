"""`play`: the loop that plays tasks in a batch of places, and the simplest batches.

A batch adapts one system (`OneByOne`), several environments with one model (`SideBySide`), a vector
environment (`rtamt_gym.play.episodes`) or native rollouts (`rtamt_gym.play.native`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

from gymnasium import spaces

from rtamt_gym.inputs.case import Case
from rtamt_gym.play.history import SimulatedTrace
from rtamt_gym.play.simulation import Simulation, failed
from rtamt_gym.results.trial import Trial
from rtamt_gym.systems.policies import Model
from rtamt_gym.systems.system import Policy


class Task(NamedTuple):
    """A run to play: its number among all tasks, its case, and its seed."""

    number: int
    case: Case
    seed: int | None


class PlayEpisode(Protocol):
    """A task while it is played: a `Simulation`, or a place of native rollouts.

    Attributes:
        wall: Seconds that it took so far.
    """

    wall: float

    @property
    def trace(self) -> SimulatedTrace | None:
        """The samples, if they were kept."""

    def step(self) -> bool:
        """Take sample 0 or make a step; return whether the episode is over."""

    def trial(self, case: Case, error: str = "") -> Trial:
        """Return the result, with the error that ended it."""

    def leave(self) -> None:
        """Abandon the episode, and undo its changes of the system."""


class PlayBatch:
    """Places that play one task each at a time.

    Attributes:
        size: The number of places.
    """

    size = 1

    def free(self, running: Collection[int]) -> Sequence[int]:
        """Return the places where a task may start now."""
        return [index for index in range(self.size) if index not in running]

    def start(self, tasks: Mapping[int, Task]) -> None:
        """Prepare places for tasks that start together."""

    def begin(self, place: int, task: Task) -> PlayEpisode:
        """Start a task in a place; `start` has prepared it."""
        raise NotImplementedError

    def step(self, running: Sequence[int]) -> float:  # noqa: ARG002
        """Make the common part of a step; return the seconds that its episodes share."""
        return 0.0

    def advance(self, episode: Any) -> bool:  # noqa: ANN401 - what `begin` has returned
        """Take sample 0 or the sample of a step; return whether the episode is over."""
        over: bool = episode.step()
        return over

    def close(self) -> None:
        """Release the resources of the batch."""


class Played(NamedTuple):
    """A task that is over; `episode` is None if an error came before it started."""

    task: Task
    trial: Trial
    episode: Any


def play(batch: PlayBatch, tasks: Iterable[Task]) -> Iterator[Played]:
    """Play tasks in the places of a batch; yield each as soon as it is over.

    An error of an episode is in its trial, with the results of the samples before it.
    """
    todo = deque(tasks)
    running: dict[int, tuple[Task, PlayEpisode]] = {}
    try:
        while todo or running:
            while todo and (places := batch.free(running)):
                starting = {position: todo.popleft() for position in places[: len(todo)]}
                batch.start(starting)
                for position, task in starting.items():
                    since = time.perf_counter()
                    try:
                        running[position] = task, batch.begin(position, task)
                    except Exception as error:  # noqa: BLE001 - the trial has it
                        wall = time.perf_counter() - since
                        yield Played(task, failed(error, task.case, task.seed, wall), None)
                    else:
                        yield from _advanced(batch, running, position)
            if running:
                share = batch.step([*running]) / len(running)
                for position in [*running]:
                    running[position][1].wall += share
                    yield from _advanced(batch, running, position)
    finally:  # also if the caller wants no more
        for _, episode in running.values():
            episode.leave()
        batch.close()


def _advanced(
    batch: PlayBatch, running: dict[int, tuple[Task, PlayEpisode]], place: int
) -> Iterator[Played]:
    """Advance the episode of a place; yield it and free the place if it is over."""
    task, episode = running[place]
    text = ""
    try:
        if not batch.advance(episode):
            return
    except Exception as error:  # noqa: BLE001 - the trial has it
        text = f"{type(error).__name__}: {error}"
    del running[place]
    trial = episode.trial(task.case, text)
    if trial.seed != task.seed:  # of a place in a vector environment, which is reset with others
        trial = replace(trial, seed=task.seed)
    yield Played(task, trial, episode)


class OneByOne(PlayBatch):
    """A batch of one system, which plays each task to its end."""

    def __init__(self, begin: Callable[[Task], Simulation]) -> None:
        self._begin = begin

    def begin(self, place: int, task: Task) -> Simulation:  # noqa: ARG002
        return self._begin(task)

    def advance(self, episode: Simulation) -> bool:
        return episode.play()


class SideBySide(PlayBatch):
    """A batch of several environments; a model acts in all of them at once.

    The model also acts in places without a task, so that its batches have one size.
    """

    def __init__(
        self,
        size: int,
        begin: Callable[[int, Task, Policy], Simulation],
        model: Model,
        space: spaces.Space[Any],
    ) -> None:
        self.size = size
        self._begin = begin
        self._policies = model.batch(space, size)
        self._actions: list[Any] = [None] * size
        self._episodes: dict[int, Simulation] = {}

    def begin(self, place: int, task: Task) -> Simulation:
        self._policies.begin(place)
        episode = self._begin(place, task, lambda _obs: self._actions[place])
        self._episodes[place] = episode
        return episode

    def step(self, running: Sequence[int]) -> float:
        since = time.perf_counter()
        shown = {position: episode.observation for position, episode in self._episodes.items()}
        substitute = shown[running[0]]  # for places without an episode, and without a first sample
        seen = [shown.get(position) for position in range(self.size)]
        self._actions = [*self._policies.act([substitute if obs is None else obs for obs in seen])]
        return time.perf_counter() - since
