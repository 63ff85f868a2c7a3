"""A study over many seeds: three tasks, each with our method, two others and controls.

A run is one seed of one method. Its row is written at its end, and a restarted program continues
with the runs that the file lacks. The seeds of a task were fixed before its first run.

Run: python examples/study.py corridor patrol speed_limit --seeds 100 --output study.jsonl
"""

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import train_corridor
import train_patrol
import train_speed_limit
from corridor import VectorCorridor
from gymnasium import Env
from gymnasium.vector import VectorEnv
from training import FIRST_EVALUATED, text_table

from rtamt_gym import (
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
    compare_methods,
    evaluate_policy,
)

EPISODES = 100
FIRST_CHOSEN = 2_000_000
"""The seed of the first episode for choosing the policy of a run."""
TARGET = 0.98
"""The rate at which a run stops, if a test on further episodes confirms it."""
METHODS = ("ours", "plain", "naive", "control")
UNSTOPPED = ("control", "whole")
"""Methods that train to the end, so that their last policies show the effect of a reward."""
OURS = 5
"""The number of runs of ours per run of another method."""
GAMMA = 0.98

Envs = VectorEnv[Any, Any, Any]


@dataclass(frozen=True)
class Task:
    """A task to learn, and its evaluation.

    Attributes:
        required: The requirements, the same for all methods.
        signals: Their signals.
        period: The time between two samples; None takes it from the environment.
        learner: A function that returns a learner with its environments for a method and a seed.
        policy_env: A function that returns the environments for evaluating a method.
        first_seed: The seed of the first run; each further run has one more.
        steps: The maximum number of steps of training.
        every: The number of steps between candidates for the best policy of a run.
        chosen_by: The number of episodes for comparing candidates.
        methods: The compared methods.
    """

    required: Mapping[str, str]
    signals: Mapping[str, Any]
    period: float | None
    learner: Callable[[str, int], Any]
    policy_env: Callable[[str], Any]
    first_seed: int
    steps: int
    every: int
    chosen_by: int
    methods: tuple[str, ...] = METHODS


def falling(left: float) -> float:
    """Return a learning rate from 1e-3 to 0; ``left`` is the share of the remaining steps."""
    return 1e-3 * left


def ppo(envs: Envs, seed: int, n_steps: int) -> Any:
    """Return PPO with noise over ten steps, rollouts of whole episodes, and a falling rate."""
    from stable_baselines3 import PPO
    from vec_env import GymnasiumVecEnv

    return PPO(
        "MlpPolicy",
        GymnasiumVecEnv(envs, seed),
        n_steps=n_steps,
        batch_size=250,
        learning_rate=falling,
        gamma=GAMMA,
        gae_lambda=1.0,
        use_sde=True,
        sde_sample_freq=10,
        seed=seed,
        device="cpu",
    )


def corridor(num: int) -> Envs:
    """Return the corridors of the first task."""
    return VectorCorridor(num, stride=0.1, steps=train_corridor.STEPS)


def corridor_options(method: str) -> dict[str, Any]:
    """Return the arguments of the monitors of the first task."""
    return {
        "specs": train_corridor.REQUIRED,
        "signals": train_corridor.SIGNALS,
        "period": 1,
        "on_violation": "report",
        "observe": "state" if method == "ours" else None,
        "clip": 2.0,  # margins go down to -1.8
    }


def corridor_learner(method: str, seed: int) -> Any:
    """Return the learner of visiting both ends; the control does not see the monitor state."""
    envs, options = corridor(40), corridor_options(method)
    if method == "naive":
        envs = VectorStlReward(envs, mode="replace", **options)
    elif method != "plain":
        reward: dict[str, Any] = {"weight": 2.0, "bonus": train_corridor.BONUS}
        envs = VectorStlReward(envs, mode="progress", gamma=GAMMA, **reward, **options)
    return ppo(envs, seed, train_corridor.STEPS)


def patrol(num: int) -> Envs:
    """Return the corridors of the second task."""
    return VectorCorridor(num, stride=0.2, steps=train_patrol.STEPS)


def patrol_options(method: str) -> dict[str, Any]:
    """Return the arguments of the monitors of the second task."""
    return {
        "specs": train_patrol.REQUIRED,
        "signals": train_patrol.SIGNALS,
        "period": 1,
        "observe": {"ours": "obligations", "control": "state"}.get(method),
        "clip": 2.0,
    }


