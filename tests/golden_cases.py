"""The golden files: formulas, traces and robustness from a program that is not in this project."""

import json
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).parent / "golden"


def cases(name: str) -> list[dict[str, Any]]:
    """The cases of a file."""
    found: list[dict[str, Any]] = json.loads((_FOLDER / name).read_text())["cases"]
    return found


def length(case: dict[str, Any]) -> int:
    """Samples of a case."""
    return len(case["trace"]["a"])
