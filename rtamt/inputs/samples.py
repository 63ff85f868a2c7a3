"""Reads the samples of callers as floats: argument forms, checks and errors.

Both back-ends use the reader: the machines in Python for every sample, those in C++ for rare
argument forms and for every error.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
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
    near_name,
    nearest,
    no_such,
)
from rtamt.inputs.arrays import Floats, array_of_numbers, kind_of, line_of_numbers, number
from rtamt.inputs.between import NO_BOUNDS, UNKNOWN, UncertainValue, halves
from rtamt.inputs.frames import named_columns
from rtamt.inputs.messages import Field, Messages
from rtamt.program.algebra import of_ends
from rtamt.program.memory import limit_episode
from rtamt.program.program import Program, ranges_of


class Rates:
    """Computes the rates of a program.

    The rate is 0 at sample 0 and between two equal values, infinite ones included.
    """

    __slots__ = ("_places", "_seconds")

    def __init__(self, program: Program) -> None:
        self._places = [program.variables.index(name) for name in program.rates.values()]
        self._seconds = program.seconds

    def __bool__(self) -> bool:
        return bool(self._places)

    def of_sample(
        self, values: Sequence[float | UncertainValue], previous: Sequence[float | UncertainValue]
    ) -> list[float | UncertainValue]:
        """Return the rates at a sample; `previous` is empty for the first one."""
        if not previous:
            return [0.0] * len(self._places)
        return [self._rate(values[position], previous[position]) for position in self._places]

    def _rate(
        self, value: float | UncertainValue, before: float | UncertainValue
    ) -> float | UncertainValue:
        if not (isinstance(value, UncertainValue) or isinstance(before, UncertainValue)):
            return 0.0 if value == before else (value - before) / self._seconds
        low, high = ends_of(value)
        low_before, high_before = ends_of(before)
        lower = (low - high_before) / self._seconds
        upper = (high - low_before) / self._seconds
        if lower != lower or upper != upper:  # noqa: PLR0124 - nan
            return UncertainValue(-np.inf, np.inf)
        return lower if lower == upper != 0 else UncertainValue(lower, upper)

    def of_columns(self, columns: Sequence[Floats], previous: Sequence[float] = ()) -> list[Floats]:
        """Return the rates at each sample of a block; nan if a value is nan."""
        return [
            self._column(columns[position], previous[position : position + 1])
            for position in self._places
        ]

    def _column(self, column: Floats, previous: Sequence[float]) -> Floats:
        before = np.concatenate([previous if len(previous) else column[:1], column[:-1]])
        with np.errstate(invalid="ignore", over="ignore"):
            rates = (column - before) / self._seconds
        rates[column == before] = 0.0
        if len(rates) and not len(previous):
            rates[0] = 0.0
        return cast("Floats", rates)

    def of_bounds(
        self, lower: Sequence[Floats], upper: Sequence[Floats]
    ) -> tuple[list[Floats], list[Floats]]:
        """Return the smallest and largest rates of a trace with values between columns."""
        low_rates: list[Floats] = []
        high_rates: list[Floats] = []
        for position in self._places:
            low, high = lower[position], upper[position]
            known = low == high
            known[1:] &= known[:-1].copy()
            known[:1] = True
            exact = self._column(low, ())
            with np.errstate(invalid="ignore", over="ignore"):
                least = (low[1:] - high[:-1]) / self._seconds
                greatest = (high[1:] - low[:-1]) / self._seconds
            absent = np.isnan(least) | np.isnan(greatest)
            for rates, ends, unknown in (
                (low_rates, least, -np.inf),
                (high_rates, greatest, np.inf),
            ):
                ends[absent] = unknown
                rates.append(np.where(known, exact, np.concatenate([exact[:1], ends])))
        return low_rates, high_rates


NanPolicy = Literal["raise", "hold", "unknown"]
"""Meaning of nan: an error, the last value of the variable, or an unknown value."""
SampleValues = list[float | UncertainValue]
"""A value for each variable, in their order; known values are numbers."""

TraceColumns = Mapping[str, object] | ArrayLike
"""Values of every variable, or messages, by name; or an array with a column per variable."""

_DOUBLE = np.dtype(np.float64)


class SampleReader:
    """Reads samples and blocks of samples of a program's variables.

    Errors name the batch entry, if there is one. With ``bounds`` the monitor returns bounds, and
    values may be uncertain.

    Attributes:
        variables: The variables of callers, in order.
        rates: Computes the values that follow them in each sample.
        intervals_fit: Whether there is memory for uncertain values; otherwise, they are refused.
    """

    __slots__ = (
        *("_known", "_messages", "_where"),
        *("bounds", "intervals_fit", "nan", "program", "rates", "variables"),
    )

    def __init__(
        self,
        program: Program,
        nan: NanPolicy = "raise",
        entry: int | None = None,
        *,
        bounds: bool = False,
    ) -> None:
        self.nan: NanPolicy = _checked(nan, bounds=bounds)
        self.program = program
        self.variables = program.inputs
        self.rates = Rates(program)
        self.bounds = bounds
        self.intervals_fit = True
        self._known = frozenset(self.variables)
        self._messages = Messages(program.specification, self.variables)
        self._where = "" if entry is None else f" of batch entry {entry}"

    def read(
        self,
        args: Sequence[object],
        named: Mapping[str, object],
        sample: int,
        previous: Sequence[float],
    ) -> list[float]:
        """Return the sample of ``update(*args, **named)``, in the order of the variables."""
        return cast("list[float]", self.read_sample(args, named, sample, previous))

    def read_sample(
        self,
        args: Sequence[object],
        named: Mapping[str, object],
        sample: int,
        previous: Sequence[float | UncertainValue],
    ) -> SampleValues:
        """Return the result of `read`, with an `UncertainValue` for each uncertain value."""
        if len(args) == len(self.variables) and not named:
            for value in args:  # the most frequent form by far: floats in order
                if type(value) is not float or value != value:  # noqa: PLR0124 - nan
                    break
            else:
                return self._with_rates(cast("SampleValues", list(args)), previous)
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
        return self._with_rates(self._sample(counted, sample, previous), previous)

    def _with_rates(
        self, values: SampleValues, previous: Sequence[float | UncertainValue]
    ) -> SampleValues:
        return values + self.rates.of_sample(values, previous) if self.rates else values

    def _sample(
        self, values: Sequence[object], sample: int, previous: Sequence[float | UncertainValue]
    ) -> SampleValues:
        read: SampleValues = []
        for name, value in zip(self.variables, values, strict=True):
            double = number(value)
            if double is not None:
                read.append(double)
            elif isinstance(value, UncertainValue):
                read.append(self._interval(value, name, sample))
            else:
                raise InputTypeError(
                    f"expected a number for '{name}' at sample {sample}, got {kind_of(value)}"
                )
        for i, value in enumerate(read):
            if value != value:  # noqa: PLR0124 - nan
                if self.nan == "unknown":
                    read[i] = UNKNOWN
                elif self.nan == "hold" and previous:
                    read[i] = previous[i]
                else:
                    self.refuse_nan(self.variables[i], sample)
        return read

    def _interval(self, value: UncertainValue, name: str, sample: int) -> float | UncertainValue:
        """Return the interval of a value; a number if it is known."""
        lower, upper = value.lower, value.upper
        if not (isinstance(lower, float) and isinstance(upper, float)):
            raise InputTypeError(
                f"expected a number at each end for '{name}' at sample {sample}, got "
                f"{kind_of(value)}"
            )
        if of_ends(lower, upper).known:
            return lower
        if not self.bounds:
            raise InputError(
                f"expected a value that is known for '{name}' at sample {sample}, got {value!r}; "
                f"{NO_BOUNDS}"
            )
        if not self.intervals_fit:
            limit_episode(self.program, unknown=True)
        return value

    def _by_name(
        self, named: Mapping[str, object], sample: int, previous: Sequence[float | UncertainValue]
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

    def _unsaid(
        self, names: AbstractSet[str], previous: Sequence[float | UncertainValue]
    ) -> dict[str, float | UncertainValue]:
        """Return the previous values of absent variables with a default, or their defaults."""
        held = dict(zip(self.variables, previous, strict=False))  # rates follow
        defaults: Mapping[str, float] = self.program.specification.defaults
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
        self, data: TraceColumns, sample: int, previous: Sequence[float]
    ) -> tuple[list[Floats], int]:
        """Return the columns of a block, in the order of the variables, and their length.

        ``sample`` is the number of its first sample, and ``previous`` the sample before it.
        """
        columns, length = self.columns(data, sample, previous)
        return self.without_nan(columns, sample, previous), length

    def columns(
        self,
        data: TraceColumns,
        sample: int = 0,
        previous: Sequence[float] = (),
        *,
        n: int | None = None,
        extra: bool = False,
    ) -> tuple[list[Floats], int]:
        """Return the result of `block`, with every nan still in it.

        ``n`` is the length for a program without variables; ``extra`` ignores unknown names.
        """
        if (plain := self._plain(data, n, extra=extra)) is not None:
            return plain + self.rates.of_columns(plain, previous), len(plain[0])
        data = cast("TraceColumns", named_columns(data))
        if isinstance(data, Mapping) or hasattr(data, "keys"):
            named = cast("Mapping[str, object]", data)
            columns, held = self.lines(named, sample, previous, extra=extra)
        else:
            if isinstance(data, str | os.PathLike):
                msg = (
                    f"expected samples, got the path {brief(os.fspath(data))}; read the file "
                    "first, as with pandas.read_csv, or run rtamt monitor SPEC FILE"
                )
                raise InputTypeError(msg)
            table = array_of_numbers(data, "the block")
            if table.ndim != 2 or table.shape[1] != len(self.variables):
                raise wrong_shape(table, "n", self.variables)
            columns = dict(zip(self.variables, map(np.ascontiguousarray, table.T), strict=True))
            held, n = {}, table.shape[0]
        if n is not None and not _is_count(n):
            raise InputError(f"expected a whole number of samples as n, got {brief(n)}")
        lengths = {len(c) for c in columns.values()} | (set() if n is None else {n})
        if len(lengths) > 1:
            got = ", ".join(f"{v}: {len(c)}" for v, c in columns.items())
            wanted = "" if n is None else f" and n={n}"
            raise InputError(f"expected columns of one length, got {got}{wanted}")
        if not lengths:
            reason, way = "the formula has no variables", "an array of shape (samples, 0)"
            if held:
                reason, way = "every variable has its default", "the values of a variable"
            raise InputError(
                f"{reason}, so that the number of samples is unknown; pass {way}, or n= for a "
                "single trace"
            )
        length = lengths.pop()
        columns = {v: np.full(length, value) for v, value in held.items()} | columns
        values = [columns[v] for v in self.variables]
        return values + self.rates.of_columns(values, previous), length

    def _plain(self, data: object, n: int | None, *, extra: bool) -> list[Floats] | None:
        """Return the columns of a dictionary of plain arrays of all variables, or None.

        They have n values, if n is a number.
        """
        if type(data) is not dict or not (
            self._known <= data.keys() if extra else self._known == data.keys()
        ):
            return None
        columns = [data[name] for name in self.variables]
        length = columns[0].size if columns and type(columns[0]) is np.ndarray else -1
        for column in columns:
            if (
                type(column) is not np.ndarray
                or column.dtype is not _DOUBLE
                or column.shape != (length,)
                or not column.flags.c_contiguous
            ):
                return None
        return columns if columns and (n is None or (type(n) is int and n == length)) else None

    def lines(
        self,
        named: Mapping[str, object],
        sample: int = 0,
        previous: Sequence[float] = (),
        *,
        extra: bool = False,
    ) -> tuple[dict[str, Floats], dict[str, float]]:
        """Return the columns by name, and the values of absent variables with a default.

        The arguments and errors are those of `block`, except for the lengths.
        """
        names: AbstractSet[str] = dict.fromkeys(map(name_text, named.keys())).keys()
        original = names
        if not self._known <= names and self._messages.names & names:
            named = self._with_fields(named, names, sample)
            names = named.keys()
        held = cast("dict[str, float]", self._unsaid(names, previous))
        missing = [v for v in self.variables if v not in names and v not in held]
        if missing and extra and original:
            raise InputError(no_such("column", missing[0], original))
        if missing or not (extra or names <= self._known):
            self._refuse_names(dict.fromkeys(names | held.keys()))
        check_near("column", held, names - self._known - self._messages.names)
        return {v: self._line(named[v], v) for v in self.variables if v in names}, held

    def _line(self, values: object, name: str) -> Floats:
        if isinstance(values, UncertainValue):
            raise InputError(
                f"expected values that are known for '{name}', got {kind_of(values)}; {NO_BOUNDS}"
            )
        return line_of_numbers(values, f"'{name}'")

    def between(
        self, data: TraceColumns, *, n: int | None = None, extra: bool = False
    ) -> tuple[list[Floats], list[Floats], int]:
        """Return the smallest and the largest values of the columns, and their length.

        If all values are known, both are one list, and every nan is still in it. It raises the
        errors of `columns` and, for uncertain values, of `without_nan`.
        """
        if self.nan != "unknown" and (plain := self._plain(data, n, extra=extra)):
            joined = plain + self.rates.of_columns(plain, ())
            return joined, joined, len(plain[0])
        both: Sequence[TraceColumns] = halves(data) if isinstance(data, Mapping) else [data]
        blocks = [self.columns(half, n=n, extra=extra) for half in both]
        (joined, length), count, separate = blocks[0], len(self.variables), len(blocks) > 1
        lower, upper = joined[:count], blocks[-1][0][:count]
        if self.nan != "unknown" and separate:
            lower, upper = self._filled(lower), self._filled(upper)
        if self.nan == "unknown" and any(np.isnan(column).any() for column in lower):
            separate = True
            upper = [np.where(np.isnan(column), np.inf, column) for column in upper]
            lower = [np.where(np.isnan(column), -np.inf, column) for column in lower]
        if not separate:
            return joined, joined, length
        least, greatest = self.rates.of_bounds(lower, upper)
        return lower + least, upper + greatest, length

    def without_nan(
        self, columns: Sequence[Floats], sample: int = 0, previous: Sequence[float] = ()
    ) -> list[Floats]:
        """Return the columns with the last value in place of each nan, if the policy allows."""
        own = list(columns[: len(self.variables)])
        filled = self._filled(own, sample, previous)
        if all(held is column for held, column in zip(filled, own, strict=True)):
            return list(columns)
        return filled + self.rates.of_columns(filled, previous)

    def _filled(
        self, columns: Sequence[Floats], sample: int = 0, previous: Sequence[float] = ()
    ) -> list[Floats]:
        return [
            self._without_nan(column, name, sample, previous[i : i + 1])
            for i, (name, column) in enumerate(zip(self.variables, columns, strict=True))
        ]

    def _with_fields(
        self, named: Mapping[str, object], names: AbstractSet[str], sample: int
    ) -> Mapping[str, object]:
        """Return the columns by variable; a column of messages becomes columns of its fields."""

        def column(field: Field, messages: object) -> object:
            if isinstance(messages, Mapping):  # a message of columns
                return field.column(messages, sample)
            several = isinstance(messages, Iterable) and not isinstance(messages, str | bytes)
            if not several or getattr(messages, "ndim", 1) == 0:
                got = kind_of(messages)
                raise InputTypeError(
                    f"expected a message for every sample as '{field.message}', got {got}"
                )
            numbered = enumerate(cast("Iterable[object]", messages), sample)
            return [field.of(message, i) for i, message in numbered]

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

    def refuse(self, values: Sequence[float | UncertainValue], sample: int) -> NoReturn:
        """Raise the error that names the first variable or term which is nan at a sample."""
        for name, value in zip(self.program.variables, values, strict=True):
            if value != value:  # noqa: PLR0124 - nan
                self.refuse_nan(name, sample)
        refuse_term(self.program, values, f"sample {sample}{self._where}")

    def refuse_between(
        self, lower: Iterable[float], upper: Iterable[float], sample: int
    ) -> NoReturn:
        """Raise the error of `refuse` for values between these."""
        self.refuse([in_between(*ends) for ends in zip(lower, upper, strict=True)], sample)


def unknown_variable(name: object, variables: Sequence[str], messages: Messages) -> InputError:
    """Return the error about a name that is neither a variable nor a message."""
    shown = name_text(name)
    near = nearest(shown, (*variables, *sorted(messages.names)))
    return InputError(f"unknown variable '{shown}'{near or listed(variables)}")


def check_near(kind: str, defaults: Mapping[str, float], others: Collection[str]) -> None:
    """Refuse a default if another column or signal has nearly the name of the variable."""
    for name, value in defaults.items() if others else ():
        near = near_name(name, others)
        if near is not None:
            raise InputError(
                f"No {kind} '{name}', which has the default {value:.12g}, but '{near}'. Rename it "
                f"to '{name}' to read it, or leave it out to take the default."
            )


def listed(variables: Sequence[str]) -> str:
    """Return a hint that lists all variables."""
    names = ", ".join(variables)
    return f"; the variables are {names}" if names else "; the formula has no variables"


def refuse_term(program: Program, values: Sequence[float | UncertainValue], place: str) -> NoReturn:
    """Raise the error that names the first term without a value.

    A machine noticed one. If every term has a value now, another thread has written to the caller's
    array since then.
    """
    ranges = ranges_of(program, [of_ends(*ends_of(value)) for value in values])
    if len(ranges) < program.terms:
        source = program.sources[len(ranges)]
        where = ", ".join(
            f"{v} = {x!r}"
            for v, x in zip(program.variables, values, strict=True)
            if program.rates.get(v, v) in source.variables
        )
        raise InputError(f"'{source}' is not a number at {place}, where {where}")
    raise InputError(
        f"a term was not a number at {place} and is one now: the array was written to while it was "
        "read; copy it, or write to it after the call"
    )


def ends_of(value: float | UncertainValue) -> tuple[float, float]:
    """Return the smallest and the largest possible value."""
    if not isinstance(value, UncertainValue):
        return value, value
    return cast("tuple[float, float]", (value.lower, value.upper))


def in_between(lower: float, upper: float) -> float | UncertainValue:
    """Return a value that lies between two numbers; a number if it is known."""
    return lower if of_ends(lower, upper).known else UncertainValue(lower, upper)


def wrong_shape(
    table: Floats, leading: str, variables: Sequence[str], rows: str = "", hint: str = ""
) -> InputError:
    """Return the error about a table whose last axis is not one column per variable."""
    columns = f"a column for each of {', '.join(variables)}" if variables else "no column"
    return InputError(
        f"expected an array of shape ({leading}, {len(variables)}), {rows}{columns}, "
        f"got shape {table.shape}{hint}"
    )


def _checked(nan: object, *, bounds: bool) -> NanPolicy:
    policies: tuple[NanPolicy, ...] = ("raise", "hold", "unknown") if bounds else ("raise", "hold")
    if is_one_of(nan, policies):
        return cast("NanPolicy", nan)
    *others, last = (f"nan={policy!r}" for policy in policies)
    expected, reason = f"{', '.join(others)} or {last}", ""
    if is_one_of(nan, ("unknown",)):
        reason = f", under which a robustness lies between two bounds; {NO_BOUNDS}"
    raise InputError(f"expected {expected}, got {brief(nan)}{reason}")


def _count(variables: Sequence[str]) -> str:
    return f"{len(variables)} value{'' if len(variables) == 1 else 's'}"


def _is_count(n: object) -> bool:
    if isinstance(n, bool | np.timedelta64):
        return False
    return isinstance(n, int | np.integer) and 0 <= int(n) <= 2**48
