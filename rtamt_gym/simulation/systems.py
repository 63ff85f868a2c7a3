"""What `simulate` can run: environments, MuJoCo models, Python functions, all as one protocol."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from inspect import isgeneratorfunction
from typing import Any, Literal, Protocol, runtime_checkable

import gymnasium as gym

from rtamt import InputError, InputTypeError
from rtamt_gym.checks.names import listing, nearest
from rtamt_gym.judges.specs import read_period
from rtamt_gym.signals.signals import SignalLike, parse_signals

__all__ = [
    "Environment",
    "Policy",
    "Sample",
    "SampleSource",
    "System",
    "SystemEnd",
    "named_signals",
]

Policy = Callable[..., Any]
"""Of an environment, the action for an observation; of a MuJoCo model, a function of model and data
that sets ``data.ctrl``, as ``mjcb_control`` does."""

Sample = Mapping[str, Any]
"""Numbers by name."""

SystemEnd = Literal["", "terminated", "truncated"]
"""Not yet; for good; by a time limit of its own."""


@runtime_checkable
class System(Protocol):
    """A simulation that gives samples, one period apart.

    Attributes:
        name: What tables and pictures call it.
        period: Seconds between samples, as the system itself says; None: it does not say.
        needs_period: Whether it cannot run without one.
        limit: Steps after which it ends by itself; None: not known.
        endless: Whether it may go on for ever.
        ended: How it has ended by itself; an empty string while it has not.
    """

    name: str
    period: float | None
    needs_period: bool
    limit: int | None
    endless: bool
    ended: SystemEnd

    def bind(
        self,
        variables: Sequence[str],
        signals: Mapping[str, SignalLike] | None,
        period: Fraction | None,
    ) -> None:
        """Finds out how the variables are read, and the signals that are none, to be recorded.

        Raises:
            RtamtError: If a variable cannot be read, or the system cannot run with this period.
        """

    def start(self) -> Sequence[float]:
        """Sample 0: the variables before the first step, then the signals that are none."""

    def advance(self) -> Sequence[float] | None:
        """The sample after one more step; None if there is none, for the system has ended."""

    def close(self) -> None:
        """Gives back what `start` has taken; also after an error."""


class Environment:
    """A Gymnasium environment and who acts in it."""

    needs_period = False
    endless = False

    def __init__(self, env: gym.Env[Any, Any], policy: Policy | None, seed: int | None) -> None:
        if policy is None:
            raise InputError(
                "an environment needs a policy, a function from observation to action; "
                "policy=lambda obs: env.action_space.sample() acts at random"
            )
        if not callable(policy):
            way_out = "lambda obs: model.predict(obs)[0]" if hasattr(policy, "predict") else ""
            raise InputTypeError(
                f"expected a policy, a function from observation to action, got {policy!r}; "
                f"write policy={way_out or f'lambda obs: {policy!r}'}"
            )
        self.name = env.spec.id if env.spec else type(env.unwrapped).__name__
        self.period = read_period(env)
        self.limit = env.spec.max_episode_steps if env.spec else None
        self.ended: SystemEnd = ""
        self._env = env
        self._policy = policy
        self._seed = seed
        self._obs: Any = None

    def bind(
        self,
        variables: Sequence[str],
        signals: Mapping[str, SignalLike] | None,
        period: Fraction | None,  # noqa: ARG002 - an environment steps as it does
    ) -> None:
        """Binds the selectors."""
        parsed = parse_signals(signals or {}, variables, spare=True)
        self._reads_at_reset = [signal.bind_reset(self._env) for signal in parsed]
        self._reads = [signal.bind(self._env) for signal in parsed]

    def start(self) -> list[float]:
        """Resets the environment."""
        self.ended = ""
        self._obs, info = self._env.reset(seed=self._seed)
        return [read(self._obs, None, None, info) for read in self._reads_at_reset]

    def advance(self) -> list[float]:
        """Steps the environment."""
        action = self._policy(self._obs)
        self._obs, reward, terminated, truncated, info = self._env.step(action)
        if terminated or truncated:
            self.ended = "terminated" if terminated else "truncated"
        return [read(self._obs, action, reward, info) for read in self._reads]

    def close(self) -> None:
        """The environment is the caller's."""


class SampleSource:
    """Samples from a function of time, from a generator function, or from an iterable."""

    def __init__(
        self,
        source: Callable[[float], Sample | None]
        | Callable[[], Iterator[Sample]]
        | Iterable[Sample],
    ) -> None:
        self.period: float | None = None
        self.limit: int | None = None
        self.needs_period = self.endless = callable(source) and not isgeneratorfunction(source)
        self.ended: SystemEnd = ""
        name = getattr(source, "__name__", "function").replace("<lambda>", "function")
        self.name = name if callable(source) else "samples"
        self._source: Any = source
        self._samples: Iterator[Sample | None] = iter(())
        self._count = 0

    def bind(
        self,
        variables: Sequence[str],
        signals: Mapping[str, SignalLike] | None,
        period: Fraction | None,
    ) -> None:
        """Notes which names are read."""
        self._reads = named_signals(variables, signals)
        self._period = period

    def start(self) -> list[float]:
        """The first sample."""
        self.ended = ""
        source = self._source
        if self.endless:
            period = self._period or Fraction(1)
            self._samples = (source(float(i * period)) for i in itertools.count())
        else:
            self._samples = iter(source() if callable(source) else source)
        self._count = 0
        first = self.advance()
        if first is None:
            raise InputError(f"expected one sample at least, {self.name} has given none")
        return first

    def advance(self) -> list[float] | None:
        """The next sample."""
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
        """Closes a generator, which may hold files."""
        if isinstance(self._samples, Generator):
            self._samples.close()


def named_signals(variables: Sequence[str], signals: Mapping[str, Any] | None) -> list[str]:
    """What is read where values have names: every variable its own, if nothing else is said.

    Args:
        variables: Names that the specifications read.
        signals: For some of them another name; and what else to record.

    Returns:
        A name for every variable, then for every signal that is none.

    Raises:
        InputError: If a signal might be meant for a variable that has none.
        InputTypeError: If ``signals`` is no mapping of names to names.
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
