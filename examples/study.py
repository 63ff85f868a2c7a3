"""A study over many seeds: three tasks, each with our method, two others and controls.

A run is one seed of one method. Its row is written when it is over, and a program that was stopped
goes on with the runs that the file lacks. The seeds of a task were fixed before its first run.

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
from training import FIRST_JUDGED, printed

from rtamt_gym import (
    StlReward,
    VectorStlMonitor,
    VectorStlReward,
    compare_methods,
    evaluate_policy,
)

EPISODES = 100
FIRST_CHOSEN = 2_000_000
"""The seed of the first episode by which the policy of a run is chosen."""
TARGET = 0.98
"""The rate at which a run stops, if a test on further episodes does not refuse it."""
METHODS = ("ours", "plain", "naive", "control")
UNSTOPPED = ("control", "whole")
"""Methods that train to the end, so that their last policies say what a reward leads to."""
OURS = 5
"""How many runs of ours come with one run of each other method."""
GAMMA = 0.98

Envs = VectorEnv[Any, Any, Any]


@dataclass(frozen=True)
class Task:
    """What is learned, and how it is judged.

    Attributes:
        required: The requirements, the same for all methods.
        signals: Their signals.
        period: Time between two samples; None: the environment says it.
        learner: Makes, from a method and a seed, a learner with its environments.
        seen: Makes environments as the policy of a method sees them, whose episodes judge.
        first_seed: The seed of the first run; each further run has one more.
        steps: The most steps of the environments that a run trains.
        every: After how many steps a policy is a candidate for the best of its run.
        chosen_by: By how many episodes candidates are compared.
        methods: What is compared.
    """

    required: Mapping[str, str]
    signals: Mapping[str, Any]
    period: float | None
    learner: Callable[[str, int], Any]
    seen: Callable[[str], Any]
    first_seed: int
    steps: int
    every: int
    chosen_by: int
    methods: tuple[str, ...] = METHODS


def falling(left: float) -> float:
    """A rate of learning from 1e-3 to 0, from the share of the steps that is left."""
    return 1e-3 * left


def ppo(envs: Envs, seed: int, n_steps: int) -> Any:
    """PPO whose noise lasts ten steps, whose rollouts are whole episodes, and whose rate falls."""
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
    """Corridors of the first task."""
    return VectorCorridor(num, stride=0.1, steps=train_corridor.STEPS)


def corridor_kept(method: str) -> dict[str, Any]:
    """The arguments of the monitors of the first task."""
    return {
        "specs": train_corridor.REQUIRED,
        "signals": train_corridor.SIGNALS,
        "period": 1,
        "on_violation": "report",
        "observe": "state" if method == "ours" else None,
        "clip": 2.0,  # margins go down to -1.8
    }


def corridor_learner(method: str, seed: int) -> Any:
    """What learns to visit both places; the control sees no state of the monitors."""
    envs, kept = corridor(40), corridor_kept(method)
    if method == "naive":
        envs = VectorStlReward(envs, mode="replace", **kept)
    elif method != "plain":
        paid: dict[str, Any] = {"weight": 2.0, "bonus": train_corridor.BONUS}
        envs = VectorStlReward(envs, mode="progress", gamma=GAMMA, **paid, **kept)
    return ppo(envs, seed, train_corridor.STEPS)


def patrol(num: int) -> Envs:
    """Corridors of the second task."""
    return VectorCorridor(num, stride=0.2, steps=train_patrol.STEPS)


def patrol_kept(method: str) -> dict[str, Any]:
    """The arguments of the monitors of the second task."""
    return {
        "specs": train_patrol.REQUIRED,
        "signals": train_patrol.SIGNALS,
        "period": 1,
        "observe": {"ours": "obligations", "control": "state"}.get(method),
        "clip": 2.0,
    }


def patrol_learner(method: str, seed: int) -> Any:
    """What learns to visit both places again and again; the control sees no clocks."""
    envs, kept = patrol(10), patrol_kept(method)
    if method == "naive":
        envs = VectorStlReward(envs, mode="replace", on_violation="report", **kept)
    elif method != "plain":
        paid: dict[str, Any] = {"penalty": 1.0, "on_violation": "terminate"}
        envs = VectorStlReward(envs, mode="potential", gamma=GAMMA, **paid, **kept)
    return ppo(envs, seed, train_patrol.STEPS)


def limited(method: str) -> Env[Any, Any]:
    """What a method learns the speed limit in.

    Ours pays 30 less at the violation, which ends an episode; the control pays the same, and goes
    on. `whole` is ours.
    """
    match method:
        case "plain" | "naive":
            return train_speed_limit.trained(method)
        case _:
            return StlReward(
                train_speed_limit.made(),
                train_speed_limit.SLOW,
                train_speed_limit.SPEED,
                mode="potential",
                gamma=0.99,
                penalty=30.0,
                on_violation="report" if method == "control" else "terminate",
            )


def limit_learner(method: str, seed: int) -> Any:
    """PPO whose noise lasts eight steps, and whose rate falls."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    return PPO(
        "MlpPolicy",
        VecNormalize(make_vec_env(lambda: limited(method), 16, seed=seed)),
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
        lambda method: VectorStlMonitor(corridor(EPISODES), **corridor_kept(method)),
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
            patrol(EPISODES), on_violation="report", **patrol_kept(method)
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
        lambda _: train_speed_limit.made,
        first_seed=42_000,
        steps=163_840,
        every=16_384,
        chosen_by=20,
        methods=(*METHODS, "whole"),
    ),
}


