"""Properties of every source file."""

import ast
from itertools import chain
from pathlib import Path

from paths import ROOT

CLOCKS = {"time", "timeit", "datetime"}


def imported(path: Path) -> set[str]:
    """Return the top-level names of the imports of a file."""
    found = chain.from_iterable(
        [node.module or ""]
        if isinstance(node, ast.ImportFrom)
        else [alias.name for alias in node.names]
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import | ast.ImportFrom)
    )
    return {name.split(".")[0] for name in found}


def test_no_test_reads_a_clock() -> None:
    tests = [path for path in (ROOT / "tests").rglob("*.py") if "bench" not in path.parts]
    assert tests
    assert [path for path in tests if CLOCKS & imported(path)] == []
