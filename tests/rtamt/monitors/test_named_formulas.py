"""Named formulas of a monitor of samples: each is observed, late by as much as it needs alone."""

import math
from typing import Literal

from bits import identical

from rtamt import Monitor

Backend = Literal["native", "python"]


def test_each_named_formula_is_late_by_its_own_future(backend: Backend) -> None:
    spec = """
        high = x > 1
        soon = eventually[0:2](high)
        always[0:1](soon)
    """
    monitor = Monitor(spec, backend=backend)
    assert monitor.latencies == {"high": 0, "soon": 2}
    seen: list[float] = []
    for x in (3.0, 0.0, 5.0):
        monitor.update(x=x)
        seen += monitor.values.values()
    assert identical(seen, [2, math.nan, -1, math.nan, 4, 4])
