"""reelay: past operators only, samples as mappings; future operators are delayed by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import reelay
import traces
import worker

FORMULAS = {
    "w1": "historically[0:{k}]{{s > -2}}",
    "saw": "historically[0:{k}]{{s > -2}}",
    "resp": "historically(once[5:5]{{req >= 3}} -> once[0:5]{{gnt >= 3}})",
    "nested": "historically(once[250:250]{{cmd >= 1}}"
    " -> once[0:200](historically[0:50]{{d < 0.1}}))",
    "until": "{{a > 0}} since[0:{k}] {{b > 0}}",
    "since": "{{a > 0}} since[0:{k}] {{b > 0}}",
}


def monitor(case: worker.Case) -> Any:  # noqa: ANN401
    return reelay.discrete_timed_monitor(
        pattern=FORMULAS[case["kind"]].format(k=case.get("k")),
        semantics="robustness",
        condense=False,
    )


def inputs(kind: str) -> Callable[[traces.Columns, int], Any]:
    def made(trace: traces.Columns, _start: int) -> Any:  # noqa: ANN401
        signals = traces.summed(kind, trace)
        return [dict(zip(signals, row, strict=True)) for row in traces.rows(signals)]

    return made


def feeder(update: Callable[..., Any]) -> Callable[[Any], object]:
    def feed(data: Any) -> None:  # noqa: ANN401
        for sample in data:
            update(sample)

    return feed


def update(case: worker.Case) -> worker.Measure:
    if case.get("monitor") == "episode":
        msg = "no bounds of an episode"
        raise ValueError(msg)
    if case["form"] in ("keywords", "array"):
        msg = "samples are mappings"
        raise ValueError(msg)
    return worker.stream(case, feeder(monitor(case).update), inputs(case["kind"]))


def memory(case: worker.Case) -> worker.Measure:
    def make(k: int) -> Callable[[Any], object]:
        return feeder(monitor(case | {"k": k}).update)

    return worker.memory(case, make, inputs(case["kind"]))


DENSE = {
    "always": "historically[0:1.0]{s > -2}",
    "sum": "historically[0:1.0]{s > -2}",
    "until": "{a > 0} since[0:1.0] {b > 0}",
}


def dense(case: worker.Case) -> worker.Measure:
    kind = case["kind"]
    if kind not in DENSE or case["chunk"] > 1:
        msg = "past operators, one event at a time"
        raise ValueError(msg)
    monitor = reelay.dense_timed_monitor(
        pattern=DENSE[kind], semantics="robustness", piecewise="constant"
    )

    def one(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        signals = traces.summed(kind, trace)
        time = float(times[0]) + 0.001  # it starts at 0
        return {"time": time, **{name: float(v[0]) for name, v in signals.items()}}

    return worker.events(case, feeder(monitor.update), one, len(traces.VARIABLES[kind]))


worker.serve({"update": update, "memory": memory, "dense": dense})
