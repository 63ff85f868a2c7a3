"""Occurrences of a trace: the time of all violations, and of the verdict with the body."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import worker

import rtamt

BODIES = {
    "predicate": "x < 1",
    "response": "y > 2 implies eventually[0:10](x > 1)",
    "until": "y > 2 implies (x > -2 until[0:10] x > 1)",
    "past": "once[0:50](y > 1) or x < 1",
    "window": "eventually[0:100](x > 1)",
    "endless": "x < 1 until y > 2",
    "alternating": "x < 1",
}


def signals(n: int, *, dense: bool, alternating: bool = False) -> dict[str, Any]:
    """Return random values of two variables; in dense time at irregular times.

    Args:
        n: The number of samples, or of events of each variable.
        dense: Whether time is dense.
        alternating: Whether every other value of x violates ``x < 1``.
    """
    noise = np.random.default_rng([11, n])
    values = dict(zip("xy", noise.standard_normal((2, n)), strict=True))
    if alternating:
        values["x"] = np.abs(values["x"]) + np.arange(n) % 2 * 2 - 1
        values["x"][::2] = np.minimum(values["x"][::2], 0.5)
    if not dense:
        return values
    times = np.cumsum(noise.integers(1, 5, n)) / 10
    return {name: rtamt.dense.Events(times, column) for name, column in values.items()}


def best(function: Callable[[], object], times: int) -> float:
    """Return the minimum processor time of several calls, in microseconds."""
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        function()
        seconds.append(time.process_time() - begin)
    return 1e6 * min(seconds)


def measure(case: worker.Case) -> worker.Measure:
    """Return the times of verdict with body and of occurrences, and the number of rows."""
    body, n, times, dense = BODIES[case["kind"]], case["n"], case["times"], case["dense"]
    trace = signals(n, dense=dense, alternating=case["kind"] == "alternating")
    spec = f"always({body})"
    api: Any = rtamt.dense if dense else rtamt
    (result,) = api.occurrences(spec, trace).bodies
    rows = float(len(result.violations) + len(result.responses))

    def run() -> list[float]:
        base = best(lambda: api.judge(spec, trace), times)
        base += best(lambda: api.evaluate(body, trace), times)
        return [base, best(lambda: api.occurrences(spec, trace), times), rows]

    return run


if __name__ == "__main__":
    worker.serve({"occurrences": measure})
