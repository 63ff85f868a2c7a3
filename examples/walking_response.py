"""Whenever the left foot lands, the right foot lands within half a second.

Position servos drive a walker along sine curves. In every run except the first, its right knee
stays bent after some time. The monitor reads the touch sensors after every step of the simulation.
It reports a violation at the end of the half second, and the run stops there.

Run: python examples/walking_response.py --episodes 3 --plot walking_response.png
"""

import argparse
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import mujoco  # type: ignore[import-untyped]
import numpy as np

from rtamt import Verdict
from rtamt_gym import StepMonitor

SPEC = "always[0:5](rise(left > 20) implies eventually[0:0.5](rise(right > 20)))"  # newtons
SIGNALS = {"left": "sensor:left_touch[0]", "right": "sensor:right_touch[0]"}
MODEL = Path(__file__).parent / "models" / "walker.xml"


def walk(data: Any, fault: float) -> None:
    """Swing the hips, and bend the knee of the leg that swings forward; a stride takes 0.8 s."""
    for side, lag in (("left", 0.0), ("right", 0.5)):
        phase = 2 * math.pi * (data.time / 0.8 + lag)
        bent = side == "right" and data.time > fault
        data.actuator(f"{side}_hip").ctrl = 0.35 * math.sin(phase)
        data.actuator(f"{side}_knee").ctrl = 0.8 if bent else 0.1 + 0.7 * max(0, math.cos(phase))


def main(argv: list[str] | None = None) -> None:
    """Walk without and with a fault; print and draw when a response is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--plot", type=Path, help="draw the runs into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, (gait, feet) = plt.subplots(2, 1, figsize=(7, 3.7), height_ratios=[1.6, 1])
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    print(f"{SPEC}\n\nknee bent from  verdict    certain after")
    for episode in range(arguments.episodes):
        fault = 1.5 * episode or math.inf
        data = mujoco.MjData(model)
        monitor = StepMonitor(model, data, SPEC, SIGNALS)
        touches = []
        while monitor.verdict is Verdict.UNDECIDED:
            walk(data, fault)
            monitor.step()  # in place of mj_step
            touches.append([force > 20 for force in monitor.values.values()])
            if episode == arguments.episodes - 1 and monitor.samples % 100 == 0:
                for side, colour in (("left", "C0"), ("right", "C1")):
                    foot = data.site(f"{side}_foot").xpos
                    leg = np.array([data.body("torso").xpos, data.body(f"{side}_shin").xpos, foot])
                    gait.plot(leg[:, 0], leg[:, 2], color=colour)
        verdict = monitor.verdict.name
        since = f"{fault} s" if episode else "never"
        print(f"{since:>14}  {verdict:9} {data.time:12.2f} s")
        feet.plot(min(fault, 9), 3 * episode + 2, "v", color="black")
        for foot, touch in enumerate(np.transpose(touches)):
            low = 3 * episode + foot
            times = 0.002 * np.arange(len(touch))
            feet.fill_between(times, low, low + 1, where=touch, color=f"C{foot}", linewidth=0)
        feet.plot([data.time] * 2, [3 * episode, 3 * episode + 2], color="black")
        feet.annotate(f" {verdict.lower()}", (data.time, 3 * episode + 1), va="center")
    if arguments.plot:
        gait.set(title="the last run, every 0.2 s; blue: left leg, orange: right leg")
        gait.set(aspect="equal", xlabel="x in m", ylabel="z in m")
        feet.set(title="feet on the ground (triangle: fault)", xlabel="time in s", yticks=[])
        feet.set_xlim(0, 6)
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
