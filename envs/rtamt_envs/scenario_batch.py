"""A batch of simulations of one scenario, the core of its environments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, StateError
from rtamt_envs.compiled import compiled, in_loops
from rtamt_envs.scenario import Bools, Floats, Scenario

_FIRST = np.ones(1, np.bool_)

_Generators = Sequence[np.random.Generator]


class ScenarioBatch:
    """A batch of simulations of a scenario: their states, parameters and observations.

    An environment has a batch of one; a vector environment and a search have many.

    Attributes:
        parameters: The parameters of each episode, shape (n, parameters).
        observations: The last observation of each episode, shape (n, observations).
        steps: The number of steps of each episode, shape (n,); -1 before the first.
    """

    def __init__(self, scenario: Scenario, parameters: Floats, num: int) -> None:
        self._scenario = scenario
        self._low = np.array([action.low for action in scenario.actions])
        self._high = np.array([action.high for action in scenario.actions])
        self._states = np.zeros((num, scenario.state))
        self._no_record = np.zeros((0, num, len(scenario.observations)))
        self.parameters = np.tile(parameters, (num, 1))
        self.observations = np.zeros((num, len(scenario.observations)))
        self.steps = np.full(num, -1, np.int64)

    def start(self, selected: Bools, generators: _Generators, parameters: Floats) -> None:
        """Start episodes in the selected simulations, with their rows of parameters."""
        self.parameters[selected] = parameters[selected]
        self.steps[selected] = 0
        noise = self._noise(1, selected, generators)
        _start(
            _functions(self._scenario)[0],
            self.parameters,
            noise,
            selected,
            self._states,
            self.observations,
        )

    def step(self, actions: Floats, selected: Bools, generators: _Generators) -> None:
        """Make a step in the selected simulations; actions of shape (n, actions).

        Raises:
            InputError: If an action is nan; the state is unchanged.
            StateError: If an episode has not started.
        """
        self._act(actions[None], selected, generators, self._no_record)

    def step_first(self, action: Floats, generator: np.random.Generator) -> None:
        """Make a step in the first simulation, without a compiled loop."""
        if self.steps[0] < 0:
            self._check_started(_FIRST)
        if np.isnan(action).any():
            self._check_numbers(action[None, None], _FIRST)
        applied = np.minimum(np.maximum(action, self._low), self._high)
        noise = generator.standard_normal(self._scenario.noise)
        self._scenario.step(
            applied, self.parameters[0], noise, self._states[0], self.observations[0]
        )
        self.steps[0] += 1

    def roll(self, actions: Floats, selected: Bools, generators: _Generators) -> Floats:
        """Make steps with actions of shape (steps, n, actions).

        Returns:
            The observations after each step, shape (steps, n, observations); nan if not selected.
        """
        record = np.full((len(actions), *self.observations.shape), np.nan)
        self._act(actions, selected, generators, record)
        return record

    def follow(self, steps: int, selected: Bools, generators: _Generators) -> Floats:
        """Make steps as `roll` does, under the baseline of the scenario."""
        self._check_started(selected)
        record = np.full((steps, *self.observations.shape), np.nan)
        _, step, baseline = _functions(self._scenario)
        _follow(
            step,
            baseline,
            self._scenario.period,
            np.zeros(len(self._low)),
            self.parameters,
            self._noise(steps, selected, generators),
            selected,
            self.steps,
            self._states,
            self.observations,
            record,
        )
        return record

    def baseline(self) -> Floats:
        """Return the actions of the baseline at the last observations, shape (n, actions)."""
        self._check_started(np.ones(len(self.steps), np.bool_))
        actions = np.zeros((len(self.steps), len(self._low)))
        for entry, action in enumerate(actions):
            time = int(self.steps[entry]) * self._scenario.period
            self._scenario.baseline(time, self.observations[entry], self.parameters[entry], action)
        return actions

    def _act(
        self, actions: Floats, selected: Bools, generators: _Generators, record: Floats
    ) -> None:
        """Make steps; store the observations if ``record`` has room."""
        self._check_started(selected)
        if np.isnan(actions).any():
            self._check_numbers(actions, selected)
        _roll(
            _functions(self._scenario)[1],
            actions,
            self._low,
            self._high,
            self.parameters,
            self._noise(len(actions), selected, generators),
            selected,
            self.steps,
            self._states,
            self.observations,
            record,
        )

    def _check_started(self, selected: Bools) -> None:
        """Raise StateError if a selected simulation has no episode."""
        waiting = selected & (self.steps < 0)
        if waiting.any():
            where = f" in environment {int(waiting.argmax())}" if len(selected) > 1 else ""
            raise StateError(f"no episode of {self._scenario.id} runs{where}; call reset() first")

    def _check_numbers(self, actions: Floats, selected: Bools) -> None:
        """Raise InputError if an action of a selected simulation is nan."""
        for step, entry, index in np.argwhere(np.isnan(actions) & selected[:, None]):
            where = f" of step {step}" if len(actions) > 1 else ""
            where += f" in environment {entry}" if len(selected) > 1 else ""
            raise InputError(
                f"expected a number as action {self._scenario.actions[index].name!r}{where}, "
                "got nan"
            )

    def _noise(self, steps: int, selected: Bools, generators: _Generators) -> Floats:
        """Return random numbers, shape (steps, n, noise); each simulation has its own generator."""
        noise = np.zeros((steps, len(selected), self._scenario.noise))
        if self._scenario.noise:
            for entry in np.flatnonzero(selected).tolist():
                noise[:, entry] = generators[entry].standard_normal(noise[:, entry].shape)
        return noise


@cache
def _functions(scenario: Scenario) -> tuple[Callable[..., None], ...]:
    """Return the functions of a scenario for the loops below: start, step, baseline."""
    return (
        in_loops(scenario.start, "start"),
        in_loops(scenario.step, "step"),
        in_loops(scenario.baseline, "baseline"),
    )


@compiled
def _start(
    start: Callable[..., None],
    parameters: Floats,
    noise: Floats,
    selected: Bools,
    states: Floats,
    observations: Floats,
) -> None:
    for entry in range(len(states)):
        if selected[entry]:
            start(parameters[entry], noise[0, entry], states[entry], observations[entry])


@compiled
def _roll(
    step: Callable[..., None],
    actions: Floats,
    low: Floats,
    high: Floats,
    parameters: Floats,
    noise: Floats,
    selected: Bools,
    steps: NDArray[np.int64],
    states: Floats,
    observations: Floats,
    record: Floats,
) -> None:
    """Step each simulation through its actions; store the observations if ``record`` has room."""
    applied = np.empty(len(low))
    for entry in range(len(states)):
        if selected[entry]:
            observation = observations[entry]
            for k in range(len(actions)):
                for i in range(len(low)):
                    applied[i] = min(max(actions[k, entry, i], low[i]), high[i])
                step(applied, parameters[entry], noise[k, entry], states[entry], observation)
                if k < len(record):
                    record[k, entry] = observation
            steps[entry] += len(actions)


@compiled
def _follow(
    step: Callable[..., None],
    baseline: Callable[..., None],
    period: float,
    action: Floats,
    parameters: Floats,
    noise: Floats,
    selected: Bools,
    steps: NDArray[np.int64],
    states: Floats,
    observations: Floats,
    record: Floats,
) -> None:
    for entry in range(len(states)):
        if selected[entry]:
            observation = observations[entry]
            for k in range(len(record)):
                baseline(steps[entry] * period, observation, parameters[entry], action)
                step(action, parameters[entry], noise[k, entry], states[entry], observation)
                record[k, entry] = observation
                steps[entry] += 1
