"""Gymnasium environments as systems, with their monitors and cases."""

from __future__ import annotations

import inspect
import math
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from numbers import Real
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.judging.judge import Judging
from rtamt_gym.judging.monitor_set import Feed, MonitorSet
from rtamt_gym.options.evaluation import EvaluationOptions, refuse_other
from rtamt_gym.signals.periods import StepTime, read_period
from rtamt_gym.signals.signals import SignalLike, checked_mapping, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES, described
from rtamt_gym.signals.taps import Tap, rescaling, tapped
from rtamt_gym.systems.system import (
    Policy,
    Signals,
    System,
    SystemEnd,
    as_number,
    as_waveform,
    exited,
    like,
    refuse_unknown,
)
from rtamt_gym.wrappers.monitor import monitor_of
from rtamt_gym.wrappers.monitoring import check_pictures
from rtamt_gym.wrappers.substeps import Inside, read_substep_period

_ATTRIBUTE = "env."
"""The prefix of the name of an attribute."""


class Environment(System):
    """A Gymnasium environment and the policy that acts in it.

    If the environment has a monitor, the policy sees the outputs of the wrappers, samples and
    rewards are the values that the monitor reads, and the monitor does not end episodes.

    Attributes:
        reward: The sum of its rewards since the start; None if they are not numbers.
        reported: Its own ``is_success`` in the last info of the episode, or None.
        refuses_nan: Whether it raises an error for a nan, if the monitors do not.
        timed: Whether bounds of specifications depend on its period.
    """

    observation: Any = None
    reward: float | None = None
    reported: bool | None = None
    refuses_nan: bool = False
    timed: bool = False
    below: bool = False
    rescaled: bool = False
    _tap: Tap | None = None
    """The tap at the monitor's environment."""
    _seen: Any = None
    """The tap that signals read; None: they read the environment."""
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
        return {**own_signals(self._env), **of_monitor, **checked_mapping(signals)}

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
    owner, way_out = (
        "the monitor of the environment",
        "leave it out, or give specifications with it",
    )
    if signals is not None and signals != own.signals:
        refuse_other("signals", own.signals, signals, owner, way_out)
    return own.specs, own.signals, reading.over(own.reading, owner, way_out)


class _Attribute(NamedTuple):
    """The value of an attribute during a run: a number, or a MuJoCo model with other constants."""

    name: str
    owner: Any
    field: str
    value: Any


