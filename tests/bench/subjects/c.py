"""The floor: the same work in C, called from Python with minimum cost; complete traces in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cdense
import cfloor
import numpy as np
import traces
import worker


def rows(trace: traces.Columns, _start: int) -> Any:  # noqa: ANN401
    return traces.rows(trace)


def mappings(trace: traces.Columns, _start: int) -> Any:  # noqa: ANN401
    return [dict(zip(trace, row, strict=True)) for row in traces.rows(trace)]


def feeder(update: Callable[..., object]) -> Callable[[Any], object]:
    def feed(data: Any) -> None:  # noqa: ANN401
        for x, y in data:
            update(x, y)

    return feed


def update(case: worker.Case) -> worker.Measure:
    if case["kind"] != "w1":
        msg = "the floor of an update is the sliding minimum"
        raise ValueError(msg)
    wedge = cfloor.Wedge(case.get("k") or 0)
    if case["form"] == "mapping":
        update = wedge.update_dict

        def feed(data: Any) -> None:  # noqa: ANN401
            for sample in data:
                update(sample)

        return worker.stream(case, feed, mappings)
    call = wedge.nothing if case["form"] == "nothing" else wedge.update
    return worker.stream(case, feeder(call), rows)


def worst(case: worker.Case) -> worker.Measure:
    def make() -> Callable[[Any], object]:
        update = cfloor.Wedge(case["k"]).update
        return lambda sample: update(*sample)

    return worker.single_updates(case, make, rows)


def memory(case: worker.Case) -> worker.Measure:
    return worker.memory(case, lambda k: feeder(cfloor.Wedge(k).update), rows)


def offline(case: worker.Case) -> worker.Measure:
    kind, n, k = case["kind"], case["n"], case["k"]
    first, second = traces.columns(kind, 0, n).values()
    if case["backend"] == "numpy":
        return worker.whole(lambda: NUMPY[kind](first, second, k), n)
    out = np.empty(n)
    number = ("w1", "resp", "nested").index(kind)
    return worker.whole(lambda: cfloor.offline(number, k, first, second, out), n)


def window(x: Any, reach: int, fold: np.ufunc) -> Any:  # noqa: ANN401
    """Return a fold over [t, t + reach] by doubling; the last value pads the trace."""
    x = np.concatenate([x, np.full(reach, x[-1])])
    length = 1
    while 2 * length <= reach + 1:
        x = fold(x[:-length], x[length:])
        length *= 2
    remainder = reach + 1 - length
    return fold(x[: len(x) - remainder], x[remainder:])


def always(x: Any) -> Any:  # noqa: ANN401
    return np.minimum.accumulate(x[::-1])[::-1]


def resp(req: Any, gnt: Any, _k: int) -> Any:  # noqa: ANN401
    return always(np.maximum(3 - req, window(gnt - 3, 5, np.maximum)))


def nested(cmd: Any, pos: Any, _k: int) -> Any:  # noqa: ANN401
    near = window(0.1 - np.abs(cmd - pos), 50, np.minimum)
    return always(np.maximum(1 - cmd, window(near, 200, np.maximum)))


NUMPY: dict[str, Callable[..., Any]] = {
    "w1": lambda a, b, k: window(a + b + 2, k, np.minimum),
    "resp": resp,
    "nested": nested,
}


def batch(case: worker.Case) -> worker.Measure:
    if case["kind"] != "w1" or case["monitor"] != "step":
        msg = "the floor of batches is the sliding minimum"
        raise ValueError(msg)
    wedges, out = [cfloor.Wedge(case["k"]) for _ in range(case["num"])], np.empty(case["num"])
    return worker.batch(case, lambda rows: cfloor.batch(wedges, rows, out))


def dense(case: worker.Case) -> worker.Measure:
    steps = cdense.Steps(1.0)
    call = steps.update if case["chunk"] == 1 else steps.update_array

    def feed(data: Any) -> None:  # noqa: ANN401
        for events in data:
            call(events)

    def pairs(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        return {"s": list(zip(times.tolist(), only(case, trace).tolist(), strict=True))}

    def arrays(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        return {"s": np.stack([times, only(case, trace)], axis=1)}

    return worker.events(case, feed, pairs if case["chunk"] == 1 else arrays, 1)


def only(case: worker.Case, trace: traces.Columns) -> Any:  # noqa: ANN401
    if case["kind"] != "always":
        msg = "the floor of dense time is the sliding minimum of a signal"
        raise ValueError(msg)
    return trace["s"]


def dense_offline(case: worker.Case) -> worker.Measure:
    n = case["n"]
    values, times = only(case, traces.columns(case["kind"], 0, n)), traces.moments(0, n)
    return worker.whole(lambda: cdense.Steps(1.0).run(times, values, np.empty(2 * n + 2)), n)


worker.serve(
    {
        "update": update,
        "worst": worst,
        "memory": memory,
        "offline": offline,
        "dense": dense,
        "dense offline": dense_offline,
        "batches": batch,
    }
)
