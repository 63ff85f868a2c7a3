"""Two drivers on a highway, two rules, and how long before a crash one was broken.

`distance`, after responsibility-sensitive safety (Shalev-Shwartz et al., 2017): who is closer than
braking takes is farther again within 3 s. `lane`: a change of lanes is over within 2 s. A violation
is only reported, so that the crash is seen.

Run: python examples/highway_rss.py --episodes 4 --plot highway_rss.png
"""

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from rtamt_gym import StlMonitor

SPECS = {
    "distance": "always[0:25](spare < 0 implies eventually[0:3](spare >= 0))",
    "lane": "always[0:25](rise(abs(offset) > 0.5) implies eventually[0:2](abs(offset) < 0.2))",
}
SIGNALS: Any = {"spare": lambda step: spare(step.env), "offset": "vehicle.lane_offset[1]"}
LEFT, IDLE, RIGHT, FASTER, SLOWER = range(5)


def spare(env: Any) -> float:  # noqa: ANN401 - highway-env has no types
    """Metres to spare before the car ahead, if it brakes at once with 6 m/s2, and we 1 s later."""
    own = env.unwrapped.vehicle
    ahead, _ = env.unwrapped.road.neighbour_vehicles(own)
    if ahead is None:
        return 100.0
    safe = own.speed * 1.0 + (own.speed**2 - ahead.speed**2) / (2 * 6.0)
    return float(ahead.position[0] - own.position[0] - own.LENGTH - max(0.0, safe))


def drive(driver: str, spare: float, time: float) -> int:
    """One keeps more than the safe distance; the other never brakes, and weaves between cars."""
    if driver == "cautious":
        return SLOWER if spare < 15 else FASTER if spare > 30 else IDLE
    return FASTER if spare > -40 or time % 1 else LEFT if time % 2 else RIGHT


def main(argv: list[str] | None = None) -> None:
    """Lets both drive, prints what became of the rules, and draws it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--plot", type=Path, help="draw the episodes into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, (distance, lane) = plt.subplots(1, 2)
    env: Any = gym.make("highway_env:highway-fast-v0", config={"policy_frequency": 5})
    monitor = StlMonitor(env, SPECS, SIGNALS, on_violation="report")
    print("driver      distance     lane  ended at")
    for episode in range(2 * arguments.episodes):
        driver, colour = [("cautious", "C0"), ("aggressive", "C1")][episode % 2]
        _, info = monitor.reset(seed=episode // 2)
        course = [(spare(env), 0.0)]
        while "stl_episode" not in info:
            info = monitor.step(drive(driver, course[-1][0], len(course) / 5))[-1]
            course.append((spare(env), abs(env.unwrapped.vehicle.lane_offset[1])))
        margins = "{distance[robustness]:+8.2f} m {lane[robustness]:+6.2f} m"
        times, broken = np.arange(len(course)) / 5, info.get("stl_violated_at", np.nan) / 5
        crash = f"  crash, {times[-1] - broken:.1f} s after a rule was broken" * info["crashed"]
        print(f"{driver:10} {margins.format(**info['stl_episode'])} {times[-1]:7.1f} s{crash}")
        line: Any = {"color": colour, "marker": "x" if crash else "", "markevery": [-1]}
        for axes, values in zip((distance, lane), np.transpose(course), strict=True):
            axes.plot(times, values, **line)
            axes.plot(broken, np.interp(broken, times, values), "o", color=colour)
    if arguments.plot:
        distance.set(title="metres to spare (dot: rule broken, cross: crash)", xlabel="time in s")
        lane.set(title="metres off the lane (blue: cautious driver)", xlabel="time in s")
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
