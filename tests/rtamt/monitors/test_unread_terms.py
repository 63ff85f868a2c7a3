"""A term that is not a number is refused everywhere, whether or not the result reads it."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

import rtamt
from rtamt import InputError

TEXT = "y = sqrt(x) > 1; x > 0"
EVENTS = {"x": [(0, -1.0), (1, 2.0)]}
Backend = Literal["native", "python"]
CALLS: dict[str, Callable[[Backend], object]] = {
    "evaluate": lambda b: rtamt.evaluate(TEXT, {"x": [-1.0]}, backend=b),
    "evaluate_many": lambda b: rtamt.evaluate_many(TEXT, {"x": [[-1.0]]}, backend=b),
    "judge": lambda b: rtamt.judge(TEXT, {"x": [-1.0]}, backend=b),
    "judge unknown": lambda b: rtamt.judge(TEXT, {"x": [np.nan, -1.0]}, nan="unknown", backend=b),
    "explain": lambda b: rtamt.explain(TEXT, {"x": [-1.0]}, backend=b),
    "Monitor": lambda b: rtamt.Monitor(TEXT, backend=b).update(x=-1.0),
    "EpisodeMonitor": lambda b: rtamt.EpisodeMonitor(TEXT, backend=b).update(x=-1.0),
    "VectorMonitor": lambda b: rtamt.VectorMonitor(TEXT, 1, backend=b).update([[-1.0]]),
    "VectorEpisodeMonitor": lambda b: rtamt.VectorEpisodeMonitor(TEXT, 1, backend=b).update(
        [[-1.0]]
    ),
    "evaluate_dense": lambda b: rtamt.evaluate_dense(TEXT, EVENTS, backend=b),
    "judge_dense": lambda b: rtamt.judge_dense(TEXT, EVENTS, backend=b),
    "explain_dense": lambda b: rtamt.explain_dense(TEXT, EVENTS, backend=b),
    "DenseMonitor": lambda b: rtamt.DenseMonitor(TEXT, backend=b).update(EVENTS),
    "DenseEpisodeMonitor": lambda b: rtamt.DenseEpisodeMonitor(TEXT, backend=b).update(EVENTS),
}


@pytest.mark.parametrize("call", CALLS)
def test_unread_term_is_refused(call: str, backend: Backend) -> None:
    with pytest.raises(InputError, match=r"'sqrt\(x\)' is not a number"):
        CALLS[call](backend)


def test_requirement_ignores_terms_of_others(backend: Backend) -> None:
    spec = rtamt.parse("a = sqrt(y) > 1; b = x > 0").requirements["b"]
    assert rtamt.judge(spec, {"x": [1.0], "y": [-1.0]}, backend=backend).verdict.name == "SATISFIED"
