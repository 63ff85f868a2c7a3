"""Pictures of sweeps: the map of a robustness over two columns, and scatters over each column."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from rtamt import Verdict
from rtamt_gym import drawing
from rtamt_gym.inputs.space import Parameter, Space
from rtamt_gym.play.record import Record
from rtamt_gym.search.sweeps.effects import RobustnessMap, text_of
from rtamt_gym.tables import shorten

_COLOURS = LinearSegmentedColormap.from_list(
    "robustness",
    [drawing.VERDICT_COLOURS[Verdict.VIOLATED], "#FFFFFF", drawing.VERDICT_COLOURS[Verdict(1)]],
)
"""From violated over 0 to satisfied."""

_PANELS = 5
"""The panels in a line of a scatter."""

_CELLS = 150
"""The maximum number of cells of a map that shows their numbers."""

Floats = NDArray[np.float64]


def draw_map(heights: RobustnessMap, space: Space, formula: str) -> Figure:
    """Draw a robustness over two columns: as cells with their numbers, or as points."""
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    ax = figure.subplots()
    drawing.tidy(ax, _label(heights.y, space))
    ax.set_xlabel(_label(heights.x, space), fontsize=9.5)
    ax.set_title(shorten(formula, 84), fontsize=8.5, loc="left", family="monospace")
    finite = heights.values[np.isfinite(heights.values)]
    reach = max(float(np.abs(finite).max()) if finite.size else 1.0, 1e-12)
    norm = TwoSlopeNorm(0.0, -reach, reach)
    if heights.cells is None:
        shown: ScalarMappable = ax.scatter(
            heights.at[:, 0],
            heights.at[:, 1],
            c=np.clip(heights.values, -reach, reach),
            cmap=_COLOURS,
            norm=norm,
            edgecolors=drawing.OPEN,
            linewidths=0.5,
        )
        _log(ax.set_xscale, heights.x, space)
        _log(ax.set_yscale, heights.y, space)
    else:
        shown = ax.imshow(
            np.clip(heights.cells, -reach, reach),
            cmap=_COLOURS,
            norm=norm,
            origin="lower",
            aspect="auto",
        )
        ax.grid(visible=False)
        _write_cells(ax, heights)
    bar = figure.colorbar(shown, ax=ax)
    minimum = " (minimum over all else)" if heights.folded else ""
    bar.set_label(f"robustness of {heights.requirement}{minimum}", fontsize=9.5)
    bar.ax.tick_params(labelsize=8.5)
    return figure


def _write_cells(ax: Axes, heights: RobustnessMap) -> None:
    for axis, ticks in ((ax.xaxis, heights.xs), (ax.yaxis, heights.ys)):
        step = math.ceil(len(ticks) / 12)
        axis.set_ticks(range(0, len(ticks), step), [f"{tick:.4g}" for tick in ticks[::step]])
    if heights.cells is None or heights.cells.size > _CELLS:
        return
    for row, line in enumerate(heights.cells):
        for column, value in enumerate(line):
            ax.text(column, row, text_of(value), ha="center", va="center", fontsize=8.5)


def draw_scatter(record: Record, space: Space) -> Figure:
    """Draw the robustness of each requirement over each column, in the colour of its verdict."""
    names, columns = list(record.requirements), space.columns
    lines = math.ceil(len(columns) / _PANELS)
    wide = min(len(columns), _PANELS)
    figure = Figure(
        figsize=(max(2.3 * wide + 0.6, 5.0), 2.1 * lines * len(names) + 0.8), layout="constrained"
    )
    panels = figure.subplots(lines * len(names), wide, squeeze=False, sharey=False)
    for ax in panels.flat[:]:
        ax.set_visible(False)
    for number, name in enumerate(names):
        heights = record.robustness_values(name)
        verdicts = [row.outcomes[name].verdict if name in row.outcomes else None for row in record]
        for index, column in enumerate(columns):
            ax = panels[number * lines + index // _PANELS, index % _PANELS]
            ax.set_visible(True)
            drawing.tidy(ax, shorten(name, 24) if index % _PANELS == 0 else "")
            ax.set_xlabel(_label(column, space), fontsize=9.5)
            ax.axhline(0.0, color=drawing.OPEN, linewidth=0.9, linestyle=(0, (4, 3)))
            _points(ax, record.numbers(column), heights, verdicts)
            _log(ax.set_xscale, column, space)
    figure.legend(
        handles=[
            Line2D([], [], marker="o", linestyle="", color=_colour(verdict), label=verdict.name)
            for verdict in Verdict
        ],
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=9,
    )
    return figure


def _points(ax: Axes, at: Floats, heights: Floats, verdicts: list[Verdict | None]) -> None:
    for verdict in Verdict:
        chosen = np.array([entry is verdict for entry in verdicts]) & np.isfinite(heights)
        ax.scatter(at[chosen], heights[chosen], s=9, color=_colour(verdict), alpha=0.7)


def _colour(verdict: Verdict) -> str:
    return drawing.VERDICT_COLOURS.get(verdict, drawing.OPEN)


def _log(set_scale: object, column: str, space: Space) -> None:
    entry = space.entries.get(column)
    if isinstance(entry, Parameter) and entry.log and callable(set_scale):
        set_scale("log")


def _label(column: str, space: Space) -> str:
    """Return the name of a column with its unit."""
    entry = space.entries.get(column)
    return f"{column} [{entry.unit}]" if isinstance(entry, Parameter) and entry.unit else column
