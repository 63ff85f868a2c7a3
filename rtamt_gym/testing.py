"""The contracts of trace formats, optimizers and systems of other packages.

The tests of another package call these functions; an `AssertionError` states the broken claim.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError, RtamtError
from rtamt_gym.checks.numbers import exact
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.event_rows import read_events
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import read_trace
from rtamt_gym.search.falsification.optimizers import OptimizerLike, find_optimizer
from rtamt_gym.search.falsification.points import Floats
from rtamt_gym.search.falsification.search import SearchOver
from rtamt_gym.systems.system import System, SystemEnd

__all__ = ["check_optimizer", "check_system", "check_trace_format"]

ColumnTable = Mapping[str, NDArray[Any]]
"""Columns by name; the first is ``time``, in seconds."""

_N = 50
_PERIOD = 1 / 8
_EMPTY = (3, 4, 9)
_DIMENSIONS = (1, 2, 7)


def _claim(holds: bool, claim: str) -> None:  # noqa: FBT001 - the claim itself, not a switch
    """Raise an `AssertionError` if a claim fails, also under ``python -O``."""
    if not holds:
        raise AssertionError(claim)


def check_trace_format(
    extension: str, write: Callable[[Path, ColumnTable], object], folder: Path, *, gaps: bool = True
) -> None:
    """Check that files of an extension are read like the formats of this package.

    A trace comes back to the last bit, column by column, with its period and as events of dense
    time. A missing column, an empty cell and a file of another format are errors with their name;
    empty cells are held or dropped on request.

    Args:
        extension: The end of the file names, such as ``".npz"``.
        write: Writes a table to a path; nan is an empty cell.
        folder: Where to write, such as pytest's ``tmp_path``.
        gaps: Whether the format has empty cells.

    Raises:
        AssertionError: If a claim fails.
        InputError: If the extension has no format.

    Example:
        >>> import tempfile
        >>> def write(path, table):
        ...     np.savez(path, **table)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     check_trace_format(".npz", write, Path(folder))
    """
    table = {
        "time": np.arange(_N) * _PERIOD,
        "speed": np.sin(np.arange(_N)),
        "gear": np.arange(_N) % 5,
    }
    path = folder / f"Trace{extension}"
    write(path, table)
    _check_whole(path, table)
    with open_recording(str(path)) as recording:
        text = _refusal(lambda: read_trace(recording, ["sped"]))
    _claim("'sped'" in text, f"expected an error that names the column 'sped', got {text!r}")
    if gaps:
        path = folder / f"gaps{extension}"
        column = table["speed"].copy()
        column[list(_EMPTY)] = np.nan
        write(path, {**table, "speed": column})
        _check_gaps(path, table)
    try:
        _read(folder / f"absent{extension}", "speed")
        text = f"expected OSError for a missing file of {extension}, got a trace"
        _claim(holds=False, claim=text)
    except OSError:
        pass
    path = folder / f"noise{extension}"
    path.write_bytes(bytes(range(128, 256)) * 8)
    text = _refusal(lambda: _read(path, "speed"))
    _claim(path.name in text, f"expected an error that names {path.name}, got {text!r}")


def _read(path: Path, *variables: str, missing: Any = "raise") -> Trace:  # noqa: ANN401
    columns = Columns(missing=missing)
    with open_recording(str(path), columns) as recording:
        return read_trace(recording, variables, columns)


def _check_whole(path: Path, table: ColumnTable) -> None:
    for names in (["gear", "speed"], ["speed"]):
        trace = _read(path, *names)
        _claim(trace.samples == _N, f"expected {_N} samples of {path.name}, got {trace.samples}")
        _claim(list(trace.columns) == names, f"expected {names}, got {list(trace.columns)}")
        for name, values in trace.columns.items():
            _claim(values.dtype == np.float64, f"expected {name} as doubles, got {values.dtype}")
            _claim_same(values, table[name], f"column {name!r} of {path.name}")
        period = trace.period()
        _claim(period == _PERIOD, f"expected a period of {_PERIOD} s, got {period}")
        _claim(not trace.notes, f"expected no notes on a whole trace, got {list(trace.notes)}")
    with open_recording(str(path)) as recording:
        times, values = read_events(recording, ["speed"]).signals["speed"]
    _claim_same(times, table["time"], f"the times of events of {path.name}")
    _claim_same(values, table["speed"], f"the events of {path.name}")


def _check_gaps(path: Path, table: ColumnTable) -> None:
    text = _refusal(lambda: _read(path, "speed", "gear"))
    for words in (path.name, "column 'speed'", "--missing hold"):
        _claim(words in text, f"expected an error about an empty cell with {words!r}, got {text!r}")
    held = table["speed"].copy()
    for row in _EMPTY:
        held[row] = held[row - 1]
    columns = _read(path, "speed", "gear", missing="hold").columns
    _claim_same(columns["speed"], held, "empty cells that hold")
    rows = np.delete(np.arange(_N), _EMPTY)
    dropped = _read(path, "speed", "gear", missing="drop").columns
    _claim_same(dropped["gear"], table["gear"][rows], "rows without empty cells")
    with open_recording(str(path)) as recording:
        times, _ = read_events(recording, ["speed", "gear"]).signals["speed"]
    _claim_same(times, table["time"][rows], "the times of events without empty cells")


def _refusal(call: Callable[[], object]) -> str:
    """Return the message of the error that a call must raise."""
    try:
        call()
    except InputError as error:
        return str(error)
    except Exception as error:
        raise AssertionError(f"expected InputError, got {type(error).__name__}: {error}") from error
    raise AssertionError("expected InputError, got none")


def _claim_same(values: NDArray[Any], expected: NDArray[Any], name: str) -> None:
    same = len(values) == len(expected) and np.array_equal(values, expected)
    _claim(same, f"expected {name} as they were written, {expected[:12]}..., got {values[:12]}...")


def check_optimizer(optimizer: OptimizerLike, *, budget: int = 200) -> None:
    """Check that `falsify` can search with an optimizer.

    It evaluates points of the unit cube, in spaces of one dimension and of several, for all values;
    it does not catch the end of the search; and it draws from its generator alone, so the same seed
    evaluates the same points.

    Args:
        optimizer: The optimizer, or its name.
        budget: The points after which a search is over.

    Raises:
        AssertionError: If a claim fails.

    Example:
        >>> def uniform(evaluate, dimension, rng):
        ...     while True:
        ...         evaluate(rng.random((8, dimension)))
        >>> check_optimizer(uniform)
    """
    search = find_optimizer(optimizer)

    def points_of(height: Callable[[Floats], Floats], dimension: int) -> Floats:
        evaluate, returned = _Recorded(height, dimension, budget), False
        with suppress(SearchOver):
            search(evaluate, dimension, np.random.default_rng(3))
            returned = True
        _claim(
            not (returned and evaluate.over),
            "expected the end of the search to leave the optimizer, got it swallowed; "
            "catch Exception, not BaseException",
        )
        return np.concatenate([*evaluate.points, np.empty((0, dimension))])

    for dimension in _DIMENSIONS:
        for height in (_slope, _flat, _never):
            before = _global_state()
            points, again = points_of(height, dimension), points_of(height, dimension)
            _claim(len(points) > 0, f"expected a point in {dimension} dimensions, got none")
            _claim(
                np.array_equal(points, again),
                "expected the same points from the same seed; draw from rng alone",
            )
            _claim(_global_state() == before, "expected numbers from rng, got NumPy's global")


class _Recorded:
    """A stand-in for the simulations of a search that records the points."""

    def __init__(self, height: Callable[[Floats], Floats], dimension: int, budget: int) -> None:
        half = max(1, dimension // 2)
        self.groups: Sequence[slice] = [slice(0, half)] + [slice(half, dimension)] * (
            half < dimension
        )
        self.points: list[Floats] = []
        self.over = False
        self._height = height
        self._dimension = dimension
        self._left = budget

    def __call__(self, points: ArrayLike, level: float = math.inf) -> Floats:
        _claim(not self.over, "expected no more points after the search is over, got some")
        _claim(not math.isnan(level), "expected a number as level, got nan")
        array = np.asarray(points, np.float64)
        _claim(
            array.ndim == 2 and array.shape[1] == self._dimension,
            f"expected points of shape (k, {self._dimension}), got shape {array.shape}",
        )
        inside = bool(np.all((array >= 0.0) & (array <= 1.0)))
        _claim(inside, f"expected points of the unit cube, got {array[:3]}")
        array = array[: self._left]
        self.points.append(array.copy())
        self._left -= len(array)
        if not self._left:
            self.over = True
            raise SearchOver
        return self._height(array)


def _global_state() -> str:
    """Return the state of NumPy's global generator, which an optimizer must not draw from."""
    state = np.random.get_state(legacy=False)["state"]  # noqa: NPY002 - to detect its use
    return f"{state['pos']} {state['key'].tobytes().hex()}"


