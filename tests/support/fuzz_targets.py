"""The Python functions that fuzzers call: each takes any bytes, and raises only for a defect.

To add a target, add a function and a row of `TARGETS` here. For C++, add a file in
``tests/fuzz/native`` and its name to the ``CMakeLists.txt`` there. Then add the name to
``tests/fuzz/fuzzing.py`` and inputs to ``tests/fuzz/corpus/NAME``.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import oracle

import rtamt
from rtamt import Formula, Interval, number, variable
from rtamt.language.formula import make
from rtamt.language.operators import OPERATORS
from rtamt_gym.recorded.bag_reader import open_bag
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.trace_files import read_trace

LIMIT = 1 << 14
"""Longer inputs find the same faults more slowly."""


class Bytes:
    """Bytes as choices and numbers; after the last one, all are 0."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    @property
    def empty(self) -> bool:
        return self.at >= len(self.data)

    def byte(self) -> int:
        self.at += 1
        return 0 if self.at > len(self.data) else self.data[self.at - 1]

    def of(self, choices: Any) -> Any:  # noqa: ANN401 - any sequence
        return choices[self.byte() % len(choices)]

    def rest(self) -> bytes:
        return self.data[self.at :]


def specification(data: bytes) -> None:
    """A text is an error with its position, or its formula can be written and read again."""
    text = data[:LIMIT].decode("utf-8", "replace")
    try:
        read = rtamt.parse(text)
    except rtamt.errors.SpecificationError:
        return
    again = rtamt.parse(str(read))
    assert str(again) == str(read)
    assert again.formula == read.formula


MONITORS: tuple[Callable[[], Any], ...] = (
    lambda: rtamt.Monitor("y = once[0:9](x > 2); next(historically[3:9](x > 1)) and y"),
    lambda: rtamt.Monitor("(x > 0) until[2:9] (x > 1)"),
    lambda: rtamt.EpisodeMonitor("always((x > 0) implies eventually[0:5](x > 1))"),
    lambda: rtamt.EpisodeMonitor("always[5:inf](prev(historically[0:7](x > 0)))"),
    lambda: rtamt.EpisodeMonitor("always((x > 0) until[3:9] (once[2:8](x > 1)))"),
    lambda: rtamt.VectorMonitor("historically[1:7](x > 0)", 3),
    lambda: rtamt.VectorEpisodeMonitor("always((x > 0) implies eventually[0:5](x > 1))", 3),
    lambda: rtamt.dense.Monitor("always[0:3](x > 0) or once[1:2](x > 1)"),
    lambda: rtamt.dense.EpisodeMonitor("always((x > 0) implies eventually[0:3](x > 1))"),
)


def snapshot(data: bytes) -> None:
    """A state from no machine is an error that leaves the monitor as it was, or is usable."""
    bytes_ = Bytes(data)
    monitor = bytes_.of(MONITORS)()
    for i in range(bytes_.byte() % 24):
        _feed(monitor, i)
    state = bytearray(monitor._machine.state())
    for _ in range(1 + bytes_.byte() % 4):
        place, kind = bytes_.byte() * 256 + bytes_.byte(), bytes_.byte()
        if kind < 192:
            state[place % len(state)] ^= 1 << kind % 8
        elif kind < 224:
            del state[place % len(state) :]
        else:
            state[place % len(state)] = bytes_.byte()
        if not state:
            break
    before = monitor._machine.state()
    try:
        monitor._machine.restore(bytes(state))
    except (ValueError, TypeError):
        assert monitor._machine.state() == before
        return
    assert monitor._machine.state()
    for i in range(40):
        try:
            _feed(monitor, 100 + i)
        except (ValueError, rtamt.errors.RtamtError):
            return


def _feed(monitor: Any, i: int) -> None:  # noqa: ANN401 - any monitor
    value = math.sin(i * 1.7) * 3
    if isinstance(monitor, rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor):
        monitor.update({"x": [(i / 2, value)]})
    elif isinstance(monitor, rtamt.VectorMonitor | rtamt.VectorEpisodeMonitor):
        monitor.update(np.full((3, 1), value))
    else:
        monitor.update(value)


