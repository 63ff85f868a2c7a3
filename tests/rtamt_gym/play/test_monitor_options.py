"""A `StepMonitor` runs under its own options."""

import math
from typing import Any

import pytest
from mujoco_models import arm

from rtamt_gym import StepMonitor, simulate
from rtamt_gym.play.history import Stop
from rtamt_gym.results import Snapshot

SPEC = "always(angle < 0.4 implies eventually[0:0.055](gap < 0.3))"


def gap(_model: Any, data: Any) -> float:  # noqa: ANN401
    """A signal that is nan at every third sample."""
    return math.nan if round(100 * data.time) % 3 == 2 else float(data.qpos[1])


def act(_model: Any, data: Any) -> None:  # noqa: ANN401
    data.ctrl[0] = math.sin(9 * data.time)


@pytest.mark.parametrize(
    "options",
    [
        {"view": "step"},
        {"view": "step", "align": "inward"},
        {"semantics": "boolean"},
        {"semantics": "output-robustness", "inputs": ["angle"], "outputs": ["gap"]},
    ],
)
@pytest.mark.parametrize("stop", ["violation", "end"])
def test_a_run_of_a_monitor_equals_one_of_its_simulation(
    options: dict[str, Any], stop: Stop
) -> None:
    options = {"align": "outward", "nan": "hold", **options}
    signals: dict[str, Any] = {"angle": "joint:shoulder.qpos", "gap": gap, "speed": "qvel[0]"}
    spec = SPEC.removeprefix("always") if "view" in options else SPEC
    monitor = StepMonitor(*arm("Euler"), spec, signals, **options)
    now = Snapshot.of(monitor)
    named: dict[str, Any] = {"policy": act, "duration": 0.6, "stop": stop}
    run = simulate(monitor, **named)  # it has not ended: the monitor can go on
    opened = simulate(arm("Euler"), spec, signals, at_truncation="open", **named, **options)
    assert run == opened == simulate(monitor, start=now, at_truncation="open", **named)
    ended = simulate(arm("Euler"), spec, signals, **named, **options)
    assert ended == simulate(monitor, start=now, **named)
    assert monitor.samples == run.steps + 1
    if "view" not in options:
        assert float(run.replay()["spec"][0]) == run.histories["spec"].final
