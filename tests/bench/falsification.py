"""Count the simulations that optimizers need to violate the requirements of two benchmarks.

Rows are requirements of the automatic transmission and of the chasing cars; columns are optimizers
with 20 seeds each. A row shows the number of searches that found a violation, and the mean number
of simulations, simulated seconds and processor milliseconds. The optimizers of psy-taliro get the
robustness in its own units, as from their users. All optimizers search the same spaces.

    python tests/bench/falsification.py run portfolio random cma  # searches without a result
    python tests/bench/falsification.py run portfolio --seeds 100:120 --into tuned.csv
    python tests/bench/falsification.py table
    python tests/bench/falsification.py speed  # milliseconds a run in entries

``results/falsification.csv`` has a line for each search. A search with a line is not repeated.
Needs the extra ``search``, psy-taliro for its two columns and Optuna for ``tpe``.
"""

from __future__ import annotations

import argparse
import csv
import math
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from pathlib import Path
from statistics import mean, median
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import rtamt_envs  # noqa: F401 - registers the scenarios

from rtamt_gym import Runner, Space, falsify
from rtamt_gym.search.falsification import search as searching

RESULTS = Path(__file__).parent / "results" / "falsification.csv"

Floats = np.ndarray[Any, np.dtype[np.float64]]

CARS, TRANSMISSION = "rtamt/ChasingCars-v0", "rtamt/AutomaticTransmission-v0"


class Row(NamedTuple):
    """A requirement of the table, with its system, budget and duration of a simulation."""

    system: str
    budget: int
    whole: float


ROWS = {
    **dict.fromkeys(("AT1", "AT2"), Row(TRANSMISSION, 300, 35.0)),
    **dict.fromkeys(("AT51", "AT52", "AT53", "AT54"), Row(TRANSMISSION, 300, 35.0)),
    **dict.fromkeys(("AT6a", "AT6b", "AT6c"), Row(TRANSMISSION, 1500, 35.0)),
    **dict.fromkeys(("CC1", "CC2", "CC3"), Row(CARS, 300, 100.0)),
    **dict.fromkeys(("CC4", "CC5", "CCx"), Row(CARS, 1500, 100.0)),
}


class Search(NamedTuple):
    """A line of the results."""

    requirement: str
    optimizer: str
    seed: int
    budget: int
    falsified: int
    simulations: int
    simulated: float
    milliseconds: float

    @classmethod
    def read(cls, line: Sequence[str]) -> Search:
        requirement, optimizer, *numbers = line
        counts = map(int, numbers[:4])
        return cls(requirement, optimizer, *counts, *map(float, numbers[4:]))


class Asked:
    """A request of an optimizer of psy-taliro: one or many points of the unit cube."""

    def __init__(self, evaluate: Callable[[Any], Floats]) -> None:
        self._evaluate = evaluate

    def eval_sample(self, sample: Any) -> float:  # noqa: ANN401
        return float(self._evaluate(sample.values[None])[0])

    def eval_samples(self, samples: Iterable[Any]) -> list[float]:
        points = np.array([sample.values for sample in samples])
        batches = [points[begin : begin + 64] for begin in range(0, len(points), 64)]
        return [float(value) for batch in batches for value in self._evaluate(batch)]


def of_taliro(name: str) -> Callable[[Any, int, np.random.Generator], None]:
    """Return an optimizer of psy-taliro in the form that `falsify` expects."""

    def optimize(evaluate: Any, dimension: int, rng: np.random.Generator) -> None:  # noqa: ANN401
        from staliro import optimizers
        from staliro.signals import Interval

        params = optimizers.Optimizer.Params(
            seed=int(rng.integers(2**31)),
            budget=1500,
            input_bounds=[Interval(0.0, 1.0)] * dimension,
        )
        while True:
            getattr(optimizers, name)().optimize(Asked(evaluate), params)

    return optimize


TALIRO = {
    "psy random": of_taliro("UniformRandom"),
    "psy annealing": of_taliro("DualAnnealing"),
}

COLUMNS = (
    "portfolio",
    "random",
    "cma",
    "dual_annealing",
    "differential_evolution",
    "tpe",
    *TALIRO,
)


ONE_BY_ONE = {"dual_annealing", "tpe", "psy annealing"}
"""Optimizers that request one point at a time."""


def search(requirement: str, optimizer: str, seed: int) -> Search:
    """Run one search.

    With a batch of one entry, monitors take fifty times as long as the simulation. Simulations of
    optimizers that request one point at a time are therefore judged at their end: the robustness is
    the same, and no simulation stops early.
    """
    system, budget, _ = ROWS[requirement]
    offline = patch.object(searching, "prefers_offline", return_value=True)
    begin = time.process_time()
    with offline if optimizer in ONE_BY_ONE else nullcontext():
        result = falsify(
            system,
            requirement,
            budget=budget,
            seed=seed,
            optimizer=TALIRO.get(optimizer, optimizer),
            scales="plain" if optimizer in TALIRO else None,
            reduce=False,
        )
    took = 1000 * (time.process_time() - begin)
    simulated = round(result.simulated_time, 2)
    counts = (int(result.falsified), result.simulations, simulated, round(took, 1))
    return Search(requirement, optimizer, seed, budget, *counts)


