"""The additional cost of counting the triggers of an implication."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

KINDS = ("req", "point", "past", "ahead")
TARGET = 15


def measure(setting: Setting) -> Iterator[Table]:
    """Measure `Judgement.triggers` and `Implications.evidence`, in percent of `judge`."""
    for dense, sizes in ((False, (200, 10_000, 1_000_000)), (True, (1_000, 20_000))):
        inputs = "events of each variable, judge_dense" if dense else "samples, judge"
        table = Table(f"triggers of one implication; {inputs}", "% of the judgement")
        subject = setting.project("triggers")
        for kind in KINDS:
            for n in sizes[:2] if setting.quick else sizes:
                times = max(3, min(100, 1_000_000 // n))
                case = {"what": "triggers", "kind": kind, "n": n, "dense": dense, "times": times}
                times_us = race({"rtamt": (subject, case)}, 3, table.notes).get("rtamt")
                if times_us is None:
                    continue
                judged, triggers, evidence = times_us
                figures = {"triggers": 100 * triggers / judged, "evidence": 100 * evidence / judged}
                table.rows.append(Row(f"{kind} {n:,}, judged in {judged:.0f} us", figures, TARGET))
        subject.stop()
        yield table
