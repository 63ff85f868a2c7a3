"""Data frames and tables of any library, whose columns are read by name without importing it."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rtamt.columns import (
    NANOSECONDS,
    is_date,
    looks_like_times,
    may_tell_objects,
    objects_in,
    split_times,
    stated_period,
    unit_of_times,
)
from rtamt.errors import InputError, InputTypeError


class _Table(Mapping[str, object]):
    """The columns of a table that is not a mapping."""

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
    """Return a polars frame or an Arrow table as columns by name, and other data as it is."""
    if hasattr(data, "collect") and hasattr(data, "collect_schema"):
        raise InputTypeError(
            f"expected a data frame, got a {type(data).__name__}, which is not read yet; "
            "pass its collect()"
        )
    names = names_of(data)
    return data if names is None or hasattr(data, "keys") else _Table(data, names)


def names_of(data: object) -> list[Any] | None:
    """Return the names of the columns, not always texts in pandas; None for other data."""
    if isinstance(data, Mapping | np.ndarray) or not hasattr(data, "__getitem__"):
        return None
    names = getattr(data, "column_names", None)  # of Arrow, where `columns` are the arrays
    if names is None:
        names = getattr(data, "columns", None)
    try:
        return None if names is None else list(names)
    except TypeError:
        return None


def check_roles(data: object, variables: Sequence[str], *, timed: bool) -> None:
    """Check that a frame is a single trace, and has no times that bounds would ignore.

    A mapping is checked for columns that are named as times; an array is not checked. ``timed``
    states that the formula has bounds and there is no period.
    """
    names = names_of(data)
    if names is None:
        if timed and isinstance(data, Mapping):
            _check_named_times(data, variables)
        return
    frame = cast("Any", data)
    ignored = [name for name in names if str(name) not in variables]
    _check_objects(frame, ignored, variables, names[0])
    if timed:
        _check_times(frame, ignored, names[0])


def _check_objects(
    frame: Any,  # noqa: ANN401 - of any library
    ignored: Sequence[Any],
    variables: Sequence[str],
    first: object,
) -> None:
    cells, instants = cells_and_times(frame, ignored)
    late = instants is not None and not (instants[1:] > instants[:-1]).all()
    if instants is not None and len(instants) > 1 and (instants[1:] < instants[:-1]).all():
        raise InputError(
            f"expected times that increase, got the newest first, {instants[0]} before "
            f"{instants[1]}; sort the rows, the oldest first"
        )
    timed = instants is not None
    looked_at = {
        n: np.asarray(column)
        for n, column in cells.items()
        if late or may_tell_objects(n, variables, timed=timed, first=n == str(first))
    }
    if not looked_at:
        return
    names = names_of(frame) or []
    present = [name for name in variables if name in map(str, names)]
    filled = [_filled(frame[name]) for name in present]
    objects = objects_in(looked_at, instants, filled, variables, str(first))
    if objects is None:
        return
    phrase = "times that repeat or go back while other columns change"
    if objects.row is not None:
        phrase = f"a column '{objects.column}' by which another trace starts in row {objects.row}"
    elif objects.column:
        more = ", ..." if len(objects.values) > _SHOWN else ""
        values = ", ".join(objects.values[:_SHOWN]) + more
        phrase = f"a column '{objects.column}' with {len(objects.values)} values ({values})"
    raise InputError(
        f"expected one trace, got a data frame that has {phrase}, as with several objects or "
        "episodes; pass the rows of one, or only the columns of the formula if all rows are one "
        "trace"
    )


def cells_and_times(
    frame: Any,  # noqa: ANN401 - of any library
    ignored: Sequence[Any],
) -> tuple[dict[str, Any], NDArray[Any] | None]:
    """Return the levels of the index and the ignored columns, and the time of each row.

    The first level or column of times is not in the cells; None if there are no times.
    """
    cells: dict[str, Any] = _levels(getattr(frame, "index", None))
    times = next((v for n, v in cells.items() if unit_of_times(n) is not None), None)
    for name in ignored:
        cells[str(name)] = frame[name]
        if times is None and (unit_of_times(str(name)) is not None or is_dated(frame[name])):
            times = cells.pop(str(name))
    instants = None if times is None else np.asarray(times)
    if instants is not None and instants.dtype.kind not in "iufmM":
        instants = None
    return cells, instants


def _levels(index: Any) -> dict[str, Any]:  # noqa: ANN401 - of any library
    """Return the levels of an index; the last of several counts rows unless it has times."""
    names = [*(getattr(index, "names", ()) or ())]
    levels = {}
    for i, name in enumerate(names):
        rows = name is None or (0 < i == len(names) - 1 and unit_of_times(str(name)) is None)
        levels["index" if rows else str(name)] = index.get_level_values(i)
    return levels


_SHOWN = 5
"""The most values in a message."""


def _filled(values: object) -> NDArray[np.bool_]:
    array = np.asarray(values)
    if array.dtype.kind == "f":
        return np.asarray(~np.isnan(array))
    if array.dtype.kind == "O":
        return np.array([value is not None and value == value for value in array.tolist()])  # noqa: PLR0124
    return np.ones(len(array), bool)


def warn_of_times(
    data: object,
    variables: Sequence[str],
    period: float,
    inner: Callable[[NDArray[Any]], NDArray[Any]] = np.diff,
) -> None:
    """Warn if times next to the variables contradict a stated period, which leaves them unread.

    Times without a unit may have any. ``inner`` returns the distances within traces.
    """
    names = names_of(data)
    columns: dict[str, Any] = {}
    if names is not None:
        columns = _levels(getattr(data, "index", None))
    elif isinstance(data, Mapping):
        names = list(data)
    for name in names or ():
        if str(name) not in variables:
            columns[str(name)] = cast("Any", data)[name]
    for name, values in columns.items():
        unit = unit_of_times(name)
        if unit is None and not is_dated(values):
            continue
        times = _plain_times(values)
        if times is None or unit not in {None, "", *_UNITS}:
            continue
        if times.dtype.kind in "mM":
            times, unit = times.astype(f"{times.dtype.kind}8[ns]").astype(np.int64), "ns"
        steps = inner(times if times.dtype.kind == "f" else times.astype(np.int64))
        scales = [_UNITS[unit]] if unit else [_UNITS[each] for each in ("s", "ms", "us", "ns")]
        if not len(steps) or any(_fits(steps * scale, period) for scale in scales):
            continue
        least, most = (f"{float(step) * scales[0]:.6g}" for step in (steps.min(), steps.max()))
        distances = least if least == most else f"{least} to {most}"
        warnings.warn(
            f"period= leaves the times in {name!r} unread, which are {distances}"
            f"{' s' if unit else ''} apart, not {period:.6g} s. Pass their period, or drop them.",
            stacklevel=_callers_level(),
        )


def _plain_times(values: Any) -> NDArray[Any] | None:  # noqa: ANN401 - a column of any library
    """Return a column of finite times as an array, dates as UTC; None if it is not one."""
    try:
        times = np.asarray(values)
        if getattr(getattr(values, "dtype", None), "tz", None) is not None:
            times = np.asarray(values, "M8[ns]")
    except (TypeError, ValueError, RuntimeError):
        return None
    plain = times.ndim == 1 and times.dtype.kind in "iufmM"
    return times if plain and np.isfinite(times).all() else None


def _callers_level() -> int:
    """Return the stack level of the first caller outside this package, for a warning."""
    level, frame = 0, inspect.currentframe()
    while frame and frame.f_globals["__name__"].partition(".")[0] == "rtamt":
        level, frame = level + 1, frame.f_back
    return level


_UNITS = {unit: count / 1e9 for unit, count in NANOSECONDS.items()}

_NEAR = 0.05
"""The part by which the distance of two times may differ from the period."""


def _fits(steps: NDArray[Any], period: float) -> bool:
    """Return whether distances of times in seconds are near a period."""
    return bool((np.abs(steps - period) <= _NEAR * period).all())


def _check_named_times(data: Mapping[Any, Any], variables: Sequence[str]) -> None:
    for name, values in data.items():
        if isinstance(name, str) and name not in variables and unit_of_times(name) is not None:
            array = np.asarray(values)
            if array.ndim == 1 and len(array) > 1:
                raise _no_period("mapping", f"a column of times '{name}'", array, "drop it")


def _check_times(frame: Any, ignored: Sequence[Any], first: object) -> None:  # noqa: ANN401
    index: Any = getattr(frame, "index", None)
    if index is not None and _holds_times(index, str(index.name or ""), first=True):
        times: Any = index
        phrase, without = "an index of times", "reset_index(drop=True)"
    else:
        called = [name for name in ignored if _holds_times(frame[name], str(name), name == first)]
        pairs = split_times([*map(str, ignored)])
        called += [seconds for seconds, part, _ in pairs if _rise(frame[seconds], frame[part])]
        if not called:
            return
        times = frame[called[0]]
        phrase, without = f"a column of times '{called[0]}'", "drop it"
    raise _no_period("data frame", phrase, times, without)


def _no_period(kind: str, phrase: str, times: Any, without: str) -> InputError:  # noqa: ANN401
    """Return the error for times that the bounds of a formula would ignore."""
    values = np.asarray(times)[:2].tolist() if _is_plain(times) else [str(t) for t in times[:2]]
    shown = " and ".join(map(str, values))
    return InputError(
        f"expected a period, because the {kind} has {phrase}, which begins with {shown}; "
        f"pass period=, the time between two samples, or {without} to count bounds in samples"
    )


def _holds_times(values: Any, name: str, first: bool) -> bool:  # noqa: ANN401, FBT001 - of any library
    """Return whether a column or an index has times, or the time between samples."""
    if unit_of_times(name) is not None or is_dated(values):
        return True
    array = np.asarray(values)
    if array.dtype.kind in "OUT":
        texts = [*map(str, array.tolist())]
        return len({*texts}) > 1 and all(map(is_date, texts))
    if looks_like_times(name, array, first=first):
        return True
    if array.dtype.kind not in "iuf" or not len(array) or not (array == array[0]).all():
        return False
    return stated_period(name, float(array[0]), single=False) is not None


def _rise(seconds: Any, parts: Any) -> bool:  # noqa: ANN401 - of any library
    """Return whether seconds and their parts rise together."""
    time, part = np.asarray(seconds), np.asarray(parts)
    if time.dtype.kind not in "iuf" or part.dtype.kind not in "iuf":
        return False
    after, before = slice(1, None), slice(None, -1)
    later = time[after] > time[before]
    return bool((later | ((time[after] == time[before]) & (part[after] > part[before]))).all())


def is_dated(values: Any) -> bool:  # noqa: ANN401 - of any library
    """Return whether a column has dates or durations, by its type."""
    kind = str(getattr(values, "dtype", getattr(values, "type", "")))
    return kind.lower().startswith(("date", "timestamp", "timedelta", "duration", "period"))


def _is_plain(times: object) -> bool:
    return getattr(getattr(times, "dtype", None), "kind", "O") in "biuf"
