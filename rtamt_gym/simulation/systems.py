"""The systems that `simulate` can run: their protocol, and those that need no simulator."""

from __future__ import annotations

import inspect
import itertools
import math
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from fractions import Fraction
from inspect import isgeneratorfunction
from typing import Any, Literal, Protocol, runtime_checkable

import gymnasium as gym

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.feeding import Feed
from rtamt_gym.judging.panel import Panel
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import SignalLike, own_signals, parse_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.signals.step_time import StepTime
from rtamt_gym.signals.taps import Tap, rescaling, tapped
from rtamt_gym.simulation.crashes import exited
from rtamt_gym.simulation.entries import refuse_unknown
from rtamt_gym.simulation.environment_case import EnvironmentCase, baseline_of
from rtamt_gym.simulation.monitors import monitor_of
from rtamt_gym.wrappers.substeps import Inside, read_substep_period

__all__ = [
    "Drivable",
    "Environment",
    "Policy",
    "Sample",
    "SampleSource",
    "Signals",
    "System",
    "SystemEnd",
    "named_signals",
    "whole_steps",
]

Policy = Callable[..., Any]
"""Gives the action for an observation of an environment; for a MuJoCo model, a function of model
and data that sets ``data.ctrl``, as ``mjcb_control`` does."""

Sample = Mapping[str, Any]
"""Numbers by name."""

Signals = Mapping[str, SignalLike] | None
"""What variables read, and what else is recorded, by name."""

SystemEnd = Literal["", "terminated", "truncated"]
"""How a system has ended by itself: not yet, for good, or by a time limit of its own."""


