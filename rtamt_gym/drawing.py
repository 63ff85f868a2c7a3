"""Colours, panels and file formats that all pictures share."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rtamt import InputError, Verdict

# The palette of Okabe and Ito, which colour-blind readers can distinguish.
SIGNAL = "#0072B2"
ROBUSTNESS = "#222222"
BOUNDS = "#9BD0F0"
VERDICT_COLOURS = {Verdict.VIOLATED: "#D55E00", Verdict.SATISFIED: "#009E73"}
OPEN = "#666666"


def check_format(path: Path) -> None:
    """Check that a file has the extension of a picture."""
    if path.suffix.lower().removeprefix(".") not in FigureCanvasAgg.get_supported_filetypes():
        raise InputError(f"cannot draw {path}: expected a name that ends in .png, .svg or .pdf")


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's extension."""
    figure.savefig(path, dpi=110)


def tidy(ax: Axes, name: str) -> None:
    """Remove the decoration of a panel and write its name on the left."""
    ax.set_ylabel(name, fontsize=9.5)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(visible=True, color="#E5E5E5", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=8.5)


def robustness_panel(
    ax: Axes, name: str, formula: str, width: int, curves: Sequence[NDArray[np.float64]]
) -> list[NDArray[np.float64]]:
    """Draw the name, the formula and the zero line of a panel of robustness.

    The range of the panel contains zero and all finite values. Returns the curves clipped to this
    range, so that infinite values end at the edges.
    """
    tidy(ax, name)
    text = "\n".join(textwrap.wrap(formula, width, max_lines=2, placeholder=" ..."))
    ax.set_title(text, fontsize=8.5, loc="left", family="monospace")
    finite = np.concatenate([[0.0], *(c[np.isfinite(c)] for c in curves)])
    least, most = float(finite.min()), float(finite.max())
    room = 0.2 * (most - least) or 1.0
    ax.set_ylim(least - room, most + room)
    ax.axhline(0.0, color=OPEN, linewidth=0.9, linestyle=(0, (4, 3)))
    return [np.clip(curve, least - room, most + room) for curve in curves]


def show_verdict(ax: Axes, verdict: Verdict, text: str) -> None:
    """Write a text about a verdict in its colour below a panel."""
    colour = VERDICT_COLOURS.get(verdict, OPEN)
    ax.set_xlabel(text, color=colour, fontsize=9, loc="right", fontweight="bold")
