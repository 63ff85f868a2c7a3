"""Benchmarks of robots as environments with a success to judge: robosuite and Meta-World.

To add a benchmark of robots: ``tests/benchmarks/NAME.txt`` with the MuJoCo that it allows,
``test_NAME.py`` next to it, and a row of ``docs/success.md``. A benchmark that is not an
environment of Gymnasium also needs an adapter here, and a stand-in in
``tests/support/benchmark_stand_ins.py``, so that the suite can run the adapter without the package.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


def benchmark(module: str, install: str) -> Any:  # noqa: ANN401 - a module without types
    """Import a module of a benchmark; an error names the packages to ``install``."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"expected {module}, found no module {error.name!r}; pip install {install}",
            name=error.name,
        ) from error
