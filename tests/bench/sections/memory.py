"""The memory of a long window."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table


def measure(setting: Setting) -> Iterator[Table]:
    """Measure bytes per sample of the window, and calls of the allocator per update."""
    k = 100_000 if setting.quick else 1_000_000
    subjects = setting.subjects()
    if setting.floor is None:
        return
    counting = {
        "LD_PRELOAD": str(setting.floor / "allocations.so"),
        "PYTHONMALLOC": "malloc",  # count Python objects too
        "MALLOC_MMAP_THRESHOLD_": "65536",  # a window must not use memory that was freed before
    }
    results: dict[str, dict[str, list[float]]] = {}
    notes: dict[str, str] = {}
    for kind, label in (("w1", "random"), ("saw", "rising")):
        results[label] = {}
        for column, subject in subjects.items():
            if column == "reelay" and kind == "saw":
                continue  # O(k) at every rising sample
            subject.environment |= counting
            case = {"what": "memory", "kind": kind, "k": k, "backend": column}
            results[label] |= race({column: (subject, case)}, 1, notes)
            subject.stop()
    table = Table(f"Memory of W1 k={k:,}", "bytes a sample; calls of malloc an update")
    for label, seen in results.items():
        held = {column: figures[0] for column, figures in seen.items()}
        table.rows.append(Row(f"bytes, {label}", held, 17))
    calls = {column: figures[1] for column, figures in results["random"].items()}
    table.rows.append(Row("mallocs an update", calls, 0))
    table.notes = notes
    yield table
