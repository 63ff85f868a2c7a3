"""Short traces, in one call each and all in one call; all tools must return equal robustness."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

LABELS = {
    "invariant": "always(x < c)",
    "resp": "always(a implies eventually b)",
}
FORMS = {
    "evaluate": "evaluate",
    "judge": "judge",
    "many": "judge_many",
    "joined": "judge_many, joined",
}


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `evaluate`, `judge` and `judge_many` against one robustness call of sentil."""
    count, repeats = (200, 20) if setting.quick else (1_000, 100)
    subject = setting.project()
    columns = {"rtamt": (subject, {})}
    if "sentil" in setting.peers:
        peer = setting.subjects()["sentil"]
        columns["sentil"] = (peer, {"form": "arrays"})
        columns["ready"] = (peer, {"form": "ready"})
    table = Table(f"{count:,} traces of 200 samples in memory, each", "us")
    table.notes["ready"] = "sentil, without making its Trace from the arrays"
    for kind, label in LABELS.items():
        for form, name in FORMS.items():
            case = {"what": "calls", "kind": kind, "count": count, "form": form}
            entries = {column: (who, case | own) for column, (who, own) in columns.items()}
            figures = race(entries, repeats, table.notes)
            values = {column: seen[1:] for column, seen in figures.items()}
            for column, seen in values.items():
                if seen != values["rtamt"]:
                    message = f"{label}: {column} has another robustness than rtamt"
                    raise AssertionError(message)
            row = {column: seen[0] for column, seen in figures.items()}
            table.rows.append(Row(f"{label}: {name}", row))
    for who, _ in columns.values():
        who.stop()
    yield table
