"""Comparisons as strict JSON, in which infinities are the texts "inf" and "-inf"."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import rtamt
from rtamt_gym.evaluation.compared import Compared
from rtamt_gym.evaluation.json_files import read_fields
from rtamt_gym.evaluation.paired import Effect
from rtamt_gym.search.runs.report import strict_json

__all__ = ["FORMAT", "read", "written"]

FORMAT: Final = "rtamt comparison 1"

_INTERVALS: Final = ("interval_a", "interval_b", "interval")


def written(kept: Mapping[str, Any]) -> str:
    """The text of a comparison, from its fields by name; `read` reads it.

    What follows from the rest, such as rates and sentences, is there for other programs.
    """
    return strict_json(
        {
            "format": FORMAT,
            "rtamt": rtamt.__version__,
            **kept,
            "seeds": list(kept["seeds"]),
            "requirements": [_compared(each) for each in kept["requirements"].values()],
            "success": _compared(kept["success"]),
            "returns": _effect(kept["returns"]),
            "notes": list(kept["notes"]),
        }
    )


def read(path: Path) -> dict[str, Any]:
    """Reads the fields of a comparison from a file with the text that `written` has made.

    Raises:
        InputError: If the file does not hold a comparison.
    """
    return read_fields(path, "comparison", FORMAT, _fields)


def _fields(kept: Mapping[str, Any]) -> dict[str, Any]:
    requirements = [_read_compared(each) for each in kept["requirements"]]
    return {name: kept[name] for name in ("system", "a", "b")} | {
        "seeds": tuple(kept["seeds"]),
        "requirements": {each.name: each for each in requirements},
        "success": _read_compared(kept["success"]),
        "returns": _read_effect(kept["returns"]),
        "notes": tuple(kept["notes"]),
    }


def _compared(compared: Compared) -> dict[str, Any]:
    kept = {each.name: getattr(compared, each.name) for each in fields(compared)}
    derived = ("pairs", "rate_a", "rate_b", "difference", "sentence")
    return (
        kept
        | {name: getattr(compared, name) for name in derived}
        | {name: list(kept[name]) for name in _INTERVALS}
        | {"robustness": _effect(compared.robustness)}
    )


def _read_compared(kept: Mapping[str, Any]) -> Compared:
    values = {each.name: kept[each.name] for each in fields(Compared)}
    values |= {name: _two(kept[name]) for name in _INTERVALS}
    return Compared(**values | {"robustness": _read_effect(kept["robustness"])})


def _effect(effect: Effect | None) -> dict[str, Any] | None:
    if effect is None:
        return None
    return {
        "statistic": effect.statistic,
        "value": _finite(effect.value),
        "interval": [_finite(end) for end in effect.interval],
        "pairs": [[_finite(a), _finite(b)] for a, b in effect.pairs],
    }


def _read_effect(kept: Mapping[str, Any] | None) -> Effect | None:
    if kept is None:
        return None
    pairs = tuple(_two(pair) for pair in kept["pairs"])
    return Effect(kept["statistic"], float(kept["value"]), _two(kept["interval"]), pairs)


def _finite(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)


def _two(kept: list[Any]) -> tuple[float, float]:
    first, second = kept
    return float(first), float(second)