def best_of(learner: Any, path: Path) -> Any:
    """The policy that a callback kept in a file, as its training environment shows it the world."""
    from stable_baselines3.common.vec_env import VecNormalize

    from rtamt_gym.learners.sb3 import as_trained

    envs = learner.get_env()
    if isinstance(envs, VecNormalize):
        envs = VecNormalize.load(f"{path}_vecnormalize.pkl", envs.venv)
    return as_trained(type(learner).load(path, env=envs, device="cpu"))


def run(name: str, method: str, seed: int) -> dict[str, Any]:
    """Trains one method with one seed, and judges its best policy; its row."""
    import torch

    from rtamt_gym.learners.sb3 import SatisfactionCallback, as_trained

    torch.set_num_threads(1)
    task = TASKS[name]
    asked: dict[str, Any] = {"period": task.period, "n_envs": task.chosen_by}
    learner = task.learner(method, seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "best"
        callback = SatisfactionCallback(
            task.seen(method),
            task.required,
            task.signals,
            eval_freq=task.every,
            episodes=task.chosen_by,
            seed=FIRST_CHOSEN,
            path=path,
            target=None if method in UNSTOPPED else TARGET,
            **asked,
        )
        begin = process_time()
        learner.learn(task.steps, callback=callback)
        seconds = process_time() - begin
        best = best_of(learner, path)

    def judged(policy: Any) -> int:
        found = evaluate_policy(
            policy,
            task.seen(method),
            task.required,
            task.signals,
            episodes=EPISODES,
            seed=FIRST_JUDGED,
            keep=0,
            **asked,
        )
        return found.success.satisfied

    satisfied = judged(best)
    stopped = callback.confirmed is not None
    return {
        "task": name,
        "method": method,
        "seed": seed,
        "steps": [steps for steps, _ in callback.evaluations],
        "chosen_by": [each.success.satisfied for _, each in callback.evaluations],
        "satisfied": satisfied,
        "last": satisfied if stopped else judged(as_trained(learner)),
        "stopped": stopped,
        "episodes": EPISODES,
        "seconds": round(seconds, 1),
    }


def rows_of(path: Path) -> list[dict[str, Any]]:
    """The rows of a file; a last line that was cut off is none."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return rows


def ends_of(rows: list[dict[str, Any]], name: str, key: str) -> dict[str, list[float]]:
    """Of each method of a task the shares, in percent, that its runs have at this key."""
    ends: dict[str, list[float]] = {}
    for row in rows:
        if row["task"] == name:
            ends.setdefault(row["method"], []).append(100 * row[key] / row["episodes"])
    return ends


def table(rows: list[dict[str, Any]], name: str) -> list[list[str]]:
    """The cells of the table of a task: a header, and a row for every method that has runs."""
    head = "method, runs, mean %, minimum, quartiles, below 80 %, last %, stopped, steps, s a run"
    cells = [head.split(", ")]
    rates, last = ends_of(rows, name, "satisfied"), ends_of(rows, name, "last")
    if not rates:
        return cells
    for method, found in compare_methods(rates).methods.items():
        of = [row for row in rows if (row["task"], row["method"]) == (name, method)]
        low, high = found.mean.interval
        interval = f" [{low:.1f}, {high:.1f}]" if found.runs > 1 else ""
        least, *quartiles, _ = found.quartiles
        cells.append(
            [
                method,
                str(found.runs),
                f"{found.mean.value:.1f}{interval}",
                f"{least:.0f}",
                ", ".join(f"{quartile:.0f}" for quartile in quartiles),
                f"{sum(end < 80 for end in rates[method])} of {found.runs}",
                f"{np.mean(last[method]):.1f}",
                f"{sum(row['stopped'] for row in of)} of {found.runs}",
                f"{np.mean([row['steps'][-1] for row in of]) / 1000:.0f}k",
                f"{np.mean([row['seconds'] for row in of]):.0f}",
            ]
        )
    return cells


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draws every run as a point, in the order of their rates, and the mean with its interval."""
    names = [name for name in TASKS if any(row["task"] == name for row in rows)]
    with plt.style.context(Path(__file__).with_name("paper.mplstyle")):
        figure, panels = plt.subplots(1, len(names), squeeze=False, figsize=(7.6, 3.4))
        for axes, name in zip(panels[0], names, strict=True):
            rates = ends_of(rows, name, "satisfied")
            for index, (method, found) in enumerate(compare_methods(rates).methods.items()):
                across = index + (np.linspace(0.4, -0.4, found.runs) if found.runs > 1 else 0.0)
                axes.plot(sorted(rates[method]), across, ".", color="C0", clip_on=False)
                axes.plot(found.mean.interval, [index, index], color="C1", linewidth=1.8)
                axes.plot(found.mean.value, index, "D", color="C1", clip_on=False)
            axes.axvline(80, color="0.8", linewidth=0.6, zorder=0)
            axes.set_yticks(range(len(rates)), [f"{m}, {len(r)}" for m, r in rates.items()])
            axes.set(title=name, xlim=(0, 100), ylim=(len(rates) - 0.5, -0.5))
            axes.set_xlabel("satisfied, %")
        figure.savefig(path)
        plt.close(figure)


def main(argv: list[str] | None = None) -> None:
    """Runs what the file lacks, and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("tasks", nargs="+", choices=TASKS)
    known = sorted({method for task in TASKS.values() for method in task.methods})
    parser.add_argument("--methods", nargs="+", choices=known, help="some of those of the tasks")
    parser.add_argument("--seeds", type=int, default=100, help="runs of ours; of others a fifth")
    parser.add_argument("--first-seed", type=int, help="of the runs; else that of the study")
    parser.add_argument("--output", type=Path, required=True, help="the file of rows")
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
        print(printed(table(rows_of(arguments.output), name)))
    if arguments.plot:
        draw(rows_of(arguments.output), arguments.plot)


if __name__ == "__main__":
    main()