FORMATS = ("csv", "jsonl", "npz", "parquet", "feather", "mcap", "db3", "bag", "ulg", "csv.gz")


def trace(data: bytes) -> None:
    """A file is an error with its name and a reason, or its columns are numbers."""
    if not data:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"trace.{FORMATS[data[0] % len(FORMATS)]}"
        path.write_bytes(data[1:LIMIT])
        try:
            if path.suffix in {".mcap", ".db3", ".bag"}:
                with open_bag(str(path)) as bag:
                    assert bag.counts
            else:
                with open_recording(str(path)) as recording:
                    names = [name for name in recording.names if name != "time"]
                    read = read_trace(recording, names[:1])
                assert all(column.dtype == float for column in read.columns.values())
        except rtamt.errors.RtamtError:
            return


_FUTURE = tuple(name for name, row in OPERATORS.items() if row.operands == "formula")
_VALUES = (0.0, -0.0, 0.0, 1.0, -1.0, 2.0, -2.0, 0.25, -0.5, 3.0, 7.5, math.inf, -math.inf)


def equality(data: bytes) -> None:
    """Both back-ends return the robustness and bounds of the definition, bit by bit."""
    bytes_ = Bytes(data[:512])
    formula = _formula(bytes_, 3)
    n = 1 + bytes_.byte() % 12
    names = sorted(formula.variables) or ["a"]
    signals = {name: [float(bytes_.of(_VALUES)) for _ in range(n)] for name in names}
    expected = _bits(oracle.robustness(formula, signals, n))
    for backend in ("python", "native"):
        found = rtamt.evaluate(formula, signals, n=n, backend=backend)
        assert _bits(found) == expected, (str(formula), signals, backend)
    monitors = [_episode(formula, backend) for backend in ("python", "native")]
    assert (monitors[0] is None) == (monitors[1] is None)
    if None in monitors:
        return
    for i in range(n):
        for monitor in monitors:
            monitor.update({name: signals[name][i] for name in monitor.variables})
        seen = {name: signals[name][: i + 1] for name in names}
        one, other = ([m.robustness, m.lower, m.upper] for m in monitors)
        assert _bits(one) == _bits(other), (str(formula), seen)
        assert _bits(one[:1]) == _bits(oracle.robustness(formula, seen, i + 1)[:1])
        assert one[1] <= one[0] <= one[2]


def _episode(formula: Formula, backend: str) -> Any:  # noqa: ANN401 - a monitor, or None
    """Return the monitor of an episode; None if unbounded operators are nested too deeply."""
    try:
        return rtamt.EpisodeMonitor(formula, backend=cast("Any", backend))
    except rtamt.errors.SpecificationError:
        return None


def _bits(values: Any) -> list[int]:  # noqa: ANN401 - anything that NumPy takes
    return [int(each) for each in np.asarray(values, dtype=float).view(np.uint64)]


def _formula(bytes_: Bytes, depth: int) -> Formula:
    if depth == 0 or bytes_.empty or bytes_.byte() % 4 == 0:
        left, right = variable(bytes_.of("abc")), number(float(bytes_.byte() % 5 - 2))
        return cast(
            "Formula", bytes_.of((left > right, left <= right, left >= right, left < right))
        )
    name = bytes_.of(_FUTURE)
    row = OPERATORS[name]
    operands = [_formula(bytes_, depth - 1) for _ in range(row.arity[0])]
    interval = None
    if row.timed and bytes_.byte() % 3:
        begin = bytes_.byte() % 4
        interval = Interval.of(begin, begin + bytes_.byte() % 4)
    return cast("Formula", make(name, tuple(operands), interval))


TARGETS: dict[str, Callable[[bytes], None]] = {
    "specification": specification,
    "snapshot": snapshot,
    "trace": trace,
    "equality": equality,
}
