"""Reach and stay: a car of highway-env must park in time and stay in its spot.

The environment accepts a touch of the spot at any speed; the specification does not. This driver
goes straight to the spot, forward or in reverse. With the spot at its side, it changes gear again
and again and does not arrive. A run stops as soon as its verdict is certain.

Run: python examples/parking.py --episodes 8 --plot parking.png
"""

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from rtamt_gym import simulate

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


def drive(obs: Any) -> Any:
    """Return acceleration and steering; the car slows down near the spot."""
    vx, vy, cos, sin = obs["achieved_goal"][2:]
    dx, dy = 100 * (obs["desired_goal"] - obs["achieved_goal"])[:2]
    ahead, left = dx * cos + dy * sin, dy * cos - dx * sin
    gear = 1 if ahead > 0 else -1
    speed = gear * min(5, np.hypot(ahead, left) / 2)
    acceleration = (speed - 5 * (vx * cos + vy * sin)) / 2
    steering = gear * 2.5 * np.arctan2(left, abs(ahead))
    return np.clip([acceleration, steering], -1, 1).astype(np.float32)


def main(argv: list[str] | None = None) -> None:
    """Park from several starts; print and draw the verdicts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--plot", type=Path, help="draw the episodes into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, (lot, distance) = plt.subplots(1, 2, width_ratios=[1.6, 1])
    # With a goal of 0, the environment does not end an episode at the first touch.
    env = gym.make("highway_env:parking-v0", config={"success_goal_reward": 0.0})
    print(f"{SPEC}\nstart  verdict    certain after  robustness in m")
    for seed in range(arguments.episodes):
        run = simulate(env, SPEC, SIGNALS, policy=drive, seed=seed, stop="decided")
        history = run.histories["parked"]
        bounds = f"{history.lower[-1]:.2f} to {history.upper[-1]:.2f}"
        print(f"{seed:5}  {history.verdict.name:9} {run.duration:12.1f} s  {bounds}")
        x, y, goal_x, goal_y = (100 * run.signals[name] for name in SIGNALS)
        colour = "C0" if history.verdict > 0 else "C1"
        lot.bar(goal_x[0], 8, 4, goal_y[0] - 4, fill=False, edgecolor=colour)
        lot.plot(x, y, "o-", color=colour, markevery=[-1])
        lot.annotate(f" {seed}", (x[-1], y[-1]), va="bottom")
        gaps = np.hypot(x - goal_x, y - goal_y)
        distance.semilogy(run.times, gaps, "o-", color=colour, markevery=[-1])
    if arguments.plot:
        lot.set(title="paths; blue: satisfied, orange: violated", aspect="equal", ylim=(-20, 20))
        lot.set(xlabel="x in m", ylabel="y in m")
        distance.set(title="distance to the spot in m", xlabel="time in s")
        distance.axhline(0.5, color="0.5", linestyle="--")
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
