"""A humanoid falls: a monitor stops it before it lands, or watches the blow of its landing.

`caught`: whenever the trunk sinks below 1 m, it is up again within 0.09 s. The monitor ends an
episode as soon as that is impossible, before the trunk hits the floor. `soft`: the trunk never hits
the floor with 1000 N or more. A blow takes a few milliseconds, and observations are 15 ms apart.
`substeps=True` updates the monitor at every step of the simulation, every 3 ms, so that it sees a
blow between two observations.

Run: python examples/falling_humanoid.py --episodes 4 --plot falling_humanoid.png
"""

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from rtamt_gym import StlMonitor

SPECS = {
    "caught": "always[0:2.4](height < 1 implies eventually[0:0.09](height >= 1))",
    "soft": "always[0:2.4](blow < 1000)",
}
SIGNALS = {"height": "body:torso.xpos[2]", "blow": "contact:torso,floor.force"}


def fall(monitor: StlMonitor[Any, Any], seed: int) -> tuple[list[float], float]:
    """Act at random; return the height after each step, and the hardest blow."""
    simulation: Any = monitor.unwrapped
    _, info = monitor.reset(seed=seed)
    monitor.action_space.seed(seed)
    heights = []
    while "stl_episode" not in info:
        _, _, _, _, info = monitor.step(monitor.action_space.sample())
        heights.append(float(simulation.data.body("torso").xpos[2]))
    return heights, 1000 - info["stl_episode"]["soft"]["robustness"]


def main(argv: list[str] | None = None) -> None:
    """Simulate several falls; print and draw the results of the monitors."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--plot", type=Path, help="draw the falls into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, (height, blow) = plt.subplots(1, 2, width_ratios=[1.4, 1])
    env = gym.make("Humanoid-v5", max_episode_steps=200, terminate_when_unhealthy=False)
    stopping = StlMonitor(env, SPECS, SIGNALS)
    coarse = StlMonitor(env, SPECS, SIGNALS, on_violation="report")
    fine = StlMonitor(env, SPECS, SIGNALS, on_violation="report", substeps=True)
    print("start  stopped at  on the floor  blow seen every 15 ms  every 3 ms")
    for seed in range(arguments.episodes):
        stop = len(fall(stopping, seed)[0])
        (heights, observed), (_, hardest) = fall(coarse, seed), fall(fine, seed)
        floor = int(np.argmax(np.array(heights) < 0.2)) + 1
        print(
            f"{seed:5} {0.015 * stop:9.2f} s {0.015 * floor:11.2f} s"
            f" {observed:20.0f} N {hardest:9.0f} N"
        )
        times, colour = 0.015 * np.arange(1, len(heights) + 1), f"C{seed % 6}"
        height.plot(times[:stop], heights[:stop], "o-", color=colour, markevery=[-1])
        height.plot(times[stop - 1 :], heights[stop - 1 :], ":", color=colour)
        blow.bar(seed - 0.2, observed, 0.4, color="0.75")
        blow.bar(seed + 0.2, hardest, 0.4, color=colour)
    if arguments.plot:
        height.set(title="height of the trunk in m; dot: the monitor stops", xlabel="time in s")
        blow.set(title="hardest blow in N; grey: every 15 ms", xlabel="start")
        blow.set_xticks(range(arguments.episodes))
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