@runtime_checkable
class System(Protocol):
    """A simulation that gives samples, one period apart.

    Attributes:
        name: Its name in tables and pictures.
        period: Its own time between samples in seconds, or None.
        needs_period: Whether it cannot run without a period; a text says why it has none itself,
            "suggest steps of 0.1 and 0.2 s".
        limit: The number of steps after which it ends by itself; None if that is not known.
        endless: Whether it may go on for ever.
        ended: How it has ended by itself; an empty string while it has not.
    """

    name: str
    period: float | None = None
    needs_period: bool | str = False
    limit: int | None = None
    endless: bool = False
    ended: SystemEnd = ""

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Prepares to read the variables, and then the signals that are not variables.

        Raises:
            RtamtError: If a variable cannot be read, or the system cannot run with this period.
        """

    def start(self) -> Sequence[float]:
        """Starts the simulation; returns sample 0, the values before the first step."""

    def advance(self) -> Sequence[float] | None:
        """Makes one step; returns the sample after it, or None if the system ended before."""

    def close(self) -> None:
        """Releases what `start` has taken; called after an error too."""


@runtime_checkable
class Drivable(Protocol):
    """A system that takes a case."""

    def driven(self, case: Case) -> System:
        """The system with what a case gives it, for one run; this one stays as it is.

        Raises:
            RtamtError: If it has nothing of a name, or an entry does not fit.
        """


class Environment(System):
    """A Gymnasium environment and the policy that acts in it.

    In an environment that has a monitor the policy sees what the wrappers show, and the samples and
    the rewards are those that the monitor reads; it ends no episode meanwhile.

    Attributes:
        observation: What it has shown last, on which the policy acts next.
        reward: The sum of its rewards since the start; None if they are no numbers.
        reported: Its own ``is_success`` in the info that ended the episode; None without one.
        refuses_nan: Whether it refuses signals that are nan, as the monitors do not.
        timed: Whether bounds of specifications hang on its period.
        below: As for `rtamt_gym.judging.reading.Reading`.
        rescaled: As for `rtamt_gym.judging.reading.Reading`.
    """

    observation: Any = None
    reward: float | None = None
    reported: bool | None = None
    refuses_nan: bool = False
    timed: bool = False
    below: bool = False
    rescaled: bool = False
    _tap: Tap | None = None
    """Below the monitor."""
    _seen: Any = None
    """What has shown the samples that are read; None: the environment."""
    _watch: StepTime | None = None

    def __init__(
        self,
        env: gym.Env[Any, Any],
        policy: Policy | None,
        seed: int | None,
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
        self._seed = seed
        self._case = case
        self._ends: ExitStack | None = None  # from a start on that changes something

    def driven(self, case: Case) -> Environment:
        """The environment with a case: options, attributes, and waveforms for its actions."""
        bound = EnvironmentCase(self._env, case, self.name)
        with bound.attributes():  # one of them may be the period
            made = Environment(
                self._env, self._policy, self._seed, substeps=self._substeps, case=bound
            )
        made.refuses_nan, made.timed = self.refuses_nan, self.timed
        made.below, made.rescaled = self.below, self.rescaled
        return made

    def known(self, signals: Signals) -> Mapping[str, SignalLike]:
        """The signals that are given, that the monitor has, and that the environment names."""
        of_monitor = {} if self._monitor is None else self._monitor.judging.signals or {}
        return {**own_signals(self._env), **of_monitor, **(signals or {})}

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Binds the selectors and finds who acts."""
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
        seen = () if self._substeps else parsed  # where no observation is read
        rescaler = rescaling(shown, seen, below=self.below, rescaled=self.rescaled)
        self._rescaler = rescaler
        if rescaler is not None:
            shown = rescaler.env
        self._reads_at_reset = [signal.bind_reset(shown) for signal in parsed]
        if self._substeps:
            self._inside = Inside(self._env, parsed)
        else:
            self.reads = [signal.bind(shown) for signal in parsed]

    def again(self, policy: Policy | None, seed: int | None) -> Environment:
        """The environment for another run, with the signals that are bound."""
        made = object.__new__(Environment)  # copy.copy() would take ten times as long
        made.__dict__.update(self.__dict__, _policy=policy, _seed=seed)
        return made

    @property
    def plain(self) -> bool:
        """Whether a step of the environment is one sample, which it shows itself."""
        return not self._substeps and self._monitor is None and self._rescaler is None

    def play(self, panel: Panel, feed: Feed, most: float) -> None:
        """Makes steps, each of which feeds a sample, until the system ends or a verdict is decided.

        Args:
            panel: The monitors.
            feed: Feeds them with a step.
            most: The greatest number of steps.
        """
        act, step, obs, watch = self._act, self._env.step, self.observation, self._watch
        settled, steps = panel.settled, 0
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
            if panel.settled != settled:
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
        """Resets an environment with a monitor, a case or what rescales; undone by ``ends``."""
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
        """Steps the environment; its samples, one or with ``substeps`` several, are the rest."""
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
        """Who acts in an episode that begins now: the case, the policy or the baseline."""
        if self._case is not None and self._case.drives:
            return self._case.policy(self._policy, baseline_of(self._env), self._step_period)
        policy = self._policy
        if policy is None:  # one that is a collection may be empty
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
        """Leaves the environment open, for it belongs to the caller, with its own attributes."""
        if self._ends is not None:
            self._ends.close()


def _reported(info: Mapping[str, Any]) -> bool | None:
    """The environment's own ``is_success`` in a last info; None if it has none."""
    own = info.get("is_success")
    return None if own is None else bool(own)


