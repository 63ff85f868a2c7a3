"""Benchmarks that are not installed: what an import of theirs says."""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["benchmark"]


def benchmark(module: str, install: str) -> Any:  # noqa: ANN401 - a module without types
    """A module of a benchmark.

    Args:
        module: Its name.
        install: What pip is told to install it.

    Raises:
        ModuleNotFoundError: If it, or a module that it needs, is not installed.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"expected {module}, found no module {error.name!r}; pip install {install}",
            name=error.name,
        ) from error
