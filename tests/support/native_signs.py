"""Signs of a trace in dense time, from the arguments that Python passes to the native class."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

LOAD = (0, "LOAD", "x", 0, 0, 0.0, 0, 0)


def signs(**changes: object) -> Any:  # noqa: ANN401 - of the native module
    """Return the signs of x on a trace that was cut, or of changed arguments."""
    native = pytest.importorskip("rtamt._native", reason="no compiler was at hand")
    made: dict[str, object] = {
        "terms": [LOAD],
        "rows": [],
        "result": 0,
        "clock": (1e9, 10**9, 1),
        "reader": object(),
        "given": [(np.array([0.0, 3.0]), np.array([1.0, -1.0]))],
        "begin": 0,
        "last": 3 * 10**9,
        "end": "cut",
    }
    return native.DenseSigns(**{**made, **changes})
