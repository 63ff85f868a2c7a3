"""Draw the three pictures of the page "STL in ten minutes".

Left: a signal, its limit and the robustness of `speed < 5`. Middle: why a monitor needs later
samples before it can return a value. Right: bounds that close in on the final robustness.

Run: python examples/basics.py --plot docs/examples/basics.png
"""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

import rtamt

SPEED = [1.0, 2.5, 4.0, 4.5, 3.0, 2.0, 3.5, 6.0, 5.5, 3.0]
REQUEST = [0.0, 4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0]
GRANT = [0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
RESPONSE = "request >= 3 implies eventually[0:2](grant >= 3)"
TIMES = range(10)


def draw_robustness(ax: Axes) -> None:
    """Draw the margin between a signal and its limit at every sample."""
    ax.plot(TIMES, SPEED, color="C0", label="speed")
    ax.axhline(5, color="0.4", linestyle="--", label="limit 5")
    for time, speed, margin in zip(
        TIMES, SPEED, rtamt.evaluate("speed < 5", {"speed": SPEED}), strict=True
    ):
        ax.plot([time, time], [speed, 5], color="C2" if rtamt.holds(margin) else "C1", linewidth=3)
    ax.set(title="robustness of  speed < 5", xlabel="time in s", ylim=(0, 7))
    ax.legend(loc="upper left")


def draw_latency(ax: Axes) -> None:
    """Draw which samples the value of the first request needs."""
    monitor = rtamt.Monitor(RESPONSE, period=1)
    values = [
        monitor.update(request=request, grant=grant)
        for request, grant in zip(REQUEST, GRANT, strict=True)
    ]
    known = [time for time, value in zip(TIMES, values, strict=True) if not math.isnan(value)]
    ax.plot(TIMES, REQUEST, "^", color="C0", label="request")
    ax.plot(TIMES, GRANT, "o", color="C4", label="grant")
    ax.axvspan(1, 3, color="C2", alpha=0.2)
    ax.axvspan(5, 7, color="C1", alpha=0.2)
    for sent, value in ((1, values[3]), (5, values[7])):
        text = f"value of {sent} s\nknown at {sent + 2} s:\n{value:+g}"
        ax.text(sent + 1, 5.6, text, ha="center", fontsize=7)
    ax.set(
        title=f"a grant within 2 s: values from {known[0]} s", xlabel="time in s", ylim=(-0.5, 9)
    )
    ax.legend(loc="upper left", ncols=2)


def draw_bounds(ax: Axes) -> None:
    """Draw the bounds of the final robustness of an episode."""
    monitor = rtamt.EpisodeMonitor("always(speed < 5)")
    lower, upper = [], []
    for speed in SPEED:
        monitor.update(speed=speed)
        lower.append(max(monitor.lower, -3))
        upper.append(monitor.upper)
    ax.fill_between(TIMES, lower, upper, color="0.88", label="final robustness lies here")
    ax.plot(TIMES, upper, color="C0", label="upper bound")
    ax.axhline(0, color="0.4", linewidth=0.6)
    ax.annotate(
        "below 0: violated,\nwhatever comes next", (7, upper[7]), (1.2, -2.2), fontsize=7,
        arrowprops={"arrowstyle": "->", "color": "0.3"},
    )  # fmt: skip
    ax.set(title="bounds of  always(speed < 5)", xlabel="time in s", ylim=(-3, 5))
    ax.legend(loc="upper right")


def main(argv: list[str] | None = None) -> None:
    """Draw the pictures, and print the verdict of the last one."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, help="write the pictures to this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, axes = plt.subplots(1, 3, figsize=(10, 2.9))
    for ax, draw in zip(axes, (draw_robustness, draw_latency, draw_bounds), strict=True):
        draw(ax)
    judgement = rtamt.judge("always(speed < 5)", {"speed": SPEED}, period=1)
    print(f"{judgement.verdict.name} at sample {judgement.decided_at}")
    if arguments.plot:
        figure.savefig(arguments.plot, dpi=100)


if __name__ == "__main__":
    main()
