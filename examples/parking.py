"""Reach and stay: a car of highway-env parks in time and stays in its spot, or it does not.

The environment is content with a touch of the spot, at any speed; the specification is not. This
driver fails with the spot at its side, where it flips the gears. Episodes stop when decided.

Run: python examples/parking.py --episodes 8 --plot parking.png
"""

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from rtamt_gym import StlMonitor

SPEC = """
distance = 100 * sqrt(pow(x - goal_x, 2) + pow(y - goal_y, 2))  // metres
parked = eventually[0:20](always[0:2](distance < 0.5))
"""
SIGNALS = {
    "x": "obs['achieved_goal'][0]",  # in hundreds of metres
    "y": "obs['achieved_goal'][1]",
    "goal_x": "obs['desired_goal'][0]",
    "goal_y": "obs['desired_goal'][1]",
}


def drive(obs: Any) -> Any:  # noqa: ANN401 - highway-env has no types
    """Acceleration and steering: straight at the spot in the gear that faces it, ever slower."""
    vx, vy, cos, sin = obs["achieved_goal"][2:]
    dx, dy = 100 * (obs["desired_goal"] - obs["achieved_goal"])[:2]
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    gear = 1 if ahead > 0 else -1
    speed = gear * min(5, np.hypot(ahead, left) / 2)
    acceleration = (speed - 5 * (vx * cos + vy * sin)) / 2
    steering = gear * 2.5 * np.arctan2(left, abs(ahead))
    return np.clip([acceleration, steering], -1, 1).astype(np.float32)


def main(argv: list[str] | None = None) -> None:
    """Parks from several starts, prints what became of it, and draws it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--plot", type=Path, help="draw the episodes into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, (lot, course) = plt.subplots(1, 2, width_ratios=[1.6, 1])
    # A goal of 0 is never met: the environment would end an episode at the first touch.
    env = gym.make("highway_env:parking-v0", config={"success_goal_reward": 0.0})
    monitor = StlMonitor(env, SPEC, SIGNALS)
    print(f"{SPEC}\nstart  verdict    certain after  robustness in m")
    for seed in range(arguments.episodes):
        obs, info = monitor.reset(seed=seed)
        path = [100 * obs["achieved_goal"][:2]]
        while info["stl_lower"] <= 0 <= info["stl_upper"]:  # undecided
            obs, _, _, _, info = monitor.step(drive(obs))
            path.append(100 * obs["achieved_goal"][:2])
        verdict, colour = ("VIOLATED", "C1") if info["stl_violated"] else ("SATISFIED", "C0")
        bounds = f"{info['stl_lower']:.2f} to {info['stl_upper']:.2f}"
        print(f"{seed:5}  {verdict:9} {monitor.samples / 5 - 0.2:12.1f} s  {bounds}")
        goal = 100 * obs["desired_goal"][:2]
        lot.bar(goal[0], 8, 4, goal[1] - 4, fill=False, edgecolor=colour)
        lot.plot(*np.transpose(path), "o-", color=colour, markevery=[-1])
        lot.annotate(f" {seed}", path[-1], va="bottom")
        gaps = np.linalg.norm(path - goal, axis=1)
        course.semilogy(np.arange(len(gaps)) / 5, gaps, "o-", color=colour, markevery=[-1])
    if arguments.plot:
        lot.set(title="paths; blue: satisfied, orange: violated", aspect="equal", ylim=(-20, 20))
        lot.set(xlabel="x in m", ylabel="y in m")
        course.set(title="distance to the spot in m", xlabel="time in s")
        course.axhline(0.5, color="0.5", linestyle="--")
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
