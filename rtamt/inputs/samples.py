"""From what a caller hands in to floats: the argument forms, the checks and their messages.

Both back-ends use this reader: the Python machine for every sample, the native one for the forms
that it does not take itself and for every message.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import Literal, NoReturn, SupportsFloat, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError, nearest
from rtamt.inputs.messages import Field, Messages
from rtamt.program.algebra import FUNCTIONS
from rtamt.program.program import Const, Load, Map, Program

__all__ = [
    "Columns",
    "NanPolicy",
    "SampleReader",
    "array_of_numbers",
    "kind_of",
    "listed",
    "refuse_term",
    "unknown_variable",
]

NanPolicy = Literal["raise", "hold"]
Columns = Mapping[str, object] | ArrayLike
"""Values of every variable, or messages, by name; or an array with a column for each."""


class SampleReader:
    """Reads samples and blocks of samples of a program's variables.

    Args:
        program: Says which variables there are and which terms can fail.
        nan: ``"raise"`` refuses a nan; ``"hold"`` keeps the variable's last value.
        lane: Which of many signals it is, for messages.
    """

    __slots__ = ("_known", "_messages", "_where", "nan", "program", "variables")

    def __init__(self, program: Program, nan: NanPolicy = "raise", lane: int | None = None) -> None:
        if nan not in ("raise", "hold"):
            msg = f"expected nan='raise' or nan='hold', got {nan!r}"
            raise InputError(msg)
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
            InputTypeError: On what is no real number.
        """
        if len(args) == len(self.variables) and not named:
            for value in args:  # what comes by far most often: floats in order
                if type(value) is not float or value != value:  # noqa: PLR0124 - nan
                    break
            else:
                return cast("list[float]", list(args))
        if args and named:
            msg = "expected values by position or by keyword, got both"
            raise InputError(msg)
        if not args:
            values: Iterable[object] = self._by_name(named, sample)
        elif len(args) == 1 and (isinstance(args[0], Mapping) or hasattr(args[0], "keys")):
            values = self._by_name(cast("Mapping[str, object]", args[0]), sample)
        elif len(args) == 1 and isinstance(args[0], list | tuple | np.ndarray):
            values = self._row(args[0])
        else:
            values = args
        return self._floats(self._counted(list(values)), sample, previous)

    def _floats(
        self, values: Sequence[object], sample: int, previous: Sequence[float]
    ) -> list[float]:
        floats = [
            self._number(value, name, sample)
            for name, value in zip(self.variables, values, strict=True)
        ]
        for i, value in enumerate(floats):
            if value != value:  # noqa: PLR0124 - nan
                if self.nan != "hold" or not previous:
                    self.refuse_nan(self.variables[i], sample)
                floats[i] = previous[i]
        return floats

    def _by_name(self, named: Mapping[str, object], sample: int) -> Iterable[object]:
        if not isinstance(named, Mapping):  # a row of a data frame, which iterates over its values
            named = {name: named[name] for name in named.keys()}  # noqa: SIM118
        if named.keys() != self._known:
            if self._messages.names:
                named = self._messages.spread(named, lambda field, m: field.of(m, sample))
            if named.keys() != self._known:
                self._refuse_names(named)
        return [named[name] for name in self.variables]

    def _refuse_names(self, named: Mapping[str, object]) -> NoReturn:
        for name in named:
            if name not in self._known:
                raise unknown_variable(name, self.variables, self._messages)
        missing = next(name for name in self.variables if name not in named)
        known = listed(self.variables)
        msg = f"expected a value for every variable, got none for '{missing}'{known}"
        raise InputError(msg)

    def _row(self, values: Sequence[object] | NDArray[np.generic]) -> Iterable[object]:
        if isinstance(values, np.ndarray):
            if values.ndim != 1 and values.shape != ():
                msg = (
                    f"expected a 1-D array of {len(self.variables)} values, "
                    f"got shape {values.shape}; update_many takes blocks"
                )
                raise InputError(msg)
            return cast("list[object]", np.atleast_1d(values).tolist())
        return values

    def _counted(self, values: list[object]) -> list[object]:
        if len(values) != len(self.variables):
            msg = (
                f"expected {len(self.variables)} values ({', '.join(self.variables)}), "
                f"got {len(values)}"
            )
            raise InputError(msg)
        return values

    def _number(self, value: object, name: str, sample: int) -> float:
        if type(value) is float:
            return value
        if isinstance(value, str | bytes | complex | np.complexfloating) or not hasattr(
            value, "__float__"
        ):
            msg = f"expected a number for '{name}' at sample {sample}, got {kind_of(value)}"
            raise InputTypeError(msg)
        try:
            return float(cast("SupportsFloat", value))
        except (TypeError, ValueError, OverflowError):  # an array of several values, for one
            msg = f"expected a number for '{name}' at sample {sample}, got {kind_of(value)}"
            raise InputTypeError(msg) from None

    def refuse_nan(self, name: str, sample: int) -> NoReturn:
        """Raise the error of a variable that is nan at a sample.

        Raises:
            InputError: Naming both.
        """
        hint = "nan='hold' keeps the last value, which the first sample has not"
        if self.nan == "raise":
            hint = "pass nan='hold' to keep the last value instead"
        msg = f"variable '{name}' is nan at sample {sample}{self._where}; {hint}"
        raise InputError(msg)

    def block(
        self,
        data: Columns,
        sample: int,
        previous: Sequence[float],
        *,
        n: int | None = None,
        extra: bool = False,
    ) -> tuple[list[NDArray[np.float64]], int]:
        """The columns of a block of samples, in the order of the variables, and their length.

        Args:
            data: A mapping of names to 1-D arrays (a data frame too), or an (n, variables) array.
            sample: Number of the block's first sample, for messages.
            previous: The sample before the block, for ``nan="hold"``.
            n: The length where there are no variables.
            extra: Whether unknown names are ignored.
        """
        if isinstance(data, Mapping) or hasattr(data, "keys"):
            named = cast("Mapping[str, object]", data)
            names: AbstractSet[str] = dict.fromkeys(map(str, named.keys())).keys()
            if not self._known <= names and self._messages.names & names:
                named = self._with_fields(named, names, sample)
                names = named.keys()
            if not self._known <= names or not (extra or names <= self._known):
                self._refuse_names(dict.fromkeys(names & self._known if extra else names))
            columns = [self._column(named[name], name) for name in self.variables]
        else:
            table = array_of_numbers(data, "the block")
            if table.ndim != 2 or table.shape[1] != len(self.variables):
                msg = (
                    f"expected an array of shape (n, {len(self.variables)}), "
                    f"a column for each of {', '.join(self.variables)}, got shape {table.shape}"
                )
                raise InputError(msg)
            columns = [np.ascontiguousarray(column) for column in table.T]
            n = table.shape[0]
        if n is not None and not _is_count(n):
            msg = f"expected a whole number of samples as n, got {n!r}"
            raise InputError(msg)
        lengths = {len(c) for c in columns} | (set() if n is None else {n})
        if len(lengths) > 1:
            got = ", ".join(f"{v}: {len(c)}" for v, c in zip(self.variables, columns, strict=True))
            asked = "" if n is None else f" and n={n}"
            msg = f"expected columns of one length, got {got}{asked}"
            raise InputError(msg)
        if not lengths:
            msg = "the formula has no variables: say how many samples with n="
            raise InputError(msg)
        for i, column in enumerate(columns):
            columns[i] = self._without_nan(column, self.variables[i], sample, previous[i : i + 1])
        return columns, lengths.pop()

    def _with_fields(
        self, named: Mapping[str, object], names: AbstractSet[str], sample: int
    ) -> Mapping[str, object]:
        """The columns with those of fields in place of the messages."""

        def column(field: Field, messages: object) -> object:
            if isinstance(messages, Mapping):  # of columns
                return field.of(messages, sample)
            if isinstance(messages, str | bytes) or not isinstance(messages, Iterable):
                got = kind_of(messages)
                msg = f"expected a message for every sample as '{field.message}', got {got}"
                raise InputTypeError(msg)
            return [field.of(message, sample + i) for i, message in enumerate(messages)]

        columns = {name: named[name] for name in names}
        for name in self._messages.names & names:
            messages = columns[name]
            if isinstance(messages, Iterator):  # several fields are to be read
                columns[name] = list(messages)
        return self._messages.spread(columns, column)

    def _column(self, values: object, name: str) -> NDArray[np.float64]:
        column = array_of_numbers(values, f"'{name}'")
        if column.ndim != 1:
            msg = f"expected a 1-D array for '{name}', got shape {column.shape}"
            raise InputError(msg)
        return np.ascontiguousarray(column)

    def _without_nan(
        self, column: NDArray[np.float64], name: str, sample: int, previous: Sequence[float]
    ) -> NDArray[np.float64]:
        missing = np.isnan(column)
        if not missing.any():
            return column
        if self.nan != "hold" or (missing[0] and not previous):
            self.refuse_nan(name, sample + int(missing.argmax()))
        held = np.concatenate([previous, column])
        offset = len(previous)
        places = np.where(np.isnan(held), 0, np.arange(len(held)))
        return cast("NDArray[np.float64]", held[np.maximum.accumulate(places)][offset:])

    def refuse(self, values: Sequence[float], sample: int) -> NoReturn:
        """Raise the error of the first term that is nan at a sample.

        Raises:
            InputError: Naming the term, the sample and the values.
        """
        refuse_term(self.program, values, f"sample {sample}{self._where}")


