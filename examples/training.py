"""The common part of the experiments on learning: runs, their rows in a file, table and picture.

A run trains one variant with one seed, and is evaluated at intervals: all variants by the same
requirement on the same episodes, which are not part of training, and which no monitor ends early.

To add an experiment, add a script with its ``TASK`` next to this file, its name to
``tests/support/experiments.py``, its runs to ``examples/results``, and a section with its table to
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
"""The fields of a row: after ``steps`` of training, the number of episodes that satisfied the
requirement, their mean return by the environment's own reward, and the seconds of training."""

OBSERVED = "observed"
"""The field of the number of episodes that satisfied the requirement at the ends of steps alone, if
sub-steps are evaluated."""

FIRST_EVALUATED = 1_000_000
"""The seed of the first episode of an evaluation."""

Row = dict[str, str]


class Paying(gym.Wrapper[Any, Any, Any, Any]):
    """Replace the reward by a function of the reward, of the end of the episode, and of info."""

    def __init__(
        self, env: gym.Env[Any, Any], pay: Callable[[float, bool, Mapping[str, Any]], float]
    ) -> None:
        """Set the function of the reward."""
        super().__init__(env)
        self._pay = pay

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step, and replace the reward."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        paid = float(self._pay(float(reward), terminated or truncated, info))
        return obs, paid, terminated, truncated, info


