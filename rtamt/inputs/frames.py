"""Data frames and tables of any library, whose columns are read by name and without its import."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np

from rtamt.errors import InputError, InputTypeError

__all__ = ["check_times", "named_columns", "unit_of_times"]

_WORDS = {
    "ns": "ns nsec nsecs nanos nanosecond nanoseconds",
    "us": "us µs μs usec usecs micros microsecond microseconds",
    "ms": "ms msec msecs millis millisecond milliseconds",
    "s": "s sec secs second seconds",
    "min": "min mins minute minutes",
    "h": "h hr hrs hour hours",
}
_UNIT_OF = {word: unit for unit, words in _WORDS.items() for word in words.split()}
"""How the units are written in names of columns, in lower case."""

_TIMES = re.compile(
    r"(?:time|timestamp|time[ _]stamp|stamp|datetime|tout|t)s?"
    r"(?:\s*[\[(]\s*(?P<inside>[^\])]*?)\s*[\])]|[\s_/.-]+(?P<behind>[^\W\d_]+))?",
    re.IGNORECASE,
)


def unit_of_times(column: str) -> str | None:
    """The unit in the name of a column of times; empty if it has none, None if it has no times.

    These are ``time``, ``timestamp``, ``time stamp``, ``stamp``, ``datetime``, ``tout`` (of
    Simulink) and ``t``, in any case but ``T``, alone or with a unit behind them. A unit in brackets
    is returned as it stands if it is unknown.

    Example:
        >>> [unit_of_times(name) for name in ("Time [s]", "timestamp_ns", "t", "time (µs)")]
        ['s', 'ns', '', 'us']
        >>> [unit_of_times(name) for name in ("time_zone", "T", "timer", "Time [ticks]")]
        [None, None, None, 'ticks']
    """
    found = _TIMES.fullmatch(column)
    if found is None or column.lower() == "ts" or column == "T":  # rather names of quantities
        return None
    inside, behind = found["inside"], found["behind"]
    if inside is not None:
        return _UNIT_OF.get(inside.lower(), inside)
    return _UNIT_OF.get(behind.lower()) if behind else ""


class _Table(Mapping[str, object]):
    """The columns of a table that is no mapping."""

    __slots__ = ("_names", "_table")

    def __init__(self, table: Any, names: list[str]) -> None:  # noqa: ANN401 - of any library
        self._table, self._names = table, dict.fromkeys(names)

    def __getitem__(self, name: str) -> object:
        return self._table[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def named_columns(data: object) -> object:
    """The columns by name of a frame of polars or a table of Arrow; other data as it is.

    Raises:
        InputTypeError: On a frame of polars that has yet to be read.
    """
    if hasattr(data, "collect") and hasattr(data, "collect_schema"):
        raise InputTypeError(
            f"expected a data frame, got a {type(data).__name__}, which is not read yet; "
            "pass its collect()"
        )
    names = _names(data)
    return data if names is None or hasattr(data, "keys") else _Table(data, names)


def _names(data: object) -> list[Any] | None:
    """The names of the columns of a frame, which pandas lets be no text; None of what is none."""
    if isinstance(data, Mapping | np.ndarray) or not hasattr(data, "__getitem__"):
        return None
    names = getattr(data, "column_names", None)  # of Arrow, whose columns are the arrays
    if names is None:
        names = getattr(data, "columns", None)
    try:
        return None if names is None else list(names)
    except TypeError:
        return None


def check_times(data: object, variables: Sequence[str]) -> None:
    """Checks that a frame has no times which a formula would ignore whose bounds count samples.

    Args:
        data: What holds the values.
        variables: The variables of the formula; a column that it reads is not ignored.

    Raises:
        InputError: If it has a column or an index of times. The message says the ways out.
    """
    names = _names(data)
    if names is None:
        return
    frame = cast("Any", data)
    index = getattr(frame, "index", None)
    dated = getattr(getattr(index, "dtype", None), "kind", "") in ("m", "M")
    if dated or unit_of_times(str(getattr(index, "name", None) or "")) is not None:
        times: Any = index
        found, without = "an index of times", "reset_index(drop=True)"
    else:
        ignored = [name for name in names if str(name) not in variables]
        called = [
            name for name in ignored if unit_of_times(str(name)) is not None or _dated(frame, name)
        ]
        if not called:
            return
        times = frame[called[0]]
        found, without = f"a column of times '{called[0]}'", "drop it"
    values = np.asarray(times)[:2].tolist() if _is_plain(times) else [str(t) for t in times[:2]]
    shown = " and ".join(map(str, values))
    raise InputError(
        f"expected a period, because the data frame has {found}, which begins with {shown}; "
        f"pass period=, the time between two samples, or {without} to count bounds in samples"
    )


def _dated(frame: Any, name: object) -> bool:  # noqa: ANN401 - of any library
    kind = str(getattr(frame[name], "dtype", getattr(frame[name], "type", "")))
    return kind.lower().startswith(("date", "timestamp", "timedelta", "duration"))


def _is_plain(times: object) -> bool:
    return getattr(getattr(times, "dtype", None), "kind", "O") in "biuf"
