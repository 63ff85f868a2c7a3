"""What the experiments on learning share: runs, their rows in a file, the table and the picture.

A run trains one variant with one seed, and is judged now and then: by the same requirement for all
variants, on the same episodes, which training does not see and no monitor ends early.

To add an experiment: a script with its ``TASK`` next to this file, its name in
``tests/support/experiments.py``, its runs in ``examples/results``, and a section with its table in
``docs/experiments.md``, which a test computes again.
"""

import argparse
import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from time import process_time
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from rtamt_gym import StlMonitor, compare_methods, evaluate_policy
from rtamt_gym.results import MethodComparison
from rtamt_gym.results.method_scores import Estimate

FIELDS = ("variant", "seed", "steps", "episodes", "satisfied", "return", "seconds")
"""A row says how many of the episodes satisfied the requirement after so many steps of training,
their mean return by the environment's own reward, and how long training took until then."""

OBSERVED = "observed"
"""One more field where sub-steps judge: how many of the same episodes satisfied the requirement by
the samples at the ends of the environment's steps alone."""

FIRST_JUDGED = 1_000_000
"""The seed of the first episode that judges."""

Row = dict[str, str]


class Paying(gym.Wrapper[Any, Any, Any, Any]):
    """Pays something else: a function of the reward, of whether the episode ended, and of info."""

    def __init__(
        self, env: gym.Env[Any, Any], pay: Callable[[float, bool, Mapping[str, Any]], float]
    ) -> None:
        """Keeps the function."""
        super().__init__(env)
        self._pay = pay

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Steps, and exchanges the reward."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        paid = float(self._pay(float(reward), terminated or truncated, info))
        return obs, paid, terminated, truncated, info


