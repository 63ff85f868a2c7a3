"""How often a node in dense time begins anew, and whether it forgets a violation that was certain.

Messages come fast, and looks as fast as that: two threads read the clock, and a clock that one
reads before the other, and hands over after it, would look as if it went back.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from bench import INPUT, PATIENCE, Subject, bench
from late import others

RATE = 300.0
LIMIT = 1000
"""The message after which the requirement is violated, as numbers count from 1."""


@dataclass(frozen=True)
class Restarts:
    """What was found.

    Attributes:
        messages: How many came.
        restarts: How often the node began anew, as it says.
        violations: Runs in which the violation was certain, as it says.
        verdicts: What was published as the verdict, in order.
    """

    messages: int
    restarts: int
    violations: int
    verdicts: tuple[int, ...]


def subject() -> Subject:
    """A node in dense time with a requirement that is violated soon, for good."""

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
    """What a node says in so many seconds, beside so many busy processes."""
    node = subject()
    with bench(generation) as running:
        running.start(node, 1e3 / RATE)
        sink = running.worker("sink", node, topic=node.topic)
        told = running.worker("told")
        count = round(seconds * RATE)
        source = running.worker("source", topic=INPUT, rate=RATE, count=count)
        with others(busy):
            running.wait(lambda: not source.runs(), source, seconds + PATIENCE)
        for worker in (told, sink):
            worker.ask_to_end()
            worker.ended()
        (_, restarts, violations, *_), *_ = running.load("told").tolist()
        verdicts = tuple(running.load("sink")[:, 0].astype(int).tolist())
    return Restarts(count, restarts, violations, verdicts)
