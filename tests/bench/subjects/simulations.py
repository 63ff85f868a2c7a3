"""MuJoCo models of Gymnasium stepped bare or under a monitor, and environments of them."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import worker

ASSETS = Path(gym.__file__).parent / "envs/mujoco/assets"
SPEC = "always(abs(x) < 1e9)"


def model(case: worker.Case) -> worker.Measure:
    """Nanoseconds for a ``mj_step``, from the same state in every measure."""
    import rtamt_gym

    made = mujoco.MjModel.from_xml_path(str(ASSETS / f"{case['model']}.xml"))
    data = mujoco.MjData(made)
    steps, signal = case["steps"], case["signal"]
    if signal is None:

        def run() -> None:
            for _ in range(steps):
                mujoco.mj_step(made, data)

        reset = lambda: None  # noqa: E731
    else:
        monitor = rtamt_gym.StepMonitor(
            made, data, SPEC, {"x": signal}, forward=case.get("forward", False)
        )
        reset = monitor.reset

        def run() -> None:
            for _ in range(steps):
                monitor.step()

    def measure() -> float:
        best = float("inf")
        for _ in range(5):
            mujoco.mj_resetData(made, data)
            reset()
            begin = time.perf_counter_ns()
            run()
            best = min(best, (time.perf_counter_ns() - begin) / steps)
        return best

    return measure


def environment(case: worker.Case) -> worker.Measure:
    """Nanoseconds for a step of an environment."""
    import rtamt_gym

    env: Any = gym.make(case["env"], max_episode_steps=100_000, disable_env_checker=True)
    if case["signal"] is not None:
        env = rtamt_gym.StlMonitor(
            env, SPEC, {"x": case["signal"]}, substeps=case["substeps"], on_violation="report"
        )
    env.action_space.seed(1)
    chosen = [env.action_space.sample() for _ in range(case["steps"])]

    def measure() -> float:
        best = float("inf")
        for _ in range(5):
            env.reset(seed=1)
            step = env.step
            begin = time.perf_counter_ns()
            for action in chosen:
                step(action)
            best = min(best, (time.perf_counter_ns() - begin) / len(chosen))
        return best

    return measure


with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)  # MuJoCo writes a log into the working directory
    worker.serve({"model": model, "environment": environment})
