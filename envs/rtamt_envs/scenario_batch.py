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
        observations: The last observation of each, shape (n, observations).
        steps: The number of steps of each episode, shape (n,); -1 before the first.
    """

    def __init__(self, scenario: Scenario, parameters: Floats, num: int) -> None:
        self._scenario = scenario
        self._low = np.array([action.low for action in scenario.actions])
        self._high = np.array([action.high for action in scenario.actions])
        self._states = np.zeros((num, scenario.state))
        self._unkept = np.zeros((0, num, len(scenario.observations)))
        self.parameters = np.tile(parameters, (num, 1))
        self.observations = np.zeros((num, len(scenario.observations)))
        self.steps = np.full(num, -1, np.int64)

    def start(self, chosen: Bools, generators: _Generators, parameters: Floats) -> None:
        """Start episodes in the chosen simulations, with their rows of parameters."""
        self.parameters[chosen] = parameters[chosen]
        self.steps[chosen] = 0
        noise = self._noise(1, chosen, generators)
        _start(
            _functions(self._scenario)[0],
            self.parameters,
            noise,
            chosen,
            self._states,
            self.observations,
        )

    def step(self, actions: Floats, chosen: Bools, generators: _Generators) -> None:
        """Make a step in the chosen simulations; actions of shape (n, actions).

        Raises:
            InputError: If an action is nan; the state is unchanged.
            StateError: If an episode has not started.
        """
        self._act(actions[None], chosen, generators, self._unkept)

    def step_first(self, action: Floats, generator: np.random.Generator) -> None:
        """Make a step in the first simulation, without the loop over all."""
        if self.steps[0] < 0:
            self._refuse_unbegun(_FIRST)
        if np.isnan(action).any():
            self._refuse_nan(action[None, None], _FIRST)
        applied = np.minimum(np.maximum(action, self._low), self._high)
        noise = generator.standard_normal(self._scenario.noise)
        self._scenario.step(
            applied, self.parameters[0], noise, self._states[0], self.observations[0]
        )
        self.steps[0] += 1

    def roll(self, actions: Floats, chosen: Bools, generators: _Generators) -> Floats:
        """Make steps with actions of shape (steps, n, actions).

        Returns:
            The observations after each step, shape (steps, n, observations); nan where not chosen.
        """
        record = np.full((len(actions), *self.observations.shape), np.nan)
        self._act(actions, chosen, generators, record)
        return record

    def follow(self, steps: int, chosen: Bools, generators: _Generators) -> Floats:
        """Make steps as `roll` does, under the baseline of the scenario."""
        self._refuse_unbegun(chosen)
        record = np.full((steps, *self.observations.shape), np.nan)
        _, step, baseline = _functions(self._scenario)
        _follow(
            step,
            baseline,
            self._scenario.period,
            np.zeros(len(self._low)),
            self.parameters,
            self._noise(steps, chosen, generators),
            chosen,
            self.steps,
            self._states,
            self.observations,
            record,
        )
        return record

    def baseline(self) -> Floats:
        """Return the actions of the baseline at the last observations, shape (n, actions)."""
        self._refuse_unbegun(np.ones(len(self.steps), np.bool_))
        actions = np.zeros((len(self.steps), len(self._low)))
        for entry, action in enumerate(actions):
            time = int(self.steps[entry]) * self._scenario.period
            self._scenario.baseline(time, self.observations[entry], self.parameters[entry], action)
        return actions

    def _act(self, actions: Floats, chosen: Bools, generators: _Generators, record: Floats) -> None:
        """Make steps; store the observations if ``made`` has room for them."""
        self._refuse_unbegun(chosen)
        if np.isnan(actions).any():
            self._refuse_nan(actions, chosen)
        _roll(
            _functions(self._scenario)[1],
            actions,
            self._low,
            self._high,
            self.parameters,
            self._noise(len(actions), chosen, generators),
            chosen,
            self.steps,
            self._states,
            self.observations,
            record,
        )

    def _refuse_unbegun(self, chosen: Bools) -> None:
        """Raise StateError if a chosen simulation has no episode."""
        unbegun = chosen & (self.steps < 0)
        if unbegun.any():
            where = f" in environment {int(unbegun.argmax())}" if len(chosen) > 1 else ""
            raise StateError(f"no episode of {self._scenario.id} runs{where}; call reset() first")

    def _refuse_nan(self, actions: Floats, chosen: Bools) -> None:
        """Raise InputError if an action of a chosen simulation is nan."""
        for step, entry, index in np.argwhere(np.isnan(actions) & chosen[:, None]):
            where = f" of step {step}" if len(actions) > 1 else ""
            where += f" in environment {entry}" if len(chosen) > 1 else ""
            raise InputError(
                f"expected a number as action {self._scenario.actions[index].name!r}{where}, "
                "got nan"
            )

    def _noise(self, steps: int, chosen: Bools, generators: _Generators) -> Floats:
        """Return random numbers, shape (steps, n, noise), each from its own generator."""
        noise = np.zeros((steps, len(chosen), self._scenario.noise))
        if self._scenario.noise:
            for entry in np.flatnonzero(chosen).tolist():
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
    chosen: Bools,
    states: Floats,
    observations: Floats,
) -> None:
    for entry in range(len(states)):
        if chosen[entry]:
            start(parameters[entry], noise[0, entry], states[entry], observations[entry])


@compiled
def _roll(
    step: Callable[..., None],
    actions: Floats,
    low: Floats,
    high: Floats,
    parameters: Floats,
    noise: Floats,
    chosen: Bools,
    steps: NDArray[np.int64],
    states: Floats,
    observations: Floats,
    record: Floats,
) -> None:
    """Step each simulation through its actions; store the observations if ``made`` has room."""
    applied = np.empty(len(low))
    for entry in range(len(states)):
        if chosen[entry]:
            seen = observations[entry]
            for k in range(len(actions)):
                for i in range(len(low)):
                    applied[i] = min(max(actions[k, entry, i], low[i]), high[i])
                step(applied, parameters[entry], noise[k, entry], states[entry], seen)
                if k < len(record):
                    record[k, entry] = seen
            steps[entry] += len(actions)


@compiled
def _follow(
    step: Callable[..., None],
    baseline: Callable[..., None],
    period: float,
    action: Floats,
    parameters: Floats,
    noise: Floats,
    chosen: Bools,
    steps: NDArray[np.int64],
    states: Floats,
    observations: Floats,
    record: Floats,
) -> None:
    for entry in range(len(states)):
        if chosen[entry]:
            seen = observations[entry]
            for k in range(len(record)):
                baseline(steps[entry] * period, seen, parameters[entry], action)
                step(action, parameters[entry], noise[k, entry], states[entry], seen)
                record[k, entry] = seen
                steps[entry] += 1
