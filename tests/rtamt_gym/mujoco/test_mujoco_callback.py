"""A program with its own loop is monitored inside `mj_step`, and unchanged afterwards."""

from __future__ import annotations

import ctypes
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from mujoco_models import INTEGRATORS, arm, record, swing

import rtamt
from rtamt.errors import InputError, StateError
from rtamt_gym import StepMonitor

SPEC = "always(z < 0.2 implies eventually[0:0.1](z > 0.2)) and always(w < 90)"
SIGNALS = {"z": "qpos[4]", "w": "qvel[0]"}

integrators = pytest.mark.parametrize("integrator", INTEGRATORS)


@integrators
@pytest.mark.parametrize("chunks", [[120], [1] * 120, [50, 70]])
def test_samples_are_those_of_a_loop_with_step(integrator: str, chunks: list[int]) -> None:
    model, data = arm(integrator)
    attached = StepMonitor(model, data, SPEC, SIGNALS)
    with attached.attached():
        for steps in chunks:
            mujoco.mj_step(model, data, nstep=steps)
    stepped = StepMonitor(model, mujoco.MjData(model), SPEC, SIGNALS)
    stepped.run(1.2, on_violation="report")
    assert attached.samples == stepped.samples == 121
    assert attached.details == stepped.details
    assert attached.violated_at == stepped.violated_at is not None
    assert np.array_equal(data.qpos, stepped.data.qpos)


@integrators
def test_every_state_is_seen_once(integrator: str) -> None:
    model, data = arm(integrator)
    seen = []

    def look(_model: Any, data: Any) -> float:
        seen.append(data.qpos[0])
        return 0.0

    with StepMonitor(model, data, "always(x < 1)", {"x": look}).attached():
        for _ in range(30):
            swing(model, data)
            mujoco.mj_step(model, data)
    assert seen == record(model, mujoco.MjData(model), 30, lambda d: d.qpos[0])


@integrators
def test_a_controller_in_the_slot_goes_on_and_is_put_back(integrator: str) -> None:
    model, data = arm(integrator)
    mujoco.set_mjcb_control(swing)
    try:
        monitor = StepMonitor(model, data, SPEC, SIGNALS)
        with monitor.attached():
            mujoco.mj_step(model, data, nstep=50)
        assert mujoco.get_mjcb_control() is swing
        bare = mujoco.MjData(model)
        mujoco.mj_step(model, bare, nstep=50)
    finally:
        mujoco.set_mjcb_control(None)
    assert np.array_equal(data.qpos, bare.qpos)
    assert monitor.samples == 51


@integrators
def test_a_compiled_controller_goes_on_with_its_pointers_and_is_put_back(integrator: str) -> None:
    model, data = arm(integrator)
    given: list[tuple[int, int]] = []

    def note(model: Any, data: Any) -> None:
        pointers = (ctypes.cast(item, ctypes.c_void_p).value for item in (model, data))
        given.append(tuple(item or 0 for item in pointers))  # type: ignore[arg-type]

    pointer = ctypes.POINTER(ctypes.c_char)
    controller = ctypes.CFUNCTYPE(None, pointer, pointer)(note)
    mujoco.set_mjcb_control(controller)
    try:
        mujoco.mj_step(model, data, nstep=3)
        alone = given.copy()
        given.clear()
        mujoco.mj_resetData(model, data)
        monitor = StepMonitor(model, data, SPEC, SIGNALS)
        with monitor.attached():
            mujoco.mj_step(model, data, nstep=3)
        assert mujoco.get_mjcb_control() is controller
    finally:
        mujoco.set_mjcb_control(None)
    assert given[: len(alone)] == alone
    assert set(given) == set(alone)
    assert monitor.samples == 4


def test_forwards_in_between_are_no_samples() -> None:
    model, data = arm("RK4")
    monitor = StepMonitor(model, data, SPEC, SIGNALS)
    with monitor.attached():
        for _ in range(20):
            mujoco.mj_forward(model, data)
            mujoco.mj_step(model, data)
            mujoco.mj_forward(model, data)
    assert monitor.samples == 21


def try_state(model: Any, data: Any) -> None:
    """Evaluate another state and restore the old one, as inverse kinematics does."""
    old = data.qpos.copy()
    data.qpos[:] = 5.0
    mujoco.mj_forward(model, data)
    data.qpos[:] = old


