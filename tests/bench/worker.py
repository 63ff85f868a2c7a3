"""The loop in the process of a subject: it prepares a case, then measures it on request."""

from __future__ import annotations

import array
import gc
import itertools
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import traces

Case = dict[str, Any]
Measure = Callable[[], float | list[float]]
FILL_CHUNK = 65_536


def serve(cases: dict[str, Callable[[Case], Measure]]) -> None:
    """Answer requests, one JSON line each, until standard input ends."""
    answers, sys.stdout = os.fdopen(os.dup(1), "w"), sys.stderr
    gc.disable()
    measure: Measure | None = None
    for line in sys.stdin:
        case = json.loads(line)
        answer: Any
        try:
            if case is None:
                answer = measure() if measure else None
            else:
                measure = None  # free the last case before the next one is built
                gc.collect()
                measure = cases[case["what"]](case)
                answer = True
        except Exception as error:  # noqa: BLE001 - the figure is left out, and its reason shown
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


def stream(
    case: Case,
    feed: Callable[[Sequence[Any]], object],
    inputs: Callable[[traces.Columns, int], Any],
) -> Measure:
    """Return nanoseconds per sample of successive chunks, once the windows are full.

    Args:
        case: ``kind`` of the trace, samples to ``fill``, ``seconds`` for a chunk.
        feed: Updates the monitor with every input in a tight loop.
        inputs: Builds the inputs of a chunk, outside the timed part.
    """
    position = 0

    def timed(n: int) -> float:
        nonlocal position
        data = inputs(traces.columns(case["kind"], position, n), position)
        position += n
        begin = time.perf_counter_ns()
        feed(data)
        return (time.perf_counter_ns() - begin) / n

    n = 64
    while position < case["fill"]:  # growing chunks, so that the time limit stops a slow tool
        timed(min(n, case["fill"] - position))
        n = min(2 * n, FILL_CHUNK)
    n, per_sample = 16, timed(16)
    while n * per_sample < case["seconds"] * 2.5e8 and n < 50_000:
        n *= 2
        per_sample = timed(n)
    n = min(50_000, max(16, int(case["seconds"] * 1e9 / per_sample)))
    return lambda: timed(n)


def events(
    case: Case,
    feed: Callable[[Sequence[Any]], object],
    inputs: Callable[[Any, traces.Columns], Any],
    variables: int,
) -> Measure:
    """Return nanoseconds per event of a stream of events in chunks.

    Args:
        case: As for `stream`, and the size of a ``chunk``.
        feed: Updates the monitor with every input in a tight loop.
        inputs: Builds an input from times and the values of the variables.
        variables: The number of variables with an event at each time.
    """

    def chunks(trace: traces.Columns, start: int) -> Any:  # noqa: ANN401
        size = len(next(iter(trace.values())))
        times = traces.moments(start, size)
        parts = [slice(i, i + case["chunk"]) for i in range(0, size, case["chunk"])]
        return [inputs(times[p], {name: v[p] for name, v in trace.items()}) for p in parts]

    measure = stream(case, feed, chunks)
    return lambda: float(measure()) / variables  # type: ignore[arg-type] # one figure


def single_updates(
    case: Case, make: Callable[[], Callable[[Any], object]], inputs: Callable[..., Any]
) -> Measure:
    """Return the worst single updates while the window fills and when it is full, in ns.

    Each pass starts with a new monitor, so passes are identical. The element-wise minimum over them
    keeps the cost of the code and removes the noise of the operating system.
    """
    import numpy as np

    k = case["k"]
    least = np.full(2 * (k + 1), np.inf)
    clock_costs = _clock()
    passes = 0

    def measure() -> list[float]:
        nonlocal passes
        update, clock = make(), time.perf_counter_ns
        # the first sample after a chunk has cold caches, so each pass cuts at other places
        cuts = range(FILL_CHUNK - 1009 * passes, len(least), FILL_CHUNK)
        passes += 1
        for start, end in itertools.pairwise([0, *cuts, len(least)]):
            # write only to this array: the first touch of a page by the harness costs 1 us
            times = array.array("q", bytes(8 * (end - start)))
            samples = inputs(traces.columns("saw", start, end - start, k), start)
            for i, sample in enumerate(samples):
                begin = clock()
                update(sample)
                times[i] = clock() - begin
            np.minimum(least[start:end], times, out=least[start:end])
        # the first updates run code that never ran before
        return [float(part.max()) - clock_costs for part in (least[16 : k + 1], least[k + 1 :])]

    return measure


