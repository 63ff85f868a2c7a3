"""`Waves`: the episodes that run in a vector environment, from one reset of all to the next."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

from rtamt_gym.evaluation.lanes import Lane, Task
from rtamt_gym.evaluation.places import Place
from rtamt_gym.judging.specs import autoreset_mode
from rtamt_gym.judging.vector_infos import final_infos, final_observations
from rtamt_gym.results.trial import Trial
from rtamt_gym.signals.columns import SignalColumns
from rtamt_gym.signals.step_time import StepTimes
from rtamt_gym.signals.taps import VectorTap
from rtamt_gym.simulation.crashes import no_exit
from rtamt_gym.simulation.models import Model, PolicyBatch
from rtamt_gym.simulation.policies import SeededPolicy
from rtamt_gym.simulation.run import Run
from rtamt_gym.simulation.systems import Policy

__all__ = ["Waves"]

Played = tuple[int, Trial, Run | None]
"""The number of an episode, its row, and its run, if no error has ended it."""

Mask = NDArray[np.bool_]


class Waves:
    """Plays episodes in the environments of a vector environment.

    Args:
        env: The vector environment.
        make: Makes the policy of an episode.
        columns: Reads the signals of all environments.
        places: Each environment as a system.
        lanes: What plays episodes in these systems.
        tap: What has shown the samples that are read, to a monitor of the environment or to a
            wrapper that rescales them; None: the environment itself.
        times: Compares the period with the environments.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        make: SeededPolicy,
        columns: SignalColumns,
        places: Sequence[Place],
        lanes: Sequence[Lane],
        tap: VectorTap | None,
        times: StepTimes,
    ) -> None:
        self._env = env
        self._make = make
        self._columns = columns
        self._places = places
        self._lanes = lanes
        self._tap = tap
        self._times = times
        self._mode = autoreset_mode(env)
        self._obs: Any = None

    def play(self, todo: deque[Task]) -> Iterator[Played]:
        """Plays an episode in each environment; in those that can be reset alone, all.

        An environment without an episode begins and does what another one does.

        Raises:
            Exception: What the environment or the policy raises where several episodes run.
        """
        single = self._mode is AutoresetMode.DISABLED
        acting = _Acting(self._env, self._make)
        mask: Mask = np.ones(len(self._lanes), np.bool_)
        yield from self._begin(mask, todo, acting, {})
        begun: Mask | None = None
        while running := self._running():
            with no_exit("the policy"):
                actions = acting.act(self._obs, running)
            ended = self._step(actions, begun, running)
            for place in running:
                yield from self._over(place, self._lanes[place].task, self._lanes[place].step())
            if ended is None:
                return
            begun = ended if self._mode is AutoresetMode.NEXT_STEP and ended.any() else None
            if single:
                mask = self._free(todo) | ended
                while mask.any() and (todo or self._running()):
                    yield from self._begin(mask, todo, acting, {"reset_mask": mask})
                    mask = self._free(todo)

    def _running(self) -> list[int]:
        return [place for place, lane in enumerate(self._lanes) if lane.task is not None]

    def _free(self, todo: deque[Task]) -> Mask:
        """The environments without an episode, if one is left for them."""
        return np.array([lane.task is None and bool(todo) for lane in self._lanes])

    def _begin(
        self, mask: Mask, todo: deque[Task], acting: _Acting, options: dict[str, Any]
    ) -> Iterator[Played]:
        """Resets the environments of the mask and begins episodes, as far as some are left."""
        due = {int(place): todo.popleft() for place in np.flatnonzero(mask) if todo}
        seeds = [due[place].seed if place in due else None for place in range(len(mask))]
        if due:
            first = next(iter(due.values())).seed
            seeds = [first if seed is None else seed for seed in seeds]
        found: Any = self._env.reset(seed=seeds, options=options)  # type: ignore[arg-type]  # a seed for each
        self._obs = found[0]
        self._times.begin(mask)
        shown, infos = found if self._tap is None else self._tap.shown
        table = self._columns.reset(shown, infos, mask)
        for place, task in due.items():
            self._places[place].take(table[place], None)
            acting.begin(place, task.seed)
            yield from self._over(place, task, self._lanes[place].begin(task))

    def _over(self, place: int, task: Task | None, row: Trial | None) -> Iterator[Played]:
        if row is not None and task is not None:
            yield task.number, row, self._lanes[place].run

    def _step(self, actions: Any, begun: Mask | None, running: Sequence[int]) -> Mask | None:  # noqa: ANN401
        """Makes a step; gives which environments it has ended, None if it raised an error."""
        try:
            with no_exit("an environment"):
                result = self._env.step(actions)
            ended: Mask = np.logical_or(result[2], result[3])
            self._times.step(ended if self._mode is AutoresetMode.SAME_STEP else begun)
        except Exception as error:
            if len(running) > 1:
                raise
            self._places[running[0]].error = error
            return None
        self._obs, terminated = result[0], result[2]
        if self._tap is not None:
            actions, result = self._tap.actions, self._tap.result
        table = self._read(result, actions, begun)
        for place in running:
            self._places[place].take(table[place], result[1][place])
            if ended[place]:
                self._places[place].end = "terminated" if terminated[place] else "truncated"
        return ended

    def _read(self, result: Any, actions: Any, begun: Mask | None) -> Any:  # noqa: ANN401
        """The signals after a step, also of the episodes that the step has ended."""
        obs, rewards, terminated, truncated, infos = result
        ended = np.logical_or(terminated, truncated)
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            if self._columns.reads_obs:
                space = (self._env if self._tap is None else self._tap).single_observation_space
                obs = final_observations(space, obs, infos, ended)
            if self._columns.reads_info:
                infos = final_infos(infos, ended)
        return self._columns.step(obs, actions, rewards, infos, begun)


class _Acting:
    """Acts in the environments of a vector environment."""

    def __init__(self, env: VectorEnv[Any, Any, Any], make: SeededPolicy) -> None:
        self._make = make
        self._observations, self._space = env.observation_space, env.single_action_space
        self._policies: list[Policy | None] = [None] * env.num_envs
        self._batch: PolicyBatch | None = None
        if isinstance(make, Model) and make.deterministic:
            self._batch = make.batch(env.single_observation_space, env.num_envs)

    def begin(self, place: int, seed: int | None) -> None:
        """Begins an episode."""
        if self._batch is not None:
            self._batch.begin(place)
        else:
            self._policies[place] = self._make(seed or 0)

    def act(self, observations: Any, running: Sequence[int]) -> Any:  # noqa: ANN401
        """The actions; an environment without an episode does what the first with one does."""
        if self._batch is not None:
            return self._batch.of(observations)
        shown = list(iterate(self._observations, observations))
        policies: Any = self._policies
        made = {place: policies[place](shown[place]) for place in running}
        actions = [made.get(place, made[running[0]]) for place in range(len(shown))]
        room: Any = create_empty_array(self._space, len(actions))
        return concatenate(self._space, actions, room)