class EnvironmentCase:
    """A case, bound to an environment."""

    def __init__(self, env: gym.Env[Any, Any], case: Case, name: str) -> None:
        self._name = name
        self._simulation: Any = env.unwrapped
        self._space = env.action_space
        self.options: dict[str, float] | None = {}
        self._attributes: list[_Attribute] = []
        self._drives: dict[str, tuple[tuple[int, ...], Waveform]] = {}
        parameters = _parameters(self._simulation)
        self._actions = _action_names(env)
        drivable = listing(self._actions)
        has_model, constants = _has_model(self._simulation), dict[str, float | Waveform]()
        for key, entry in case.items():
            if key in parameters:
                self.options[key] = as_number(key, entry, drivable)
            elif key in self._actions:
                waveform = as_waveform(key, entry)
                _check_fits(key, waveform, self._space, self._actions[key])
                self._drives[key] = self._actions[key], waveform
            elif has_model and _is_of_model(key):
                constants[key] = entry
            elif key.startswith(_ATTRIBUTE) and not parameters:
                self._attributes.append(_attribute(name, key, as_number(key, entry, drivable), env))
            else:
                known = [*self._actions, *parameters]
                if parameters:
                    refuse_unknown(name, key, known)
                more = "numbers of its attributes, such as 'env.gravity'"
                if has_model:
                    more += ", and of its model, such as 'body:torso.mass'"
                own = [f"{_ATTRIBUTE}{key}"] if hasattr(self._simulation, key) else []
                refuse_unknown(name, key, known, more, own)
        self.options = self.options or None
        if constants:
            self._attributes.append(_changed_model(self._simulation, Case(constants), name))

    @contextmanager
    def attributes(self) -> Iterator[None]:
        """Set the attributes inside a context, and restore them afterwards."""
        before: list[tuple[_Attribute, bool, Any]] = []
        try:
            for attribute in self._attributes:
                own = attribute.field in getattr(attribute.owner, "__dict__", {attribute.field})
                before.append((attribute, own, getattr(attribute.owner, attribute.field)))
                try:
                    setattr(attribute.owner, attribute.field, attribute.value)
                except AttributeError as error:
                    before.pop()
                    raise InputError(
                        f"cannot set {attribute.name!r} of {self._name}: {error}"
                    ) from None
            yield
        finally:
            for attribute, own, value in reversed(before):
                if own:
                    setattr(attribute.owner, attribute.field, value)
                else:  # the class had the value
                    delattr(attribute.owner, attribute.field)

    def check(self) -> None:
        """Raise InputError if the reset has changed an attribute or a parameter."""
        for attribute in self._attributes:
            now = getattr(attribute.owner, attribute.field)
            if now != attribute.value:
                raise InputError(
                    f"{attribute.name!r} of the case is {attribute.value!r}, but the reset of "
                    f"{self._name} sets it to {now!r}: it cannot be chosen"
                )
        parameters = _parameters(self._simulation)
        for name, value in (self.options or {}).items():
            if parameters.get(name) != value:
                raise InputError(
                    f"{name!r} of the case is {value:g}, but after the reset of {self._name} with "
                    f"this option it is {parameters.get(name)!r}"
                )

    def policy(self, policy: Policy | None, baseline: Policy | None, period: Fraction) -> Policy:
        """Return the policy that drives the actions of the case and calls another for the rest."""
        drives = [(element, wave.stepper(period)) for element, wave in self._drives.values()]
        driven = {element for element, _ in drives}
        left = [name for name, element in self._actions.items() if element not in driven]
        if not left:
            if policy is not None:
                raise InputError(
                    f"the case drives all actions of {self._name}, {listing(self._drives)}, and "
                    "leaves no action to the policy; remove the policy, or an action from the case"
                )
            others: Policy | None = None
        else:
            others = policy or baseline
            if others is None:
                raise InputError(
                    f"the case drives {listing(self._drives)} of {self._name}, and nothing drives "
                    f"{listing(left)}; add them to the case, or give ",
                    Argument("policy"),
                    " for them",
                )
        space, step = self._space, 0

        def act(obs: Any) -> Any:  # noqa: ANN401
            nonlocal step
            action: Any = np.zeros(space.shape or (), space.dtype)
            if others is not None:
                action[...] = others(obs)
            for element, value in drives:
                action[element] = value(step)
            step += 1
            return int(action) if isinstance(space, spaces.Discrete) else action

        return act

    @property
    def drives(self) -> bool:
        """Whether the case drives an action."""
        return bool(self._drives)


def baseline_of(env: gym.Env[Any, Any]) -> Policy | None:
    """Return the environment's own policy, its attribute ``baseline``.

    None without one, or if a wrapper changes the actions.
    """
    simulation: Any = env.unwrapped
    baseline = getattr(simulation, "baseline", None)
    if not callable(baseline) or env.action_space != simulation.action_space:
        return None
    policy: Policy = baseline
    return policy


def _parameters(simulation: Any) -> Mapping[str, Any]:  # noqa: ANN401
    """Return the parameters of a scenario by name; empty for other environments."""
    parameters = getattr(simulation, "parameters", None)
    if isinstance(parameters, Mapping) and hasattr(simulation, "action_names"):
        return parameters
    return {}


