"""Errors of `StepMonitor`; after an error it must be reset."""

from __future__ import annotations

import math
from typing import Any

import mujoco  # type: ignore[import-untyped]
import pytest
from mujoco_models import INTEGRATORS, arm

import rtamt
from rtamt.errors import InputError, InputTypeError, StateError
from rtamt_gym import StepMonitor
from rtamt_gym.mujoco.step_monitor import StepClock

X = {"x": "qpos[0]"}


def disturbed(data: Any, model: Any, how: str) -> None:
    match how:
        case "reset":
            mujoco.mj_resetData(model, data)
        case "step":
            mujoco.mj_step(model, data)
        case "timestep":
            model.opt.timestep = 0.02
        case "unstable":
            data.qvel[0] = 1e20


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("how", ["reset", "step", "timestep", "unstable"])
def test_a_simulation_that_leaves_its_course_is_noticed_within_16_samples(
    integrator: str, how: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log about instabilities
    model, data = arm(integrator)
    monitor = StepMonitor(model, data, "always(x < 9)", X)
    monitor.run(0.2)
    disturbed(data, model, how)
    with pytest.raises(StateError, match="expected the time") as caught:
        monitor.run(16 * model.opt.timestep)
    assert str(caught.value).startswith(f"expected the time {0.01 * monitor.samples:.12g} s at ")
    for _ in range(2):
        with pytest.raises(StateError) as again:
            monitor.step()
        assert str(again.value) == (
            "expected a running simulation, got step() after finish() or after an error; "
            "call reset()"
        )
    model.opt.timestep = 0.01
    monitor.reset()
    monitor.step()
    assert monitor.samples == 2


def test_rounding_of_the_time_does_not_add_up() -> None:
    clock = StepClock()
    clock.start(5.0, 0.1)
    for sample in range(0, 10_000, 16):
        clock.check(5.0 + 0.1 * sample * (1 + 5e-4), sample)
    with pytest.raises(StateError):
        clock.check(5.0 + 0.1 * 10_016, 10_016)


def test_no_verdict_is_decided_from_samples_of_another_course() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "always(x < 0.25)", X)
    model.opt.gravity[:] = 0.0
    monitor.run(0.05)
    mujoco.mj_resetData(model, data)
    data.qpos[0] = 0.5
    with pytest.raises(StateError, match=r"got 0\.01 s"):
        monitor.step()
    assert monitor.violated_by is None


def test_a_reset_between_two_runs_begins_a_new_one() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "always(x < 9)", X)
    result = []
    for _ in range(3):
        mujoco.mj_resetData(model, data)
        monitor.reset()
        monitor.run(0.3)
        result.append((monitor.samples, monitor.robustness))
    assert result == [result[0]] * 3
    assert result[0][0] == 31


def test_a_nan_ends_the_run_and_a_reset_begins_another() -> None:
    model, data = arm()
    values = [0.5, 0.5, math.nan, 0.5, 0.5]

    def read(_model: Any, _data: Any) -> float:
        return values.pop(0)

    monitor = StepMonitor(model, data, "always(x < 1)", {"x": read})
    monitor.step()
    with pytest.raises(InputError, match="nan"):
        monitor.step()
    assert (monitor.samples, monitor.robustness) == (2, 0.5)
    with pytest.raises(StateError, match="after an error"):
        monitor.step()
    monitor.reset()
    assert monitor.samples == 1


def test_a_nan_may_keep_the_last_value() -> None:
    values = [0.5, math.nan, math.nan, 0.25, math.nan]

    def read(_model: Any, _data: Any) -> float:
        return values.pop(0)

    monitor = StepMonitor(*arm(), "always(x < 1)", {"x": read}, nan="hold")
    monitor.reset()
    assert [monitor.step() for _ in range(4)] == [0.5] * 4
    assert monitor.samples == 5


def test_a_callable_that_gives_no_number_is_named() -> None:
    def tell(_model: Any, _data: Any) -> str:
        return "high"

    monitor = StepMonitor(*arm(), "always(x < 1)", {"x": tell})  # type: ignore[dict-item]
    with pytest.raises(InputTypeError) as caught:
        monitor.reset()
    assert str(caught.value).startswith("signal 'x': expected a number from test_a_callable_that")
    assert str(caught.value).endswith("tell, got 'high'")
    assert monitor.samples == 0


def test_finish_needs_a_sample_and_ends_the_run() -> None:
    monitor = StepMonitor(*arm(), "always(x < 1)", X)
    with pytest.raises(StateError):
        monitor.finish()
    monitor.step()
    final = monitor.finish()
    with pytest.raises(StateError, match=r"after finish\(\)"):
        monitor.step()
    assert monitor.finish() == final
    assert monitor.verdict is rtamt.Verdict.SATISFIED


def test_a_controller_that_fails_ends_the_run_but_not_the_monitor() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "always(x < 9)", X)

    def fail(_model: Any, data: Any) -> None:
        if data.time > 0.045:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        monitor.run(1.0, fail)
    assert monitor.samples == 6
    monitor.run(0.1)
    assert monitor.samples == 16


WITHIN = "eventually[0:0.1](x > 9)"
CHANGED = (
    "the timestep of the model was 0.01 s when the monitor was made, and is 0.02 s now; make a new "
    "StepMonitor"
)


@pytest.mark.parametrize("steps", [0, 3])
@pytest.mark.parametrize("start", ["reset", "step", "attached"])
def test_changed_timestep_is_refused(steps: int, start: str) -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, WITHIN, X)
    for _ in range(steps):
        monitor.step()
    model.opt.timestep = 0.02
    if steps or start == "reset":
        with pytest.raises(StateError) as caught:
            monitor.reset()
    elif start == "step":
        with pytest.raises(StateError) as caught:
            monitor.step()
    else:
        with pytest.raises(StateError) as caught, monitor.attached():
            mujoco.mj_step(model, data)
    assert str(caught.value) == CHANGED
    assert monitor.verdict is rtamt.Verdict.UNDECIDED
    model.opt.timestep = 0.01
    mujoco.mj_resetData(model, data)
    monitor.reset()
    monitor.run(1.0)
    assert monitor.violated_at == 10


def test_changed_timestep_without_bounds_warns_once() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "always(x < 9)", X)
    model.opt.timestep = 0.02
    with pytest.warns(UserWarning, match="make a new StepMonitor"):
        monitor.reset()
    monitor.reset()


@pytest.mark.parametrize("period", ["50ms", 0.02, 0.005])
def test_other_period_than_the_timestep_warns(period: rtamt.typing.Period) -> None:
    model, data = arm()
    with pytest.warns(UserWarning, match=r"but the timestep of the model is 0\.01 s") as caught:
        monitor = StepMonitor(model, data, WITHIN, X, period=period)
    assert caught[0].filename == __file__
    monitor.reset()  # the same warning is not repeated
    model.opt.timestep = 0.1
    with pytest.warns(UserWarning, match=r"but the timestep of the model is 0\.1 s"):
        monitor.reset()


def test_right_period_and_counted_steps_do_not_warn() -> None:
    model, data = arm()
    StepMonitor(model, data, WITHIN, X, period="10ms").reset()
    counting = StepMonitor(model, data, "eventually[0:10](x > 9)", X, period=1)
    model.opt.timestep = 0.02
    counting.reset()
    confirmed = StepMonitor(model, data, WITHIN, X, period="20ms")
    model.opt.timestep = 0.01
    with pytest.warns(UserWarning, match="bounds last 0.5 times as long as written"):
        confirmed.reset()