@integrators
@pytest.mark.parametrize("forward_first", [False, True])
def test_trial_state_is_not_a_sample(integrator: str, forward_first: bool) -> None:  # noqa: FBT001
    model, data = arm(integrator)
    signals = {"angle": "joint:shoulder.qpos", "height": "site:grip.xpos[2]", "z": "qpos[4]"}
    spec = "always(angle < 9 and height < 9 and z > -9)"

    def program(*, tries: bool) -> StepMonitor:
        mujoco.mj_resetData(model, data)
        monitor = StepMonitor(model, data, spec, signals)
        with monitor.attached():
            for step in range(12):
                if tries and step % 3 == 0:
                    if forward_first:
                        mujoco.mj_forward(model, data)
                    try_state(model, data)
                    try_state(model, data)
                mujoco.mj_step(model, data)
            if tries:
                try_state(model, data)
            else:
                mujoco.mj_forward(model, data)
        return monitor

    plain, tried = program(tries=False), program(tries=True)
    assert tried.samples == plain.samples == 13
    assert tried.details == plain.details


@integrators
def test_trial_state_does_not_violate(integrator: str) -> None:
    model, data = arm(integrator)
    monitor = StepMonitor(model, data, "always(x < 4)", {"x": "qpos[0]"})
    with monitor.attached():
        mujoco.mj_step(model, data, nstep=3)
        try_state(model, data)
        mujoco.mj_step(model, data, nstep=3)
        assert monitor.violated_by is None
    assert (monitor.samples, monitor.violated_by) == (7, None)


@integrators
@pytest.mark.parametrize("trial", [1, 2, 5])
def test_trial_steps_are_refused_or_not_samples(integrator: str, trial: int) -> None:
    model, data = arm(integrator)
    monitor = StepMonitor(model, data, "always(x < 4)", {"x": "qpos[0]"})
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    before = np.empty(mujoco.mj_stateSize(model, kind))

    def program() -> None:
        with monitor.attached():
            mujoco.mj_step(model, data, nstep=3)
            mujoco.mj_getState(model, data, before, kind)
            data.qpos[0] = 3.0
            mujoco.mj_step(model, data, nstep=trial)
            mujoco.mj_setState(model, data, before, kind)
            mujoco.mj_step(model, data, nstep=3)

    if trial == 1 and integrator != "RK4":
        program()
        assert monitor.samples == 7
        assert monitor.robustness == pytest.approx(4.0, abs=0.5)
    else:
        with pytest.raises(StateError, match="expected the time"):
            program()


def test_a_run_may_begin_with_reset_and_go_on_with_step() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, SPEC, SIGNALS)
    monitor.reset()
    with monitor.attached():
        mujoco.mj_step(model, data, nstep=10)
    monitor.step()
    with monitor.attached():
        mujoco.mj_step(model, data, nstep=10)
    assert monitor.samples == 22
    whole = StepMonitor(model, mujoco.MjData(model), SPEC, SIGNALS)
    whole.run(0.21, on_violation="report")
    assert monitor.details == whole.details


def test_other_simulations_are_left_alone() -> None:
    model, data = arm()
    other, others = arm("RK4")
    env = gym.make("InvertedPendulum-v5")
    seen: list[float] = []

    def look(_model: Any, data: Any) -> float:
        # Late after a step, in time inside the next one.
        seen.append(float(data.site("grip").xpos[2]))
        return 0.0

    with StepMonitor(model, data, "always(x < 1)", {"x": look}).attached():
        mujoco.mj_step(model, data, nstep=5)
        mujoco.mj_step(other, others, nstep=7)
        env.reset(seed=1)
        env.step(env.action_space.sample())
        mujoco.mj_step(model, data, nstep=5)
    env.close()
    disturbed = seen.copy()
    seen.clear()
    alone = mujoco.MjData(model)
    with StepMonitor(model, alone, "always(x < 1)", {"x": look}).attached():
        mujoco.mj_step(model, alone, nstep=10)
    assert disturbed == seen
    assert len(seen) == 11


def test_two_monitors_may_be_attached() -> None:
    model, data = arm()
    one, two = (StepMonitor(model, data, SPEC, SIGNALS) for _ in range(2))
    with one.attached(), two.attached():
        mujoco.mj_step(model, data, nstep=5)
    assert mujoco.get_mjcb_control() is None
    assert one.samples == two.samples == 6
    assert one.details == two.details


