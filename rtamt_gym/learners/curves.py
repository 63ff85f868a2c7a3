"""Curves of training: satisfaction, robustness, progress, cost and return against steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from rtamt_gym.drawing import tidy
from rtamt_gym.learners.logs import StepCurve, TrainingLog

ALL = ""
"""The column of all requirements together."""

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""The palette of Okabe and Ito, which colour-blind readers can distinguish."""


@dataclass(frozen=True, slots=True)
class CurvePanel:
    """A panel: its title, and the ends of the keys of its curve and of the edges of its band."""

    title: str
    key: Sequence[str]
    low: Sequence[str] = ()
    high: Sequence[str] = ()


PANELS = (
    CurvePanel(
        "satisfied", ("rate", "satisfied"), ("low", "satisfied_low"), ("high", "satisfied_high")
    ),
    CurvePanel("robustness", ("robustness_median",), ("robustness_p5",), ("robustness_p95",)),
    CurvePanel("progress", ("progress",)),
    CurvePanel("cost", ("cost",)),
    CurvePanel("return", ("return",)),
)
"""The panels of a column, from the top; panels without a curve are left out."""


@dataclass(frozen=True, slots=True)
class CurveBand:
    """A curve with a band.

    Several logs have the mean as their curve, and minimum and maximum as their band. ``counts`` is
    the number of logs with a value at each step.
    """

    steps: NDArray[np.float64]
    middle: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    counts: NDArray[np.int64]


def columns_of(logs: Sequence[TrainingLog]) -> list[str]:
    """Return `ALL` and the requirements of logs, in order of appearance."""
    names = dict.fromkeys(
        requirement
        for log in logs
        for key in log.curves
        for _, requirement, end in [_parts(key)]
        if requirement and any(end in panel.key for panel in PANELS)
    )
    return [ALL, *names]


def _parts(key: str) -> tuple[str, str, str]:
    """Return the parts of a key: evaluation or training, the requirement, and the end."""
    prefix, _, metric = key.rpartition("stl/")
    name, _, end = metric.rpartition("/")
    return ("evaluation" if prefix.endswith("eval_") else "training"), name, end


def band_of(
    logs: Sequence[TrainingLog], panel: CurvePanel, requirement: str, kind: str
) -> CurveBand | None:
    """Return the curve of a panel with its band; None if no log has it.

    A log has a value from its first to its last step, on a line between its points. Where several
    logs have values, the curve is their mean, and the band reaches from the minimum to the maximum.
    ``kind`` is ``"evaluation"`` or ``"training"``.

    Example:
        >>> short, long = (np.zeros(1), np.ones(1)), (np.array([0.0, 2.0]), np.array([0.0, 1.0]))
        >>> logs = [TrainingLog("run", {"stl/satisfied": curve}) for curve in (short, long)]
        >>> band = band_of(logs, PANELS[0], ALL, "training")
        >>> band.steps.tolist(), band.middle.tolist(), band.low.tolist(), band.high.tolist()
        ([0.0, 2.0], [0.5, 1.0], [0.0, 1.0], [1.0, 1.0])
    """
    curves = [curve for log in logs if (curve := _curve(log, panel.key, requirement, kind))]
    if not curves:
        return None
    if len(curves) == 1:
        steps, middle = curves[0]
        (log,) = [log for log in logs if _curve(log, panel.key, requirement, kind)]
        edges = [_curve(log, ends, requirement, kind) for ends in (panel.low, panel.high)]
        low, high = (middle if edge is None else np.interp(steps, *edge) for edge in edges)
        return CurveBand(steps, middle, low, high, np.ones(len(steps), np.int64))
    steps = np.unique(np.concatenate([curve[0] for curve in curves]))
    table = np.array([np.interp(steps, *curve, left=np.nan, right=np.nan) for curve in curves])
    return CurveBand(
        steps,
        np.nanmean(table, axis=0),
        np.nanmin(table, axis=0),
        np.nanmax(table, axis=0),
        np.count_nonzero(~np.isnan(table), axis=0),
    )


