"""Charts describe their cells, points and curves, and the parts that are not shown."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_results import SPECS, evaluation, figures, row, tank, wave

from rtamt_gym import Parameter, compare, simulate, sweep
from rtamt_gym.reports.evaluations import of_evaluation
from rtamt_gym.reports.figures import episode_figure
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Figure, Section
from rtamt_gym.reports.numbers import ROOM
from rtamt_gym.reports.simulations import of_record
from rtamt_gym.reports.write import report_of, section_of
from rtamt_gym.results import Record, Run

INFLOW, LEAK = Parameter("inflow", 0.1, 0.3), Parameter("leak", 0.1, 0.2)


def chart(section: Section, kind: str) -> Figure:
    """Return the first chart of a kind of the first requirement."""
    return figures(section, kind)[0]


def raised(inflow: float, leak: float, start: float) -> Iterator[dict[str, float]]:
    """Return the tank, filled higher at first."""
    for sample in tank(inflow, leak):
        yield {"level": sample["level"] + start}


def test_map_notes_minima_of_several_simulations() -> None:
    start = Parameter("start", 0.0, 0.6)
    options: dict[str, Any] = {"samples": 3, "sampler": "grid", "period": 1, "progress": False}
    one = of_record(sweep(tank, SPECS, [INFLOW, LEAK], **options), ROOM)
    several = of_record(sweep(raised, SPECS, [INFLOW, LEAK, start], **options), ROOM)
    says = "A cell is the minimum of several simulations."
    assert says not in chart(one, "map").summary
    folded = chart(several, "map")
    assert folded.summary.endswith(f" {says}")
    # The minimum over hidden points is at the largest start.
    alone, least = (chart(each, "map").data["cells"][0][0] for each in (one, several))
    assert alone is not None
    assert least == pytest.approx(alone - 0.6)


def test_omitted_points_are_counted() -> None:
    heights = np.random.default_rng(1).normal(size=2100)
    rows = [row({"dry": height}, case={"x": float(i)}) for i, height in enumerate(heights)]
    formulas = {"dry": "always(x < 1)"}
    many = chart(of_record(Record(rows, formulas, "made"), ROOM), "cases")
    assert "; 100 simulations left out. The table of simulations" in many.summary
    few = chart(of_record(Record(rows[:2000], formulas, "made"), ROOM), "cases")
    assert "left out" not in few.summary


def saved(run: Run, folder: Path) -> Section:
    """Return the section of the file of a run."""
    run.save(folder / "run.parquet")
    return section_of(folder / "run.parquet", ROOM)


def test_instant_curve_is_noted(tmp_path: Path) -> None:
    rows = [{"x": value} for value in (1.0, -2.0, 3.0)]
    said = {}
    for view in ("episode", "step"):
        section = saved(
            simulate(rows, "eventually[0:1](x > 0)", period=1, view=view, stop="end"), tmp_path
        )
        (episode,) = section.requirements[0].worst
        said[view] = episode_figure(episode, section.unit).summary
    assert "instant" not in said["episode"]
    assert said["step"].endswith(
        " The curve of robustness is of each instant, its bounds are about all of them."
    )


def test_shown_samples_of_long_episode() -> None:
    made = evaluation([row({"low": -4.0, "seen": 1.0}, seed=0)], {"low": (wave(6000),)})
    (episode,) = of_evaluation(made, ROOM).requirements[0].worst
    assert 60 <= len(episode.times) < 6000
    assert episode_figure(episode, "s").summary.endswith(
        f" {len(episode.times)} of 6000 samples are shown."
    )


def test_pairs_with_known_robustness() -> None:
    a, b = (
        evaluation([row({"low": low, "seen": math.nan}, seed=i) for i in range(4)], {})
        for low in (1.0, 2.0)
    )
    charts = re.findall(r'data-chart="([^"]*)"', render(report_of(compare(a, b))))
    assert charts == ["comparison-low-pairs", "comparison-all-requirements-pairs"]
