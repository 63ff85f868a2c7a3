"""MuJoCo models of Gymnasium, environments of them, and FMUs: bare or with a monitor."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import worker

ASSETS = Path(gym.__file__).parent / "envs/mujoco/assets"
SPEC = "always(abs(x) < 1e9)"
SUPPORT = Path(__file__).parents[2] / "support"


def model(case: worker.Case) -> worker.Measure:
    """Return nanoseconds per ``mj_step``, from the same state in every measurement."""
    import rtamt_gym

    model = mujoco.MjModel.from_xml_path(str(ASSETS / f"{case['model']}.xml"))
    data = mujoco.MjData(model)
    steps, signal = case["steps"], case["signal"]
    if signal is None:

        def run() -> None:
            for _ in range(steps):
                mujoco.mj_step(model, data)

        reset = lambda: None  # noqa: E731
    else:
        monitor = rtamt_gym.StepMonitor(
            model, data, SPEC, {"x": signal}, forward=case.get("forward", False)
        )
        reset = monitor.reset

        def run() -> None:
            for _ in range(steps):
                monitor.step()

    def measure() -> float:
        best = float("inf")
        for _ in range(5):
            mujoco.mj_resetData(model, data)
            reset()
            begin = time.perf_counter_ns()
            run()
            best = min(best, (time.perf_counter_ns() - begin) / steps)
        return best

    return measure


def environment(case: worker.Case) -> worker.Measure:
    """Return nanoseconds per step of an environment."""
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


def fmu(case: worker.Case) -> worker.Measure:
    """Return nanoseconds per step of the tank of the tests, whose level is read."""
    sys.path.insert(0, str(SUPPORT))
    import fmpy
    import fmus

    import rtamt_gym

    version, steps = case["version"], case["steps"]
    folder = Path.cwd() / f"fmi{version}"
    folder.mkdir()
    path = fmus.write_fmu(folder / "tank.fmu", fmus.library(version, folder), version)
    described = fmpy.read_model_description(path)
    (level,) = (v.valueReference for v in described.modelVariables if v.name == "level")
    unpacked = fmpy.extract(path, folder / "unpacked")

    def bare() -> float:
        slave = fmpy.instantiate_fmu(unpacked, described, fmi_type="CoSimulation")
        if version == 2:
            slave.setupExperiment()
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        read = slave.getReal if version == 2 else slave.getFloat64
        begin = time.perf_counter_ns()
        for i in range(steps):
            slave.doStep(i * 0.1, 0.1)
            read([level])
        took = time.perf_counter_ns() - begin
        slave.terminate()
        slave.freeInstance()
        return took / steps

    def took(n: int) -> int:
        system = rtamt_gym.Fmus(path)
        begin = time.perf_counter_ns()
        rtamt_gym.simulate(system, case["specs"], duration=0.1 * n)
        return time.perf_counter_ns() - begin

    def simulated() -> float:
        # The cost of loading does not depend on the steps, so subtract it.
        loading = min(took(1) for _ in range(3))
        return (min(took(1 + steps) for _ in range(3)) - loading) / steps

    return simulated if case["specs"] else bare


def episodes(case: worker.Case) -> worker.Measure:
    """Return nanoseconds per step of a policy, in a bare loop or with `evaluate_policy`."""
    import rtamt_gym

    env: Any = gym.make("CartPole-v1")
    signals = {"x": "obs[0]", "v": "obs[1]", "a": "obs[2]"}
    signs = {"good": 1, "bad": -1}
    sign = signs[case["policy"]]

    def policy(obs: Any) -> int:  # noqa: ANN401
        return int(sign * (obs[2] + obs[3]) > 0)

    def bare() -> int:
        steps = 0
        for seed in range(case["episodes"]):
            obs, _ = env.reset(seed=seed)
            over = False
            while not over:
                obs, _, terminated, truncated, _ = env.step(policy(obs))
                over = terminated or truncated
                steps += 1
        return steps

    steps = bare()

    def measure() -> float:
        begin = time.perf_counter_ns()
        if case["specs"] is None:
            bare()
        else:
            used = {name: signals[name] for name in signals if f"{name} " in str(case["specs"])}
            used |= {name: signals[name] for name in signals if f"{name})" in str(case["specs"])}
            rtamt_gym.evaluate_policy(
                *(policy, env, case["specs"], used),
                episodes=case["episodes"],
                at_termination="failure",
                keep=0,
            )
        return (time.perf_counter_ns() - begin) / steps

    return measure


with tempfile.TemporaryDirectory() as folder:
    os.chdir(folder)  # MuJoCo writes a log into the working directory
    worker.serve({"model": model, "environment": environment, "fmu": fmu, "episodes": episodes})
