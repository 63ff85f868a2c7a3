"""The memory of a node over an hour's worth of messages at full speed.

The clock of ROS is simulated: ten messages and 0.1 s of the clock make a step, and the next one is
sent as soon as the node has answered. An hour at 100 messages and 10 samples a second is 360,000
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
    """Bytes that the node holds after a tenth, a half and all of the steps, and the steps a second.

    Attributes:
        early: After a tenth of the steps.
        half: After half of them.
        whole: At the end.
        unanswered: Steps without an answer within a second.
        speed: Steps a second.
    """

    early: int
    half: int
    whole: int
    unanswered: int
    speed: float


def measure(generation: int, subject: Subject, steps: int = STEPS) -> Memory:
    """The memory of a subject, which must be made for simulated time."""
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
