"""Judgements of responses, with and without the number of triggers."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import worker

import rtamt

SPECS = {
    "req": "always(req >= 3 implies eventually[0:5](gnt >= 3))",
    "point": "always(req >= 3 implies gnt >= 3)",
    "past": "always(once[0:5](req >= 3) implies eventually[0:5](gnt >= 3))",
    "ahead": "always(eventually[0:5](req >= 3) implies eventually[0:5](gnt >= 3))",
}


def measure(case: worker.Case) -> worker.Measure:
    """Return microseconds of a judgement, of its triggers, and of `Implications.evidence`."""
    spec, n, dense = rtamt.parse(SPECS[case["kind"]]), case["n"], case["dense"]
    req, gnt = np.zeros(n), np.zeros(n)
    req[2::10], gnt[4::10] = 4.0, 5.0
    signals: dict[str, Any] = {"req": req, "gnt": gnt}
    if dense:
        times = np.arange(n) * 0.1
        signals = {name: rtamt.dense.Events(times, values) for name, values in signals.items()}
    counted = rtamt.dense.Implications(spec) if dense else rtamt.monitors.Implications(spec)
    judge = rtamt.dense.judge if dense else rtamt.judge
    verdict = judge(spec, signals).verdict

    def run() -> list[float]:
        figures = []
        for _ in range(case["times"]):
            begin = time.perf_counter()
            judgement = judge(spec, signals)
            judged = time.perf_counter()
            _ = judgement.triggers
            read = time.perf_counter()
            counted.evidence(signals, "cut", verdict)  # type: ignore[arg-type]
            end = time.perf_counter()
            figures.append((judged - begin, read - judged, end - read))
        return [1e6 * float(seconds) for seconds in np.min(figures, axis=0)]

    return run


if __name__ == "__main__":
    worker.serve({"triggers": measure})