def _curve(log: TrainingLog, ends: Sequence[str], requirement: str, kind: str) -> StepCurve | None:
    for key, curve in log.curves.items():
        if _parts(key) in {(kind, requirement, end) for end in ends}:
            return curve
    return None


def panels_of(
    groups: Mapping[str, Sequence[TrainingLog]], columns: Sequence[str]
) -> Iterator[tuple[str, CurvePanel]]:
    """Yield the requirement and the panel of each place that has a curve."""
    logs = [log for group in groups.values() for log in group]
    for requirement in columns:
        for panel in PANELS:
            if any(
                _curve(log, panel.key, requirement, kind)
                for log in logs
                for kind in ("evaluation", "training")
            ):
                yield requirement, panel


def draw_training(
    groups: Mapping[str, Sequence[TrainingLog]], columns: Sequence[str] | None = None
) -> Figure:
    """Draw logs of training: a column for each requirement, a colour for each group.

    Lines are evaluations; dotted lines are episodes of training. The curve of several logs is their
    mean. By default it draws all columns.
    """
    logs = [log for group in groups.values() for log in group]
    columns = columns_of(logs) if columns is None else columns
    places = [*panels_of(groups, columns)]
    used = [name for name in columns if any(name == column for column, _ in places)]
    if len(used) == 2 and used[0] == ALL:  # a single requirement equals all requirements
        repeated = [panel for column, panel in places if column == used[1]]
        places = [(c, p) for c, p in places if c != ALL or p not in repeated]
        used = [name for name in used if any(name == column for column, _ in places)]
    height = max(sum(column == name for column, _ in places) for name in used)
    figure = Figure(figsize=(1.0 + 3.6 * len(used), 0.9 + 2.0 * height), layout="constrained")
    grid = figure.subplots(height, len(used), squeeze=False, sharex=True)
    for index, name in enumerate(used):
        panels = [panel for column, panel in places if column == name]
        for row in range(height):
            ax = grid[row][index]
            if row >= len(panels):
                ax.set_axis_off()
                continue
            _draw_panel(ax, groups, panels[row], name)
            if not row:
                ax.set_title(name or "all requirements", fontsize=9.5, loc="left")
            if row == len(panels) - 1:
                ax.set_xlabel("steps of training", fontsize=9.5)
                ax.tick_params(labelbottom=True)
                ax.xaxis.set_major_locator(MaxNLocator(5))
                ax.xaxis.set_major_formatter(EngFormatter(sep=""))
    if len(groups) > 1:
        grid[0][0].legend(fontsize=8.5, frameon=False)
    return figure


def _draw_panel(
    ax: Axes, groups: Mapping[str, Sequence[TrainingLog]], panel: CurvePanel, requirement: str
) -> None:
    tidy(ax, panel.title)
    if panel.title in {"satisfied", "progress"}:
        ax.set_ylim(-0.03, 1.03)
    if panel.title == "robustness":
        ax.axhline(0.0, color="#666666", linewidth=0.9, linestyle=(0, (4, 3)))
    for index, (name, logs) in enumerate(groups.items()):
        colour = _COLOURS[index % len(_COLOURS)]
        evaluated = band_of(logs, panel, requirement, "evaluation")
        trained = band_of(logs, panel, requirement, "training")
        if trained is not None:
            _draw_band(ax, trained, colour, "" if evaluated else name, shaded=evaluated is None)
        if evaluated is not None:
            _draw_band(ax, evaluated, colour, name, shaded=True, solid=True)


def _draw_band(
    ax: Axes, band: CurveBand, colour: str, name: str, *, shaded: bool, solid: bool = False
) -> None:
    style = "-" if solid else ":"
    mark = "o" if len(band.steps) < 30 and solid else ""
    label = name or "_"
    ax.plot(
        band.steps,
        band.middle,
        style,
        color=colour,
        linewidth=1.4,
        marker=mark,
        markersize=3,
        label=label,
    )
    if shaded:
        ax.fill_between(band.steps, band.low, band.high, color=colour, alpha=0.18, linewidth=0)
