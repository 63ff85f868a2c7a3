"""What dense time costs: a whole trace its length, an event the same in any window."""

import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import rtamt
from rtamt.machines.backend import Backend

BACKENDS: list[Backend] = ["python", "native"] if rtamt.BACKEND == "native" else ["python"]
backends = pytest.mark.parametrize("backend", BACKENDS)


def table(n: int) -> NDArray[np.float64]:
    """Events at irregular times, one in a unit of time on average."""
    random = np.random.default_rng(5)
    return np.column_stack([np.cumsum(random.uniform(0.5, 1.5, n)), random.standard_normal(n)])


def seconds(call: Callable[[], object]) -> float:
    """Time of the processor, of which a busy machine takes nothing away."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


def ratio(one: Callable[[], object], other: Callable[[], object]) -> float:
    """Time of one over time of the other, the least of some turns each."""
    turns = [(seconds(one), seconds(other)) for _ in range(5)]
    return min(a for a, _ in turns) / min(b for _, b in turns)


@backends
@pytest.mark.parametrize(
    "text",
    [
        "always((x > 1) implies eventually[0:200](x < 0))",
        "(x > -1) until[50:200] (x > 1)",
        "(x > -1) since (x > 1)",
        "eventually[3:inf] always (x > -1)",
    ],
)
def test_a_whole_trace_costs_its_length(text: str, backend: Backend) -> None:
    n = 200_000 if backend == "native" else 600
    short, long = ({"x": rtamt.Events(*table(k).T)} for k in (n, 4 * n))
    spec = rtamt.parse(text)
    seen = ratio(
        lambda: rtamt.evaluate_dense(spec, long, backend=backend),
        lambda: rtamt.evaluate_dense(spec, short, backend=backend),
    )
    assert seen <= 4 * 2


@backends
def test_an_event_costs_the_same_in_any_window(backend: Backend) -> None:
    n = 20_000 if backend == "native" else 2_000
    rows = table(2 * n).tolist()

    def fed(window: int) -> Callable[[], None]:
        monitor = rtamt.DenseMonitor(f"always[0:{window}](x > -2)", backend=backend)
        monitor.update({"x": rows[:n]})
        state = monitor.__reduce__()[2]

        def feed() -> None:
            monitor.__setstate__(state)
            for row in rows[n : n + 1000]:
                monitor.update({"x": [row]})

        return feed

    assert ratio(fed(n // 2), fed(20)) <= 3