def patrol_learner(method: str, seed: int) -> Any:
    """Return the learner of patrolling both ends; the control does not see the obligations."""
    envs, options = patrol(10), patrol_options(method)
    if method == "naive":
        envs = VectorStlReward(envs, mode="replace", on_violation="report", **options)
    elif method != "plain":
        reward: dict[str, Any] = {"penalty": 1.0, "on_violation": "terminate"}
        envs = VectorStlReward(envs, mode="potential", gamma=GAMMA, **reward, **options)
    return ppo(envs, seed, train_patrol.STEPS)


def speed_limit_env(method: str) -> Env[Any, Any]:
    """Return the training environment of a method for the speed limit.

    In ours, a violation costs 30 and ends the episode; in the control, it costs 30 and the episode
    continues. `whole` is ours.
    """
    match method:
        case "plain" | "naive":
            return train_speed_limit.training_env(method)
        case _:
            return StlReward(
                train_speed_limit.make_env(),
                train_speed_limit.SLOW,
                train_speed_limit.SPEED,
                mode="potential",
                gamma=0.99,
                penalty=30.0,
                on_violation="report" if method == "control" else "terminate",
            )


def limit_learner(method: str, seed: int) -> Any:
    """Return PPO with noise over eight steps and a falling rate."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    return PPO(
        "MlpPolicy",
        VecNormalize(make_vec_env(lambda: speed_limit_env(method), 16, seed=seed)),
        n_steps=128,
        batch_size=512,
        learning_rate=falling,
        use_sde=True,
        sde_sample_freq=8,
        policy_kwargs={"log_std_init": -3.0},
        seed=seed,
        device="cpu",
    )


TASKS = {
    "corridor": Task(
        train_corridor.REQUIRED,
        train_corridor.SIGNALS,
        1.0,
        corridor_learner,
        lambda method: VectorStlMonitor(corridor(EPISODES), **corridor_options(method)),
        first_seed=40_000,
        steps=40_000,
        every=4000,
        chosen_by=EPISODES,
    ),
    "patrol": Task(
        train_patrol.REQUIRED,
        train_patrol.SIGNALS,
        1.0,
        patrol_learner,
        lambda method: VectorStlMonitor(
            patrol(EPISODES), on_violation="report", **patrol_options(method)
        ),
        first_seed=41_000,
        steps=48_000,
        every=4000,
        chosen_by=EPISODES,
    ),
    "speed_limit": Task(
        train_speed_limit.REQUIRED,
        train_speed_limit.SIGNALS,
        None,
        limit_learner,
        lambda _: train_speed_limit.make_env,
        first_seed=42_000,
        steps=163_840,
        every=16_384,
        chosen_by=20,
        methods=(*METHODS, "whole"),
    ),
}


def best_of(learner: Any, path: Path) -> Any:
    """Return the best policy from its file, with the normalization of its training environment."""
    from stable_baselines3.common.vec_env import VecNormalize

    from rtamt_gym.learners.sb3 import as_trained

    envs = learner.get_env()
    if isinstance(envs, VecNormalize):
        envs = VecNormalize.load(f"{path}_vecnormalize.pkl", envs.venv)
    return as_trained(type(learner).load(path, env=envs, device="cpu"))


def run(name: str, method: str, seed: int) -> dict[str, Any]:
    """Train one method with one seed, and evaluate its best policy; return the row."""
    import torch

    from rtamt_gym.learners.sb3 import SatisfactionCallback, as_trained

    torch.set_num_threads(1)
    task = TASKS[name]
    options: dict[str, Any] = {"period": task.period, "n_envs": task.chosen_by}
    learner = task.learner(method, seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "best"
        callback = SatisfactionCallback(
            task.policy_env(method),
            task.required,
            task.signals,
            eval_freq=task.every,
            episodes=task.chosen_by,
            seed=FIRST_CHOSEN,
            path=path,
            target=None if method in UNSTOPPED else TARGET,
            **options,
        )
        begin = process_time()
        learner.learn(task.steps, callback=callback)
        seconds = process_time() - begin
        best = best_of(learner, path)

    def count_satisfied(policy: Any) -> int:
        evaluation = evaluate_policy(
            policy,
            task.policy_env(method),
            task.required,
            task.signals,
            episodes=EPISODES,
            seed=FIRST_EVALUATED,
            keep=0,
            **options,
        )
        return evaluation.success.satisfied

    satisfied = count_satisfied(best)
    stopped = callback.confirmed is not None
    return {
        "task": name,
        "method": method,
        "seed": seed,
        "steps": [steps for steps, _ in callback.evaluations],
        "chosen_by": [evaluation.success.satisfied for _, evaluation in callback.evaluations],
        "satisfied": satisfied,
        "last": satisfied if stopped else count_satisfied(as_trained(learner)),
        "stopped": stopped,
        "episodes": EPISODES,
        "seconds": round(seconds, 1),
    }


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a file, without an incomplete last line."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return rows


def ends_of(rows: list[dict[str, Any]], name: str, key: str) -> dict[str, list[float]]:
    """Return the rates of all runs of a task in percent, by method; ``key`` names the count."""
    ends: dict[str, list[float]] = {}
    for row in rows:
        if row["task"] == name:
            ends.setdefault(row["method"], []).append(100 * row[key] / row["episodes"])
    return ends


def table(rows: list[dict[str, Any]], name: str) -> list[list[str]]:
    """Return the cells of the table of a task: a header, and a row for every method with runs."""
    head = "method, runs, mean %, minimum, quartiles, below 80 %, last %, stopped, steps, s a run"
    cells = [head.split(", ")]
    rates, last = ends_of(rows, name, "satisfied"), ends_of(rows, name, "last")
    if not rates:
        return cells
    for method, scores in compare_methods(rates).methods.items():
        runs = [row for row in rows if (row["task"], row["method"]) == (name, method)]
        low, high = scores.mean.interval
        interval = f" [{low:.1f}, {high:.1f}]" if scores.runs > 1 else ""
        minimum, *quartiles, _ = scores.quartiles
        cells.append(
            [
                method,
                str(scores.runs),
                f"{scores.mean.value:.1f}{interval}",
                f"{minimum:.0f}",
                ", ".join(f"{quartile:.0f}" for quartile in quartiles),
                f"{sum(end < 80 for end in rates[method])} of {scores.runs}",
                f"{np.mean(last[method]):.1f}",
                f"{sum(row['stopped'] for row in runs)} of {scores.runs}",
                f"{np.mean([row['steps'][-1] for row in runs]) / 1000:.0f}k",
                f"{np.mean([row['seconds'] for row in runs]):.0f}",
            ]
        )
    return cells


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw every run as a point, in the order of their rates, and the mean with its interval."""
    names = [name for name in TASKS if any(row["task"] == name for row in rows)]
    with plt.style.context(Path(__file__).with_name("paper.mplstyle")):
        figure, plots = plt.subplots(1, len(names), squeeze=False, figsize=(7.6, 3.4))
        for axes, name in zip(plots[0], names, strict=True):
            rates = ends_of(rows, name, "satisfied")
            for index, (method, scores) in enumerate(compare_methods(rates).methods.items()):
                offsets = np.linspace(0.4, -0.4, scores.runs) if scores.runs > 1 else 0.0
                across = index + offsets
                axes.plot(sorted(rates[method]), across, ".", color="C0", clip_on=False)
                axes.plot(scores.mean.interval, [index, index], color="C1", linewidth=1.8)
                axes.plot(scores.mean.value, index, "D", color="C1", clip_on=False)
            axes.axvline(80, color="0.8", linewidth=0.6, zorder=0)
            axes.set_yticks(range(len(rates)), [f"{m}, {len(r)}" for m, r in rates.items()])
            axes.set(title=name, xlim=(0, 100), ylim=(len(rates) - 0.5, -0.5))
            axes.set_xlabel("satisfied, %")
        figure.savefig(path)
        plt.close(figure)


