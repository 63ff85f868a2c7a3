"""The systems that `simulate` can run: their protocol, and those that need no simulator."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from numbers import Integral
from typing import Any, Literal, NoReturn, Protocol, runtime_checkable

from rtamt import InputError, InputTypeError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.signals.signals import SignalLike

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


def exited(what: str, end: SystemExit, where: str = "") -> InputError:
    """The error of what calls ``sys.exit``: it would end the program without a verdict.

    Args:
        what: What calls it, in words.
        end: What it has raised.
        where: Its place in a file, as `line_in` writes it.
    """
    code = "" if end.code is None else repr(end.code)
    return InputError(
        f"{what} called sys.exit({code}){where}, which is no end of a simulation; let it return, "
        "or raise an error"
    )


class no_exit:  # noqa: N801 - a context, used as a word
    """Raises the error of `exited` where what runs inside calls ``sys.exit``.

    Other errors are not touched, not even their tracebacks, as some take no attributes.

    Args:
        what: What runs.

    Raises:
        InputError: If it does.
    """

    def __init__(self, what: str) -> None:
        self._what = what

    def __enter__(self) -> None:
        """Nothing is to be done before."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, SystemExit):
            raise exited(self._what, error) from error


def as_number(name: str, entry: float | Waveform, drivable: str = "") -> float:
    """The number of an entry.

    Args:
        name: The name of the entry.
        entry: The entry.
        drivable: What waveforms drive, for the message.

    Raises:
        InputError: If it is a waveform.
    """
    if isinstance(entry, Waveform):
        raise InputError(
            f"expected {name!r} of the case as a number, which does not change during a run, got a "
            f"waveform{drivable and f'; waveforms drive {drivable}'}"
        )
    return entry


def as_waveform(name: str, entry: float | Waveform) -> Waveform:
    """The waveform of an entry; a number is one that stays.

    Raises:
        InputError: If it is an infinite number.
    """
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
    """Refuses an entry that a system has nothing of, and names the nearest.

    Args:
        system: The name of the system.
        name: The name of the entry.
        known: The names that it takes.
        more: What else it takes, for the message.
        meant: What the name stands for most likely, if that is known.
    """
    names = list(known)
    takes = " and ".join(filter(None, [listing(names) if names else "", more])) or "none"
    meaning = "".join(f"; did you mean {each!r}?" for each in meant) or nearest(name, names)
    raise InputError(f"{system} takes no {name!r} of a case; it takes {takes}{meaning}")


def like(present: object, name: str, number: float) -> float:
    """A number in the type of the present value: a whole number or a truth value where that is one.

    Raises:
        InputError: If it is no such number.
    """
    if not isinstance(present, bool | Integral):
        return number
    if not number.is_integer():
        raise InputError(
            f"expected {name!r} of the case as a whole number, as {present!r}, got {number!r}"
        )
    if isinstance(present, bool):
        return bool(number)
    return int(number)
