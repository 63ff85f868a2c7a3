"""How often a node in dense time restarts, and whether it forgets a certain violation.

Messages and looks are equally fast: two threads read the clock. If one thread reads it first and
passes its time on second, the clock seems to go back.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from bench import INPUT, PATIENCE, Subject, bench
from late import others

RATE = 300.0
LIMIT = 1000
"""The number of the message that violates the requirement; numbers count from 1."""


@dataclass(frozen=True)
class Restarts:
    """The figures of a run.

    Attributes:
        messages: The number of messages.
        restarts: The number of restarts in the node's diagnostics.
        violations: The number of runs with a certain violation in its diagnostics.
        verdicts: The published verdicts, in order.
    """

    messages: int
    restarts: int
    violations: int
    verdicts: tuple[int, ...]


def subject() -> Subject:
    """Return a node in dense time with a requirement that is soon violated for good."""

    def command(folder: Path, _period: float) -> list[str]:
        file = folder / "calm.stl"
        file.write_text(
            f"""from geometry_msgs.msg import Twist
            input Twist cmd
            @ topic(cmd, {INPUT})
            calm = always(cmd.linear.x <= {LIMIT})
            """
        )
        options = ["--stl", str(file), "--dense", "--period", "3", "--stale", "inf"]
        return [sys.executable, "-m", "rtamt_ros", *options]

    return Subject("dense", "rtamt/calm/verdict", "std_msgs/Int8", "data", command)


def measure(generation: int, seconds: float, *, busy: int) -> Restarts:
    """Measure a node for a time, next to busy processes."""
    node = subject()
    with bench(generation) as running:
        running.start(node, 1e3 / RATE)
        sink = running.worker("sink", node, topic=node.topic)
        counts = running.worker("told")
        count = round(seconds * RATE)
        source = running.worker("source", topic=INPUT, rate=RATE, count=count)
        with others(busy):
            running.wait(lambda: not source.runs(), source, seconds + PATIENCE)
        for worker in (counts, sink):
            worker.ask_to_end()
            worker.ended()
        (_, restarts, violations, *_), *_ = running.load("told").tolist()
        verdicts = tuple(running.load("sink")[:, 0].astype(int).tolist())
    return Restarts(count, restarts, violations, verdicts)
