"""The first second of a program: imports, the first parse, large formulas."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from controller import HERE, LeftOut, Setting, single_threaded
from report import Row, Table

TARGETS = {
    "import rtamt over numpy": ("rtamt", 60),
    "load the parser": ("parser", 40),
    "first parse, parser loaded": ("first parse", 25),
    "13 operators": ("13 operators", 1),
    "10,000 conjuncts": ("10,000 conjuncts", 5_000),
    "10,000 open brackets": ("10,000 open brackets", 50),
    "import numpy, to compare": ("numpy", None),
}


def fresh(*arguments: str) -> dict[str, Any]:
    """Return the report of a new process."""
    command = [sys.executable, "-m", "subjects.start", *arguments]
    done = subprocess.run(
        command, cwd=HERE, env=single_threaded(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise LeftOut(done.stderr.strip().rpartition("\n")[2])
    return json.loads(done.stdout)


def measure(setting: Setting) -> Iterator[Table]:
    """Measure the minimum over new processes."""
    table, seen = Table("Start, fresh processes", "ms"), []
    try:
        modules = json.dumps(fresh()["modules"])
        seen = [fresh(modules)["ms"] for _ in range(2 if setting.quick else 5)]
    except LeftOut as why:
        table.notes["rtamt"] = str(why)
    for label, (name, target) in TARGETS.items():
        known = [times[name] for times in seen if name in times]
        figures = {"rtamt": min(known)} if known else {}
        table.rows.append(Row(label, figures, target))
    yield table