def main(argv: list[str] | None = None) -> None:
    """Run what the file lacks, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tasks", nargs="+", choices=TASKS)
    known = sorted({method for task in TASKS.values() for method in task.methods})
    parser.add_argument("--methods", nargs="+", choices=known, help="run only these methods")
    parser.add_argument(
        "--seeds", type=int, default=100, help="runs of ours; other methods run a fifth"
    )
    parser.add_argument(
        "--first-seed", type=int, help="seed of the first run (default: as in the study)"
    )
    parser.add_argument("--output", type=Path, required=True, help="file of the rows")
    parser.add_argument("--plot", type=Path, help="draw the rates of all runs into this file")
    arguments = parser.parse_args(argv)
    finished = {(row["task"], row["method"], row["seed"]) for row in rows_of(arguments.output)}
    first = arguments.first_seed
    runs = [
        (name, method, (TASKS[name].first_seed if first is None else first) + index // every)
        for index in range(arguments.seeds)
        for name in arguments.tasks
        for method in TASKS[name].methods
        for every in [1 if method == "ours" else OURS]
        if index % every == 0 and (arguments.methods is None or method in arguments.methods)
    ]
    for name, method, seed in runs:
        if (name, method, seed) in finished:
            continue
        row = run(name, method, seed)
        with arguments.output.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{name}, {method}, seed {seed}: {row['satisfied']} of {EPISODES}", flush=True)
    for name in arguments.tasks:
        print(text_table(table(rows_of(arguments.output), name)))
    if arguments.plot:
        draw(rows_of(arguments.output), arguments.plot)


if __name__ == "__main__":
    main()
