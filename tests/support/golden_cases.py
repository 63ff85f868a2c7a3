"""The golden files: formulas, traces, and their robustness from another program."""

import json
from typing import Any

from paths import GOLDEN


def cases(name: str) -> list[dict[str, Any]]:
    """Return the cases of a file."""
    content = json.loads((GOLDEN / name).read_text())
    found: list[dict[str, Any]] = content["cases"] if isinstance(content, dict) else content
    return found


def length(case: dict[str, Any]) -> int:
    """Return the number of samples of a case."""
    return len(case["trace"]["a"])