def _slope(points: Floats) -> Floats:
    return np.asarray(points.sum(axis=1) + 1.0)


def _flat(points: Floats) -> Floats:
    return np.ones(len(points))


def _never(points: Floats) -> Floats:
    """A requirement with infinite robustness, as under the Boolean semantics."""
    return np.full(len(points), math.inf)


def check_system(
    make: Callable[[], System],
    variables: Sequence[str],
    *,
    period: Fraction | None = None,
    steps: int = 10,
) -> None:
    """Check that `simulate` and the searches can run a system.

    Its samples are numbers, in the order of the variables; a second run has the same samples, also
    after a run that was left early; an unknown name is an error before a run starts; `close` works
    at any time.

    Args:
        make: Returns the system, ready to be bound.
        variables: Names that it has; two, if it has so many.
        period: The time between samples, for a system that needs it.
        steps: The number of steps.

    Raises:
        AssertionError: If a claim fails.

    Example:
        >>> from rtamt_gym.systems.adapters import SampleSource
        >>> check_system(lambda: SampleSource([{"x": 0.0, "y": 2}, {"x": 1.0, "y": 3}]), ["x", "y"])
    """
    system = make()
    _claim(isinstance(system, System), f"expected a System, got {type(system).__name__}")
    _claim(bool(system.name), "expected a name, got an empty one")
    known = system.period
    _claim(known is None or 0 < known < math.inf, f"expected a period above 0, got {known}")
    _claim(
        not system.needs_period or known is None,
        f"expected a period or the need of one, got both: {known} and {system.needs_period!r}",
    )
    names = list(variables)
    rows = _run(system, names, period, steps)
    _claim(
        _run(make(), names, period, steps) == rows, "expected the same samples of another system"
    )
    _run(system, names, period, 0)
    _claim(
        _run(system, names, period, steps) == rows,
        "expected the same samples of a second run after a run that was left early",
    )
    backwards = _run(make(), names[::-1], period, steps)
    _claim(
        [row[::-1] for row in backwards] == rows,
        f"expected values in the order of the variables {names[::-1]}, got {backwards[0]}",
    )
    unknown, system = f"{names[0]}_that_is_not_there", make()
    try:
        system.bind([unknown], None, _period(system, period))
        system.start()
    except RtamtError as error:
        _claim(unknown in str(error), f"expected an error that names {unknown!r}, got {error}")
    else:
        _claim(holds=False, claim=f"expected an error about {unknown!r}, got a sample")
    finally:
        system.close()


def _run(
    system: System, names: list[str], period: Fraction | None, steps: int
) -> list[list[float]]:
    """Return the samples of a run of at most ``steps`` steps."""
    system.bind(names, None, _period(system, period))
    try:
        rows = [[float(value) for value in system.start()]]
        _claim(
            system.ended == "",
            f"expected a running system after start(), got ended={system.ended!r}",
        )
        while len(rows) <= steps and (values := system.advance()) is not None:
            rows.append([float(value) for value in values])
            _claim(system.ended in get_args(SystemEnd), f"got ended={system.ended!r}")
        if len(rows) <= steps:
            _claim(
                system.ended != "",
                "expected `ended` as terminated or truncated after the last sample, got ''",
            )
            within = system.limit is None or len(rows) <= system.limit + 1
            _claim(within, "got steps past the limit")
    finally:
        system.close()
    for row in rows:
        _claim(len(row) == len(names), f"expected {len(names)} values, got {row}")
    return rows


def _period(system: System, period: Fraction | None) -> Fraction | None:
    """Return the time between samples as `simulate` passes it: the system's own, or this one."""
    return period if system.period is None else exact(system.period)
