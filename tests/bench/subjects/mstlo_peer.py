"""mstlo: one signal at a time; delayed values, or intervals (RoSI) for bounded episodes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mstlo_python
import traces
import worker

FORMULAS = {
    "w1": "G[0,{k}](s > -2)",
    "saw": "G[0,{k}](s > -2)",
    "resp": "(req >= 3) -> F[0,5](gnt >= 3)",
    "nested": "(cmd >= 1) -> F[0,200](G[0,50](d < 0.1))",
    "until": "(a > 0) U[0,{k}] (b > 0)",
}


def monitor(case: worker.Case) -> Any:  # noqa: ANN401
    episode = case.get("monitor") == "episode"
    kind = case.get("formula", case["kind"])
    if kind not in FORMULAS:
        msg = f"no {kind}: future operators only, each with an end"
        raise ValueError(msg)
    return mstlo_python.Monitor(
        mstlo_python.parse_formula(FORMULAS[kind].format(k=case.get("k"))),
        semantics="Rosi" if episode else "DelayedQuantitative",
        algorithm="Incremental",
    )


def inputs(kind: str) -> Callable[[traces.Columns, int], Any]:
    def made(trace: traces.Columns, start: int) -> Any:  # noqa: ANN401
        signals = traces.summed(kind, trace)
        return [
            [(name, x, float(start + i)) for name, x in zip(signals, row, strict=True)]
            for i, row in enumerate(traces.rows(signals))
        ]

    return made


def feeder(update: Callable[..., Any]) -> Callable[[Any], object]:
    def feed(data: Any) -> None:  # noqa: ANN401
        for sample in data:
            for signal in sample:
                update(*signal).verdicts()

    return feed


def update(case: worker.Case) -> worker.Measure:
    if case["form"] in ("mapping", "keywords", "array"):
        msg = "samples come in one form"
        raise ValueError(msg)
    return worker.stream(case, feeder(monitor(case).update), inputs(case["kind"]))


def worst(case: worker.Case) -> worker.Measure:
    def make() -> Callable[[Any], object]:
        update = monitor(case).update
        return lambda sample: update(*sample[0]).verdicts()

    return worker.single_updates(case, make, inputs("saw"))


def memory(case: worker.Case) -> worker.Measure:
    def make(k: int) -> Callable[[Any], object]:
        return feeder(monitor(case | {"k": k}).update)

    return worker.memory(case, make, inputs(case["kind"]))


DENSE = {
    "always": "G[0,1.0](s > -2)",
    "sum": "G[0,1.0](s > -2)",
    "resp": "(req >= 3) -> F[0,1.0](gnt >= 3)",
    "until": "(a > 0) U[0,1.0] (b > 0)",
}


def dense_monitor(case: worker.Case) -> Any:  # noqa: ANN401
    return mstlo_python.Monitor(
        mstlo_python.parse_formula(DENSE[case["kind"]]),
        semantics="DelayedQuantitative",
        algorithm="Incremental",
    )


def dense(case: worker.Case) -> worker.Measure:
    monitor, kind = dense_monitor(case), case["kind"]
    update, batch = monitor.update, monitor.update_batch

    def one(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        signals = traces.summed(kind, trace)
        return [(name, float(v[0]), float(times[0])) for name, v in signals.items()]

    def many(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        return steps(times, traces.summed(kind, trace))

    def feed(data: Any) -> None:  # noqa: ANN401
        for chunk in data:
            batch(chunk).verdicts()

    single = case["chunk"] == 1
    return worker.events(
        case, feeder(update) if single else feed, one if single else many, events_of(kind)
    )


def events_of(kind: str) -> int:
    return len(traces.VARIABLES[kind])


def steps(times: Any, signals: traces.Columns) -> Any:  # noqa: ANN401
    moments = times.tolist()
    return {name: list(zip(v.tolist(), moments, strict=True)) for name, v in signals.items()}


def dense_offline(case: worker.Case) -> worker.Measure:
    n, kind = case["n"], case["kind"]
    data = steps(traces.moments(0, n), traces.summed(kind, traces.columns(kind, 0, n)))
    return worker.whole(
        lambda: dense_monitor(case).update_batch(data).verdicts(), n * events_of(kind)
    )


worker.serve(
    {
        "update": update,
        "worst": worst,
        "memory": memory,
        "dense": dense,
        "dense offline": dense_offline,
    }
)
