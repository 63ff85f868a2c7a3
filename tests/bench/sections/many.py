"""Many traces of one file, judged in one call, against a grouped minimum of pyarrow."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

TARGETS = {"two": 3.0, "until": 10.0, "past": 10.0}


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `judge_many` of two requirements on columns in memory, and ``rtamt monitor``."""
    traces = 2_000 if setting.quick else 100_000
    table = Table(f"{traces:,} groups of up to 400 samples, two requirements", "s")
    subject = setting.project("many")
    for kind, target in TARGETS.items():
        case = {"what": "many", "kind": kind, "traces": traces}
        times = race({"rtamt": (subject, case)}, 3 if setting.quick else 5, table.notes).get(
            "rtamt"
        )
        if times is None:
            continue
        grouped, file, memory, command = times
        figures = {"file": file, "memory": memory, "command": command, "pyarrow": grouped}
        label = f"{kind}: {file / grouped:.1f} times pyarrow's grouped minimum"
        table.rows.append(Row(label, figures, target * grouped))
    subject.stop()
    yield table
