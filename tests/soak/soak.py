"""Run monitors for a long time: memory stays flat, and samples of the results equal the definition.

Three parts, each with its own number: updates of a mixed set of native monitors (a sample of a
signal or of an entry, or an event), wrappers of Gymnasium created and dropped, and snapshots. The
Python machines run samples of the rounds again, compared bit by bit. The resident memory after a
tenth of a part is compared with its end.

Run: python tests/soak/soak.py [--updates N] [--wrappers N] [--snapshots N] [--seed N]
"""

from __future__ import annotations

import argparse
import copy
import gc
import os
import sys
from collections.abc import Callable, Sequence
from multiprocessing import Process
from pathlib import Path
from typing import Any, Literal

import numpy as np
from bits import identical
from gymnasium.envs.classic_control import CartPoleEnv

import rtamt
from rtamt_gym import StlMonitor

TEXT = "always[0:5](x > 0 implies eventually[0:20](y > 1)) and once[3:40](x + y > 0)"
ENTRIES = 1_000
BLOCK, ENTRY_SAMPLES, SAMPLES, EVENTS = 40_000, 100, 4_000, 1_000  # of a round
WRAPPED = "always[0:100ms](abs(angle) < 0.2) and once[0:40ms](cart < 1)"
ROUND = BLOCK + 2 * ENTRIES * ENTRY_SAMPLES + 2 * SAMPLES + 2 * EVENTS
CHECKS = 5  # the number of compared rounds of a part
FLAT = 4 << 20  # bytes by which the allocator's pages may differ

Backend = Literal["native", "python"]
Found = list[Any]


class Rounds:
    """A mixed set of monitors that run one round of samples after the other.

    Args:
        backend: The back-end.
        seed: The seed of the samples.
        entries: The batch entries.
        first: The first round.
    """

    def __init__(
        self, backend: Backend, seed: int, entries: Sequence[int] = range(ENTRIES), first: int = 0
    ) -> None:
        self._next, self._seed, self._entries, number = first, seed, entries, len(entries)
        self._block = rtamt.Monitor(TEXT, backend=backend)
        self._single = rtamt.Monitor(TEXT, backend=backend)
        self._episode = rtamt.EpisodeMonitor(TEXT, backend=backend)
        self._late = rtamt.VectorMonitor(TEXT, number, backend=backend)
        self._episodes = rtamt.VectorEpisodeMonitor(TEXT, number, backend=backend)
        self._dense = rtamt.dense.Monitor(TEXT, backend=backend)

    def run(self) -> Found:
        """Return the results of the monitors in the next round."""
        random = np.random.default_rng((self._seed, self._next))
        block = random.normal(size=(BLOCK, 2))
        entries = random.normal(size=(ENTRY_SAMPLES, ENTRIES, 2))[:, list(self._entries)]
        samples = random.normal(size=(SAMPLES, 2)).tolist()
        events = random.normal(size=(EVENTS, 2)).tolist()
        found: Found = [self._block.update_many(block)]
        self._episode.reset()
        found += [self._single.update(x, y) for x, y in samples]
        found += [self._episode.update(x, y) for x, y in samples]
        found += [self._episode.lower, self._episode.upper, self._episode.finish("cut")]
        self._episodes.reset()
        for values in entries:
            found += [self._late.update(values), self._episodes.update(values)]
        for i, (x, y) in enumerate(events):
            time = (self._next * EVENTS + i) * 0.5
            found.append(self._dense.update({"x": [(time, x)], "y": [(time, y)]}))
        self._next += 1
        return found


