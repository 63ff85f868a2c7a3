"""Compare the node with an evaluator that hears the same messages and shares no code with it.

The evaluator records the arrival of each message. For every sample that the node publishes, it
checks

- whether the stamp is on the grid, and not later than its arrival;
- which message the sample holds, by the values of `x` and `z`: the newest one that the evaluator
  had by the stamp (same), an earlier one (older) or a later one (newer). Two processes hear a
  message at different times, so a difference counts as explained if a message came within `SLACK`
  of the stamp. A bare subscriber is compared with the evaluator in the same way, as the floor;
- whether the robustness of each other requirement has the bits that its definition gives on the
  messages that the samples hold, and on those that the evaluator would have held.

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
"""Nanoseconds by which two processes may hear a message apart while other programs run."""


@dataclass
class Agreement:
    """What was found.

    Attributes:
        samples: Samples that the node said it has judged, of all requirements.
        compared: Values that have a definition: all on which the evaluator missed no sample.
        equal: Those with the same bits.
        own: Values that have the same bits on the messages that the evaluator would have held.
        off_grid: Stamps that are no whole number of periods after the first.
        before: Messages that came before their stamp.
        same: Times at which the node held the newest message that the evaluator had.
        older: Times at which it held an earlier one.
        newer: Times at which it held a later one.
        unexplained: Differences without a message within `SLACK` of the stamp.
        apart: The largest distance in nanoseconds from a stamp of a different message.
        bare_same: `same` of the bare subscriber, at the same times.
        bare_older: `older` of the bare subscriber.
        bare_newer: `newer` of the bare subscriber.
        published: Messages of the input.
        missed: Messages that the evaluator did not receive.
        bare_missed: Messages that the bare subscriber did not receive.
        lost: Messages that the node lost according to its diagnostics; -1 if unknown.
        late_arrivals: Messages that it took after a sample that they preceded, also by diagnostics.
        late: Samples that the node evaluated late according to its diagnostics.
        restarts: How often the node began anew, as it says.
        early: Bytes that the node held after a tenth of the time.
        whole: Those at the end.
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
    """A node that samples with a requirement in each of its files."""

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
    """What agrees in so many seconds, beside so many busy processes."""
    with bench(generation) as running:
        running.start(subject(), 1e3 / RATE)
        topics = {name: f"bench/{name}" for name in REQUIREMENTS}
        evaluator = running.worker("evaluator", topic=INPUT, outputs=topics)
        listener = running.worker("listener", topic=INPUT)
        told = running.worker("told")
        count = round(seconds * RATE * 1.3)
        noise = running.worker("noise", topic=INPUT, rate=RATE * 1.3, count=count, readers=3)
        assert running.node is not None
        tenth = time.monotonic() + seconds / 10
        with others(busy):
            running.wait(lambda: time.monotonic() > tenth, noise, seconds)
            early = bare.resident(running.node.pid)
            running.wait(lambda: not noise.runs(), noise, seconds + PATIENCE)
        whole = bare.resident(running.node.pid)
        workers = (evaluator, listener, told)
        for worker in workers:
            worker.ask_to_end()  # they save what they heard
        saving = PATIENCE + seconds / 10
        for worker in workers:
            running.wait(lambda worker=worker: not worker.runs(), worker, saving)
        with np.load(running.ros.folder / "evaluator.npz") as file:
            heard = {name: file[name] for name in file.files}
        bare_messages = running.load("listener")
        late, restarts, _, arrivals, lost = running.load("told").T
        published = int(running.load("noise"))
    found = compare(heard, bare_messages)
    found.restarts, found.early, found.whole = int(restarts.max()), early, whole
    found.late, found.lost, found.published = int(late.sum()), int(lost.max()), published
    found.late_arrivals = int(arrivals.max())
    found.missed = published - len(heard["messages"])
    found.bare_missed = published - len(bare_messages)
    return found


def compare(heard: dict[str, np.ndarray], bare_messages: np.ndarray) -> Agreement:
    """Compare the received messages.

    Args:
        heard: ``messages``: rows of arrival in nanoseconds, and of `x` and `z` as the bits of
            floats; for each requirement rows of stamp, arrival, and robustness as bits.
        bare_messages: The messages of the bare subscriber, as ``messages``.
    """
    found = Agreement()
    arrivals, x, z = heard["messages"][:, 0], *heard["messages"][:, 1:].T.copy().view(np.float64)
    places = {pair: place for place, pair in enumerate(zip(x.tolist(), z.tolist(), strict=True))}
    bare_x, bare_z = bare_messages[:, 1:].T.copy().view(np.float64)
    for name in REQUIREMENTS:
        stamps, came, _ = heard[name].T
        found.samples += len(stamps)
        found.before += int(np.count_nonzero(came < stamps))
        found.off_grid += int(np.count_nonzero((stamps - heard["x"][0, 0]) % PERIOD))
    for begin, end in runs(heard["x"]):
        grid = np.arange(begin, end + 1, PERIOD)
        held = course(heard["x"], grid), course(heard["z"], grid)
        own = arrivals.searchsorted(grid, side="right") - 1
        bare_own = bare_messages[:, 0].searchsorted(grid, side="right") - 1
        for at in np.flatnonzero((own >= 0) & (bare_own >= 0)):
            bare_pair = float(bare_x[bare_own[at]]), float(bare_z[bare_own[at]])
            difference = places.get(bare_pair, len(x)) - own[at]
            found.bare_same += int(difference == 0)
            found.bare_older += int(difference < 0)
            found.bare_newer += int(difference > 0)
            pair = float(held[0][at]), float(held[1][at])
            if np.isnan(pair).any():
                continue
            difference = places.get(pair, len(x)) - own[at]
            found.same += int(difference == 0)
            found.older += int(difference < 0)
            found.newer += int(difference > 0)
            if difference:
                distance = abs(arrivals - grid[at]).min()
                found.apart = max(found.apart, int(distance))
                found.unexplained += int(distance > SLACK)
        for name, requirement in REQUIREMENTS.items():
            said = course(heard[name], grid)
            last = len(grid) - requirement.late
            expected = requirement.means(*held)[:last]
            there = ~np.isnan(said[:last]) & ~np.isnan(expected)
            found.compared += int(np.count_nonzero(there))
            found.equal += same(said[:last][there], expected[there])
            expected = requirement.means(x[own], z[own])[:last]
            found.own += same(said[:last][there], expected[there])
    return found


def runs(rows: np.ndarray) -> list[tuple[int, int]]:
    """The first and the last stamp of each run: it ends at nan, or before half a second of none."""
    stamps = rows[:, 0]
    known = ~np.isnan(rows[:, 2].copy().view(np.float64))
    ends = np.flatnonzero((np.diff(stamps) > 50 * PERIOD) | ~known[:-1] | ~known[1:]) + 1
    parts = np.split(np.arange(len(rows)), ends)
    return [(stamps[each[0]], stamps[each[-1]]) for each in parts if len(each) and known[each[0]]]


def course(rows: np.ndarray, grid: np.ndarray) -> Course:
    """The robustness at each time of a grid; nan where no message came."""
    found = np.full(len(grid), np.nan)
    on = (rows[:, 0] >= grid[0]) & (rows[:, 0] <= grid[-1]) & ((rows[:, 0] - grid[0]) % PERIOD == 0)
    found[(rows[on, 0] - grid[0]) // PERIOD] = rows[on, 2].copy().view(np.float64)
    return found


def same(some: Course, others: Course) -> int:
    """How many have the same bits."""
    return int(np.count_nonzero(some.copy().view(np.int64) == others.copy().view(np.int64)))
