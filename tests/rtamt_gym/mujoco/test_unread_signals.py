"""Signals of a `StepMonitor` that no specification reads."""

import copy
import pickle
from typing import Any

import mujoco  # type: ignore[import-untyped]
import pytest
from mujoco_models import arm
from steps import StepCounter

from rtamt import InputError
from rtamt_gym import StepMonitor, simulate
from rtamt_gym.results import Snapshot

HELD = "always(abs(angle) < 0.5)"
READ = {"angle": "joint:shoulder.qpos"}


def counted(count: list[float]) -> dict[str, Any]:
    """Return signals around the one that is read; the last counts its calls."""

    def calls(_model: Any, data: Any) -> float:
        count.append(float(data.time))
        return len(count)

    return {"height": "site:grip.xpos[2]", **READ, "speed": "qvel[0]", "calls": calls}


def monitored() -> StepMonitor:
    plain = StepMonitor(*arm("Euler"), HELD, {"speed": "qvel[0]", **READ})
    plain.run(0.1)
    return plain


def test_they_are_in_the_values_and_change_nothing() -> None:
    count: list[float] = []
    shown = []
    for signals in (READ, counted(count)):
        monitor = StepMonitor(*arm("Euler"), HELD, signals)
        path = [monitor.step() for _ in range(50)]
        shown.append((path, monitor.details, monitor.data.qpos.tolist(), monitor.samples))
    assert shown[0] == shown[1]
    data = monitor.data
    assert monitor.values == {
        "angle": data.qpos[0],
        "height": data.site("grip").xpos[2],
        "speed": data.qvel[0],
        "calls": 1.0,
    }
    assert copy.deepcopy(plain := monitored()).values == plain.values
    assert pickle.loads(pickle.dumps(plain)).values == plain.values


def test_a_step_does_not_read_them() -> None:
    count: list[float] = []
    monitor = StepMonitor(*arm("RK4"), HELD, counted(count))
    monitor.run(0.5)
    with monitor.attached():
        mujoco.mj_step(monitor.model, monitor.data, nstep=5)
    assert count == []
    plain = StepMonitor(*arm("RK4"), HELD, READ)
    plain.run(0.5)
    lines = StepCounter()
    assert lines(monitor.step) == lines(plain.step)


def test_a_run_records_them_as_those_of_the_simulation_itself() -> None:
    model, data = arm("Euler")
    signals: dict[str, Any] = {"speed": "qvel[0]", **READ, "rate": "ctrl[0]"}

    def act(_model: Any, data: Any) -> None:
        data.ctrl[0] = 1 - data.time

    run = simulate(StepMonitor(model, data, HELD, signals), policy=act, duration=0.3)
    again = simulate(arm("Euler"), HELD, signals, policy=act, duration=0.3)
    assert list(run.signals) == list(again.signals) == ["angle", "speed", "rate"]
    assert run == again


def test_monitors_that_differ_in_them_share_snapshots() -> None:
    rich = StepMonitor(*arm("Euler"), HELD, {**READ, "speed": "qvel[0]"})
    plain = StepMonitor(*arm("Euler"), HELD, {"time": "time", **READ})
    rich.run(0.1)
    now = Snapshot.of(rich)
    plain.run(0.2)
    run, other = (simulate(m, start=now, duration=0.1) for m in (rich, plain))
    assert run.histories == other.histories
    assert run.signals["angle"].tolist() == other.signals["angle"].tolist()
    assert other.signals["time"][0] == pytest.approx(0.1)


def test_they_must_fit_the_model_too() -> None:
    with pytest.raises(InputError) as refused:
        StepMonitor(*arm("Euler"), HELD, {**READ, "far": "qpos[99]"})
    assert str(refused.value).startswith("signal 'far': ")
    with pytest.raises(InputError) as refused:
        StepMonitor(*arm("Euler"), HELD, {"angel": "joint:shoulder.qpos"})
    assert str(refused.value) == (
        "variable 'angle' has no signal; the signals are 'angel'; did you mean 'angel'?"
    )