def nothing(_model: Any, _data: Any) -> None:
    """A controller without an effect."""


@pytest.mark.parametrize("before", [None, nothing])
def test_the_slot_is_as_it_was_after_an_error_of_the_program(before: Any) -> None:
    model, data = arm()

    def program() -> None:
        with StepMonitor(model, data, SPEC, SIGNALS).attached():
            mujoco.mj_step(model, data)
            raise ZeroDivisionError

    mujoco.set_mjcb_control(before)
    try:
        with pytest.raises(ZeroDivisionError):
            program()
        assert mujoco.get_mjcb_control() is before
    finally:
        mujoco.set_mjcb_control(None)


def test_an_error_of_a_signal_is_raised_at_the_end_and_not_through_mujoco() -> None:
    model, data = arm()

    def read(_model: Any, data: Any) -> float:
        return float("nan") if data.time > 0.045 else 0.0

    monitor = StepMonitor(model, data, "always(x < 1)", {"x": read})
    with pytest.raises(InputError, match="variable 'x' is nan at sample 5"), monitor.attached():
        mujoco.mj_step(model, data, nstep=20)
    assert data.time == pytest.approx(0.2)
    assert mujoco.get_mjcb_control() is None
    assert monitor.samples == 5
    with pytest.raises(StateError):
        monitor.step()


@pytest.mark.parametrize("how", ["reset", "timestep", "jump"])
@integrators
def test_a_program_that_changes_the_time_is_told_at_the_end(how: str, integrator: str) -> None:
    model, data = arm(integrator)
    monitor = StepMonitor(model, data, SPEC, SIGNALS)

    def program() -> None:
        with monitor.attached():
            mujoco.mj_step(model, data, nstep=10)
            if how == "reset":
                mujoco.mj_resetData(model, data)
            elif how == "timestep":
                model.opt.timestep = 0.002
            else:
                data.time += 1.0
            mujoco.mj_step(model, data, nstep=10)

    with pytest.raises(
        StateError, match=r"expected the time .* at sample (9|1[01]), got"
    ) as caught:
        program()
    assert str(caught.value).endswith("call reset()")
    assert mujoco.get_mjcb_control() is None


def test_a_program_that_sets_another_callback_is_told_at_the_end() -> None:
    model, data = arm()

    def program() -> None:
        with StepMonitor(model, data, SPEC, SIGNALS).attached():
            mujoco.set_mjcb_control(nothing)
            mujoco.mj_step(model, data)

    try:
        with pytest.raises(StateError) as caught:
            program()
        assert mujoco.get_mjcb_control() is nothing
    finally:
        mujoco.set_mjcb_control(None)
    assert str(caught.value) == (
        "expected mjcb_control as it was attached, but the program has set another callback: "
        "no samples came since; set the controller before, and the monitor calls it too"
    )


def test_a_program_that_makes_no_step_has_one_sample() -> None:
    monitor = StepMonitor(*arm(), SPEC, SIGNALS)
    with monitor.attached():
        pass
    assert monitor.samples == 1
    assert monitor.verdict is rtamt.Verdict.UNDECIDED


@integrators
def test_the_last_sample_is_derived_too_where_the_monitor_derives(integrator: str) -> None:
    model, data = arm(integrator)
    seen: list[float] = []

    def look(_model: Any, data: Any) -> float:
        seen.append(float(data.sensor("rate").data[0]))
        return 0.0

    with StepMonitor(model, data, "always(x < 1)", {"x": look}, forward=True).attached():
        mujoco.mj_step(model, data, nstep=20)
    bare = mujoco.MjData(model)
    mujoco.mj_step(model, bare, nstep=20)
    assert bare.sensor("rate").data[0] != bare.joint("elbow").qvel[0]  # of the step before
    assert seen[-1] == bare.joint("elbow").qvel[0]


def test_a_finished_run_takes_no_more_samples() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, SPEC, SIGNALS)
    with monitor.attached():
        mujoco.mj_step(model, data, nstep=5)
    monitor.finish()
    details = monitor.details
    with pytest.raises(StateError, match="after finish"), monitor.attached():
        mujoco.mj_step(model, data, nstep=5)
    assert (monitor.samples, monitor.details) == (6, details)
    monitor.reset()
    with monitor.attached():
        mujoco.mj_step(model, data, nstep=5)
    assert monitor.samples == 6
