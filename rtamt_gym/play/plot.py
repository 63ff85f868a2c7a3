"""Pictures of runs: signals, robustness between its bounds, and when the verdict was certain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from rtamt_gym import drawing
from rtamt_gym.options.evaluation import View
from rtamt_gym.play.run import History, Run
from rtamt_gym.results.outcome import verdict_text

_CURVES: Final[Mapping[View, str]] = {
    "episode": "robustness if it ended now",
    "step": "robustness of the newest instant",
}
"""The meaning of the curve of robustness, by view."""

_AFTER = 0.2
"""Room for the shading after a verdict at the last sample, as a fraction of the run's length."""


def draw(runs: Sequence[Run]) -> Figure:
    """Draw runs side by side: the signals, and below them a panel for every specification.

    A panel shows the robustness of the samples so far, between its lower and upper bound; infinite
    bounds end at the frame. A line marks the sample that decided the verdict; the rest is shaded.
    """
    heights = [1.0] * len(runs[0].signals) + [1.6] * len(runs[0].histories)
    size = (5.2 * len(runs) + 0.4, 1.25 * sum(heights) + 1.1)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(
        len(heights), len(runs), sharex="col", squeeze=False, height_ratios=heights
    )
    for column, run in zip(axes.T, runs, strict=True):
        _draw_run(column, run)
    verdicts = {c.verdict for run in runs for c in run.histories.values()}
    figure.legend(
        handles=[
            Line2D([], [], color=drawing.ROBUSTNESS, label=_CURVES[runs[0].view]),
            Patch(color=drawing.BOUNDS, alpha=0.5, label="what it can still become"),
            *(
                Patch(color=c, alpha=0.4, label=v.name)
                for v, c in drawing.VERDICT_COLOURS.items()
                if v in verdicts
            ),
        ],
        loc="outside lower center",
        ncols=2 if len(runs) == 1 else 4,
        frameon=False,
        fontsize=9,
    )
    return figure


def _draw_run(axes: NDArray[np.object_], run: Run) -> None:
    times = run.times
    last = any(c.decided_at == run.last_sample for c in run.histories.values())
    begin, end = float(times[0]), float(times[-1])
    end += (end - begin) * _AFTER * last or float(end == begin)
    signal_axes, history_axes = np.split(axes, [len(run.signals)])
    ax: Axes
    for ax, (name, values) in zip(signal_axes, run.signals.items(), strict=True):
        drawing.tidy(ax, name)
        ax.plot(times, values, color=drawing.SIGNAL, linewidth=1.6)
        ax.margins(y=0.15)
    for ax, (name, history) in zip(history_axes, run.histories.items(), strict=True):
        _draw_history(ax, name, history, run, end)
        text = f"{verdict_text(history.verdict, history.final)}, {history.final_text('+.3g')}"
        if decided := history.decided_text(run.period):
            text += f", at {decided}"
        drawing.show_verdict(ax, history.verdict, text)
    axes[-1].set_xlim(begin, end)
    axes[-1].annotate(
        "time in s" if run.period else "samples",
        (0.0, 0.0),
        (0.0, -26.0),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=9,
        color=drawing.OPEN,
    )
    driver = run.label or ("" if run.seed is None else f"seed {run.seed}")
    axes[0].set_title(
        f"{run.system}, {driver}" if driver else run.system, fontsize=12, fontweight="bold", pad=10
    )


def _draw_history(ax: Axes, name: str, history: History, run: Run, end: float) -> None:
    times = run.times
    curves = (history.robustness, history.lower, history.upper)
    robustness, lower, upper = drawing.robustness_panel(ax, name, history.formula, 64, curves)
    ax.fill_between(times, lower, upper, color=drawing.BOUNDS, alpha=0.5, linewidth=0)
    if history.decided_at is not None:
        colour = drawing.VERDICT_COLOURS[history.verdict]
        time = float(times[max(history.decided_at - run.first_sample, 0)])
        ax.axvspan(time, end, color=colour, alpha=0.18, linewidth=0)
        ax.axvline(time, color=colour, linewidth=1.6)
    ax.plot(times, robustness, color=drawing.ROBUSTNESS, linewidth=1.6)