class SampleSource(System):
    """A function of time, a generator function, or an iterable that gives samples."""

    def __init__(
        self,
        source: Callable[[float], Sample | None]
        | Callable[[], Iterator[Sample]]
        | Iterable[Sample],
        case: Mapping[str, Any] | None = None,
    ) -> None:
        self.needs_period = self.endless = callable(source) and not isgeneratorfunction(source)
        name = getattr(source, "__name__", "function").replace("<lambda>", "function")
        self.name = name if callable(source) else "samples"
        self._source: Any = source
        self._case = case or {}
        self._samples: Iterator[Sample | None] = iter(())
        self._count = 0

    def driven(self, case: Case) -> System:
        """The function with the entries of a case as keyword arguments."""
        if not callable(self._source):
            raise InputError(
                "samples that are there already take no case; give a generator function, whose "
                f"keyword arguments are the names {listing(case)}"
            )
        known, open_ = _keywords(self._source, 1 if self.endless else 0)
        for name in case:
            if name not in known and not open_:
                refuse_unknown(self.name, name, known, "" if known else "no keyword arguments")
        return SampleSource(self._source, case)

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        self._reads = named_signals(variables, signals)
        self._period = period

    def start(self) -> list[float]:
        self.ended = ""
        source = self._source
        if self.endless:
            period = self._period or Fraction(1)
            self._samples = (source(float(i * period), **self._case) for i in itertools.count())
        else:
            self._samples = iter(source(**self._case) if callable(source) else source)
        self._count = 0
        first = self.advance()
        if first is None:
            raise InputError(f"expected one sample at least, {self.name} has given none")
        return first

    def advance(self) -> list[float] | None:
        sample = next(self._samples, None)
        if sample is None:
            self.ended = "terminated"
            return None
        if not isinstance(sample, Mapping):
            raise InputTypeError(
                f"expected a mapping of names to numbers as sample {self._count} of {self.name}, "
                f"got {sample!r}"
            )
        try:
            values = [sample[name] for name in self._reads]
        except KeyError:
            missing = next(name for name in self._reads if name not in sample)
            raise InputError(
                f"sample {self._count} of {self.name} has no {missing!r}; "
                f"it has {listing(sample)}{nearest(missing, sample)}"
            ) from None
        self._count += 1
        return values

    def close(self) -> None:
        """Closes a generator, which may hold open files."""
        if isinstance(self._samples, Generator):
            self._samples.close()


def _keywords(function: Callable[..., object], skip: int) -> tuple[list[str], bool]:
    """The keyword arguments that a function takes, and whether it takes any name.

    Args:
        function: The function.
        skip: How many arguments it is given by their place.
    """
    try:
        parameters = [*inspect.signature(function).parameters.values()]
    except ValueError:  # as of some functions that are not written in Python
        return [], True
    named = [
        each.name
        for each in parameters[skip:]
        if each.kind in {each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY}
    ]
    return named, any(each.kind is each.VAR_KEYWORD for each in parameters)


def named_signals(variables: Sequence[str], signals: Mapping[str, Any] | None) -> list[str]:
    """The names to read from a system whose values have names.

    Args:
        variables: The variables of the specifications; each reads the value of its own name unless
            ``signals`` gives another.
        signals: Names that variables read, and names of further values to record.

    Returns:
        A name for every variable, then for every signal that is not a variable.

    Raises:
        InputError: If a signal has nearly the name of a variable that has no signal.
        InputTypeError: If ``signals`` is not a mapping from names to names.
    """
    given = {} if signals is None else signals
    if not isinstance(given, Mapping):
        raise InputTypeError(
            f'expected a mapping such as signals={{"x": "its name"}}, got {signals!r}'
        )
    for name, read in given.items():
        silent = [variable for variable in variables if variable not in given]
        if name not in variables and (meant := nearest(name, silent)):
            raise InputError(
                f"signal {name!r} is read by no specification; the variables are "
                f"{listing(variables)}{meant}"
            )
        if not isinstance(read, str):
            raise InputTypeError(f"signal {name!r}: expected a name, got {read!r}")
    return [given.get(name, name) for name in dict.fromkeys([*variables, *given])]


_ROUNDING = Fraction(1, 10**11)
"""How far, of its own size, a period is rounded at most where it becomes a fraction."""


def whole_steps(whole: Fraction, step: Fraction, what: str, of: str) -> int:
    """The number of steps in a whole, both in seconds, one of them rounded perhaps.

    Raises:
        InputError: If the whole is not a multiple of the step. The message calls the whole
            ``what`` and the step ``of``, and names the nearest multiples.
    """
    count = whole / step
    near = round(count)
    if abs(count - near) > near * _ROUNDING:
        less, more = math.floor(count) * step, math.ceil(count) * step
        ways = f"{float(less):g} s or {float(more):g} s" if less else f"{float(more):g} s"
        raise InputError(
            f"the {what} {float(whole):g} s is not a multiple of the {of} {float(step):g} s "
            f"({float(count):g} steps); use {ways}"
        )
    return near
