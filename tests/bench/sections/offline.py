"""Evaluation of complete traces."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

CASES = (("w1", 1_000, 4), ("resp", 0, 8), ("nested", 0, 15))


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `evaluate` of a million samples."""
    n, repeats = (200_000, 2) if setting.quick else (1_000_000, 7)
    subjects = setting.subjects()
    for slow in ("mstlo", "reelay"):  # no offline evaluation: see their updates
        subjects.pop(slow, None)
    if floor := setting.reference():
        subjects["numpy"] = floor
    table = Table(f"evaluate, {n:,} samples; W1 with k=1,000", "ns a sample")
    for kind, k, target in CASES:
        case = {"what": "offline", "kind": kind, "k": k, "n": n}
        entries = {name: (who, case | {"backend": name}) for name, who in subjects.items()}
        if "python" in entries:
            entries["python"][1]["n"] = n // 20  # linear, and slow
        figures = race(entries, repeats, table.notes)
        row = {column: seen[0] for column, seen in figures.items()}
        table.rows.append(Row(kind, row, target))
    for subject in subjects.values():
        subject.stop()
    yield table
