"""The project: updates, complete traces and memory, through its public names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import traces
import worker
from sections.dense import KINDS

import rtamt

FORMULAS = {
    "w1": "always[0:{k}](a + b > -2)",
    "saw": "always[0:{k}](a + b > -2)",
    "resp": "always((req >= 3) implies eventually[0:5](gnt >= 3))",
    "nested": "always((cmd >= 1) implies eventually[0:200] always[0:50] (abs(cmd - pos) < 0.1))",
    "until": "(a > 0) until[0:{k}] (b > 0)",
    "since": "(a > 0) since[0:{k}] (b > 0)",
    "invariant": "always(a + b > -2)",
}


def monitor(case: worker.Case) -> Any:  # noqa: ANN401 - either of the monitors
    """Return the monitor of a case; the formula of an episode covers the whole episode."""
    text = FORMULAS[case.get("formula", case["kind"])].format(k=case.get("k"))
    if case.get("monitor") != "episode":
        return rtamt.Monitor(text, backend=case["backend"])
    if not text.startswith("always("):
        text = f"always({text})"
    return rtamt.EpisodeMonitor(text, backend=case["backend"])


def inputs(form: str) -> Callable[[traces.Columns, int], Any]:
    """Return the function that builds the samples of a form before they are timed."""

    def made(trace: traces.Columns, _start: int) -> Any:  # noqa: ANN401
        if form == "array":
            import numpy as np

            return list(np.stack(list(trace.values()), axis=1))
        if form == "mapping":
            return [dict(zip(trace, row, strict=True)) for row in traces.rows(trace)]
        return traces.rows(trace)

    return made


def feeder(form: str, machine: Any, names: Sequence[str]) -> Callable[[Any], object]:  # noqa: ANN401
    """Return a tight loop over samples, in an argument form."""
    update = machine.update

    def positional(data: Any) -> None:  # noqa: ANN401
        for x, y in data:
            update(x, y)

    def keywords(data: Any) -> None:  # noqa: ANN401
        for x, y in data:
            update(a=x, b=y)

    def single(data: Any) -> None:  # noqa: ANN401
        for sample in data:
            update(sample)

    def verdicts(data: Any) -> None:  # noqa: ANN401
        for x, y in data:
            update(x, y)
            machine.lower, machine.upper, machine.verdict  # noqa: B018 - what is measured is reading

    if tuple(names) != tuple(machine.variables):
        msg = f"expected variables {names}, got {machine.variables}"
        raise ValueError(msg)
    forms = {"positional": positional, "keywords": keywords, "verdicts": verdicts}
    return forms.get(form, single)


def update(case: worker.Case) -> worker.Measure:
    form, machine = case["form"], monitor(case)
    feed = feeder(form, machine, traces.VARIABLES[case["kind"]])
    return worker.stream(case, feed, inputs(form))


def worst(case: worker.Case) -> worker.Measure:
    def make() -> Callable[[Any], object]:
        update = monitor(case).update
        return lambda sample: update(*sample)

    return worker.single_updates(case, make, inputs("positional"))


def memory(case: worker.Case) -> worker.Measure:
    def make(k: int) -> Callable[[Any], object]:
        return feeder("positional", monitor(case | {"k": k}), traces.VARIABLES[case["kind"]])

    return worker.memory(case, make, inputs("positional"))


def offline(case: worker.Case) -> worker.Measure:
    trace = traces.columns(case["kind"], 0, case["n"])
    spec = rtamt.parse(FORMULAS[case["kind"]].format(k=case["k"]))
    return worker.whole(lambda: rtamt.evaluate(spec, trace, backend=case["backend"]), case["n"])


def dense(case: worker.Case) -> worker.Measure:
    """Measure single events as pairs, and chunks as arrays."""
    machine = rtamt.dense.Monitor(KINDS[case["kind"]], backend=case["backend"])

    def pairs(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        return {n: list(zip(times.tolist(), v.tolist(), strict=True)) for n, v in trace.items()}

    def arrays(times: Any, trace: traces.Columns) -> Any:  # noqa: ANN401
        return {name: np.stack([times, v], axis=1) for name, v in trace.items()}

    form = pairs if case["chunk"] == 1 else arrays
    return worker.events(
        case, feeder("mapping", machine, machine.variables), form, len(machine.variables)
    )


def dense_offline(case: worker.Case) -> worker.Measure:
    trace, times = traces.columns(case["kind"], 0, case["n"]), traces.moments(0, case["n"])
    signals = {name: rtamt.dense.Events(times, values) for name, values in trace.items()}
    spec = rtamt.parse(KINDS[case["kind"]])
    return worker.whole(
        lambda: rtamt.dense.evaluate(spec, signals, backend=case["backend"]),
        case["n"] * len(signals),
    )


CALLS = {
    "invariant": "always(x < 2.5)",
    "resp": "always(a > 2 implies eventually[0:10](b > 1))",
}


def calls(case: worker.Case) -> worker.Measure:
    spec, data = rtamt.parse(CALLS[case["kind"]]), traces.short(case["count"])
    joined = {name: np.concatenate([one[name] for one in data]) for name in data[0]}
    lengths = [200] * len(data)
    forms = {
        "evaluate": lambda: [rtamt.evaluate(spec, one)[0] for one in data],
        "judge": lambda: [rtamt.judge(spec, one, end="complete").robustness for one in data],
        "many": lambda: rtamt.judge_many(spec, data, end="complete", threads=1).robustness,
        "joined": lambda: (
            rtamt.judge_many(spec, joined, end="complete", lengths=lengths, threads=1).robustness
        ),
    }
    return worker.calls(forms[case["form"]], len(data))


def batch(case: worker.Case) -> worker.Measure:
    kinds = {"step": rtamt.VectorMonitor, "episode": rtamt.VectorEpisodeMonitor}
    text = FORMULAS[case.get("formula", case["kind"])].format(k=case.get("k"))
    entries = kinds[case["monitor"]](text, case["num"], backend=case["backend"])

    def verdicts(rows: Any) -> None:  # noqa: ANN401
        entries.update(rows)
        entries.lower, entries.upper, entries.verdict  # noqa: B018 - what is measured is reading

    return worker.batch(case, verdicts if case.get("read") else entries.update)


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
