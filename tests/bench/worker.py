"""Runs inside the process of a subject: prepares a case, then measures it when asked."""

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
                measure = None  # frees what the last case held before the next is built
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
    """Nanoseconds for each sample of chunk after chunk, once the windows are full.

    Args:
        case: ``kind`` of the trace, samples to ``fill``, ``seconds`` for a chunk.
        feed: Gives every input to the monitor in a tight loop.
        inputs: Makes the inputs of a chunk, outside of what is timed.
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
    while position < case["fill"]:  # growing chunks: a slow tool is noticed by its time limit
        timed(min(n, case["fill"] - position))
        n = min(2 * n, FILL_CHUNK)
    n, each = 16, timed(16)
    while n * each < case["seconds"] * 2.5e8 and n < 50_000:
        n *= 2
        each = timed(n)
    n = min(50_000, max(16, int(case["seconds"] * 1e9 / each)))
    return lambda: timed(n)


def events(
    case: Case,
    feed: Callable[[Sequence[Any]], object],
    inputs: Callable[[Any, traces.Columns], Any],
    variables: int,
) -> Measure:
    """Nanoseconds for each event of a stream of events that come in chunks.

    Args:
        case: As for `stream`, and the size of a ``chunk``.
        feed: Gives every input to the monitor in a tight loop.
        inputs: Makes an input of times and of the variables' values then.
        variables: How many have an event at each of the times.
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
    """Worst single updates while the window fills and once it is full, in ns, over all passes.

    Each pass starts from a new monitor, so that passes are identical, and the element-wise minimum
    over them leaves what belongs to the code, not to the operating system.
    """
    import numpy as np

    k = case["k"]
    least = np.full(2 * (k + 1), np.inf)
    clock_costs = _clock()
    passes = 0

    def measure() -> list[float]:
        nonlocal passes
        update, clock = make(), time.perf_counter_ns
        # the first sample after a chunk was made finds cold caches: each pass cuts elsewhere
        cuts = range(FILL_CHUNK - 1009 * passes, len(least), FILL_CHUNK)
        passes += 1
        for start, end in itertools.pairwise([0, *cuts, len(least)]):
            # nothing is kept but in this array: a page that the harness touches first costs 1 us
            times = array.array("q", bytes(8 * (end - start)))
            samples = inputs(traces.columns("saw", start, end - start, k), start)
            for i, sample in enumerate(samples):
                begin = clock()
                update(sample)
                times[i] = clock() - begin
            np.minimum(least[start:end], times, out=least[start:end])
        # the very first updates run code that was never run before
        return [float(part.max()) - clock_costs for part in (least[16 : k + 1], least[k + 1 :])]

    return measure


def _clock() -> float:
    clock = time.perf_counter_ns
    return min(-(clock() - clock()) for _ in range(1000))


def whole(run: Callable[[], object], n: int) -> Measure:
    """Nanoseconds for each of n samples of a call that takes them all."""

    def measure() -> float:
        begin = time.perf_counter_ns()
        run()
        return (time.perf_counter_ns() - begin) / n

    run()
    return measure


def calls(run: Callable[[], Sequence[float]], count: int) -> Measure:
    """Microseconds of processor time for each trace of a call, and the robustness of each."""

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
    """Nanoseconds for each entry of a step of many entries.

    Args:
        case: ``kind`` of the trace, ``num`` entries, steps to ``fill``, ``seconds`` for a measure.
        step: Takes a sample in every entry.
        inputs: Makes what it takes of an array of shape (num, variables).
    """
    import numpy as np

    num, steps = case["num"], 64
    trace = np.stack(list(traces.columns(case["kind"], 0, num * steps).values()), axis=1)
    # each entry has a stretch of the trace of its own
    data = [inputs(rows) for rows in trace.reshape(num, steps, -1).transpose(1, 0, 2).copy()]

    def timed(n: int) -> float:
        chunk = [data[i % steps] for i in range(n)]
        begin = time.perf_counter_ns()
        for rows in chunk:
            step(rows)
        return (time.perf_counter_ns() - begin) / (n * num)

    for _ in range(0, case["fill"], steps):
        each = timed(steps)
    n = max(8, int(case["seconds"] * 1e9 / (each * num)))
    return lambda: timed(n)


def resident() -> int:
    """Bytes of memory that the process holds."""
    with open("/proc/self/statm") as file:  # noqa: PTH123 - peers' interpreters, short and plain
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def memory(
    case: Case,
    make: Callable[[int], Callable[[Iterable[Any]], object]],
    inputs: Callable[[traces.Columns, int], Any],
) -> Measure:
    """Bytes of memory for each sample of the window, and allocations for each update.

    Allocations are calls of the C allocator, counted by the preloaded library of the floor.
    """
    k, kind = case["k"], case["kind"]

    def chunk(start: int, n: int) -> Any:  # noqa: ANN401 - what the tool takes
        return inputs(traces.columns(kind, start, n, k), start)

    size, warm = 4096, 10_000
    make(1)(chunk(0, size))  # what is loaded or cached once is no part of the window
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
    each = (counter.value - begin) / warm
    return lambda: [held, each]
