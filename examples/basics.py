"""Draw the three pictures of the page "STL in ten minutes".

Left: a signal, its limit and the robustness of `speed < 5`. Middle: why a monitor needs later
samples before it can return a value. Right: bounds that close in on the final robustness.

Run: python examples/basics.py --plot docs/examples/basics.png
"""

import argparse
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
    margins = rtamt.evaluate("speed < 5", {"speed": SPEED})
    for time, speed, margin in zip(TIMES, SPEED, margins, strict=True):
        ax.plot([time, time], [speed, 5], color="C2" if rtamt.holds(margin) else "C1", linewidth=3)
    ax.set(title="robustness of  speed < 5", xlabel="time in s", ylim=(0, 7))
    ax.legend(loc="upper left")


def draw_latency(ax: Axes) -> None:
    """Draw which samples the values of two requests need."""
    monitor = rtamt.Monitor(RESPONSE, period=1)
    values = [monitor.update(*sample) for sample in zip(REQUEST, GRANT, strict=True)]
    ax.plot(TIMES, REQUEST, "^", color="C0", label="request")
    ax.plot(TIMES, GRANT, "o", color="C4", label="grant")
    for sent, color in ((1, "C2"), (5, "C1")):
        known = sent + monitor.latency
        ax.axvspan(sent, known, color=color, alpha=0.2)
        text = f"value of {sent} s\nknown at {known} s:\n{values[known]:+g}"
        ax.text(sent + 1, 5.6, text, ha="center", fontsize=7)
    ax.set(title="a grant within 2 s", xlabel="time in s", ylim=(-0.5, 9))
    ax.legend(loc="upper left", ncols=2)


def draw_bounds(ax: Axes) -> None:
    """Draw the bounds of the final robustness of an episode."""
    monitor = rtamt.EpisodeMonitor("always(speed < 5)")
    upper = [(monitor.update(speed), monitor.upper)[1] for speed in SPEED]
    ax.fill_between(TIMES, -3, upper, color="0.88", label="final robustness lies here")
    ax.plot(TIMES, upper, color="C0", label="upper bound")
    ax.axhline(0, color="0.4", linewidth=0.6)
    note = "below 0: violated,\nwhatever comes next"
    ax.annotate(note, (7, upper[7]), (1.2, -2.2), fontsize=7, arrowprops={"arrowstyle": "->"})
    ax.set(title="bounds of  always(speed < 5)", xlabel="time in s", ylim=(-3, 5))
    ax.legend(loc="upper right")


def main(argv: list[str] | None = None) -> None:
    """Draw the pictures, and print the verdict of the last picture."""
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
