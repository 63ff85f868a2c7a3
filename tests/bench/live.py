"""The cost of a live view per step; needs rerun-sdk. Usage: python tests/bench/live.py

Prints processor microseconds per step, the minimum of several runs: without a view, with a view
that writes a file, with a view and a viewer, and for pictures. They include the sending thread. The
viewer is a process of its own.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

import rtamt
from rtamt_gym import EvaluationOptions, StepMonitor, StlMonitor, VectorStlMonitor, simulate
from rtamt_gym.commands.watch import StreamView
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.watch import StreamWatch, WatchOptions

SPECS = {
    "upright": "always(abs(theta) < 0.2)",
    "centre": "always(abs(x) < 2)",
    "back": "always((x > 1) implies eventually[0:1](x < 1))",
}
SIGNALS = {"theta": "obs[2]", "x": "obs[0]", "speed": ("reward", 0.0)}
MODEL = """<mujoco><worldbody><body><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>
</worldbody></mujoco>"""
STEPS, EPISODE, REPEATS = 60_000, 500, 4


class Cheap(gym.Env[Any, Any]):
    """An environment with a step of negligible cost."""

    observation_space = gym.spaces.Box(-9, 9, (4,), np.float32)
    action_space = gym.spaces.Discrete(2)
    metadata = {"render_fps": 50, "render_modes": ["rgb_array"]}  # noqa: RUF012
    render_mode = "rgb_array"
    _obs = np.zeros(4, np.float32)
    _frame = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ARG002
        return self._obs, {}

    def step(self, action: Any) -> Any:  # noqa: ARG002
        return self._obs, 1.0, False, False, {}

    def render(self) -> Any:
        return self._frame


def send(live: Any) -> None:
    """Send the queued data, so that the time includes its full cost."""
    if live is not None:
        live.send()


def single(live: Any, steps: int = STEPS) -> float:
    """Return microseconds for a step of `StlMonitor`."""
    keywords = {} if live is None else {"live": live}
    env = StlMonitor(Cheap(), SPECS, SIGNALS, on_violation="report", period=0.02, **keywords)
    since = time.process_time()
    for number in range(steps):
        if number % EPISODE == 0:
            env.reset()
        env.step(0)
    send(live)
    return (time.process_time() - since) / steps * 1e6


def vector(live: Any, num: int = 64) -> float:
    """Return microseconds for a step of `VectorStlMonitor`."""
    keywords = {} if live is None else {"live": live}
    envs = gym.make_vec("CartPole-v1", num_envs=num, vectorization_mode="vector_entry_point")
    monitor = VectorStlMonitor(
        envs, SPECS, {**SIGNALS, "speed": "obs[1]"}, at_termination="cut", **keywords
    )
    monitor.reset(seed=1)
    actions = np.zeros(num, np.int64)
    steps = STEPS // 10
    since = time.process_time()
    for _ in range(steps):
        monitor.step(actions)
    send(live)
    return (time.process_time() - since) / steps * 1e6


def mujoco_step(live: Any) -> float:
    """Return microseconds for a step of `StepMonitor`."""
    keywords = {} if live is None else {"live": live}
    model = mujoco.MjModel.from_xml_string(MODEL)
    monitor = StepMonitor(
        model, mujoco.MjData(model), "always(z > -1e9)", {"z": "qpos[0]"}, **keywords
    )
    monitor.reset()
    since = time.process_time()
    for _ in range(STEPS):
        monitor.step()
    send(live)
    return (time.process_time() - since) / STEPS * 1e6


def streamed(live: Any) -> float:
    """Return microseconds for a row of `rtamt watch`."""
    specs = {name: rtamt.parse(text) for name, text in SPECS.items()}
    options = WatchOptions(specs, EvaluationOptions(), Columns())
    watch = StreamWatch(options, "stdin", lambda _: None)
    if live is not None:
        watch.rules.show = StreamView(live, [*specs], watch.rules.variables).sample
    text = "time,theta,x\n" + "".join(f"{i / 50},0,0\n" for i in range(STEPS))
    since = time.process_time()
    watch.add(text.encode())
    send(live)
    return (time.process_time() - since) / STEPS * 1e6


def simulated(live: Any) -> float:
    """Return microseconds for a step of `simulate`."""
    keywords = {} if live is None else {"live": live}
    since = time.process_time()
    simulate(
        Cheap(), SPECS, SIGNALS, period=0.02, duration=STEPS * 0.02, stop="end",
        policy=lambda _: 0, **keywords,
    )  # fmt: skip
    send(live)
    return (time.process_time() - since) / STEPS * 1e6


def main() -> None:
    views: dict[str, Callable[[Path], Any]] = {"no view": lambda _: None}
    if "--no-views" not in sys.argv:
        from rtamt_gym.live import RerunView

        views |= {
            "file": RerunView,
            "file and viewer": lambda path: RerunView(path, viewer=True),
        }
    best: dict[tuple[str, str], float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(REPEATS):
            for name, make in views.items():
                for measure in (single, vector, mujoco_step, simulated, streamed):
                    with ExitStack() as stack:
                        live = make(Path(folder, f"{number}.rrd"))
                        if live is not None:
                            stack.enter_context(live)
                        key = measure.__name__, name
                        best[key] = min(best.get(key, 1e9), measure(live))
        for (measured, name), value in sorted(best.items()):
            print(f"{measured}, {name}: {value:.2f} us a step")
        if len(views) > 1:
            from rtamt_gym.live import RerunView

            with RerunView(Path(folder, "p.rrd"), pictures=1) as live:
                print(f"a picture of 640 x 480: {single(live, 200) / 1000:.1f} ms")


if __name__ == "__main__":
    main()
