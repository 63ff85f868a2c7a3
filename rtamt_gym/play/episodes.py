"""`Episodes`: plays episodes of a policy in an environment, one by one or side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.play.loop import Played, SideBySide, Task, play
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.play.simulation import Simulation, Simulator
from rtamt_gym.systems.models import Model
from rtamt_gym.systems.policies import evaluated
from rtamt_gym.systems.system import Policy
from rtamt_gym.wrappers.monitor import monitor_of

_WAVES = 8
"""The number of episodes per environment that a worker gets at once."""


class Episodes(Runner):
    """Plays episodes of a policy in an environment.

    A deterministic model acts in ``n_envs`` episodes at once, each in its own environment. Other
    policies act in one episode after the other.

    Attributes:
        evaluated: The policy.
        unasked: Whether ``at_termination`` was not given.
        monitor: The monitor of the environment, or None.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any] | Callable[[], gym.Env[Any, Any]],
        requirements: Requirements | None = None,
        *,
        policy: Any,  # noqa: ANN401
        deterministic: bool = True,
        n_envs: int = 1,
        made: gym.Env[Any, Any] | None = None,
        **options: Any,  # noqa: ANN401 - as for `Runner`
    ) -> None:
        self._n_envs = check_count(Argument("n_envs"), n_envs)
        self._given = env
        self._envs: list[gym.Env[Any, Any]] = []
        self._simulators: dict[int, Simulator] = {}
        made = made or (env if isinstance(env, gym.Env) else env())
        self.evaluated = evaluated(policy, made, deterministic=deterministic)
        options = {"batch": n_envs, **options}
        self.monitor = monitor_of(made)
        super().__init__(made, requirements, policies=self.evaluated.make, **options)
        self.unasked = self.evaluation_options.at_termination is None
        if self.unasked:  # every episode would warn
            self.evaluation_options = self.evaluation_options.having(at_termination="complete")
        if self._model is not None and n_envs > 1:
            self._envs = [made, self._another()]

    @property
    def arguments(self) -> Mapping[str, Any]:
        """As `Runner.arguments`."""
        own = {
            name: value
            for name, value in super().arguments.items()
            if name not in {"policy", "policies"}
        }
        return {**own, "policy": self.evaluated, "n_envs": self._n_envs}

    @property
    def origin(self) -> Any:  # noqa: ANN401
        """As `Runner.origin`: the function that makes the environment, if there is one."""
        return self._given

    @property
    def batch(self) -> int:
        """The minimum number of episodes that a worker gets at once."""
        return self._n_envs * _WAVES if self._envs else super().batch

    def close(self) -> None:
        """Close the environments made here: all but the first, which `Runner.close` closes."""
        for env in self._envs[1:]:
            env.close()
        super().close()

    def _play(
        self, tasks: Sequence[Task], above: Mapping[str, float] | None, *, keeps: bool
    ) -> Iterator[Played]:
        model = self._model
        if not self._envs or model is None or keeps:
            yield from super()._play(tasks, above, keeps=keeps)
            return
        size = min(self._n_envs, len(tasks))
        while len(self._envs) < size:
            self._envs.append(self._another())

        def begin(place: int, task: Task, policy: Policy) -> Simulation:
            simulator = self._simulator_of(self._envs[place])
            return self._begin(task.case, task.seed, above, None, policy, simulator, light=True)

        batch = SideBySide(size, begin, model, self.system.observation_space)
        one_by_one = self._one_by_one(above, light=True)
        yield from self._played(batch, tasks, lambda task: play(one_by_one, [task]))

    def _simulator_of(self, env: gym.Env[Any, Any]) -> Simulator:
        """Return the simulator of an environment, made once for all its episodes."""
        if id(env) not in self._simulators:
            specs, duration = self.requirements, self._of_runs["duration"]
            self._simulators[id(env)] = Simulator(
                env, specs, self.signals, self.evaluation_options, duration=duration
            )
        return self._simulators[id(env)]

    @property
    def _model(self) -> Model | None:
        """The model that can act in many episodes at once, or None."""
        make = self.evaluated.make
        return make if isinstance(make, Model) and make.deterministic else None

    def _another(self) -> gym.Env[Any, Any]:
        """Make another environment like the first."""
        if not isinstance(self._given, gym.Env):
            return self._given()
        spec = self._given.spec
        missing = (
            [
                additional_wrapper.name
                for additional_wrapper in spec.additional_wrappers
                if additional_wrapper.kwargs is None
            ]
            if spec
            else []
        )
        if spec is None or missing:
            phrase = f"the wrapper {missing[0]} of {self.name}" if missing else self.name
            raise InputError(
                Argument("n_envs", self._n_envs),
                f" needs as many environments, and {phrase} cannot be constructed again; pass a "
                "function that makes the environment",
            )
        return gym.make(spec)