def read(path: Path) -> list[Search]:
    """Return the searches in a file."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [Search.read(line) for line in list(csv.reader(file))[1:]]


def run(path: Path, optimizers: Sequence[str], rows: Sequence[str], seeds: range) -> None:
    """Run the searches that are not in a file, and append each result at once."""
    done = {row[:3] for row in read(path)}
    if not done:
        path.write_text(",".join(Search._fields) + "\n")
    for optimizer in optimizers:
        for requirement in rows:
            left = [seed for seed in seeds if (requirement, optimizer, seed) not in done]
            if left:
                falsify(ROWS[requirement].system, requirement, budget=1)  # compile the model
            for seed in left:
                with path.open("a", newline="") as file:
                    csv.writer(file, lineterminator="\n").writerow(
                        search(requirement, optimizer, seed)
                    )
            print(*table(read(path), [optimizer], [requirement])[-1:], flush=True)


HEAD = (
    f"{'':5} {'optimizer':22} {'found':>7} {'mean':>6} {'median':>6} {'stopped':>8} {'whole':>8} "
    f"{'ms':>5}"
)


def table(searches: Sequence[Search], optimizers: Sequence[str], rows: Sequence[str]) -> list[str]:
    """Print the table, with a line for each requirement and optimizer."""
    lines = [HEAD]
    for requirement in rows:
        for optimizer in optimizers:
            own = [row for row in searches if row[:2] == (requirement, optimizer)]
            if own:
                lines.append(line(requirement, optimizer, own))
    return lines


HEADS = {
    "dual_annealing": "annealing",
    "differential_evolution": "diff. ev.",
    "psy annealing": "psy ann.",
}


def means(searches: Sequence[Search], optimizers: Sequence[str], rows: Sequence[str]) -> list[str]:
    """Print the mean number of simulations of each optimizer, and how many searches succeeded."""
    lines = [f"{'':5}" + "".join(f"{HEADS.get(name, name):>10}" for name in optimizers)]
    for requirement in rows:
        cells = [requirement.ljust(5)]
        for optimizer in optimizers:
            own = [row for row in searches if row[:2] == (requirement, optimizer)]
            counts = [row.simulations for row in own if row.falsified]
            share = "" if len(counts) == len(own) else f" {len(counts)}/{len(own)}"
            cells.append(f"{f'{mean(counts):.0f}' if counts else '-'}{share}".rjust(10))
        lines.append("".join(cells))
    return lines


def line(requirement: str, optimizer: str, own: Sequence[Search]) -> str:
    """Return a line of the table; seconds and milliseconds include failed searches."""
    counts = [row.simulations for row in own if row.falsified]
    average, middle = (mean(counts), median(counts)) if counts else (math.nan, math.nan)
    stopped = mean(row.simulated for row in own)
    seconds = mean(row.simulations for row in own) * ROWS[requirement].whole
    cost = sum(row.milliseconds for row in own) / sum(row.simulations for row in own)
    share = f"{len(counts)}/{len(own)}"
    return (
        f"{requirement:5} {optimizer:22} {share:>7} {average:6.1f} {middle:6.4g} {stopped:8.0f} "
        f"{seconds:8.0f} {cost:5.1f}"
    )


def speed(rows: Sequence[str], entries: int = 100) -> None:
    """Print processor milliseconds per random simulation, in batches and with monitors."""
    print(f"{'':5} {'ms a run':>9}   to the violation or the end, {entries} entries")
    for requirement in rows:
        with Runner(
            ROWS[requirement].system, requirement, stop="violation", batch=entries
        ) as runner:
            space = Space(runner.inputs, duration=ROWS[requirement].whole)
            points = np.random.default_rng(0).random((entries, space.dimension))
            cases = [space.case(point) for point in points]
            dict(runner.run(cases, range(entries)))  # compile the model
            took = []
            for _ in range(3):
                begin = time.process_time()
                dict(runner.run(cases, range(entries)))
                took.append(time.process_time() - begin)
        print(f"{requirement:5} {1000 * min(took) / entries:9.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("what", choices=("run", "table", "speed"))
    parser.add_argument("optimizers", nargs="*", default=COLUMNS)
    parser.add_argument("--rows", nargs="+", default=list(ROWS))
    parser.add_argument("--seeds", default="0:20", help="FIRST:END")
    parser.add_argument("--into", type=Path, default=RESULTS)
    options = parser.parse_args()
    if options.what == "run":
        run(
            options.into,
            options.optimizers,
            options.rows,
            range(*map(int, options.seeds.split(":"))),
        )
    elif options.what == "table":
        searches = read(options.into)
        there = [name for name in options.optimizers if any(row[1] == name for row in searches)]
        print(*table(searches, there, options.rows), "", sep="\n")
        print(*means(searches, there, options.rows), sep="\n")
    else:
        speed(options.rows)


if __name__ == "__main__":
    main()
