"""Dense time: events at irregular times, about a thousand of them in the window."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, Subject, race
from report import Row, Table

KINDS = {
    "always": "always[0:1](s > -2)",
    "sum": "always[0:1](a + b > -2)",
    "resp": "(req >= 3) implies eventually[0:1](gnt >= 3)",
    "until": "(a > 0) until[0:1] (b > 0)",
}
CHUNKS = {"1": (1, 120), "100": (100, 40)}
OFFLINE = 40


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `rtamt.dense`: `Monitor.update` by events and by chunks, `evaluate` of signals."""
    subjects = setting.subjects()
    seconds, repeats = (0.002, 3) if setting.quick else (0.01, 9)
    table = Table("DenseMonitor.update with 1 event, with 100 as arrays", "ns an event")
    for kind in KINDS:
        for label, (chunk, target) in CHUNKS.items():
            case = {"kind": kind, "chunk": chunk, "fill": 2_000, "seconds": seconds}
            row(table, f"{kind} x {label}", target, subjects, {"what": "dense"} | case, repeats)
    table.notes |= KINDS | {"sentil": "samples, not signals that hold their value"}
    yield table

    n = 200_000 if setting.quick else 1_000_000
    offline = Table(f"evaluate_dense, {n:,} events of each variable", "ns an event")
    for kind in KINDS:
        case = {"what": "dense offline", "kind": kind, "n": n}
        row(offline, kind, OFFLINE, subjects, case, min(repeats, 5))
    yield offline
    for subject in subjects.values():
        subject.stop()


def row(
    table: Table,
    label: str,
    target: float,
    subjects: dict[str, Subject],
    case: dict[str, object],
    repeats: int,
) -> None:
    """Measure a case with every subject that supports it, and add the figures to a table."""
    entries = {name: (who, case | {"backend": name}) for name, who in subjects.items()}
    if "n" in case and "python" in entries:
        entries["python"][1]["n"] = 20_000  # linear, and slow
    notes: dict[str, str] = {}
    figures = race(entries, repeats, notes)
    table.rows.append(Row(label, {name: seen[0] for name, seen in figures.items()}, target))
    for name in ("native", "python"):
        if name in notes:
            table.notes[f"{label} {name}"] = notes[name]
