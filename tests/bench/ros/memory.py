"""The memory of a node over an hour of messages at full speed.

The ROS clock is simulated: a step has ten messages and advances the clock by 0.1 s, and the next
step follows the answer of the node. An hour at 100 messages and 10 samples per second is 360,000
messages and 36,000 steps.
"""

from __future__ import annotations

import xmlrpc.client
from dataclasses import dataclass

import numpy as np
from bench import INPUT, Subject, bench

STEPS = 36_000


@dataclass(frozen=True)
class Memory:
    """The bytes that the node holds, and its speed.

    Attributes:
        early: After a tenth of the steps.
        half: After half of them.
        whole: At the end.
        unanswered: Steps without an answer within a second.
        speed: Steps per second.
    """

    early: int
    half: int
    whole: int
    unanswered: int
    speed: float


def measure(generation: int, subject: Subject, steps: int = STEPS) -> Memory:
    """Return the memory of a subject that uses simulated time."""
    with bench(generation) as running:
        if generation == 1:
            master = xmlrpc.client.ServerProxy(running.ros.environment["ROS_MASTER_URI"])
            master.setParam("bench", "/use_sim_time", True)  # noqa: FBT003 - the API of the master
        running.start(subject, 100.0)
        assert running.node is not None
        sending = running.worker(
            "hour",
            subject,
            topic=INPUT,
            out=subject.topic,
            every=subject.name.startswith("dense"),
            steps=steps,
            pid=running.node.pid,
        )
        running.wait(lambda: not sending.runs(), sending, steps * 0.1 + 60.0)
        rows = running.load("hour")
    answered = rows[:, 0] > 0
    times = rows[answered, 0]
    held = rows[:, 1]
    return Memory(
        int(held[steps // 10]),
        int(held[steps // 2]),
        int(held[-1]),
        int(np.count_nonzero(~answered)),
        (len(times) - 1) / (times[-1] - times[0]) * 1e9 if len(times) > 1 else 0.0,
    )
