"""The example that follows gradients runs and confirms its claims."""

from __future__ import annotations

import contextlib
import importlib.util
import io
from pathlib import Path
from types import ModuleType

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from paths import EXAMPLES

import rtamt


@pytest.fixture(scope="module")
def unicycle() -> ModuleType:
    spec = importlib.util.spec_from_file_location("unicycle", EXAMPLES / "unicycle.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_distances_of_a_straight_path(unicycle: ModuleType) -> None:
    controls = np.zeros((2, 60))
    controls[0] = 100.0  # the maximum speed, and no turn
    places = np.asarray(unicycle.path(controls))
    np.testing.assert_allclose(places, [0.2 * np.arange(61), np.zeros(61)], atol=1e-4)
    seen = unicycle.signals(places)
    assert seen["clear"][8] == pytest.approx(0.1, abs=1e-4)  # at (1.6, 0), 0.8 from its centre
    assert seen["first"][3] == pytest.approx(0.4 - 2.0, abs=1e-4)


def test_both_gradients_satisfy_the_task(unicycle: ModuleType, tmp_path: Path) -> None:
    picture = tmp_path / "unicycle.png"
    with contextlib.redirect_stdout(io.StringIO()) as out, mpl.rc_context():
        unicycle.main(["--plot", str(picture)])
        plt.close("all")
    assert picture.read_bytes().startswith(b"\x89PNG")
    _, *rows = map(str.split, out.getvalue().splitlines())
    assert [row[:3:2] for row in rows] == [["standard", "SATISFIED"], ["smooth", "SATISFIED"]]
    for _, robustness, _, below, _ in rows:
        assert float(robustness) > 0.0
        assert 0 < int(below) < unicycle.STEPS


def test_solution_is_judged_without_jax(unicycle: ModuleType) -> None:
    start = np.zeros((2, unicycle.SAMPLES - 1))
    found, seen = unicycle.ascend(start, smooth=True)
    signals = {k: np.asarray(v) for k, v in unicycle.signals(unicycle.path(found)).items()}
    expected = rtamt.evaluate(unicycle.TASK, signals, period=unicycle.PERIOD)[0]
    assert float(unicycle.robustness(found)) == pytest.approx(expected, abs=1e-5)
    assert expected > float(seen[0])
