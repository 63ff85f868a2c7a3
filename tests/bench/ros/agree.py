"""Compare the node with an evaluator that receives the same messages and shares no code with it.

The evaluator records the arrival of each message. For every sample that the node publishes, it
checks

- whether the stamp is on the grid, and not later than its arrival;
- which message the sample holds, by the values of `x` and `z`: the newest one that the evaluator
  had at the stamp (same), an earlier one (older) or a later one (newer). Two processes receive a
  message at different times, so a difference counts as explained if a message arrived within
  `SLACK` of the stamp. A bare subscriber is compared with the evaluator in the same way, as the
  floor;
- whether the robustness of each other requirement has the bits of its definition on the messages
  in the samples, and on the messages that the evaluator had.

The node's memory is read after a tenth of the time and at the end.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import bare
import numpy as np
from bench import INPUT, PATIENCE, Subject, bench
from definitions import REQUIREMENTS, Course
from late import others

RATE = 100.0
PERIOD = 10_000_000
SLACK = 20_000_000
"""Nanoseconds between the arrivals of a message in two processes while other programs run."""


@dataclass
class Agreement:
    """The result of a comparison.

    Attributes:
        samples: The number of samples in the node's diagnostics, over all requirements.
        compared: The values with a definition, for which the evaluator missed no sample.
        equal: The values with the same bits.
        own: The values with the same bits on the messages that the evaluator had.
        off_grid: The stamps that are not a whole number of periods after the first.
        before: The messages that arrived before their stamp.
        same: The times at which the node held the newest message of the evaluator.
        older: The times at which it held an earlier one.
        newer: The times at which it held a later one.
        unexplained: The differences without a message within `SLACK` of the stamp.
        apart: The maximum distance in nanoseconds from a stamp to a different message.
        bare_same: `same` of the bare subscriber, at the same times.
        bare_older: `older` of the bare subscriber.
        bare_newer: `newer` of the bare subscriber.
        published: The messages of the input.
        missed: The messages that the evaluator did not receive.
        bare_missed: The messages that the bare subscriber did not receive.
        lost: The messages that the node lost according to its diagnostics; -1 if unknown.
        late_arrivals: The messages taken after a sample that they preceded, by diagnostics.
        late: The samples that the node evaluated late according to its diagnostics.
        restarts: The number of restarts in the node's diagnostics.
        early: The bytes that the node held after a tenth of the time.
        whole: The bytes that it held at the end.
    """

    samples: int = 0
    compared: int = 0
    equal: int = 0
    own: int = 0
    off_grid: int = 0
    before: int = 0
    same: int = 0
    older: int = 0
    newer: int = 0
    unexplained: int = 0
    apart: int = 0
    bare_same: int = 0
    bare_older: int = 0
    bare_newer: int = 0
    published: int = 0
    missed: int = 0
    bare_missed: int = 0
    lost: int = 0
    late: int = 0
    late_arrivals: int = 0
    restarts: int = 0
    early: int = 0
    whole: int = 0


def subject() -> Subject:
    """Return a sampling node with one requirement in each of its files."""

    def command(folder: Path, period: float) -> list[str]:
        options = []
        for name, requirement in REQUIREMENTS.items():
            file = folder / f"{name}.stl"
            file.write_text(
                f"""from geometry_msgs.msg import Twist
                from geometry_msgs.msg import PointStamped
                input Twist cmd
                output PointStamped out
                @ topic(cmd, {INPUT})
                @ topic(out, bench/{name})
                out.point.x = {requirement.text}
                """
            )
            options += ["--stl", str(file)]
        return [sys.executable, "-m", "rtamt_ros", *options, "--period", f"{period:g}"]

    return Subject("sampled", "bench/x", "geometry_msgs/PointStamped", "point.x", command)


def measure(generation: int, seconds: float, *, busy: int) -> Agreement:
    """Measure the agreement over a time, next to a number of busy processes."""
    with bench(generation) as running:
        running.start(subject(), 1e3 / RATE)
        topics = {name: f"bench/{name}" for name in REQUIREMENTS}
        evaluator = running.worker("evaluator", topic=INPUT, outputs=topics)
        listener = running.worker("listener", topic=INPUT)
        counts = running.worker("told")
        count = round(seconds * RATE * 1.3)
        noise = running.worker("noise", topic=INPUT, rate=RATE * 1.3, count=count, readers=3)
        assert running.node is not None
        tenth = time.monotonic() + seconds / 10
        with others(busy):
            running.wait(lambda: time.monotonic() > tenth, noise, seconds)
            early = bare.resident(running.node.pid)
            running.wait(lambda: not noise.runs(), noise, seconds + PATIENCE)
        whole = bare.resident(running.node.pid)
        workers = (evaluator, listener, counts)
        for worker in workers:
            worker.ask_to_end()  # they save the received messages
        saving = PATIENCE + seconds / 10
        for worker in workers:
            running.wait(lambda worker=worker: not worker.runs(), worker, saving)
        with np.load(running.ros.folder / "evaluator.npz") as file:
            heard = {name: file[name] for name in file.files}
        bare_messages = running.load("listener")
        late, restarts, _, arrivals, lost = running.load("told").T
        published = int(running.load("noise"))
    agreement = compare(heard, bare_messages)
    agreement.restarts, agreement.early, agreement.whole = int(restarts.max()), early, whole
    agreement.late, agreement.lost, agreement.published = (
        int(late.sum()),
        int(lost.max()),
        published,
    )
    agreement.late_arrivals = int(arrivals.max())
    agreement.missed = published - len(heard["messages"])
    agreement.bare_missed = published - len(bare_messages)
    return agreement


def compare(heard: dict[str, np.ndarray], bare_messages: np.ndarray) -> Agreement:
    """Compare the received messages.

    Args:
        heard: ``messages``: rows of arrival in nanoseconds, and of `x` and `z` as the bits of
            floats; for each requirement rows of stamp, arrival, and robustness as bits.
        bare_messages: The messages of the bare subscriber, as ``messages``.
    """
    agreement = Agreement()
    arrivals, x, z = heard["messages"][:, 0], *heard["messages"][:, 1:].T.copy().view(np.float64)
    places = {pair: index for index, pair in enumerate(zip(x.tolist(), z.tolist(), strict=True))}
    bare_x, bare_z = bare_messages[:, 1:].T.copy().view(np.float64)
    for name in REQUIREMENTS:
        stamps, came, _ = heard[name].T
        agreement.samples += len(stamps)
        agreement.before += int(np.count_nonzero(came < stamps))
        agreement.off_grid += int(np.count_nonzero((stamps - heard["x"][0, 0]) % PERIOD))
    for begin, end in runs(heard["x"]):
        grid = np.arange(begin, end + 1, PERIOD)
        held = course(heard["x"], grid), course(heard["z"], grid)
        own = arrivals.searchsorted(grid, side="right") - 1
        bare_own = bare_messages[:, 0].searchsorted(grid, side="right") - 1
        for index_of_time in np.flatnonzero((own >= 0) & (bare_own >= 0)):
            bare_pair = (
                float(bare_x[bare_own[index_of_time]]),
                float(bare_z[bare_own[index_of_time]]),
            )
            difference = places.get(bare_pair, len(x)) - own[index_of_time]
            agreement.bare_same += int(difference == 0)
            agreement.bare_older += int(difference < 0)
            agreement.bare_newer += int(difference > 0)
            pair = float(held[0][index_of_time]), float(held[1][index_of_time])
            if np.isnan(pair).any():
                continue
            difference = places.get(pair, len(x)) - own[index_of_time]
            agreement.same += int(difference == 0)
            agreement.older += int(difference < 0)
            agreement.newer += int(difference > 0)
            if difference:
                distance = abs(arrivals - grid[index_of_time]).min()
                agreement.apart = max(agreement.apart, int(distance))
                agreement.unexplained += int(distance > SLACK)
        for name, requirement in REQUIREMENTS.items():
            published = course(heard[name], grid)
            last = len(grid) - requirement.late
            expected = requirement.means(*held)[:last]
            there = ~np.isnan(published[:last]) & ~np.isnan(expected)
            agreement.compared += int(np.count_nonzero(there))
            agreement.equal += same(published[:last][there], expected[there])
            expected = requirement.means(x[own], z[own])[:last]
            agreement.own += same(published[:last][there], expected[there])
    return agreement


def runs(rows: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and last stamp of each run; a nan or a gap of half a second ends a run."""
    stamps = rows[:, 0]
    known = ~np.isnan(rows[:, 2].copy().view(np.float64))
    ends = np.flatnonzero((np.diff(stamps) > 50 * PERIOD) | ~known[:-1] | ~known[1:]) + 1
    parts = np.split(np.arange(len(rows)), ends)
    return [(stamps[part[0]], stamps[part[-1]]) for part in parts if len(part) and known[part[0]]]


def course(rows: np.ndarray, grid: np.ndarray) -> Course:
    """Return the robustness at each time of a grid; nan without a message."""
    values = np.full(len(grid), np.nan)
    on = (rows[:, 0] >= grid[0]) & (rows[:, 0] <= grid[-1]) & ((rows[:, 0] - grid[0]) % PERIOD == 0)
    values[(rows[on, 0] - grid[0]) // PERIOD] = rows[on, 2].copy().view(np.float64)
    return values


def same(some: Course, others: Course) -> int:
    """Return how many values have the same bits."""
    return int(np.count_nonzero(some.copy().view(np.int64) == others.copy().view(np.int64)))
