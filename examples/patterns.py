"""The patterns of requirements, each with a trace that satisfies it and a trace that violates it.

Most requirements of robots are one of a few patterns. The table has the verdicts on both traces.

Run: python examples/patterns.py --plot patterns.png; --each FOLDER writes a file per pattern
"""

import argparse
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import rtamt
from rtamt.patterns import CATALOGUE, Pattern

GUIDES: dict[str, tuple[float, ...]] = {"never": (3,), "always within limits": (18, 24)}
GUIDES |= {"settling time": (0.9, 1.1), "overshoot": (1, 1.2), "rise time": (0.1, 0.9)}
GUIDES["rate limit"] = (-2, 2)
"""The levels of patterns about a quantity; the other patterns are about conditions."""


def draw(ax: Any, pattern: Pattern, trace: Any, colour: str) -> None:
    """Draw a trace: a quantity with its levels, or a row for each condition."""
    times = np.arange(len(next(iter(trace.values()))) + 1)
    ax.set(xlim=(0, times[-1]), xticks=(0, 3, 6, 9))
    for row, values in enumerate(reversed(trace.values())):
        steps = np.array([*values, values[-1]])  # a sample lasts until the next
        if pattern.name in GUIDES:
            ax.step(times, steps, colour, where="post")
            ax.set_yticks(GUIDES[pattern.name])
            ax.grid(axis="y", color="0.7", linestyle="--")
            continue
        ax.fill_between(times, row, row + 0.7 * (steps > 0), step="post", color=colour, lw=0)
        ax.axhline(row, color="0.7", linewidth=0.6)
    if pattern.name not in GUIDES:
        ax.set(ylim=(-0.2, len(trace)), yticks=np.arange(len(trace)) + 0.3)
        ax.set_yticklabels(reversed(list(trace)))
        ax.tick_params(axis="y", length=0)


def pair(axes: Any, pattern: Pattern) -> list[str]:
    """Evaluate and draw both traces of a pattern; return the verdict and robustness of each."""
    cells = []
    axes[1].sharey(axes[0])
    for ax, trace in zip(axes, (pattern.satisfying, pattern.violating), strict=True):
        judgement = rtamt.judge(pattern.formula, dict(trace), period=1, end="complete")
        cells.append(f"{judgement.verdict.name:>12}{judgement.robustness:6.2f}")
        draw(ax, pattern, trace, "C2" if rtamt.holds(judgement.robustness) else "C1")
    return cells


def main(argv: list[str] | None = None) -> None:
    """Evaluate and draw both traces of every pattern."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, help="draw the traces into this file")
    parser.add_argument("--each", type=Path, help="draw each pattern into a file of this folder")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, axes = plt.subplots(7, 4, figsize=(9, 8.5), sharex=True)
    print(f"{'pattern':22}{'first trace':>18}{'second trace':>18}")
    for pattern, plots in zip(CATALOGUE, axes.reshape(-1, 2), strict=False):
        print(f"{pattern.name:22}" + "".join(pair(plots, pattern)))
        name = pattern.name.replace(" ", r"\ ")
        plots[0].set_title(rf"$\bf{{{name}}}$: {pattern.wanted}", fontsize=7.5)
        if arguments.each:
            single, single_axes = plt.subplots(1, 2, figsize=(6, 1.5))
            pair(single_axes, pattern)
            single.savefig(arguments.each / f"{pattern.name.replace(' ', '_')}.png", dpi=110)
    for ax in axes.flat[2 * len(CATALOGUE) :]:
        ax.set_axis_off()
    axes[-1, 0].set_xlabel("time in s")
    if arguments.plot:
        figure.savefig(arguments.plot, dpi=110)


if __name__ == "__main__":
    main()
