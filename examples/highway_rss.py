"""Two drivers on a highway and two rules: when a driver breaks a rule before a crash.

`distance`, from responsibility-sensitive safety (Shalev-Shwartz et al., 2017): a car that is too
close to brake in time makes room within 3 s. `lane`: a change of lanes takes at most 2 s. The runs
continue after a violation, to show the crash that follows.

Run: python examples/highway_rss.py --episodes 4 --plot highway_rss.png
"""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib.pyplot as plt

from rtamt_gym import simulate

SPECS = {
    "distance": "always[0:25](spare < 0 implies eventually[0:3](spare >= 0))",
    "lane": "always[0:25](rise(abs(offset) > 0.5) implies eventually[0:2](abs(offset) < 0.2))",
}
SIGNALS: Any = {"spare": lambda at: spare(at.env.unwrapped), "offset": "vehicle.lane_offset[1]"}
LEFT, IDLE, RIGHT, FASTER, SLOWER = range(5)


def spare(highway: Any) -> float:
    """Return the metres to spare if the car ahead brakes now with 6 m/s2, and our car 1 s later."""
    own = highway.vehicle
    ahead, _ = highway.road.neighbour_vehicles(own)
    if ahead is None:
        return 100.0
    safe = own.speed * 1.0 + (own.speed**2 - ahead.speed**2) / (2 * 6.0)
    return float(ahead.position[0] - own.position[0] - own.LENGTH - max(0.0, safe))


def drive(driver: str, highway: Any, _obs: object) -> int:
    """Return the action of a driver: cautious with distance, or weaving between cars."""
    if driver == "cautious":
        return SLOWER if spare(highway) < 15 else FASTER if spare(highway) > 30 else IDLE
    if spare(highway) > -40 or highway.steps % 5:
        return FASTER
    return LEFT if highway.steps % 2 else RIGHT


def main(argv: list[str] | None = None) -> None:
    """Simulate both drivers; print and draw the rules that they break."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=4)
    parser.add_argument("--plot", type=Path, help="draw the episodes into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, (distance, lane) = plt.subplots(1, 2)
    env = gym.make("highway_env:highway-fast-v0", config={"policy_frequency": 5})
    print("driver      distance      lane  broken at  ended at")
    for seed in range(arguments.episodes):
        for driver, colour in (("cautious", "C0"), ("aggressive", "C1")):
            policy = partial(drive, driver, env.unwrapped)
            options: Any = {"seed": seed, "stop": "end", "at_termination": "complete"}
            run = simulate(env, SPECS, SIGNALS, policy=policy, **options)
            margins = "  ".join(f"{run.histories[rule].final:+6.2f} m" for rule in SPECS)
            crash, broken = run.ended == "terminated", "never"
            if (sample := run.violated_at) is not None:
                broken = f"{run.times[sample]:.1f} s"
                distance.plot(run.times[sample], run.signals["spare"][sample], "o", color=colour)
            print(f"{driver:10}  {margins}  {broken:>9}  {run.duration:6.1f} s{'  crash' * crash}")
            style: Any = {"color": colour, "marker": "x" if crash else "", "markevery": [-1]}
            distance.plot(run.times, run.signals["spare"], **style)
            lane.plot(run.times, abs(run.signals["offset"]), **style)
    if arguments.plot:
        distance.set(title="metres to spare (dot: rule broken, cross: crash)", xlabel="time in s")
        lane.set(title="metres off the lane (blue: cautious driver)", xlabel="time in s")
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
