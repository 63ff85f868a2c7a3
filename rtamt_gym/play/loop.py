"""Episodes that run side by side: a model acts in all of them at once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rtamt_gym.inputs.case import Case
from rtamt_gym.play.recorder import failed
from rtamt_gym.play.run import Run
from rtamt_gym.play.simulation import Simulation
from rtamt_gym.results.trial import Trial
from rtamt_gym.systems.models import Model
from rtamt_gym.systems.system import Policy, System


class Task(NamedTuple):
    """An episode that is to be played: its number in the order of all, what it is given."""

    number: int
    case: Case
    seed: int | None


Begin = Callable[[Any, Task, Policy], Simulation]
"""Begins an episode in an environment, with a policy."""


class Lane:
    """One place of those side by side: an environment, and the episode that runs in it.

    Attributes:
        task: The episode; None if there is none.
        action: What the next step does.
        shown: What the environment has shown last; None if it has shown nothing.
        run: The last episode that was over without an error, if it was the last.

    Args:
        env: The environment, or what stands for it.
        begin: Begins an episode in it.
    """

    def __init__(self, env: gym.Env[Any, Any] | System, begin: Begin) -> None:
        self._env = env
        self._begin = begin
        self._wall = 0.0
        self.task: Task | None = None
        self.action: Any = None
        self.shown: Any = None
        self.run: Run | None = None

    def begin(self, task: Task) -> Trial | None:
        """Begins an episode and takes sample 0; gives its row if it is over then."""
        self.task, self._wall, self.run = task, 0.0, None
        try:
            self._simulation = self._begin(self._env, task, lambda _obs: self.action)
        except Exception as error:  # noqa: BLE001 - the row has it
            self.task = None
            return failed(error, task.case, task.seed, 0.0)
        return self.step()

    def step(self) -> Trial | None:
        """Makes a step of the episode; gives its row if it is over then."""
        task, simulation = self.task, self._simulation
        assert task is not None, "an episode has begun"  # noqa: S101 - for mypy
        begin = time.perf_counter()
        row: Trial | None = None
        try:
            simulation.step()
            self.shown = simulation.observation
            self.run = simulation.run
            if simulation.over:
                row = replace(simulation.trial(task.case), seed=task.seed)
        except Exception as error:  # noqa: BLE001 - the row has it
            text = f"{type(error).__name__}: {error}"
            row = replace(simulation.trial(task.case, text), seed=task.seed)
        self._wall += time.perf_counter() - begin
        if row is None:
            return None
        self.task = None
        return replace(row, wall=self._wall)

    def leave(self) -> None:
        """Ends an episode that nobody goes on with: its environment becomes what it was before."""
        if self.task is not None:
            self.task = None
            self._simulation.leave()

    def share(self, wall: float) -> None:
        """Adds the episode's share of the seconds that a step of all episodes took."""
        self._wall += wall


def side_by_side(
    lanes: Sequence[Lane], model: Model, space: spaces.Space[Any], tasks: Iterable[Task]
) -> Iterator[tuple[int, Trial]]:
    """Plays episodes, each lane one after the other; gives the row of each when it is over.

    The model acts on all lanes in every step, also on those that have no more episodes, so that
    batches are of one size.

    Raises:
        Exception: What the model raises. The episodes that run then are lost.
    """
    try:
        yield from _played(lanes, model, space, iter(tasks))
    finally:  # after an error, an interruption, and where no more episodes are asked for
        for lane in lanes:
            lane.leave()


def _played(
    lanes: Sequence[Lane], model: Model, space: spaces.Space[Any], todo: Iterator[Task]
) -> Iterator[tuple[int, Trial]]:
    batch = model.batch(space, len(lanes))
    free = list(enumerate(lanes))
    while True:
        for place, lane in free:
            for task in todo:
                row = lane.begin(task)
                if row is None:
                    batch.begin(place)
                    break
                yield task.number, row
        running = [lane for lane in lanes if lane.task is not None]
        if not running:
            return
        begin = time.perf_counter()
        some = running[0].shown
        actions = batch.act([some if lane.shown is None else lane.shown for lane in lanes])
        share = (time.perf_counter() - begin) / len(running)
        free = []
        for place, (lane, action) in enumerate(zip(lanes, actions, strict=True)):
            if lane.task is None:
                continue
            lane.share(share)
            lane.action, number = action, lane.task.number
            row = lane.step()
            if row is not None:
                yield number, row
                free.append((place, lane))


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTrace:
    """The samples of one simulation.

    Attributes:
        signals: The values of every variable, by name.
        period: Seconds between samples, or None.
    """

    signals: Mapping[str, NDArray[np.float64]]
    period: Fraction | None

    @property
    def samples(self) -> int | None:
        """The number of samples; None of no variables."""
        return next((len(values) for values in self.signals.values()), None)
