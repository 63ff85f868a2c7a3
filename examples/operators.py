"""Every temporal operator in a picture: its signals, its robustness, and where it holds.

The trace is complete: a window that extends past the end is cut, and an empty window has robustness
inf or -inf, drawn at the edge. The last row is dense time, where values last until the next sample.

Run: python examples/operators.py --plot docs/examples/operators.png
"""

import argparse
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import rtamt

P = [-1.0, -2.0, 1.0, 2.0, 1.0, -1.0, -1.5, 0.5, 1.5, 0.5]
Q = [-1.5, -1.0, -1.0, -0.5, 1.5, 1.0, -1.0, -1.5, -1.0, 0.5]
NAMED = (("p", P), ("q", Q))
FORMULAS = (
    *("not p > 0", "p > 0 and q > 0", "p > 0 or q > 0", "p > 0 implies q > 0"),
    *("p > 0 iff q > 0", "p > 0 xor q > 0", "always[0:2](p > 0)", "eventually[0:2](p > 0)"),
    *("always(p > -2.5)", "eventually(q > 1)", "always[2:3](p > 0)", "eventually[2:3](p > 0)"),
    *("p > 0 until[0:1] q > 0", "p > 0 unless[0:1] q > 0", "next(p > 0)", "s_next(p > 0)"),
    *("historically[0:2](p > 0)", "once[0:2](p > 0)", "p > 0 since q > 0", "prev(p > 0)"),
    *("s_prev(p > 0)", "p > 0 since[0:2] q > 0", "rise(p > 0)", "fall(p > 0)"),
)
DENSE = (
    *("always[0:1](p > 0)", "eventually[0:1](p > 0)"),
    *("once[0:1](p > 0)", "p > 0 until[0:3] q > 0"),
)
EDGE = 3.4


def draw(ax: Any, formula: str, *, dense: bool) -> None:
    """Draw the signals of an operator, and its robustness in colours that show where it holds."""
    ax.axhline(0, color="0.6", linewidth=0.6)
    for name, values, colour in ("p", P, "C0"), ("q", Q, "0.4"):
        if f"{name} >" in formula:
            ax.plot(values, colour, linewidth=0.8, drawstyle="steps-post" if dense else "default")
            ax.text(-0.5, values[0], name, color=colour, fontsize=7, ha="right", va="center")
    if dense:
        signals = {name: rtamt.dense.Events(range(10), x) for name, x in NAMED}
        robustness = rtamt.dense.evaluate(formula, signals)
        times = [*robustness.times, 9]
        for begin, end, value in zip(times, times[1:], robustness.values, strict=False):
            colour = "C2" if rtamt.holds(value) else "C1"
            ax.plot([begin, end], [value, value], colour, linewidth=2, solid_capstyle="butt")
        return
    for i, value in enumerate(rtamt.evaluate(formula, dict(NAMED), period=1)):
        marker = "o" if math.isfinite(value) else "^" if value > 0 else "v"
        colour = "C2" if rtamt.holds(value) else "C1"
        ax.plot(i, np.clip(value, -EDGE, EDGE), marker, color=colour, markersize=4)


def main(argv: list[str] | None = None) -> None:
    """Draw every operator, and print at which samples it holds."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--plot", type=Path, help="draw the operators into this file")
    arguments = parser.parse_args(argv)
    plt.style.use(Path(__file__).with_name("paper.mplstyle"))
    figure, axes = plt.subplots(7, 4, figsize=(9, 9), sharex=True, sharey=True)
    print("held formula")
    for ax, formula in zip(axes.flat, FORMULAS + DENSE, strict=True):
        dense = ax in axes[-1]
        draw(ax, formula, dense=dense)
        ax.set_title("dense: " * dense + formula, fontsize=7, family="monospace", loc="left")
        ax.set(xlim=(-1.3, 9.3), ylim=(-3.8, 3.8), xticks=(0, 3, 6, 9))
        if not dense:
            values = rtamt.evaluate(formula, dict(NAMED), period=1)
            print("".join("+" if rtamt.holds(value) else "-" for value in values), formula)
    if arguments.plot:
        figure.savefig(arguments.plot, dpi=80)


if __name__ == "__main__":
    main()