@dataclass(frozen=True)
class Task:
    """A task to learn, and its evaluation.

    Attributes:
        name: The name of the file of results.
        required: The requirements, the same for all variants.
        signals: The signals of the requirements.
        period: The time between two samples; None takes it from the environment.
        policy_env: A function that returns the environment of the policy of a variant.
        learner: A function that returns a learner with its environments for a variant and a seed.
        variants: The names of the variants, in the order of the table.
        ours: The variant that is compared with all others.
        drawn: The variants in the picture.
        first_seed: The seed of the first published run; each further run has one more.
        steps: The steps of training of every run.
        points: The number of evaluations of a run, at equal intervals.
        episodes: The number of episodes of an evaluation.
        substeps: Whether an evaluation includes every physics step.
    """

    name: str
    required: Mapping[str, str]
    signals: Mapping[str, Any]
    period: float | None
    policy_env: Callable[[str], gym.Env[Any, Any]]
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
    """Train one variant with one seed; return a row for every evaluation."""
    import torch

    torch.set_num_threads(1)
    learner = task.learner(variant, seed)
    rows, seconds = [], 0.0
    for _ in range(task.points):
        begin = process_time()
        learner.learn(steps // task.points, reset_num_timesteps=False)
        seconds += process_time() - begin
        satisfied, mean_return = evaluate(task, learner, variant, substeps=task.substeps)
        values = (variant, seed, learner.num_timesteps, task.episodes, satisfied)
        texts = [*map(str, values), f"{mean_return:.6g}", f"{seconds:.1f}"]
        if task.substeps:
            texts.append(str(evaluate(task, learner, variant, substeps=False)[0]))
        rows.append(dict(zip(task.fields, texts, strict=True)))
    return rows


def evaluate(task: Task, learner: Any, variant: str, *, substeps: bool) -> tuple[int, float]:
    """Return the number of episodes that satisfy all requirements, and the mean return."""

    def make_env() -> gym.Env[Any, Any]:
        env = task.policy_env(variant)
        if not substeps:
            return env
        return StlMonitor(env, task.required, task.signals, substeps=True, on_violation="report")

    evaluation = evaluate_policy(
        learner,
        make_env,
        None if substeps else task.required,
        None if substeps else task.signals,
        period=None if substeps else task.period,
        episodes=task.episodes,
        seed=FIRST_EVALUATED,
        n_envs=task.episodes,
        keep=0,
    )
    return evaluation.success.satisfied, float(evaluation.returns.mean())


@dataclass(frozen=True)
class Curves:
    """The runs of one variant, of shape (runs, points).

    Attributes:
        steps: The steps of training at each point.
        rates: The shares of the episodes that satisfied the requirement.
        observed: The shares at the ends of steps alone; the same without sub-steps.
        returns: The mean returns.
        seconds: Seconds of training.
    """

    steps: NDArray[np.float64]
    rates: NDArray[np.float64]
    observed: NDArray[np.float64]
    returns: NDArray[np.float64]
    seconds: NDArray[np.float64]


def read_curves(path: Path) -> dict[str, Curves]:
    """Return the runs in a file of results, by variant."""
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


def compare(
    task: Task, curves: Mapping[str, Curves], values: Callable[[Curves], NDArray[np.float64]]
) -> MethodComparison:
    """Compare variants by a curve of each run; the baseline is ours if it has runs.

    Variants may have been evaluated at different steps, so the points are numbered.
    """
    by_variant = {name: values(curves[name]) for name in task.variants if name in curves}
    points = range(max(runs.shape[1] for runs in by_variant.values()))
    baseline = task.ours if task.ours in by_variant else None
    return compare_methods(by_variant, baseline=baseline, steps=points)


def interval(mean: Estimate, runs: int) -> str:
    """Return a mean over runs as text; of several runs, with its bootstrap interval of 95 %."""
    low, high = mean.interval
    return f"{mean.value:.0f}" + (f" [{low:.0f}, {high:.0f}]" if runs > 1 else "")


def table(task: Task, curves: Mapping[str, Curves]) -> list[list[str]]:
    """Return the cells of the table of results: a header, and a row for every variant with runs."""
    has_returns = any(runs.returns.any() for runs in curves.values())
    head = ["variant", "seeds", "satisfied, %"]
    head += ["minimum", "observed, %", "minimum"] if task.substeps else []
    head += ["return"] * has_returns
    head += ["p"] if task.substeps else ["90 % at", "p", "s a seed"]  # 80 columns hold no more
    rows = [head]
    if not curves:
        return rows
    rates_of = compare(task, curves, lambda runs: 100 * runs.rates).methods
    returns_of = compare(task, curves, lambda runs: runs.returns).methods
    observed_of = compare(task, curves, lambda runs: 100 * runs.observed).methods
    for variant in task.variants:
        if variant not in curves:
            continue
        runs, rates = curves[variant], rates_of[variant]
        thousands = runs.steps[0][runs.rates.mean(axis=0) >= 0.9] / 1000
        row = [variant, str(rates.runs), interval(rates.mean, rates.runs)]
        if task.substeps:
            minima = [f"{100 * final[:, -1].min():.0f}" for final in (runs.rates, runs.observed)]
            row += [minima[0], interval(observed_of[variant].mean, rates.runs), minima[1]]
        row += [interval(returns_of[variant].mean, rates.runs)] * has_returns
        several = task.ours in rates_of and min(rates.runs, rates_of[task.ours].runs) > 1
        p = f"{rates.p:.1g}" if several and rates.p is not None else ""
        first = f"{thousands[0]:.0f}k" if thousands.size else "never"
        row += [p] if task.substeps else [first, p, f"{runs.seconds[:, -1].mean():.0f}"]
        rows.append(row)
    return rows


def text_table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table for the terminal."""
    columns = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, columns, strict=True)).rstrip()
        for row in rows
    )


def draw(task: Task, curves: Mapping[str, Curves], path: Path) -> None:
    """Draw the rates over the steps of training, with the intervals of their means.

    With sub-steps, dots show the mean rates at the ends of steps alone.
    """
    rates_of = compare(task, curves, lambda runs: 100 * runs.rates).methods
    with plt.style.context(Path(__file__).with_name("paper.mplstyle")):
        figure, axes = plt.subplots(figsize=(4.6, 2.6))
        styles = cycle(["-", "--"])  # one curve may hide another
        for variant, style in zip(task.drawn, styles, strict=False):
            if variant in curves:
                steps, rates = curves[variant].steps[0] / 1000, rates_of[variant]
                label = f"{variant}, {rates.runs} runs"
                means = [point.value for point in rates.curve]
                (line,) = axes.plot(steps, means, style, marker=".", label=label)
                if rates.runs > 1:
                    low, high = np.array([point.interval for point in rates.curve]).T
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
    """Run what the file of results lacks, print the table, and draw the curves."""
    parser = argparse.ArgumentParser(description=about.partition("\n")[0])
    output = Path(__file__).with_name("results") / f"{task.name}.csv"
    parser.add_argument("--seeds", type=int, default=10, help="runs of every variant")
    parser.add_argument(
        "--first-seed", type=int, default=task.first_seed, help="seed of the first run"
    )
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
    print(text_table(table(task, curves)))
    if arguments.plot:
        draw(task, curves, arguments.plot)
