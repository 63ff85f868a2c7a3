"""Gymnasium environments as systems, and their monitors."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from typing import Any

import gymnasium as gym

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.monitor_set import Feed, MonitorSet
from rtamt_gym.options.evaluation import EvaluationOptions, refuse_other
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import SignalLike, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.step_time import StepTime
from rtamt_gym.signals.taps import Tap, rescaling, tapped
from rtamt_gym.systems.environment_case import EnvironmentCase, baseline_of
from rtamt_gym.systems.system import Policy, Signals, System, SystemEnd, exited
from rtamt_gym.wrappers.monitor import monitor_of
from rtamt_gym.wrappers.monitoring import check_pictures
from rtamt_gym.wrappers.substeps import Inside, read_substep_period


class Environment(System):
    """A Gymnasium environment and the policy that acts in it.

    If the environment has a monitor, the policy sees the outputs of the wrappers; samples and
    rewards are those that the monitor reads, and the monitor ends no episode.

    Attributes:
        observation: The last observation, on which the policy acts next.
        reward: The sum of its rewards since the start; None if they are not numbers.
        reported: Its own ``is_success`` in the info that ended the episode; None without one.
        refuses_nan: Whether it refuses signals that are nan, if the monitors do not.
        timed: Whether bounds of specifications depend on its period.
        below: As for the evaluation options, like ``rescaled``.
    """

    observation: Any = None
    reward: float | None = None
    reported: bool | None = None
    refuses_nan: bool = False
    timed: bool = False
    below: bool = False
    rescaled: bool = False
    _tap: Tap | None = None
    """What the monitor sees."""
    _seen: Any = None
    """What shows the samples that are read; None: the environment."""
    _watch: StepTime | None = None

    def __init__(
        self,
        env: gym.Env[Any, Any],
        policy: Policy | None,
        *,
        substeps: bool = False,
        case: EnvironmentCase | None = None,
    ) -> None:
        if policy is not None and not callable(policy):
            way_out = "lambda obs: model.predict(obs)[0]" if hasattr(policy, "predict") else ""
            raise InputTypeError(
                f"expected a policy, a function from observation to action, got {policy!r}; "
                f"write policy={way_out or f'lambda obs: {policy!r}'}"
            )
        self._monitor = monitor_of(env)
        substeps = substeps or (self._monitor is not None and self._monitor.substeps)
        self.name = env.spec.id if env.spec else type(env.unwrapped).__name__
        self.period = read_substep_period(env) if substeps else read_period(env)
        self.limit = env.spec.max_episode_steps if env.spec else None
        if substeps and self.limit is not None:
            step = read_period(env)
            self.limit = round(self.limit * step / self.period) if step and self.period else None
        self._substeps = substeps
        self._env = env
        self._policy = policy
        self._seed: int | None = None
        self._case = case
        self._ends: ExitStack | None = None  # set by a start that changes something

    def driven(self, case: Case) -> Environment:
        """Return the environment with the options, attributes and action waveforms of a case."""
        bound = EnvironmentCase(self._env, case, self.name)
        with bound.attributes():  # the case may change the period, so apply it first
            environment = Environment(self._env, self._policy, substeps=self._substeps, case=bound)
        environment._seed = self._seed
        environment.refuses_nan, environment.timed = self.refuses_nan, self.timed
        environment.below, environment.rescaled = self.below, self.rescaled
        return environment

    def known(self, signals: Signals) -> Mapping[str, SignalLike]:
        """Return the passed signals, then signals of the monitor and of the environment."""
        of_monitor = {} if self._monitor is None else self._monitor.judging.signals or {}
        return {**own_signals(self._env), **of_monitor, **(signals or {})}

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Bind the selectors."""
        self._step_period = period or Fraction(1)
        if period is not None:
            was_read = self.period is not None and math.isclose(self.period, period)
            self._watch = StepTime(
                self._env,
                float(period),
                read_substep_period if self._substeps else read_period,
                was_read=was_read,
                timed=self.timed,
                substeps=self._substeps,
                stated=self.period if was_read else None,
            )
        if self._substeps:
            self._step_period = exact(read_period(self._env) or 1)
        shown: Any = self._env if self._monitor is None else self._monitor.env
        parsed = parse_signals(
            signals or {},
            variables,
            SOURCES,
            extra=True,
            own=self.known(None),
            refuse_nan=self.refuses_nan,
        )
        seen = () if self._substeps else parsed  # substeps read no observation
        rescaler = rescaling(shown, seen, below=self.below, rescaled=self.rescaled)
        self._rescaler = rescaler
        if rescaler is not None:
            shown = rescaler.env
        self._reads_at_reset = [signal.bind_reset(shown) for signal in parsed]
        if self._substeps:
            self._inside = Inside(self._env, parsed)
        else:
            self.reads = [signal.bind(shown) for signal in parsed]

    def renderer(self) -> Callable[[], Any]:
        """Return the function that renders the environment."""
        check_pictures(self._env, "RerunView(pictures=)", lists=False)
        return self._env.render

    def again(self, policy: Policy | None, seed: int | None) -> Environment:
        """Return the environment for another run, with its bound signals."""
        environment = object.__new__(Environment)  # ten times as fast as copy.copy()
        environment.__dict__.update(self.__dict__, _policy=policy, _seed=seed)
        return environment

    @property
    def plain(self) -> bool:
        """Whether a step is one sample, which the environment itself returns."""
        return not self._substeps and self._monitor is None and self._rescaler is None

    def play(self, monitor_set: MonitorSet, feed: Feed, most: float) -> None:
        """Make steps and feed their samples until the system ends or a verdict is decided."""
        act, step, obs, watch = self._act, self._env.step, self.observation, self._watch
        settled, steps = monitor_set.settled, 0
        while steps < most:
            steps += 1
            try:
                action = act(obs)
            except SystemExit as end:
                raise exited("the policy", end) from end
            obs, reward, terminated, truncated, info = step(action)
            if watch is not None and watch.left:
                watch.step()
            self.observation = obs
            try:
                self.reward += float(reward)  # type: ignore[operator]  # None: see `_earn`
            except TypeError:
                self.reward = None
            feed(obs, action, reward, info)
            if terminated or truncated:
                self.ended = "terminated" if terminated else "truncated"
                self.reported = _reported(info)
                return
            if monitor_set.settled != settled:
                return

    def start(self) -> list[float]:
        self.ended = ""
        self.reward, self.reported = 0.0, None
        self._rest: deque[list[float]] = deque()
        self._end: SystemEnd = ""
        self._act: Policy = self._find_policy()
        if self.plain and self._case is None:
            self.observation, info = self._env.reset(seed=self._seed)
        else:
            self._ends = ExitStack()
            info = self._start(self._ends)
        if self._watch is not None:
            self._watch.begin()
        seen = self.observation, None, None, info
        if self._seen is not None:
            seen = self._seen.seen
        return [read(*seen) for read in self._reads_at_reset]

    def _start(self, ends: ExitStack) -> dict[str, Any]:
        """Reset an environment with a monitor, a case or rescaling; ``ends`` undoes it."""
        if self._monitor is not None:
            self._tap = Tap(self._monitor.env)
            ends.enter_context(self._monitor.tapped(self._tap))
        self._seen = self._tap
        if self._rescaler is not None:
            inner = self._rescaler.env
            self._seen = tapped(self._rescaler)
            ends.callback(setattr, self._rescaler, "env", inner)
        case = self._case
        if case is None:
            self.observation, info = self._env.reset(seed=self._seed)
        else:
            ends.enter_context(case.attributes())
            self.observation, info = self._env.reset(seed=self._seed, options=case.options)
            case.check()
        return info

    def advance(self) -> list[float]:
        if not self._rest:
            self._step()
        values = self._rest.popleft()
        if not self._rest:
            self.ended = self._end
        return values

    def _step(self) -> None:
        """Step the environment, and queue its samples: one, or several with ``substeps``."""
        try:
            action = self._act(self.observation)
        except SystemExit as end:
            raise exited("the policy", end) from end
        within = self._substeps
        result = self._inside.step(action, self._keep) if within else self._env.step(action)
        obs, reward, terminated, truncated, info = result
        if self._watch is not None:
            self._watch.step(len(self._rest) if self._substeps else 1)
        self.observation = obs
        if self._tap is not None:
            obs, action, reward, info = self._tap.seen
        if not self._substeps:
            seen = (obs, action, reward, info) if self._seen is None else self._seen.seen
            self._rest.append([read(*seen) for read in self.reads])
        self._earn(reward)
        if terminated or truncated:
            self._end = "terminated" if terminated else "truncated"
            self.reported = _reported(info)

    def _earn(self, reward: Any) -> None:  # noqa: ANN401
        try:
            self.reward += float(reward)  # type: ignore[operator]  # None: see below
        except TypeError:  # several objectives have several rewards
            self.reward = None

    def _keep(self, *step: Any) -> None:  # noqa: ANN401 - the arguments of a `Read`
        self._rest.append([read(*step) for read in self._inside.reads])

    def _find_policy(self) -> Policy:
        """Return who acts in an episode: the case, the policy or the baseline."""
        if self._case is not None and self._case.drives:
            return self._case.policy(self._policy, baseline_of(self._env), self._step_period)
        policy = self._policy
        if policy is None:  # a policy that is a collection may be empty
            policy = baseline_of(self._env)
        if policy is None:
            raise InputError(
                "an environment needs a policy, a function from observation to action; ",
                Argument(
                    "policy", words="policy=lambda obs: env.action_space.sample() acts at random"
                ),
            )
        return policy

    def close(self) -> None:
        """Restore the attributes; the environment stays open, because it belongs to the caller."""
        if self._ends is not None:
            self._ends.close()


def _reported(info: Mapping[str, Any]) -> bool | None:
    """Return the environment's own ``is_success`` in the last info, or None."""
    own = info.get("is_success")
    return None if own is None else bool(own)


def with_own_monitor(
    monitor: Any,  # noqa: ANN401 - of one environment, or of many
    specs: Any,  # noqa: ANN401
    signals: Mapping[str, SignalLike] | None,
    reading: EvaluationOptions,
) -> tuple[Any, Mapping[str, SignalLike] | None, EvaluationOptions]:
    """Return specifications, signals and options; by default, the values of the monitor."""
    if monitor is None or specs is not None:
        return specs, signals, reading
    own: Judging = monitor.judging
    whose, way_out = (
        "the monitor of the environment",
        "leave it out, or give specifications with it",
    )
    if signals is not None and signals != own.signals:
        refuse_other("signals", own.signals, signals, whose, way_out)
    return own.specs, own.signals, reading.over(own.reading, whose, way_out)