def updates(number: int, seed: int) -> None:
    """Run rounds of updates; the definition repeats some of them, after the round before."""
    native = Rounds("native", seed)

    def step(i: int, sampled: bool) -> None:  # noqa: FBT001 - called by position
        found = native.run()
        if sampled:
            check = Process(target=defined_round, args=(i, seed, found))
            check.start()  # in another process: the definition needs memory of its own
            check.join()
            if check.exitcode != 0:
                sys.exit(1)

    soak("updates", -(-number // ROUND), ROUND, step)


def defined_round(i: int, seed: int, found: Found) -> None:
    """Compare a round, for some of its entries, with the definition."""
    some = [0, ENTRIES // 2, ENTRIES - 1]
    defined = Rounds("python", seed, some, max(i - 1, 0))
    if i > 0:
        defined.run()
    thin = [each[some] if np.shape(each) == (ENTRIES,) else each for each in found]
    require_same(thin, defined.run(), f"of round {i}")


def wrappers(number: int, seed: int) -> None:
    """Wrap, reset and step environments five times, and drop them."""

    def step(i: int, sampled: bool) -> None:  # noqa: FBT001 - called by position
        env = StlMonitor(CartPoleEnv(), WRAPPED, {"angle": "obs[2]", "cart": "obs[0]"})
        obs, info = env.reset(seed=seed + i)
        shown = [(obs, info)]
        for k in range(5):
            obs, _, _, _, info = env.step((i >> k) & 1)
            shown.append((obs, info))
        env.close()
        if sampled:
            defined = rtamt.EpisodeMonitor(WRAPPED, "20ms", backend="python")
            for obs, info in shown:
                defined.update(angle=float(obs[2]), cart=float(obs[0]))
                found = [info["robustness"], info["stl_lower"], info["stl_upper"]]
                expected = [defined.robustness, defined.lower, defined.upper]
                require_same(found, expected, f"of wrapper {i}")

    soak("wrappers", number, 1, step)


def snapshots(number: int, seed: int) -> None:
    """Run monitors that continue as their copies, of two kinds in turn."""
    random = np.random.default_rng(seed)
    kinds = (rtamt.Monitor, rtamt.EpisodeMonitor)
    native: list[Any] = [kind(TEXT, backend="native") for kind in kinds]
    defined: list[Any] = [kind(TEXT, backend="python") for kind in kinds]

    def step(i: int, _: bool) -> None:  # noqa: FBT001 - all are compared
        k, sample = i % len(kinds), random.normal(size=2).tolist()
        native[k] = copy.copy(native[k])
        found, expected = native[k].update(*sample), defined[k].update(*sample)
        require_same([found], [expected], f"of snapshot {i}")

    soak("snapshots", number, 1, step, number)


def soak(
    name: str, steps: int, each: int, step: Callable[[int, bool], None], checks: int = CHECKS
) -> None:
    """Run a number of steps, compare some, and compare the memory at a tenth and at the end."""
    sampled = {round(k) for k in np.linspace(0, steps - 1, min(checks, steps))}
    early = 0
    for i in range(steps):
        step(i, i in sampled)
        if i == steps // 10:
            early = resident()
    grown = resident() - early
    print(
        f"{name:10} {steps * each:>13,}, {len(sampled):,} stretches equal the definition, "
        f"memory grew by {grown / 2**20:+.1f} MiB",
        flush=True,
    )
    if grown > FLAT:
        sys.exit(f"expected memory to grow by less than {FLAT >> 20} MiB after a tenth")


def require_same(found: Found, expected: Found, of: str) -> None:
    """Exit with the difference, if values differ in a bit."""
    for i, (one, other) in enumerate(zip(found, expected, strict=True)):
        if not identical(np.ravel(one), np.ravel(other)):
            sys.exit(f"expected value {i} {of} to be {other!r}, got {one!r}")


def resident() -> int:
    """Return the resident bytes of this process."""
    gc.collect()
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGESIZE")


def main() -> None:
    """Run the three parts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--updates", type=int, default=10**9, help="default: 1e9")
    parser.add_argument("--wrappers", type=int, default=10**5, help="default: 1e5")
    parser.add_argument("--snapshots", type=int, default=10**6, help="default: 1e6")
    parser.add_argument("--seed", type=int, default=0, help="of all samples (default: 0)")
    args = parser.parse_args()
    for part, number in (
        (updates, args.updates),
        (wrappers, args.wrappers),
        (snapshots, args.snapshots),
    ):
        if number > 0:
            part(number, args.seed)


if __name__ == "__main__":
    main()