@dataclass(frozen=True)
class Task:
    """What is learned, and how it is judged.

    Attributes:
        name: The name of the file of results.
        required: The requirements, the same for all variants.
        signals: The signals of the requirements.
        period: Time between two samples; None: the environment says it.
        seen: Makes the environment that the policy of a variant acts in, with what it observes.
        learner: Makes, from a variant and a seed, a learner with its environments.
        variants: Their names, in the order of the table.
        ours: The variant with which every other one is compared.
        drawn: The variants in the picture.
        first_seed: The seed of the first published run; each further run has one more.
        steps: Steps of the environment that every run trains.
        points: How often a run is judged, at equal distances.
        episodes: How many episodes judge.
        substeps: Whether every step of the physics inside of a step judges.
    """

    name: str
    required: Mapping[str, str]
    signals: Mapping[str, Any]
    period: float | None
    seen: Callable[[str], gym.Env[Any, Any]]
    learner: Callable[[str, int], Any]
    variants: tuple[str, ...]
    ours: str
    drawn: tuple[str, ...]
    first_seed: int
    steps: int
    points: int
    episodes: int
    substeps: bool = False

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields of a row."""
        return (*FIELDS, OBSERVED) if self.substeps else FIELDS


def train(task: Task, variant: str, seed: int, steps: int) -> list[Row]:
    """Trains one variant with one seed; a row for every time it is judged."""
    import torch

    torch.set_num_threads(1)
    learner = task.learner(variant, seed)
    rows, seconds = [], 0.0
    for _ in range(task.points):
        begin = process_time()
        learner.learn(steps // task.points, reset_num_timesteps=False)
        seconds += process_time() - begin
        satisfied, returned = judged(task, learner, variant, substeps=task.substeps)
        found = (variant, seed, learner.num_timesteps, task.episodes, satisfied)
        texts = [*map(str, found), f"{returned:.6g}", f"{seconds:.1f}"]
        if task.substeps:
            texts.append(str(judged(task, learner, variant, substeps=False)[0]))
        rows.append(dict(zip(task.fields, texts, strict=True)))
    return rows


def judged(task: Task, learner: Any, variant: str, *, substeps: bool) -> tuple[int, float]:
    """How many episodes satisfy all requirements, and the mean return."""

    def seen() -> gym.Env[Any, Any]:
        env = task.seen(variant)
        if not substeps:
            return env
        return StlMonitor(env, task.required, task.signals, substeps=True, on_violation="report")

    found = evaluate_policy(
        learner,
        seen,
        None if substeps else task.required,
        None if substeps else task.signals,
        period=None if substeps else task.period,
        episodes=task.episodes,
        seed=FIRST_JUDGED,
        n_envs=task.episodes,
        keep=0,
    )
    return found.success.satisfied, float(found.returns.mean())


@dataclass(frozen=True)
class Curves:
    """The runs of one variant, of shape (runs, points).

    Attributes:
        steps: Steps of training at each point.
        rates: The shares of the episodes that satisfied the requirement.
        observed: The shares by the ends of steps alone; the same where no sub-steps judge.
        returns: The mean returns.
        seconds: Seconds of training.
    """

    steps: NDArray[np.float64]
    rates: NDArray[np.float64]
    observed: NDArray[np.float64]
    returns: NDArray[np.float64]
    seconds: NDArray[np.float64]


def read_curves(path: Path) -> dict[str, Curves]:
    """The runs in a file of results, by variant."""
    runs: dict[str, dict[str, list[list[float]]]] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            counts = [int(row["satisfied"]), int(row.get(OBSERVED, row["satisfied"]))]
            rates = [count / int(row["episodes"]) for count in counts]
            point = [float(row["steps"]), *rates, float(row["return"]), float(row["seconds"])]
            runs.setdefault(row["variant"], {}).setdefault(row["seed"], []).append(point)
    return {
        variant: Curves(*np.moveaxis(np.array(list(of_seed.values())), 2, 0))
        for variant, of_seed in runs.items()
    }


def compared(
    task: Task, curves: Mapping[str, Curves], values: Callable[[Curves], NDArray[np.float64]]
) -> MethodComparison:
    """The variants by a curve of each run, such as its rates; the baseline is ours if it has runs.

    Variants may have been judged at other steps, so that the points are numbered.
    """
    found = {name: values(curves[name]) for name in task.variants if name in curves}
    points = range(max(each.shape[1] for each in found.values()))
    baseline = task.ours if task.ours in found else None
    return compare_methods(found, baseline=baseline, steps=points)


def interval(found: Estimate, runs: int) -> str:
    """A mean over runs; of several with its bootstrap interval of 95 %."""
    low, high = found.interval
    return f"{found.value:.0f}" + (f" [{low:.0f}, {high:.0f}]" if runs > 1 else "")


def table(task: Task, curves: Mapping[str, Curves]) -> list[list[str]]:
    """The cells of the table of results: a header, and a row for every variant that has runs."""
    paid = any(found.returns.any() for found in curves.values())
    head = ["variant", "seeds", "satisfied, %"]
    head += ["minimum", "observed, %", "minimum"] if task.substeps else []
    head += ["return"] * paid
    head += ["p"] if task.substeps else ["90 % at", "p", "s a seed"]  # 80 columns hold no more
    rows = [head]
    if not curves:
        return rows
    rated = compared(task, curves, lambda found: 100 * found.rates).methods
    returned = compared(task, curves, lambda found: found.returns).methods
    observed = compared(task, curves, lambda found: 100 * found.observed).methods
    for variant in task.variants:
        if variant not in curves:
            continue
        found, rates = curves[variant], rated[variant]
        reached = found.steps[0][found.rates.mean(axis=0) >= 0.9] / 1000
        row = [variant, str(rates.runs), interval(rates.mean, rates.runs)]
        if task.substeps:
            least = [f"{100 * of[:, -1].min():.0f}" for of in (found.rates, found.observed)]
            row += [least[0], interval(observed[variant].mean, rates.runs), least[1]]
        row += [interval(returned[variant].mean, rates.runs)] * paid
        several = task.ours in rated and min(rates.runs, rated[task.ours].runs) > 1
        p = f"{rates.p:.1g}" if several and rates.p is not None else ""
        at = f"{reached[0]:.0f}k" if reached.size else "never"
        row += [p] if task.substeps else [at, p, f"{found.seconds[:, -1].mean():.0f}"]
        rows.append(row)
    return rows


def printed(rows: Sequence[Sequence[str]]) -> str:
    """A table for the terminal."""
    columns = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, columns, strict=True)).rstrip()
        for row in rows
    )


def draw(task: Task, curves: Mapping[str, Curves], path: Path) -> None:
    """Draws the rates over the steps of training, with the intervals of their means.

    Where sub-steps judge, dots show the mean rates by the ends of steps alone.
    """
    rated = compared(task, curves, lambda found: 100 * found.rates).methods
    with plt.style.context(Path(__file__).with_name("paper.mplstyle")):
        figure, axes = plt.subplots(figsize=(4.6, 2.6))
        styles = cycle(["-", "--"])  # one curve may hide another
        for variant, style in zip(task.drawn, styles, strict=False):
            if variant in curves:
                steps, found = curves[variant].steps[0] / 1000, rated[variant]
                label = f"{variant}, {found.runs} runs"
                means = [each.value for each in found.curve]
                (line,) = axes.plot(steps, means, style, marker=".", label=label)
                if found.runs > 1:
                    low, high = np.array([each.interval for each in found.curve]).T
                    axes.fill_between(
                        steps, low, high, color=line.get_color(), alpha=0.2, linewidth=0
                    )
                if task.substeps:
                    observed = 100 * curves[variant].observed.mean(axis=0)
                    axes.plot(steps, observed, ":", color=line.get_color())
        axes.set(ylim=(-3, 103), xlim=(0, None))
        axes.set(xlabel="steps of training, in thousands", ylabel="satisfied, %")
        figure.legend(loc="outside right upper")
        figure.savefig(path)
        plt.close(figure)


def main(task: Task, about: str, argv: list[str] | None = None) -> None:
    """Runs what the file of results lacks, prints the table, and draws the curves."""
    parser = argparse.ArgumentParser(description=about.partition("\n")[0])
    output = Path(__file__).with_name("results") / f"{task.name}.csv"
    parser.add_argument("--seeds", type=int, default=10, help="runs of every variant")
    parser.add_argument("--first-seed", type=int, default=task.first_seed, help="of the runs")
    parser.add_argument("--variants", nargs="+", choices=task.variants, default=task.variants)
    parser.add_argument("--jobs", type=int, default=1, help="runs at the same time")
    parser.add_argument("--steps", type=int, default=task.steps, help="steps of every run")
    parser.add_argument("--output", type=Path, default=output, help="the file of results")
    parser.add_argument("--plot", type=Path, help="draw the learning curves into this file")
    arguments = parser.parse_args(argv)
    output = arguments.output
    if not output.exists():
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(",".join(task.fields) + "\n", encoding="utf-8")
    with output.open(encoding="utf-8", newline="") as file:
        finished = {(row["variant"], int(row["seed"])) for row in csv.DictReader(file)}
    runs = [
        (variant, seed)
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        for variant in arguments.variants
        if (variant, seed) not in finished
    ]
    calls = (delayed(train)(task, variant, seed, arguments.steps) for variant, seed in runs)
    for rows in Parallel(arguments.jobs, return_as="generator_unordered")(calls):
        with output.open("a", encoding="utf-8", newline="") as file:
            csv.DictWriter(file, task.fields, lineterminator="\n").writerows(rows)
        last = rows[-1]
        rate = f"{last['satisfied']} of {last['episodes']}"
        print(f"{last['variant']}, seed {last['seed']}: {rate} in {last['seconds']} s", flush=True)
    curves = read_curves(output)
    print(printed(table(task, curves)))
    if arguments.plot:
        draw(task, curves, arguments.plot)
