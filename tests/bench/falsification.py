"""Counts the simulations that optimizers need to violate the requirements of two benchmarks.

Rows are requirements of the automatic transmission and of the chasing cars, columns optimizers, by
20 seeds each: how often a violation was found, by how many simulations, and how many simulated
seconds and milliseconds of the processor that took. psy-taliro's optimizers get the robustness in
its own units, which is what its users give them; all get the same spaces.

    python tests/bench/falsification.py run portfolio random cma  # what is not in the file yet
    python tests/bench/falsification.py run portfolio --seeds 100:120 --into tuned.csv
    python tests/bench/falsification.py table
    python tests/bench/falsification.py speed  # milliseconds a run in entries

Results stand in ``results/falsification.csv``, a line for each search; a search that has one there
is not run again. Needs the extra ``search``, psy-taliro for its two columns and Optuna for ``tpe``.
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
    """A requirement of the table: its system, the budget and the length of a whole run."""

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
    """What an optimizer of psy-taliro asks: points of the unit cube, one by one or many."""

    def __init__(self, evaluate: Callable[[Any], Floats]) -> None:
        self._evaluate = evaluate

    def eval_sample(self, sample: Any) -> float:  # noqa: ANN401
        return float(self._evaluate(sample.values[None])[0])

    def eval_samples(self, samples: Iterable[Any]) -> list[float]:
        points = np.array([sample.values for sample in samples])
        batches = [points[begin : begin + 64] for begin in range(0, len(points), 64)]
        return [float(value) for batch in batches for value in self._evaluate(batch)]


def of_taliro(name: str) -> Callable[[Any, int, np.random.Generator], None]:
    """An optimizer of psy-taliro as `falsify` calls one."""

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
"""Optimizers that ask for one point at a time."""


def search(requirement: str, optimizer: str, seed: int) -> Search:
    """Runs one search.

    In an entry alone, monitors take fifty times the simulation. Runs of optimizers that ask for one
    point at a time are therefore judged at their end: the same robustness, and no run is stopped.
    """
    system, budget, _ = ROWS[requirement]
    whole = patch.object(searching, "prefers_offline", return_value=True)
    begin = time.process_time()
    with whole if optimizer in ONE_BY_ONE else nullcontext():
        found = falsify(
            system,
            requirement,
            budget=budget,
            seed=seed,
            optimizer=TALIRO.get(optimizer, optimizer),
            scales="plain" if optimizer in TALIRO else None,
            reduce=False,
        )
    took = 1000 * (time.process_time() - begin)
    simulated = round(found.simulated_time, 2)
    counts = (int(found.falsified), found.simulations, simulated, round(took, 1))
    return Search(requirement, optimizer, seed, budget, *counts)


def read(path: Path) -> list[Search]:
    """The searches that are in a file."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [Search.read(line) for line in list(csv.reader(file))[1:]]


def run(path: Path, optimizers: Sequence[str], rows: Sequence[str], seeds: range) -> None:
    """Runs the searches that are not in a file yet, and adds them, each as soon as it is over."""
    done = {each[:3] for each in read(path)}
    if not done:
        path.write_text(",".join(Search._fields) + "\n")
    for optimizer in optimizers:
        for requirement in rows:
            left = [seed for seed in seeds if (requirement, optimizer, seed) not in done]
            if left:
                falsify(ROWS[requirement].system, requirement, budget=1)  # compiles the model
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
    """The table, a line for each requirement and optimizer."""
    lines = [HEAD]
    for requirement in rows:
        for optimizer in optimizers:
            own = [each for each in searches if each[:2] == (requirement, optimizer)]
            if own:
                lines.append(line(requirement, optimizer, own))
    return lines


HEADS = {
    "dual_annealing": "annealing",
    "differential_evolution": "diff. ev.",
    "psy annealing": "psy ann.",
}


def means(searches: Sequence[Search], optimizers: Sequence[str], rows: Sequence[str]) -> list[str]:
    """A column for each optimizer: the mean simulations, and how many found it if not all did."""
    lines = [f"{'':5}" + "".join(f"{HEADS.get(name, name):>10}" for name in optimizers)]
    for requirement in rows:
        cells = [requirement.ljust(5)]
        for optimizer in optimizers:
            own = [each for each in searches if each[:2] == (requirement, optimizer)]
            counts = [each.simulations for each in own if each.falsified]
            share = "" if len(counts) == len(own) else f" {len(counts)}/{len(own)}"
            cells.append(f"{f'{mean(counts):.0f}' if counts else '-'}{share}".rjust(10))
        lines.append("".join(cells))
    return lines


def line(requirement: str, optimizer: str, own: Sequence[Search]) -> str:
    """A line of the table: seconds and milliseconds count failures too."""
    counts = [each.simulations for each in own if each.falsified]
    average, middle = (mean(counts), median(counts)) if counts else (math.nan, math.nan)
    stopped = mean(each.simulated for each in own)
    whole = mean(each.simulations for each in own) * ROWS[requirement].whole
    cost = sum(each.milliseconds for each in own) / sum(each.simulations for each in own)
    found = f"{len(counts)}/{len(own)}"
    return (
        f"{requirement:5} {optimizer:22} {found:>7} {average:6.1f} {middle:6.4g} {stopped:8.0f} "
        f"{whole:8.0f} {cost:5.1f}"
    )


def speed(rows: Sequence[str], entries: int = 100) -> None:
    """Prints milliseconds of the processor a run of random inputs, in entries and with monitors."""
    print(f"{'':5} {'ms a run':>9}   to the violation or the end, {entries} entries")
    for requirement in rows:
        with Runner(
            ROWS[requirement].system, requirement, stop="violation", batch=entries
        ) as runner:
            space = Space(runner.inputs, duration=ROWS[requirement].whole)
            points = np.random.default_rng(0).random((entries, space.dimension))
            cases = [space.case(point) for point in points]
            dict(runner.run(cases, range(entries)))  # compiles the model
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
    given = parser.parse_args()
    if given.what == "run":
        run(given.into, given.optimizers, given.rows, range(*map(int, given.seeds.split(":"))))
    elif given.what == "table":
        searches = read(given.into)
        there = [name for name in given.optimizers if any(each[1] == name for each in searches)]
        print(*table(searches, there, given.rows), "", sep="\n")
        print(*means(searches, there, given.rows), sep="\n")
    else:
        speed(given.rows)


if __name__ == "__main__":
    main()
