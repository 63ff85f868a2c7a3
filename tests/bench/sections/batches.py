"""Batches of many signals."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from controller import Setting, Subject, race
from report import Row, Table

NUMBERS = (64, 1_024, 4_096)
SLOW = ("python", "sentil")

THERE = 12  # ns, the floor at any number of entries on the machine of the targets


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `VectorMonitor` and `VectorEpisodeMonitor`; a peer is a loop over its monitors."""
    subjects = setting.subjects()
    for other in ("mstlo", "reelay"):  # already much slower in single updates
        subjects.pop(other, None)
    try:
        yield monitors(setting, subjects)
        yield episodes(setting, subjects)
    finally:
        for subject in subjects.values():
            subject.stop()


def monitors(setting: Setting, subjects: dict[str, Subject]) -> Table:
    """Measure the window minimum, and the cost of a call for a single entry."""
    table = Table("VectorMonitor.update, W1", "ns an entry")
    for k in (100, 1_000):
        for num in NUMBERS:
            if setting.quick and num == 1_024:
                continue
            case = {"kind": "w1", "k": k, "fill": k + 1, "num": num, "monitor": "step"}
            row(setting, subjects, table, f"k={k} N={num}", 20, case)
    here = [row.figures["floor"] for row in table.rows if "floor" in row.figures]
    if here:
        table.notes["floor"] = (
            f"{THERE} ns on the machine of the targets, {min(here):.0f} to {max(here):.0f} here"
        )
    one = {"kind": "w1", "k": 100, "fill": 128, "num": 1, "monitor": "step"}
    row(setting, subjects, table, "k=100 N=1", None, one)
    return table


def episodes(setting: Setting, subjects: dict[str, Subject]) -> Table:
    """Measure values and bounds of every episode."""
    table = Table("VectorEpisodeMonitor.update; +read: bounds and verdict too", "ns an entry")
    cases = (("always(a + b > -2)", "w1", "invariant"), ("resp", "resp", "resp"))
    for label, kind, formula in cases:
        for num in NUMBERS:
            if setting.quick and num == 1_024:
                continue
            case = {"kind": kind, "formula": formula, "num": num, "fill": 128}
            case["monitor"] = "episode"
            row(setting, subjects, table, f"{label} N={num}", 60, case)
            if num == NUMBERS[0]:
                row(setting, {"native": subjects["native"]}, table, ".. +read", None, case, read=1)
    return table


def row(
    setting: Setting,
    subjects: dict[str, Subject],
    table: Table,
    label: str,
    target: float | None,
    case: dict[str, Any],
    **more: object,
) -> None:
    """Measure a case with every subject and add the figures to a table."""
    repeats = 3 if setting.quick else 9
    entries = {
        column: (
            subject,
            case | more | {"what": "batches", "backend": column, "seconds": 0.01},
        )
        for column, subject in subjects.items()
        if column not in SLOW or case["num"] <= NUMBERS[0]
    }
    if case["monitor"] == "episode":
        entries.pop("floor", None)
    figures = race(entries, repeats, table.notes)
    table.rows.append(Row(label, {column: seen[0] for column, seen in figures.items()}, target))
