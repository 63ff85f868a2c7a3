"""Pictures of episodes, in a module of their own because Matplotlib is optional."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rtamt_envs.scenario import EpisodeSoFar, Quantity, Scenario
from rtamt_gym.drawing import SIGNAL, tidy

_DPI = 100


def figure_of(scenario: Scenario, episode: EpisodeSoFar) -> Figure:
    """Draw an episode into a new figure."""
    figure = Figure(figsize=(8.0, 6.0), dpi=_DPI, layout="constrained")
    if scenario.draw is None:
        draw_courses(figure, episode, scenario.observations)
    else:
        scenario.draw(figure, episode)
    return figure


def frame(scenario: Scenario, episode: EpisodeSoFar) -> NDArray[np.uint8]:
    """Draw an episode as an array of pixels, shape (600, 800, 3)."""
    canvas = FigureCanvasAgg(figure_of(scenario, episode))
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]


def draw_courses(figure: Figure, episode: EpisodeSoFar, observations: tuple[Quantity, ...]) -> None:
    """Plot each observation, one panel below the other."""
    panels = figure.subplots(len(observations), 1, sharex=True, squeeze=False)[:, 0]
    for ax, quantity, values in zip(panels, observations, episode.observations.T, strict=True):
        tidy(ax, f"{quantity.name} [{quantity.unit}]" if quantity.unit else quantity.name)
        ax.plot(episode.times, values, color=SIGNAL, linewidth=1.2)
    panels[-1].set_xlabel("time [s]", fontsize=9.5)
