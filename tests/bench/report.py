"""Tables of figures, with their targets, floors and best peers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

PEERS = ("sentil", "mstlo", "reelay")
REFERENCES = ("floor", "numpy", *PEERS)
WIDTH = 80


@dataclass
class Row:
    """The figures of a row by column, and its target if there is one."""

    label: str
    figures: dict[str, float]
    target: float | None = None


@dataclass
class Table:
    """The rows of a section in one unit; the notes give reasons for missing figures."""

    title: str
    unit: str
    rows: list[Row] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        columns = list(dict.fromkeys(name for row in self.rows for name in row.figures))
        columns.sort(key=lambda name: REFERENCES.index(name) if name in REFERENCES else -1)
        ratios = {
            "/floor": [ratio(row, ("floor",)) for row in self.rows],
            "/peer": [ratio(row, PEERS) for row in self.rows],
        }
        ratios = {name: values for name, values in ratios.items() if any(values)}
        head = [*columns, "target", *ratios]
        cells = [head] + [
            [
                *(number(row.figures.get(column)) for column in columns),
                number(row.target),
                *(number(values[i]) for values in ratios.values()),
            ]
            for i, row in enumerate(self.rows)
        ]
        widths = [max(len(line[i]) for line in cells) + 1 for i in range(len(head))]
        first = min(max((len(row.label) for row in self.rows), default=0), WIDTH - sum(widths))
        labels = ["", *(row.label for row in self.rows)]
        lines = [f"{self.title} [{self.unit}]"[:WIDTH]]
        lines += [
            f"{label[:first]:<{first}}"
            + "".join(f"{cell:>{width}}" for cell, width in zip(line, widths, strict=True))
            for label, line in zip(labels, cells, strict=True)
        ]
        lines += [f"- {where}: {why}"[:WIDTH] for where, why in self.notes.items()]
        return "\n".join(lines)

    def plain(self) -> dict[str, object]:
        """Return the table as JSON data."""
        return {
            "title": self.title,
            "unit": self.unit,
            "rows": [row.__dict__ for row in self.rows],
            "notes": self.notes,
        }


def ratio(row: Row, references: tuple[str, ...]) -> float | None:
    """Return the project's first figure divided by the minimum of the references."""
    ours = next((value for name, value in row.figures.items() if name not in REFERENCES), None)
    theirs = [row.figures[name] for name in references if row.figures.get(name, 0.0) > 0.0]
    return ours / min(theirs) if ours is not None and theirs else None


def number(value: float | None) -> str:
    """Return a number with about three digits, thousands as k and M; a dash for None."""
    if value is None or math.isnan(value):
        return "-"
    size = abs(value)
    if 0 < size < 0.05:
        return f"{value:.4f}"
    for limit, scale, letter in ((999.5e3, 1e6, "M"), (9_999.5, 1e3, "k")):
        if size >= limit:
            return f"{value / scale:.3g}{letter}"
    if size >= 99.5:
        return f"{value:.0f}"
    return f"{value:.1f}" if size >= 9.95 else f"{value:.2f}"
