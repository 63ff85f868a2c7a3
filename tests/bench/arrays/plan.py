"""The optimizer of ``examples/unicycle.py``, with our smooth robustness and with stljax."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import jax
from measuring import Case, answer, least, processor_seconds

sys.path.insert(0, str(Path(__file__).parents[3] / "examples"))
import unicycle


def found(case: Case, smooth: Any) -> Case:
    """Return milliseconds per step and the final standard robustness; ``smooth`` is maximized."""
    unicycle.robustness, standard = smooth, unicycle.robustness
    start = 0.3 * jax.random.normal(jax.random.key(1), (2, unicycle.SAMPLES - 1))
    run = jax.jit(lambda start: unicycle.ascend(start, smooth=True)[0])
    compiling = processor_seconds(lambda: run.lower(start).compile())
    controls = run(start)
    seconds = least(lambda: run(start).block_until_ready(), 2 if case["quick"] else 5)
    return {
        "step": seconds * 1e3 / unicycle.STEPS,
        "compile": compiling,
        "robustness": float(standard(controls)),
    }


def ours(case: Case) -> Case:
    return found(case, unicycle.robustness)


def stljax(case: Case) -> Case:
    from stljax.formula import Always, And, Eventually, GreaterThan

    samples = round(1 / unicycle.PERIOD)
    first = Eventually(GreaterThan("first", 0.0), interval=[0, 3 * samples])
    stay = Always(GreaterThan("last", 0.0), interval=[0, samples])
    visits = And(first, Eventually(stay, interval=[0, 5 * samples]))
    task = And(Always(GreaterThan("clear", 0.0)), visits)

    def robustness(controls: Any, temperature: Any = 0.01, **_: Any) -> Any:
        seen = unicycle.signals(unicycle.path(controls))
        operand = (seen["clear"], (seen["first"], seen["last"]))
        # Its temperature is the inverse of ours; with its own large number, gradients become nan.
        smooth = {"approx_method": "logsumexp", "temperature": 1 / temperature}
        return task.robustness(operand, large_number=1e3, **smooth)

    return found(case, robustness)


answer({"jax": ours, "stljax": stljax})
