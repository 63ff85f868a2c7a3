"""Functions of time, generator functions and iterables of samples as systems."""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from inspect import isgeneratorfunction
from typing import Any

from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.systems.system import Sample, Signals, System, named_signals, refuse_unknown


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
        """Return the function with the entries of a case as keyword arguments."""
        if not callable(self._source):
            raise InputError(
                "a sequence of samples takes no case; give a generator function with the keyword "
                f"arguments {listing(case)}"
            )
        known, open_ = _keywords(self._source, 1 if self.endless else 0)
        for name in case:
            if name not in known and not open_:
                self._refuse_as_time(name)
                refuse_unknown(self.name, name, known, "" if known else "no keyword arguments")
        for name in _required(self._source, 1 if self.endless else 0):
            if name not in case:
                raise InputError(
                    f"{self.name} needs a value of {name!r}: vary it (--vary {name}=1:2, "
                    f"Parameter) or fix it (--set {name}=1, fixed=)"
                )
        return SampleSource(self._source, case)

    def _refuse_as_time(self, name: str) -> None:
        """Raise InputError if a name is the first argument of a function, which is the time."""
        first = [*_keywords(self._source, 0)[0][:1]]
        if self.endless and first == [name]:
            raise InputError(
                f"{self.name} does not yield, so that its first argument, {name!r}, is the time; "
                f"yield samples, or write {self.name}(time, {name}) to return one"
            )

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
            raise InputError(f"expected at least one sample, {self.name} returned none")
        return first

    def advance(self) -> list[float] | None:
        try:
            sample = next(self._samples, None)
        except TypeError as error:
            self._refuse_number(error)
            raise
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

    def _refuse_number(self, error: TypeError) -> None:
        """Raise InputError if a function calls a number of the case as a signal over time."""
        numbers = [name for name, value in self._case.items() if isinstance(value, int | float)]
        if numbers and re.fullmatch("'(float|int)' object is not callable", str(error)):
            raise InputError(
                f"{self.name} calls a number as a function of time; a signal over time needs "
                f"points (--vary {numbers[-1]}=0:1,points=5, Signal)"
            ) from error

    def close(self) -> None:
        """Close a generator, which may hold open files."""
        if isinstance(self._samples, Generator):
            self._samples.close()


def _required(function: Callable[..., object], skip: int) -> list[str]:
    """Return the arguments of a function that have no default, without the first ``skip``."""
    try:
        parameters = [*inspect.signature(function).parameters.values()]
    except ValueError:
        return []
    kinds = {inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY}
    return [
        parameter.name
        for parameter in parameters[skip:]
        if parameter.kind in kinds and parameter.default is parameter.empty
    ]


def _keywords(function: Callable[..., object], skip: int) -> tuple[list[str], bool]:
    """Return the keyword arguments of a function, and whether it takes any name."""
    try:
        parameters = [*inspect.signature(function).parameters.values()]
    except ValueError:  # some functions in C have no signature
        return [], True
    named = [
        parameter.name
        for parameter in parameters[skip:]
        if parameter.kind in {parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY}
    ]
    return named, any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
