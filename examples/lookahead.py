"""A controller that looks ahead: it chooses the future with the largest robustness.

A cart balances a pole in a corridor with bends, where feedback alone reacts too late.

Run: python examples/lookahead.py --plot lookahead.png
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import mujoco  # type: ignore[import-untyped]
import numpy as np

from rtamt_gym import StepMonitor, simulate
from rtamt_gym.results import Snapshot

MODEL = mujoco.MjModel.from_xml_path(str(Path(__file__).parent / "models" / "cart.xml"))
SPEC = """inside = abs(angle) < 0.3 and abs(cart - middle) < 0.3
out = inside and once[0:0.6](abs(cart - middle) < 0.15)"""
SIGNALS: dict[str, Any] = {"cart": "joint:slide.qpos", "angle": "joint:hinge.qpos"}
SIGNALS["middle"] = lambda _model, data: middle(data.time)


def middle(time: Any) -> Any:
    """Return the middle of the corridor at a time, in metres."""
    return 0.5 - 0.5 * np.cos(1.1 * time)


def towards(goal: float) -> Callable[[Any, Any], None]:
    """Return feedback that balances the pole and moves the cart to a goal."""

    def act(_model: Any, data: Any) -> None:
        (x, angle), (speed, turn) = data.qpos, data.qvel
        data.ctrl[0] = 1.5 * (x - goal) + 6 * angle + 1.6 * speed + 1.4 * turn

    return act


def drive(ax: Any, ahead: float) -> StepMonitor:
    """Drive and draw; compare futures of ``ahead`` seconds, or use feedback alone if it is 0."""
    monitor = StepMonitor(MODEL, mujoco.MjData(MODEL), SPEC, SIGNALS, view="step")
    for decision in range(120):
        now, center, futures = Snapshot.of(monitor), middle(monitor.data.time), []
        for goal in center + np.linspace(-0.8, 0.8, 17) if ahead else ():
            future = simulate(monitor, start=now, policy=towards(goal), duration=ahead, stop="end")
            worst = min(future.histories["out"].robustness[1:])
            futures.append((worst, goal))
            if decision % 10 == 0:
                ax.plot(future.times, future.signals["cart"], "C2" if worst > 0 else "C1", lw=0.4)
        policy = towards(max(futures)[1] if futures else center)
        run = simulate(monitor, policy=policy, duration=0.1, stop="end")
        ax.plot(run.times, run.signals["cart"], color="C0")
    times = np.linspace(0, 12, 200)
    ax.fill_between(times, middle(times) - 0.3, middle(times) + 0.3, color="0.9")
    return monitor


def main(argv: list[str] | None = None) -> None:
    """Drive by feedback alone and by looking ahead; print and draw both."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, help="draw the cart into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, axes = plt.subplots(1, 2, sharey=True)
    print(f"{SPEC}\n\n{'driver':17}verdict    at step  robustness")
    for ax, driver, ahead in zip(axes, ("feedback alone", "looks 1 s ahead"), (0, 1), strict=True):
        monitor = drive(ax, ahead)
        step = monitor.violated_at or "-"
        print(f"{driver:17}{monitor.verdict.name:9}{step:>9}{monitor.upper:12.2f}")
        ax.set(title=driver, ylim=(-0.6, 1.6), xlabel="time in s", ylabel="cart in m")
    if arguments.plot:
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
