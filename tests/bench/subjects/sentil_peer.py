"""sentil: one monitor, samples as lists (packed) or mappings, times as floats."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import sentil
import traces
import worker

FORMULAS = {
    "w1": "always[0,{k}] (a + b > -2)",
    "saw": "always[0,{k}] (a + b > -2)",
    "resp": "always ((req >= 3) -> eventually[0,5] (gnt >= 3))",
    "nested": "always ((cmd >= 1) -> eventually[0,200] (always[0,50] (abs(cmd - pos) < 0.1)))",
    "until": "(a > 0) until[0,{k}] (b > 0)",
    "since": "(a > 0) since[0,{k}] (b > 0)",
    "invariant": "always (a + b > -2)",
}


def formula(case: worker.Case) -> str:
    text = FORMULAS[case.get("formula", case["kind"])].format(k=case.get("k"))
    outside = case.get("monitor") == "episode" and not text.startswith("always (")
    return f"always ({text})" if outside else text


def packed(trace: traces.Columns, start: int) -> Any:  # noqa: ANN401
    trace = dict(sorted(trace.items()))  # its symbols are in alphabetical order
    return [(float(start + i), list(row)) for i, row in enumerate(traces.rows(trace))]


def mappings(trace: traces.Columns, start: int) -> Any:  # noqa: ANN401
    return [
        (float(start + i), dict(zip(trace, row, strict=True)))
        for i, row in enumerate(traces.rows(trace))
    ]


def feeder(update: Callable[..., Any], form: str) -> Callable[[Any], object]:
    def value(data: Any) -> None:  # noqa: ANN401
        for time, sample in data:
            update(time, sample).value  # noqa: B018 - what is measured is reading

    def bounds(data: Any) -> None:  # noqa: ANN401
        for time, sample in data:
            result = update(time, sample)
            result.value, result.lower, result.upper, result.resolved  # noqa: B018

    return bounds if form == "verdicts" else value


def update(case: worker.Case) -> worker.Measure:
    monitor, form = sentil.OnlineMonitor(formula(case)), case["form"]
    if form == "mapping":
        return worker.stream(case, feeder(monitor.update, form), mappings)
    return worker.stream(case, feeder(monitor.update_packed, form), packed)


def worst(case: worker.Case) -> worker.Measure:
    def make() -> Callable[[Any], object]:
        update = sentil.OnlineMonitor(formula(case)).update_packed
        return lambda sample: update(*sample)

    return worker.single_updates(case, make, packed)


def memory(case: worker.Case) -> worker.Measure:
    def make(k: int) -> Callable[[Any], object]:
        return feeder(sentil.OnlineMonitor(formula(case | {"k": k})).update_packed, "positional")

    return worker.memory(case, make, packed)


def offline(case: worker.Case) -> worker.Measure:
    trace = traces.columns(case["kind"], 0, case["n"])
    parsed, times = sentil.Formula.parse(formula(case)), np.arange(case["n"], dtype=float)
    return worker.whole(lambda: parsed.robustness_signal(sentil.Trace(times, trace)), case["n"])


def batch(case: worker.Case) -> worker.Measure:
    updates = [sentil.OnlineMonitor(formula(case)).update_packed for _ in range(case["num"])]
    order, now = np.argsort(traces.VARIABLES[case["kind"]]), 0.0

    def step(rows: Any) -> None:  # noqa: ANN401
        nonlocal now
        now += 1.0
        for update, row in zip(updates, rows, strict=True):
            update(now, row).value  # noqa: B018 - what is measured is reading

    return worker.batch(case, step, lambda rows: rows[:, order].tolist())


CALLS = {
    "invariant": "always (x < 2.5)",
    "resp": "always ((a > 2) -> eventually[0,10] (b > 1))",
}


def calls(case: worker.Case) -> worker.Measure:
    formula, data = sentil.Formula.parse(CALLS[case["kind"]]), traces.short(case["count"])
    robustness, trace, times = formula.robustness, sentil.Trace, np.arange(200.0)
    if case["form"] == "ready":
        ready = [trace(times, columns) for columns in data]
        return worker.calls(lambda: [robustness(one) for one in ready], len(data))
    return worker.calls(lambda: [robustness(trace(times, one)) for one in data], len(data))


DENSE = {
    "always": "always[0,1.0] (s > -2)",
    "sum": "always[0,1.0] (a + b > -2)",
    "resp": "(req >= 3) -> eventually[0,1.0] (gnt >= 3)",
    "until": "(a > 0) until[0,1.0] (b > 0)",
}


def dense(case: worker.Case) -> worker.Measure:
    if case["chunk"] > 1:
        msg = "one sample at a time"
        raise ValueError(msg)
    update = sentil.OnlineMonitor(DENSE[case["kind"]]).update_packed

    def one(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        return float(times[0]), [float(v[0]) for _, v in sorted(trace.items())]

    variables = len(traces.VARIABLES[case["kind"]])
    return worker.events(case, feeder(update, "positional"), one, variables)


def dense_offline(case: worker.Case) -> worker.Measure:
    n, kind = case["n"], case["kind"]
    trace, times = traces.columns(kind, 0, n), traces.moments(0, n)
    parsed = sentil.Formula.parse(DENSE[kind])
    return worker.whole(
        lambda: parsed.robustness_signal(sentil.Trace(times, trace)), n * len(trace)
    )


worker.serve(
    {
        "update": update,
        "worst": worst,
        "memory": memory,
        "offline": offline,
        "calls": calls,
        "dense": dense,
        "dense offline": dense_offline,
        "batches": batch,
    }
)
