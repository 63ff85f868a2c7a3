"""The samples that a caller hands in, read as floats: argument forms, checks and error texts.

Both back-ends use the reader: the machines in Python for every sample, those in C++ for the
argument forms that they do not read themselves and for every error.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Literal, NoReturn, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import (
    Advice,
    Argument,
    InputError,
    InputTypeError,
    Message,
    brief,
    is_one_of,
    name_text,
    nearest,
)
from rtamt.inputs.arrays import Floats, array_of_numbers, kind_of, line_of_numbers, number
from rtamt.inputs.frames import named_columns
from rtamt.inputs.messages import Field, Messages
from rtamt.program.algebra import FUNCTIONS
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.program import Program

__all__ = [
    "Columns",
    "NanPolicy",
    "SampleReader",
    "listed",
    "refuse_term",
    "unknown_variable",
    "wrong_shape",
]

NanPolicy = Literal["raise", "hold"]
Columns = Mapping[str, object] | ArrayLike
"""Values of every variable, or messages, by name; or an array with a column for each variable."""


class SampleReader:
    """Reads samples and blocks of samples of a program's variables.

    Args:
        program: Its variables are read; its terms are named in errors.
        nan: ``"raise"`` refuses a nan; ``"hold"`` keeps the variable's last value.
        lane: The number of the signal among many, for errors.

    Raises:
        InputError: On another policy for nan.
    """

    __slots__ = ("_known", "_messages", "_where", "nan", "program", "variables")

    def __init__(self, program: Program, nan: NanPolicy = "raise", lane: int | None = None) -> None:
        if not is_one_of(nan, ("raise", "hold")):
            raise InputError(f"expected nan='raise' or nan='hold', got {brief(nan)}")
        self.program = program
        self.variables = program.variables
        self.nan = nan
        self._known = frozenset(program.variables)
        self._messages = Messages(program.specification, program.variables)
        self._where = "" if lane is None else f" of lane {lane}"

    def read(
        self,
        args: Sequence[object],
        named: Mapping[str, object],
        sample: int,
        previous: Sequence[float],
    ) -> list[float]:
        """The sample that ``update(*args, **named)`` means, in the order of the variables.

        Raises:
            InputError: On missing or unknown variables, a wrong count, a wrong shape, a nan.
            InputTypeError: On a value that is not a real number.
        """
        if len(args) == len(self.variables) and not named:
            for value in args:  # the most frequent form by far: floats in order
                if type(value) is not float or value != value:  # noqa: PLR0124 - nan
                    break
            else:
                return cast("list[float]", list(args))
        if args and named:
            raise InputError("expected values by position or by keyword, got both")
        if not args:
            values: Iterable[object] = self._by_name(named, sample, previous)
        elif len(args) == 1 and (isinstance(args[0], Mapping) or hasattr(args[0], "keys")):
            values = self._by_name(cast("Mapping[str, object]", args[0]), sample, previous)
        elif len(args) == 1 and isinstance(args[0], list | tuple | np.ndarray):
            values = self._row(args[0])
        else:
            values = args
        counted = list(values)
        if len(counted) != len(self.variables):
            raise InputError(
                f"expected {_count(self.variables)} ({', '.join(self.variables)}), "
                f"got {len(counted)}"
            )
        return self._floats(counted, sample, previous)

    def _floats(
        self, values: Sequence[object], sample: int, previous: Sequence[float]
    ) -> list[float]:
        floats = []
        for name, value in zip(self.variables, values, strict=True):
            read = number(value)
            if read is None:
                raise InputTypeError(
                    f"expected a number for '{name}' at sample {sample}, got {kind_of(value)}"
                )
            floats.append(read)
        for i, value in enumerate(floats):
            if value != value:  # noqa: PLR0124 - nan
                if self.nan != "hold" or not previous:
                    self.refuse_nan(self.variables[i], sample)
                floats[i] = previous[i]
        return floats

    def _by_name(
        self, named: Mapping[str, object], sample: int, previous: Sequence[float]
    ) -> Iterable[object]:
        if not isinstance(named, Mapping):  # a row of a data frame, which iterates over its values
            named = {name: named[name] for name in named.keys()}  # noqa: SIM118
        if named.keys() != self._known:
            if self._messages.names:
                named = self._messages.spread(named, lambda field, m: field.of(m, sample))
            if named.keys() != self._known:
                named = {**self._unsaid(named.keys(), previous), **named}
            if named.keys() != self._known:
                self._refuse_names(named)
        return [named[name] for name in self.variables]

    def _unsaid(self, names: AbstractSet[str], previous: Sequence[float]) -> dict[str, float]:
        """The variables with a default that are absent: they are as before, at first the default.

        Args:
            names: Those that have a value.
            previous: The sample before; empty if there is none.
        """
        held = dict(zip(self.variables, previous, strict=True)) if len(previous) else {}
        defaults = self.program.specification.defaults
        return {v: held.get(v, defaults[v]) for v in self.variables if v in defaults.keys() - names}

    def _refuse_names(self, named: Mapping[str, object]) -> NoReturn:
        for name in named:
            if name not in self._known:
                raise unknown_variable(name, self.variables, self._messages)
        missing = next(name for name in self.variables if name not in named)
        known = listed(self.variables)
        raise InputError(f"expected a value for every variable, got none for '{missing}'{known}")

    def _row(self, values: Sequence[object] | NDArray[np.generic]) -> Iterable[object]:
        if isinstance(values, np.ndarray):
            if values.ndim != 1 and values.shape != ():
                raise InputError(
                    f"expected a 1-D array of {_count(self.variables)}, "
                    f"got shape {values.shape}; update_many takes blocks"
                )
            return cast("list[object]", np.atleast_1d(values).tolist())
        return values

    def refuse_nan(self, name: str, sample: int) -> NoReturn:
        """Raise the error that names a variable which is nan at a sample."""
        hint = Message(
            "; ", Argument("nan", "hold"), " keeps the last value, and the first sample has none"
        )
        if self.nan == "raise":
            hint = Advice("; pass ", Argument("nan", "hold"), " to keep the last value instead")
        raise InputError(f"variable '{name}' is nan at sample {sample}{self._where}", hint)

    def block(
        self,
        data: Columns,
        sample: int,
        previous: Sequence[float],
        *,
        n: int | None = None,
        extra: bool = False,
    ) -> tuple[list[Floats], int]:
        """The columns of a block of samples, in the order of the variables, and their length.

        Args:
            data: A mapping (or data frame) of names to 1-D arrays, or an array of shape
                (n, variables).
            sample: Number of the block's first sample, for errors.
            previous: The sample before the block, for ``nan="hold"``; empty if there is none.
            n: The length, for a program without variables.
            extra: Whether unknown names are ignored.

        Raises:
            InputError: On missing or unknown variables, columns of different length, a nan.
            InputTypeError: On values that are not real numbers.
        """
        columns, length = self.columns(data, sample, previous, n=n, extra=extra)
        return self.without_nan(columns, sample, previous), length

    def columns(
        self,
        data: Columns,
        sample: int = 0,
        previous: Sequence[float] = (),
        *,
        n: int | None = None,
        extra: bool = False,
    ) -> tuple[list[Floats], int]:
        """What `block` returns, with every nan still in it."""
        data = cast("Columns", named_columns(data))
        if isinstance(data, Mapping) or hasattr(data, "keys"):
            named = cast("Mapping[str, object]", data)
            names: AbstractSet[str] = dict.fromkeys(map(name_text, named.keys())).keys()
            if not self._known <= names and self._messages.names & names:
                named = self._with_fields(named, names, sample)
                names = named.keys()
            held = self._unsaid(names, previous)
            if not self._known <= names | held.keys() or not (extra or names <= self._known):
                named_ones = names & self._known if extra else names
                self._refuse_names(dict.fromkeys(named_ones | held.keys()))
            given = {v: line_of_numbers(named[v], f"'{v}'") for v in self.variables if v in names}
        else:
            table = array_of_numbers(data, "the block")
            if table.ndim != 2 or table.shape[1] != len(self.variables):
                raise wrong_shape(table, "n", self.variables)
            given = dict(zip(self.variables, map(np.ascontiguousarray, table.T), strict=True))
            held, n = {}, table.shape[0]
        if n is not None and not _is_count(n):
            raise InputError(f"expected a whole number of samples as n, got {brief(n)}")
        lengths = {len(c) for c in given.values()} | (set() if n is None else {n})
        if len(lengths) > 1:
            got = ", ".join(f"{v}: {len(c)}" for v, c in given.items())
            asked = "" if n is None else f" and n={n}"
            raise InputError(f"expected columns of one length, got {got}{asked}")
        if not lengths:
            what = "every variable has its default" if held else "the formula has no variables"
            raise InputError(f"{what}: say how many samples with n=")
        length = lengths.pop()
        made = {v: np.full(length, value) for v, value in held.items()} | given
        return [made[v] for v in self.variables], length

    def without_nan(
        self, columns: Sequence[Floats], sample: int = 0, previous: Sequence[float] = ()
    ) -> list[Floats]:
        """The columns with the last value in place of each nan, or the error that refuses it."""
        return [
            self._without_nan(column, name, sample, previous[i : i + 1])
            for i, (name, column) in enumerate(zip(self.variables, columns, strict=True))
        ]

    def _with_fields(
        self, named: Mapping[str, object], names: AbstractSet[str], sample: int
    ) -> Mapping[str, object]:
        """The columns, with those of the fields in place of those of their messages."""

        def column(field: Field, messages: object) -> object:
            if isinstance(messages, Mapping):  # a message of columns
                return field.column(messages, sample)
            several = isinstance(messages, Iterable) and not isinstance(messages, str | bytes)
            if not several or getattr(messages, "ndim", 1) == 0:
                got = kind_of(messages)
                raise InputTypeError(
                    f"expected a message for every sample as '{field.message}', got {got}"
                )
            each = enumerate(cast("Iterable[object]", messages))
            return [field.of(message, sample + i) for i, message in each]

        columns = {name: named[name] for name in names}
        for name in self._messages.names & names:
            messages = columns[name]
            if isinstance(messages, Iterator):  # each field iterates over it
                columns[name] = list(messages)
        return self._messages.spread(columns, column)

    def _without_nan(
        self, column: Floats, name: str, sample: int, previous: Sequence[float]
    ) -> Floats:
        missing = np.isnan(column)
        if not missing.any():
            return column
        if self.nan != "hold" or (missing[0] and not previous):
            self.refuse_nan(name, sample + int(missing.argmax()))
        held = np.concatenate([previous, column])
        offset = len(previous)
        places = np.where(np.isnan(held), 0, np.arange(len(held)))
        return cast("Floats", held[np.maximum.accumulate(places)][offset:])

    def refuse(self, values: Sequence[float], sample: int) -> NoReturn:
        """Raise the error that names the first variable or term which is nan at a sample."""
        for name, value in zip(self.variables, values, strict=True):
            if math.isnan(value):
                self.refuse_nan(name, sample)
        refuse_term(self.program, values, f"sample {sample}{self._where}")


def unknown_variable(name: object, variables: Sequence[str], messages: Messages) -> InputError:
    """The error that refuses a name that is neither a variable nor a message with one."""
    shown = name_text(name)
    near = nearest(shown, (*variables, *sorted(messages.names)))
    return InputError(f"unknown variable '{shown}'{near or listed(variables)}")


def listed(variables: Sequence[str]) -> str:
    """A hint that lists all variables."""
    names = ", ".join(variables)
    return f"; the variables are {names}" if names else "; the formula has no variables"


def refuse_term(program: Program, values: Sequence[float], place: str) -> NoReturn:
    """Raise the error that names the first term which is nan for values of the variables.

    The machine found one. If none is nan any more, another thread has written to the caller's array
    between the machine's look at it and this one.
    """
    registers: list[float] = []
    for instruction in program.instructions[: program.terms]:
        match instruction:
            case Load(variable):
                registers.append(values[program.variables.index(variable)])
            case Const(value):
                registers.append(value)
            case Map(function, args):
                registers.append(FUNCTIONS[function].apply(*(registers[a] for a in args)))
        if math.isnan(registers[-1]):
            source = program.sources[len(registers) - 1]
            where = ", ".join(
                f"{v} = {x!r}"
                for v, x in zip(program.variables, values, strict=True)
                if v in source.variables
            )
            raise InputError(f"'{source}' is not a number at {place}, where {where}")
    raise InputError(
        f"a term was not a number at {place} and is one now: the array was written to while it was "
        "read; copy it, or write to it after the call"
    )


def wrong_shape(
    table: Floats, leading: str, variables: Sequence[str], rows: str = "", hint: str = ""
) -> InputError:
    """The error that refuses a table whose last axis is not one column for each variable."""
    columns = f"a column for each of {', '.join(variables)}" if variables else "no column"
    return InputError(
        f"expected an array of shape ({leading}, {len(variables)}), {rows}{columns}, "
        f"got shape {table.shape}{hint}"
    )


def _count(variables: Sequence[str]) -> str:
    return f"{len(variables)} value{'' if len(variables) == 1 else 's'}"


def _is_count(n: object) -> bool:
    if isinstance(n, bool | np.timedelta64):
        return False
    return isinstance(n, int | np.integer) and 0 <= int(n) <= 2**48