def _action_names(env: gym.Env[Any, Any]) -> dict[str, tuple[int, ...]]:
    """Return the indices of action components by name; empty if actions are not numeric arrays."""
    space = env.action_space
    if not isinstance(
        space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    ):
        return {}
    shape = space.shape or ()
    names = getattr(env.unwrapped, "action_names", None)
    if isinstance(names, Sequence) and shape == (len(names),):
        return {str(name): (i,) for i, name in enumerate(names)}
    places = list(np.ndindex(shape))
    return {"action" + "".join(f"[{i}]" for i in element): element for element in places}


def _check_fits(
    name: str, waveform: Waveform, space: spaces.Space[Any], element: tuple[int, ...]
) -> None:
    """Raise InputError if a waveform leaves the range of its action component."""
    low, high = min(waveform.values), max(waveform.values)
    if isinstance(space, spaces.Box):
        # In the type of the action: a bound of 0.1 in float32 is not 0.1.
        smallest, largest = space.dtype.type(low), space.dtype.type(high)
        bounds = space.low[element], space.high[element]
    else:
        integral = all(value.is_integer() for value in waveform.values)
        if not integral or waveform.interpolation != "hold":
            raise InputError(
                f"expected {name!r} of the case as whole numbers with interpolation='hold', for "
                f"the actions {described(space)}, got {waveform!r}"
            )
        smallest, largest = low, high
        bounds = _whole_bounds(space, element)
    if smallest < bounds[0] or largest > bounds[1]:
        got = f"{low:g}" if low == high else f"values from {low:g} to {high:g}"
        raise InputError(
            f"expected {name!r} of the case from {bounds[0]:g} to {bounds[1]:g}, the bounds of "
            f"the action, got {got}"
        )


def _whole_bounds(space: Any, element: tuple[int, ...]) -> tuple[int, int]:  # noqa: ANN401
    match space:
        case spaces.Discrete():
            return int(space.start), int(space.start + space.n - 1)
        case spaces.MultiDiscrete():
            start = int(space.start[element])
            return start, start + int(space.nvec[element]) - 1
        case _:
            return 0, 1


def _has_model(simulation: Any) -> bool:  # noqa: ANN401
    """Return whether an environment steps a MuJoCo model, without importing MuJoCo."""
    mujoco = sys.modules.get("mujoco")
    return mujoco is not None and isinstance(getattr(simulation, "model", None), mujoco.MjModel)


def _is_of_model(key: str) -> bool:
    from rtamt_gym.systems.mujoco import is_of_model

    return is_of_model(key)


def _changed_model(simulation: Any, case: Case, name: str) -> _Attribute:  # noqa: ANN401
    from rtamt_gym.systems.mujoco import changed

    return _Attribute(listing(case), simulation, "model", changed(simulation.model, case, name))


def _attribute(system: str, name: str, number: float, env: gym.Env[Any, Any]) -> _Attribute:
    """Return the attribute of the simulation with a dotted name."""
    owner: Any = None
    value: Any = env.unwrapped
    path, field = "env", ""
    for field in name.removeprefix(_ATTRIBUTE).split("."):
        owner = value
        if not hasattr(owner, field):
            known = [other for other in dir(owner) if not other.startswith("_")]
            meant = nearest(field, known).replace("'", f"'{path}.", 1)
            raise InputError(f"{system} has no {name!r}{meant or _numbers_of(owner, path)}")
        value, path = getattr(owner, field), f"{path}.{field}"
    if not isinstance(value, Real):
        raise InputError(
            f"expected a number as {name!r} of {system}, which a case can set, got "
            f"{type(value).__name__} {value!r}"
        )
    return _Attribute(name, owner, field, like(value, name, number))


def _numbers_of(owner: Any, path: str) -> str:  # noqa: ANN401
    """Return the numeric attributes of the object at a dotted path, for a message."""
    named = []
    for field in dir(owner):
        value = inspect.getattr_static(owner, field, None)  # without calling properties
        if (
            isinstance(value, int | float)
            and not isinstance(value, bool)
            and not field.startswith("_")
        ):
            named.append(f"{path}.{field}")
    return f"; its numbers are {listing(named)}" if named else ""