def unknown_variable(name: object, variables: Sequence[str], messages: Messages) -> InputError:
    """The error of a name that is neither a variable nor a message of some."""
    near = nearest(str(name), (*variables, *sorted(messages.names)))
    return InputError(f"unknown variable '{name}'{near or listed(variables)}")


def listed(variables: Sequence[str]) -> str:
    """A hint with all variables."""
    names = ", ".join(variables)
    return f"; the variables are {names}" if names else "; the formula has no variables"


def refuse_term(program: Program, values: Sequence[float], place: str) -> NoReturn:
    """Raise the error of the first term that is nan where the variables have these values.

    Raises:
        InputError: Naming the term, the place and the values.
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
            msg = f"'{source}' is not a number at {place}, where {where}"
            raise InputError(msg)
    msg = f"no term is nan at {place}"
    raise AssertionError(msg)


def array_of_numbers(values: object, what: str) -> NDArray[np.float64]:
    """An array of doubles, not copied if it is one; a masked value is nan.

    Raises:
        InputTypeError: On what holds no real numbers.
    """
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        array = np.asarray(values)
    except ValueError as ragged:
        msg = f"expected an array of numbers for {what}, got {kind_of(values)}"
        raise InputTypeError(msg) from ragged
    if array.dtype.kind not in "biuf" and array.size:
        kind = array.dtype if isinstance(values, np.ndarray | list | tuple) else kind_of(values)
        msg = f"expected an array of numbers for {what}, got {kind}"
        raise InputTypeError(msg)
    return array.astype(np.float64, copy=False)


def _is_count(n: object) -> bool:
    return isinstance(n, int | np.integer) and not isinstance(n, bool) and int(n) >= 0


def kind_of(value: object) -> str:
    """Type and beginning of a value in one line, for messages."""
    text = " ".join(repr(value).split())
    shown = text if len(text) <= 40 else text[:37] + "..."
    return f"{type(value).__name__} {shown}"
