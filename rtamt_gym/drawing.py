"""What pictures have in common: colours, frames, formats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray

from rtamt import InputError, Verdict

__all__ = ["BOUNDS", "OPEN", "ROBUSTNESS", "SIGNAL", "VERDICTS", "check_format", "frame", "tidy"]

# Okabe and Ito's palette, which colour-blind readers tell apart.
SIGNAL = "#0072B2"
ROBUSTNESS = "#222222"
BOUNDS = "#9BD0F0"
VERDICTS = {Verdict.VIOLATED: "#D55E00", Verdict.SATISFIED: "#009E73"}
OPEN = "#666666"


def check_format(path: Path) -> None:
    """Refuses a file name that says no format of pictures.

    Raises:
        InputError: Naming the usual formats.
    """
    if path.suffix.lower().removeprefix(".") not in FigureCanvasAgg.get_supported_filetypes():
        raise InputError(f"cannot draw {path}: expected a name that ends in .png, .svg or .pdf")


def frame(curves: Sequence[NDArray[np.float64]]) -> tuple[float, float]:
    """The range of the finite values and zero, with room for what goes to infinity."""
    finite = np.concatenate([[0.0], *(c[np.isfinite(c)] for c in curves)])
    least, most = float(finite.min()), float(finite.max())
    room = 0.2 * (most - least) or 1.0
    return least - room, most + room


def tidy(ax: Axes, name: str) -> None:
    """A panel without decoration, named on its left."""
    ax.set_ylabel(name, fontsize=9.5)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(visible=True, color="#E5E5E5", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=8.5)