def _clock() -> float:
    clock = time.perf_counter_ns
    return min(-(clock() - clock()) for _ in range(1000))


def whole(run: Callable[[], object], n: int) -> Measure:
    """Return nanoseconds per sample of a call that takes all n samples."""

    def measure() -> float:
        begin = time.perf_counter_ns()
        run()
        return (time.perf_counter_ns() - begin) / n

    run()
    return measure


def calls(run: Callable[[], Sequence[float]], count: int) -> Measure:
    """Return processor microseconds per trace of a call, and the robustness of each."""

    def measure() -> list[float]:
        begin = time.process_time_ns()
        values = run()
        return [(time.process_time_ns() - begin) / count / 1e3, *map(float, values)]

    return measure


def batch(
    case: Case,
    step: Callable[[Any], object],
    inputs: Callable[[Any], Any] = lambda rows: rows,
) -> Measure:
    """Return nanoseconds per entry of a step of many entries.

    Args:
        case: ``kind`` of the trace, ``num`` entries, steps to ``fill``, ``seconds`` for a
            measurement.
        step: Takes a sample in every entry.
        inputs: Converts an array of shape (num, variables) to the argument of ``step``.
    """
    import numpy as np

    num, steps = case["num"], 64
    trace = np.stack(list(traces.columns(case["kind"], 0, num * steps).values()), axis=1)
    # each entry has its own part of the trace
    data = [inputs(rows) for rows in trace.reshape(num, steps, -1).transpose(1, 0, 2).copy()]

    def timed(n: int) -> float:
        chunk = [data[i % steps] for i in range(n)]
        begin = time.perf_counter_ns()
        for rows in chunk:
            step(rows)
        return (time.perf_counter_ns() - begin) / (n * num)

    for _ in range(0, case["fill"], steps):
        per_step = timed(steps)
    n = max(8, int(case["seconds"] * 1e9 / (per_step * num)))
    return lambda: timed(n)


def resident() -> int:
    """Return the bytes of memory that the process holds."""
    with open("/proc/self/statm") as file:  # noqa: PTH123 - peers' interpreters, short and plain
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def memory(
    case: Case,
    make: Callable[[int], Callable[[Iterable[Any]], object]],
    inputs: Callable[[traces.Columns, int], Any],
) -> Measure:
    """Return bytes of memory per sample of the window, and allocations per update.

    The preloaded library of the floor counts calls of the C allocator.
    """
    k, kind = case["k"], case["kind"]

    def chunk(start: int, n: int) -> Any:  # noqa: ANN401 - what the tool takes
        return inputs(traces.columns(kind, start, n, k), start)

    size, warm = 4096, 10_000
    make(1)(chunk(0, size))  # code and caches of the first use are not part of the window
    gc.collect()
    before = resident()
    feed = make(k)
    for start in range(0, k + 1, size):
        feed(chunk(start, size))
    gc.collect()
    held = (resident() - before) / (k + 1)
    import ctypes

    counter = ctypes.c_uint64.in_dll(ctypes.CDLL(None), "rtamt_bench_allocations")
    first, second = chunk(start + size, warm), chunk(start + size + warm, warm)
    feed(first)
    begin = counter.value
    feed(second)
    allocations = (counter.value - begin) / warm
    return lambda: [held, allocations]
