"""What a judgement costs more that says how often its implication was put to the test."""

from __future__ import annotations

from collections.abc import Iterator

from controller import Setting, race
from report import Row, Table

KINDS = ("req", "point", "past", "ahead")
TARGET = 15


def measure(setting: Setting) -> Iterator[Table]:
    """`Judgement.triggers` and `Implications.evidence` beside `judge`, in percent of it."""
    for dense, sizes in ((False, (200, 10_000, 1_000_000)), (True, (1_000, 20_000))):
        what = "events of each variable, judge_dense" if dense else "samples, judge"
        table = Table(f"asked of one implication; {what}", "% of the judgement")
        subject = setting.project("asked")
        for kind in KINDS:
            for n in sizes[:2] if setting.quick else sizes:
                times = max(3, min(100, 1_000_000 // n))
                case = {"what": "asked", "kind": kind, "n": n, "dense": dense, "times": times}
                found = race({"rtamt": (subject, case)}, 3, table.notes).get("rtamt")
                if found is None:
                    continue
                judged, asked, evidence = found
                figures = {"asked": 100 * asked / judged, "evidence": 100 * evidence / judged}
                table.rows.append(Row(f"{kind} {n:,}, judged in {judged:.0f} us", figures, TARGET))
        subject.stop()
        yield table
