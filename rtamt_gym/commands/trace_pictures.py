"""Pictures of the traces of a solver."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import groupby
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rtamt.checking import ExampleTrace
from rtamt_gym import drawing
from rtamt_gym.tables import counted, shorten

_ABREAST: Final = 3
_MOST: Final = 12


def draw(traces: Sequence[tuple[str, ExampleTrace]], period: Fraction | None) -> Figure:
    """Draw a panel for each variable of each trace, with the repeated part shaded.

    Args:
        traces: One or more traces with their titles; the first 12 are drawn.
        period: Seconds between samples; None to count samples.
    """
    shown = [*traces[:_MOST]]
    across = min(_ABREAST, len(shown))
    rows = [shown[i : i + across] for i in range(0, len(shown), across)]
    heights = [0.7 + 1.1 * max(1, *(len(trace.columns) for _, trace in row)) for row in rows]
    figure = Figure(figsize=(max(6.0, 4.0 * across), sum(heights) + 0.4), layout="constrained")
    parts = figure.subfigures(len(rows), across, squeeze=False, height_ratios=heights)
    for row, some in zip(rows, parts, strict=True):
        for (title, trace), part in zip(row, some, strict=False):
            part.suptitle(title, fontsize=10, fontweight="bold")
            panels = part.subplots(max(1, len(trace.columns)), 1, sharex=True, squeeze=False)[:, 0]
            for ax, (name, values) in zip(panels, trace.columns.items(), strict=False):
                _variable(ax, name, values, trace, period)
            if not trace.columns:
                panels[0].set_axis_off()
                panels[0].text(0.0, 0.5, f"any {counted(trace.samples, 'sample')}", fontsize=9)
            unit = "samples" if period is None else "time in s"
            again = "; shaded: again and again" if trace.loop else ""
            panels[-1].set_xlabel(unit + again, fontsize=9, color=drawing.OPEN)
    if len(traces) > len(shown):
        figure.suptitle(f"{len(shown)} of {len(traces)} traces", fontsize=10, color=drawing.OPEN)
    return figure


def _variable(
    ax: Axes, name: str, values: Sequence[float], trace: ExampleTrace, period: Fraction | None
) -> None:
    step = 1.0 if period is None else float(period)
    drawing.tidy(ax, shorten(name, 18))
    times = [0.0]
    levels = [values[0]]
    position = 0
    for value, run in groupby(values):  # a point for each run: traces may be long
        if position:
            times.append(position * step)
            levels.append(value)
        position += len([*run])
    times.append(trace.samples * step)  # the last sample is as wide as the others
    levels.append(values[-1])
    finite = [level for level in levels if math.isfinite(level)] or [0.0]
    margin = 0.2 * (max(finite) - min(finite)) or 1.0  # a constant line needs a margin too
    bottom, top = min(finite) - margin, max(finite) + margin
    ax.set_ylim(bottom, top)
    clipped = np.clip(levels, bottom, top)  # infinities lie at the edge
    ax.plot(times, clipped, color=drawing.SIGNAL, linewidth=1.4, drawstyle="steps-post")
    ax.margins(x=0.0)
    if trace.loop:
        loop_start = (trace.samples - trace.loop) * step
        ax.axvspan(loop_start, trace.samples * step, color=drawing.BOUNDS, alpha=0.4, linewidth=0)
