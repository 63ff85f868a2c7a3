"""An update costs the same at any window and at any time; a whole trace costs its length.

Ratios only, with wide margins. A busy machine slows one side now and then, so a ratio is taken
again before it counts; a cost that grows is there every time.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import rtamt
from rtamt.machines.backend import Backend

BACKENDS: list[Backend] = ["python", "native"] if rtamt.BACKEND == "native" else ["python"]
ATTEMPTS = 4
RESPONSE = "always((a > 1) implies eventually[0:5](b > 0))"

backends = pytest.mark.parametrize("backend", BACKENDS)


def noise(n: int) -> NDArray[np.float64]:
    return np.random.default_rng(7).standard_normal((n, 2))


def seconds(call: Callable[[], object]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def ratio(one: Callable[[], object], other: Callable[[], object], margin: float) -> float:
    """Time of one over time of other, the least of some turns each; taken again if above."""
    seen = float("inf")
    for _ in range(ATTEMPTS):
        turns = [(seconds(one), seconds(other)) for _ in range(5)]
        seen = min(seen, min(a for a, _ in turns) / min(b for _, b in turns))
        if seen <= margin:
            break
    return seen


def feeder(
    monitor: rtamt.Monitor | rtamt.EpisodeMonitor, rows: list[list[float]]
) -> Callable[[], None]:
    def feed() -> None:
        update = monitor.update
        for a, b in rows:
            update(a, b)

    return feed


@backends
def test_update_costs_the_same_at_any_window(backend: Backend) -> None:
    rows = noise(2_000).tolist()

    def full(k: int) -> Callable[[], None]:
        monitor = rtamt.Monitor(f"always[0:{k}](a + b > -2)", backend=backend)
        monitor.update_many(noise(k + 1))
        return feeder(monitor, rows)

    assert ratio(full(100_000), full(100), margin=2.5) <= 2.5


@backends
def test_episode_update_costs_the_same_late_as_early(backend: Backend) -> None:
    rows = noise(50).tolist()
    fresh, old = (rtamt.EpisodeMonitor(RESPONSE, backend=backend) for _ in range(2))
    for a, b in noise(2_000).tolist():
        old.update(a, b)

    def early() -> None:
        fresh.reset()
        feed_fresh()

    feed_fresh = feeder(fresh, rows)
    assert ratio(feeder(old, rows), early, margin=1.5) <= 1.5


@backends
def test_evaluate_is_linear_in_the_length_of_the_trace(backend: Backend) -> None:
    n = 200_000 if backend == "native" else 2_000
    short, long = noise(n), noise(4 * n)
    spec = rtamt.parse("always((a > 1) implies eventually[0:200] always[0:50] (b > -1))")
    margin = 4 * 2.0
    seen = ratio(
        lambda: rtamt.evaluate(spec, long, backend=backend),
        lambda: rtamt.evaluate(spec, short, backend=backend),
        margin,
    )
    assert seen <= margin


def events(start: int, n: int) -> dict[str, rtamt.Events]:
    times = np.arange(start, start + n) / 100
    return {name: rtamt.Events(times, v) for name, v in zip("ab", noise(n).T, strict=True)}


@backends
def test_dense_update_costs_the_same_while_a_variable_runs_ahead(backend: Backend) -> None:
    n = 60_000 if backend == "native" else 20_000
    ahead = events(0, n)

    def late(lead: int) -> Callable[[], None]:
        monitor = rtamt.DenseMonitor("always[0:1](a + b > -2)", backend=backend)
        monitor.update({"a": ahead["a"][:lead], "b": ahead["b"][:1]})
        fresh = iter(zip(ahead["b"].times.tolist(), ahead["b"].values.tolist(), strict=True))
        next(fresh)

        def feed() -> None:
            for _ in range(50):
                monitor.update({"b": [next(fresh)]})

        return feed

    assert ratio(late(n), late(n // 20), margin=3) <= 3
