"""The protocol of systems, and code that their implementations share.

To add a system that takes cases: a method ``driven`` (see `Drivable`), a row of the table of cases
in ``docs/simulations.md``, and a property that compares it with a loop written by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from numbers import Integral
from typing import Any, Literal, NoReturn, Protocol, runtime_checkable

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import exact
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.signals.signals import SignalLike

Policy = Callable[..., Any]
"""Returns the action for an observation of an environment; for a MuJoCo model, a function of model
and data that sets ``data.ctrl``, like ``mjcb_control``."""

Sample = Mapping[str, Any]
"""Numbers by name."""

Signals = Mapping[str, SignalLike] | None
"""The sources of variables and of further recorded signals, by name."""

SystemEnd = Literal["", "terminated", "truncated"]
"""How a system has ended by itself: not yet, finally, or by its own time limit."""


@runtime_checkable
class System(Protocol):
    """A simulation that returns samples, one period apart.

    Attributes:
        name: The name in tables and pictures.
        period: Its own time between samples in seconds, or None.
        needs_period: Whether it cannot run without an explicit period; a text states the reason,
            such as "suggest steps of 0.1 and 0.2 s".
        limit: The number of steps after which it ends by itself; None if it is unknown.
        endless: Whether it may never end.
        ended: How it has ended by itself; an empty string while it has not.
    """

    name: str
    period: float | None = None
    needs_period: bool | str = False
    limit: int | None = None
    endless: bool = False
    ended: SystemEnd = ""

    def bind(self, variables: Sequence[str], signals: Signals, period: Fraction | None) -> None:
        """Prepare to read the variables, then the signals that are not variables.

        Raises:
            RtamtError: If a variable cannot be read, or the system cannot run with this period.
        """

    def start(self) -> Sequence[float]:
        """Start the simulation; return sample 0, the values before the first step."""

    def advance(self) -> Sequence[float] | None:
        """Make one step; return its sample, or None if the system has ended."""

    def close(self) -> None:
        """Release the resources of `start`; also called after an error."""


@runtime_checkable
class Drivable(Protocol):
    """A system that takes a case."""

    def driven(self, case: Case) -> System:
        """Return the system driven by a case, for one run; this one does not change.

        Raises:
            RtamtError: If an entry is unknown or does not fit.
        """


def named_signals(variables: Sequence[str], signals: Mapping[str, Any] | None) -> list[str]:
    """Return the names to read for the variables, then for further signals."""
    chosen = {} if signals is None else signals
    if not isinstance(chosen, Mapping):
        raise InputTypeError(
            f'expected a mapping such as signals={{"x": "its name"}}, got {signals!r}'
        )
    for name, read in chosen.items():
        silent = [variable for variable in variables if variable not in chosen]
        if name not in variables and (meant := nearest(name, silent)):
            raise InputError(
                f"signal {name!r} is read by no specification; the variables are "
                f"{listing(variables)}{meant}"
            )
        if not isinstance(read, str):
            raise InputTypeError(f"signal {name!r}: expected a name, got {read!r}")
    return [chosen.get(name, name) for name in dict.fromkeys([*variables, *chosen])]


_ROUNDING = Fraction(1, 10**11)
"""The maximum relative error of a period as a fraction."""


def whole_steps(duration: Fraction, step: Fraction, name: str, step_name: str) -> int:
    """Return the number of steps in a duration; either argument may be rounded."""
    count = duration / step
    near = round(count)
    if abs(count - near) > near * _ROUNDING:
        less, more = math.floor(count) * step, math.ceil(count) * step
        durations = f"{float(less):g} s or {float(more):g} s" if less else f"{float(more):g} s"
        raise InputError(
            f"the {name} {float(duration):g} s is not a multiple of the {step_name} "
            f"{float(step):g} s "
            f"({float(count):g} steps); use {durations}"
        )
    return near


def step_limit(
    duration: float | None, period: Fraction | None, system: str, *, endless: bool = False
) -> int | None:
    """Return the number of steps of a run of ``duration`` seconds; None without an end.

    Example:
        >>> step_limit(0.3, Fraction(1, 10), "tank"), step_limit(None, None, "tank")
        (3, None)
    """
    if duration is None:
        if endless:
            raise InputError(
                f"{system} does not end by itself; give ",
                Argument("duration"),
                " in seconds, or ",
                Argument("duration", "inf", words="duration=math.inf"),
                " to run until it is stopped",
            )
        return None
    if duration == math.inf:
        return None
    duration = check_number("duration", duration)
    if period is None:
        raise InputError(
            Argument("duration", duration),
            f" can mean {duration:g} s or {duration:g} steps, since {system} does not state the "
            "duration of a step; give ",
            Argument("period"),
            " in seconds, or ",
            Argument("period", 1),
            " if the duration, and every bound, counts steps",
        )
    steps = int(exact(duration) / period)  # a float may lie a little below a number of periods
    if steps == 0:
        number = f"{float(period):g}"
        in_milliseconds = (
            (", or ", Argument("period", f"{number}ms"), f" if a step lasts {number} ms")
            if period >= 1
            else ()
        )
        raise InputError(
            Argument("duration", duration),
            f" is shorter than a step of {number} s, so no step would be evaluated; give at least ",
            Argument("duration", float(period)),
            *in_milliseconds,
        )
    return steps


def exited(caller: str, end: SystemExit, where: str = "") -> InputError:
    """Return the error for a call of ``sys.exit``, which would end the whole program."""
    code = "" if end.code is None else repr(end.code)
    return InputError(
        f"{caller} called sys.exit({code}){where}, which does not end a simulation; return, or "
        "raise an error"
    )


class no_exit:  # noqa: N801 - a context, used as a word
    """A context where ``sys.exit`` raises the error of `exited`; other errors do not change."""

    def __init__(self, caller: str) -> None:
        self._caller = caller

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, SystemExit):
            raise exited(self._caller, error) from error


def as_number(name: str, entry: float | Waveform, drivable: str = "") -> float:
    """Return an entry as a number; ``drivable`` lists the names that waveforms drive."""
    if isinstance(entry, Waveform):
        raise InputError(
            f"expected {name!r} of the case as a number, which does not change during a run, got a "
            f"waveform{drivable and f'; waveforms drive {drivable}'}"
        )
    return entry


def as_waveform(name: str, entry: float | Waveform) -> Waveform:
    """Return an entry as a waveform; a number is a constant one."""
    if isinstance(entry, Waveform):
        return entry
    if not math.isfinite(entry):
        raise InputError(
            f"expected {name!r} of the case as a waveform or a finite number, got {entry!r}"
        )
    return Waveform([0.0], [entry])


def refuse_unknown(
    system: str, name: str, known: Iterable[str], more: str = "", meant: Iterable[str] = ()
) -> NoReturn:
    """Raise InputError for an unknown entry, with the nearest name."""
    names = list(known)
    takes = " and ".join(filter(None, [listing(names) if names else "", more])) or "none"
    meaning = "".join(f"; did you mean {candidate!r}?" for candidate in meant) or nearest(
        name, names
    )
    raise InputError(f"{system} takes no {name!r} of a case; it takes {takes}{meaning}")


def like(present: object, name: str, number: float) -> float:
    """Return a number in the type of the present value: float, int or bool."""
    if not isinstance(present, bool | Integral):
        return number
    if not number.is_integer():
        raise InputError(
            f"expected {name!r} of the case as a whole number, as {present!r}, got {number!r}"
        )
    if isinstance(present, bool):
        return bool(number)
    return int(number)
