"""The time of `rtamt.occurrences` against `judge` and `evaluate` of the body, and its growth."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

KINDS = ("predicate", "response", "until", "past", "window", "endless")
TARGET = 3


def measure(setting: Setting) -> Iterator[Table]:
    """Measure the time of all violations, divided by verdict and robustness of the body."""
    for dense, sizes in ((False, (10_000, 1_000_000)), (True, (1_000, 20_000))):
        inputs = "events of each variable" if dense else "samples"
        table = Table(f"occurrences; {inputs}", "judge + evaluate")
        subject = setting.project("occurrences")
        cases = [(kind, n) for kind in KINDS for n in (sizes[:1] if setting.quick else sizes)]
        if not (dense or setting.quick):
            cases.append(("alternating", 2_000_000))  # a million violations, in at most 1 s
        for kind, n in cases:
            times = max(3, min(50, 1_000_000 // n))
            case = {"what": "occurrences", "kind": kind, "n": n, "dense": dense, "times": times}
            figures_us = race({"rtamt": (subject, case)}, 3, table.notes).get("rtamt")
            if figures_us is None:
                continue
            base, every, rows = figures_us
            label = f"{kind} {n:,}, {rows:.0f} rows in {every:.0f} us"
            target = None if kind == "alternating" else TARGET
            table.rows.append(Row(label, {"occurrences": every / base}, target))
        subject.stop()
        yield table
