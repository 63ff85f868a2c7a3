"""Pictures of runs: the content of each panel."""

import math
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from rtamt import Verdict
from rtamt_gym.drawing import save
from rtamt_gym.play.history import Floats, History
from rtamt_gym.play.run import draw
from rtamt_gym.results import Run

INF = math.inf


def array(*values: float) -> Floats:
    return np.array(values)


def run(period: Fraction | None = Fraction(1, 2), *, decided: bool = True) -> Run:
    return Run(
        system="Test-v0",
        seed=3,
        label="",
        period=period,
        view="episode",
        stop="violation",
        limit=10,
        signals={"x": array(3.0, 2.0, -1.0)},
        histories={
            "positive": History(
                "always(x > 0)",
                array(3.0, 2.0, -1.0),
                array(-INF, -INF, -INF),
                array(3.0, 2.0, -1.0),
                -1.0,
                Verdict.VIOLATED if decided else Verdict.UNDECIDED,
                2 if decided else None,
            )
        },
        ended="violation",
        violated_by="positive" if decided else None,
        wall_time=0.0,
    )


def panel(of: Run) -> Axes:
    """Return the panel of the specification."""
    return draw([of]).axes[1]


def test_signals_are_above_and_specifications_below() -> None:
    figure = draw([run(), run()])
    assert [ax.get_ylabel() for ax in figure.axes] == ["x", "x", "positive", "positive"]
    assert [ax.get_title() for ax in figure.axes[:2]] == ["Test-v0, seed 3"] * 2
    assert [ax.get_title(loc="left") for ax in figure.axes[2:]] == ["always(x > 0)"] * 2


def test_samples_stand_at_their_times() -> None:
    line = draw([run()]).axes[0].lines[0]
    assert np.array(line.get_xydata()).tolist() == [[0.0, 3.0], [0.5, 2.0], [1.0, -1.0]]


def test_without_a_period_the_axis_counts_samples() -> None:
    line = draw([run(period=None)]).axes[0].lines[0]
    assert np.array(line.get_xdata()).tolist() == [0.0, 1.0, 2.0]


def test_infinite_bounds_end_at_the_frame() -> None:
    ax = panel(run())
    (band,) = (c for c in ax.collections if isinstance(c, PolyCollection))
    heights = np.asarray(band.get_paths()[0].vertices)[:, 1]
    low, high = ax.get_ylim()
    assert low < -1.0
    assert high > 3.0
    assert heights.min() == low
    assert heights.max() == 3.0


def test_all_behind_the_verdict_is_shaded_even_behind_the_last_sample() -> None:
    ax = panel(run())
    (shade,) = ax.patches  # a polygon before Matplotlib 3.9, a rectangle since
    path = shade.get_patch_transform().transform_path(shade.get_path())
    times = np.asarray(path.vertices)[:, 0]
    assert times.min() == 1.0
    assert times.max() == pytest.approx(ax.get_xlim()[1], rel=1e-12)
    assert times.max() > 1.0
    assert ax.get_xlabel() == "VIOLATED, -1, at 1 s"


def test_an_open_verdict_is_not_shaded() -> None:
    ax = panel(run(decided=False))
    assert not ax.patches
    assert ax.get_xlabel() == "UNDECIDED, -1"


def test_a_constant_at_zero_and_a_lone_sample_have_a_frame() -> None:
    course = History(
        "always(x == x)", array(0.0), array(-INF), array(0.0), 0.0, Verdict.UNDECIDED, None
    )
    lone = replace(
        run(None, decided=False),
        signals={"x": array(1.0)},
        histories={"same": course},
        label="lone",
    )
    ax = panel(lone)
    assert ax.get_ylim() == (-1.0, 1.0)
    assert ax.get_xlim() == (0.0, 1.0)


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(("name", "begin"), [("e.png", b"\x89PNG"), ("e.svg", b"<?xml")])
def test_the_name_says_the_format(tmp_path: Path, name: str, begin: bytes) -> None:
    save(draw([run()]), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(begin)


@pytest.mark.slow
def test_no_window_system_is_asked_for() -> None:
    code = "import sys; from rtamt_gym import simulate; from rtamt_gym.play.run import draw; "
    code += "draw([simulate([{'x': 1.0}], 'always(x > 0)')]); "
    code += "sys.exit('matplotlib.pyplot' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
