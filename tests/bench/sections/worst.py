"""The worst single update, on the input that empties a monotonic wedge at once."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table


def measure(setting: Setting) -> Iterator[Table]:
    """Measure the worst update while the window fills, and when it is full."""
    k, passes = (100_000, 7) if setting.quick else (1_000_000, 7)
    subjects = setting.subjects()
    subjects.pop("reelay", None)  # O(k) at every rising sample
    if setting.quick:
        subjects.pop("mstlo", None)
    title = f"Worst single update, W1 k={k:,}, saw-tooth, {passes} passes"
    table = Table(title, "ns")
    notes: dict[str, str] = {}
    results: dict[str, list[float]] = {}
    for column, subject in subjects.items():  # passes hold millions of times: one tool at a time
        case = {"what": "worst", "kind": "saw", "k": k, "backend": column}
        enough = passes if column == "native" else 2 if column == "mstlo" else 3
        results |= race({column: (subject, case)}, enough, notes)
        subject.stop()
    for i, (label, target) in enumerate((("while it fills", None), ("once it is full", 200))):
        table.rows.append(Row(label, {name: seen[i] for name, seen in results.items()}, target))
    table.notes = notes
    yield table
