"""Pictures of methods over training seeds: curves with bands, every run, performance profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rtamt_gym import drawing
from rtamt_gym.results.method_scores import Estimate, MethodScores

_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#222222")
"""The palette of Okabe and Ito."""


def draw(
    methods: Mapping[str, MethodScores],
    steps: Sequence[float],
    thresholds: Sequence[float],
    score: str,
) -> Figure:
    """Draw the curves of training if there are any, the score of every run, and the profiles."""
    panels = 2 + bool(steps)
    figure = Figure(figsize=(3.6 * panels + 0.4, 3.3), layout="constrained")
    *first, runs, profiles = figure.subplots(1, panels)
    colours = dict(zip(methods, cycle(_COLOURS), strict=False))
    for ax in first:
        for name, method in methods.items():
            _band(ax, steps, method.curve, name, colours[name])
        drawing.tidy(ax, f"mean {score}")
        ax.set_xlabel("steps of training", fontsize=9)
    for index, (name, method) in enumerate(methods.items()):
        scores = np.sort(np.ravel(method.scores))
        # Runs next to each other, so that equal runs stay visible.
        across = index + np.linspace(-0.3, 0.3, len(scores))
        runs.plot(across, scores, ".", color=colours[name], markersize=4)
        low, high = method.mean.interval
        runs.plot([index, index], [low, high], color=colours[name], linewidth=2)
        runs.plot([index], [method.mean.value], "o", color=colours[name])
    runs.set_xticks(range(len(methods)), list(methods))
    drawing.tidy(runs, f"{score} of each run")
    for name, method in methods.items():
        _band(profiles, thresholds, method.profile, name, colours[name])
    drawing.tidy(profiles, "share of runs above")
    profiles.set_xlabel(score, fontsize=9)
    handles, labels = profiles.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _band(
    ax: Axes, places: Sequence[float], estimates: Sequence[Estimate], name: str, colour: str
) -> None:
    """Draw a curve with the intervals of its points."""
    low, high = np.array([estimate.interval for estimate in estimates]).T
    ax.plot(
        places, [estimate.value for estimate in estimates], color=colour, label=name, linewidth=1.6
    )
    ax.fill_between(places, low, high, color=colour, alpha=0.18, linewidth=0)
