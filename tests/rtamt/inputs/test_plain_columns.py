"""Plain arrays in a dictionary, which have a fast path, equal lists."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bits import identical

from rtamt import Monitor, RtamtError, evaluate, judge

X, Y = np.array([1.0, 2.0, -1.0]), np.array([0.5, -0.0, 3.0])
NAN = np.array([1.0, np.nan, 2.0])
TRACES: dict[str, dict[str, Any]] = {
    "plain": {"x": X, "y": Y},
    "lengths": {"x": X, "y": Y[:2]},
    "scalars": {"x": np.array(1.0), "y": np.array(2.0)},
    "integers": {"x": np.array([1, 2, 3]), "y": Y},
    "float32": {"x": X.astype(np.float32), "y": Y},
    "strided": {"x": np.arange(6.0)[::2], "y": Y[::-1]},
    "others": {"x": X, "y": Y, "z": X},
    "missing": {"x": X},
    "nan": {"x": NAN, "y": Y},
    "empty": {"x": X[:0], "y": Y[:0]},
}
READERS: dict[str, Callable[[Any], Any]] = {
    "evaluate": lambda trace: evaluate("x > 0 or y > 1", trace).tolist(),
    "length": lambda trace: evaluate("x > 0 or y > 1", trace, n=2).tolist(),
    "rate": lambda trace: evaluate("rate(x) > 0 or y > 1", trace, 1.0).tolist(),
    "hold": lambda trace: evaluate("x > 0 or y > 1", trace, nan="hold").tolist(),
    "judge": lambda trace: str(judge("always(x > 0 or y > 1)", trace)),
    "unknown": lambda trace: str(judge("always(x > 0 or y > 1)", trace, nan="unknown")),
    "monitor": lambda trace: Monitor("x > 0 or y > 1").update_many(trace).tolist(),
}


def outcome(read: Callable[[Any], Any], trace: Any) -> Any:  # noqa: ANN401 - of any reader
    try:
        return read(trace)
    except RtamtError as error:
        return f"{type(error).__name__}: {error}"


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", TRACES)
def test_arrays_are_read_as_lists(name: str, reader: str) -> None:
    trace = TRACES[name]
    lists = {key: column.tolist() for key, column in trace.items()}
    expected, got = (outcome(READERS[reader], each) for each in (lists, trace))
    if isinstance(expected, list):
        assert identical(got, expected)
    else:
        assert got == expected
