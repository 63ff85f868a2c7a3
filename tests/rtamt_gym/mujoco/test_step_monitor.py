"""`StepMonitor`: one sample for every `mj_step` with every integrator, and no other effect."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mujoco_models import INTEGRATORS, arm, record, swing
from profiles import examples
from strategies import VARIABLES, formulas

import rtamt
from rtamt_gym import StepMonitor
from rtamt_gym.options.evaluation import View

integrators = pytest.mark.parametrize("integrator", INTEGRATORS)

SPECS = {
    "held": "always(abs(angle) < 0.5)",
    "answers": "always(height < 0.3 implies eventually[0:0.1](rate > 0))",
    "lands": "eventually[0:0.4](touch > 0.5)",
}
SIGNALS = {
    "angle": "joint:shoulder.qpos",
    "height": "site:grip.xpos[2]",
    "rate": "sensor:rate",
    "touch": "contact:'ball.1',floor",
}


def looks(model: Any) -> dict[str, Callable[[Any], float]]:
    """Return the values of the signals, read without selectors."""
    pair = {model.geom("skin").id, model.geom("floor").id}
    return {
        "angle": lambda d: d.qpos[0],
        "height": lambda d: d.site_xpos[0, 2],
        "rate": lambda d: d.sensordata[3],
        "touch": lambda d: float(
            any({int(c.geom1), int(c.geom2)} == pair and c.efc_address >= 0 for c in d.contact)
        ),
    }


def test_what_is_judged_is_said_as_wrappers_say_it() -> None:
    model, data = arm("Euler")
    judging = StepMonitor(model, data, SPECS, SIGNALS, view="step", nan="hold").judging
    assert {name: str(spec) for name, spec in judging.specs.items()} == SPECS
    assert (judging.reading.view, judging.reading.nan) == ("step", "hold")


@integrators
@pytest.mark.parametrize("forward", [False, True])
def test_samples_are_those_of_a_loop_written_by_hand(
    integrator: str,
    forward: bool,  # noqa: FBT001
) -> None:
    model, data = arm(integrator)
    steps = 60
    columns = {
        name: record(model, mujoco.MjData(model), steps, look, forward=forward)
        for name, look in looks(model).items()
    }
    monitor = StepMonitor(model, data, SPECS, SIGNALS, forward=forward)
    judges = {name: rtamt.EpisodeMonitor(text, period=0.01) for name, text in SPECS.items()}
    monitor.reset()
    for sample in range(steps + 1):
        values = {name: column[sample] for name, column in columns.items()}
        assert monitor.values == values
        for judge in judges.values():
            judge.update({name: values[name] for name in judge.variables})
        assert monitor.samples == sample + 1
        assert monitor.robustness == min(judge.robustness for judge in judges.values())
        assert monitor.lower == min(judge.lower for judge in judges.values())
        assert monitor.upper == min(judge.upper for judge in judges.values())
        assert monitor.details == {
            name: {
                "robustness": judge.robustness,
                "lower": judge.lower,
                "upper": judge.upper,
                "verdict": judge.verdict.name,
            }
            for name, judge in judges.items()
        }
        swing(model, data)
        assert monitor.step() == monitor.robustness


@settings(max_examples=examples(60))
@given(formulas(endless=True), st.sampled_from(INTEGRATORS), st.integers(1, 20))
def test_robustness_online_is_robustness_offline(
    formula: rtamt.Formula, integrator: str, steps: int
) -> None:
    spec = rtamt.Specification.of(formula)
    if not spec.looks_ahead:
        spec = spec.always()
    places = {name: place for place, name in enumerate(VARIABLES)}
    model, data = arm(integrator)
    signals = {name: f"qpos[{places[name]}]" for name in spec.variables}
    try:
        monitor = StepMonitor(model, data, spec, signals, period=1)
    except rtamt.SpecificationError as error:
        assert "without an end" in str(error)  # noqa: PT017 - more of them than a monitor takes
        return
    monitor.run(steps * 0.01, swing, on_violation="report")
    columns = {
        name: record(model, mujoco.MjData(model), steps, lambda d, at=places[name]: d.qpos[at])  # type: ignore[misc]
        for name in spec.variables
    }
    assert monitor.robustness == rtamt.evaluate(spec, columns, n=steps + 1)[0]


@integrators
@pytest.mark.parametrize("forward", [False, True])
def test_monitoring_does_not_change_the_run(integrator: str, forward: bool) -> None:  # noqa: FBT001
    model, data = arm(integrator)
    StepMonitor(model, data, SPECS, SIGNALS, forward=forward).run(3.0, swing, on_violation="report")
    bare = mujoco.MjData(model)
    for _ in range(300):
        swing(model, bare)
        mujoco.mj_step(model, bare)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    states = np.empty((2, mujoco.mj_stateSize(model, kind)))
    for state, each in zip(states, (data, bare), strict=True):
        mujoco.mj_getState(model, each, state, kind)
    assert np.array_equal(states[0], states[1])


@integrators
def test_what_is_derived_is_late_by_a_step_unless_it_is_derived_again(integrator: str) -> None:
    model, _ = arm(integrator)
    scratch = mujoco.MjData(model)

    def height(data: Any) -> float:
        scratch.qpos[:] = data.qpos
        mujoco.mj_kinematics(model, scratch)
        return float(scratch.site("grip").xpos[2])

    late, fresh = (
        StepMonitor(
            model,
            mujoco.MjData(model),
            "always(seen < 9 and sensed < 9)",
            {"seen": "site:grip.xpos[2]", "sensed": "sensor:where[2]"},
            forward=forward,
        )
        for forward in (False, True)
    )
    before = height(late.data)
    for _ in range(20):
        late.step()
        fresh.step()
        now = height(late.data)
        assert fresh.values == {"seen": now, "sensed": now}
        assert late.values["sensed"] == before != now
        # Under RK4, positions come from an intermediate state.
        assert (late.values["seen"] == before) == (integrator != "RK4")
        assert late.values["seen"] != now
        before = now


def test_sample_0_is_the_state_that_the_first_step_starts_from() -> None:
    model, data = arm()
    model.opt.gravity[:] = 0.0
    monitor = StepMonitor(model, data, "always(x < 1)", {"x": "qpos[0]"})
    assert monitor.samples == 0
    assert math.isnan(monitor.robustness)
    assert monitor.verdict is rtamt.Verdict.UNDECIDED
    data.qpos[0] = 0.5
    monitor.step()
    assert monitor.samples == 2
    assert monitor.upper == 0.5
    data.qpos[0] = 0.25
    monitor.reset()
    assert (monitor.samples, monitor.robustness) == (1, 0.75)


def test_a_controller_can_react_to_the_robustness() -> None:
    model, data = arm()
    model.opt.gravity[:] = 0.0
    monitor = StepMonitor(model, data, "always(x < 0.5)", {"x": "qpos[0]"})
    seen = []

    def retreat(_model: Any, data: Any) -> None:
        seen.append(monitor.robustness)
        data.ctrl[0] = 0.1 if monitor.robustness > 0.4 else -0.1

    assert monitor.run(1.0, retreat) is rtamt.Verdict.UNDECIDED
    assert len(seen) == 100
    assert seen[0] == 0.5
    assert min(seen) < 0.4
    bare = StepMonitor(model, mujoco.MjData(model), "always(x < 0.5)", {"x": "qpos[0]"})
    push = lambda _, data: data.ctrl.__setitem__(0, 0.1)  # noqa: E731
    assert bare.run(1.0, push) is rtamt.Verdict.VIOLATED


def test_a_run_stops_at_the_first_certain_violation_or_reports_it() -> None:
    text, signals = "always(z > 0.2)", {"z": "qpos[4]"}
    model, data = arm()
    monitor = StepMonitor(model, data, text, signals)
    assert monitor.run(2.0) is rtamt.Verdict.VIOLATED
    at = monitor.violated_at
    assert at == monitor.samples - 1
    assert monitor.violated_by == "spec"
    assert monitor.run(2.0) is rtamt.Verdict.VIOLATED
    assert monitor.samples == at + 1
    reporting = StepMonitor(model, mujoco.MjData(model), text, signals)
    reporting.run(2.0, on_violation="report")
    assert reporting.samples == 201
    assert reporting.violated_at == at
    assert reporting.outcomes == {
        "spec": {
            "robustness": reporting.robustness,
            "verdict": "VIOLATED",
            "satisfied": False,
            "decided_at": at,
        }
    }


@pytest.mark.parametrize(("duration", "steps"), [(0.01, 1), (0.3, 30), (0.297, 30), (0.004, 0)])
def test_a_run_makes_the_nearest_number_of_steps(duration: float, steps: int) -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "always(x < 9)", {"x": "qpos[0]"})
    monitor.run(duration)
    assert monitor.samples == steps + 1


def test_finish_makes_the_verdict_final() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "always(x < 9)", {"x": "qpos[0]"})
    monitor.run(0.1)
    assert monitor.verdict is rtamt.Verdict.UNDECIDED
    assert monitor.finish() == monitor.lower == monitor.upper == monitor.robustness > 0.0
    assert monitor.outcomes["spec"]["satisfied"] is True
    assert monitor.outcomes["spec"]["ended_at"] == 10
    assert "decided_at" not in monitor.outcomes["spec"]
    monitor.reset()
    assert monitor.verdict is rtamt.Verdict.UNDECIDED
    assert monitor.outcomes["spec"].keys().isdisjoint({"decided_at", "ended_at"})


def test_the_period_is_the_timestep() -> None:
    model, data = arm()
    monitor = StepMonitor(model, data, "eventually[0:0.05](x > 9)", {"x": "qpos[0]"})
    assert monitor.period == rtamt.EpisodeMonitor("x > 0", period=0.01).period
    monitor.run(1.0)
    assert monitor.violated_at == 5
    steps = StepMonitor(
        model, mujoco.MjData(model), "eventually[0:7](x > 9)", {"x": "qpos[0]"}, period=1
    )
    steps.run(1.0)
    assert steps.violated_at == 7


def test_the_step_view_speaks_of_every_instant() -> None:
    model, data = arm()
    text = "z < 0.25 implies eventually[0:0.05](z > 0.25)"
    online = rtamt.Monitor(text, period=0.01)
    heights = record(model, mujoco.MjData(model), 80, lambda d: d.qpos[4])
    expected = [online.update(z) for z in heights]
    monitor = StepMonitor(model, data, text, {"z": "qpos[4]"}, view="step")
    monitor.reset()
    for value in expected[1:]:
        swing(model, data)
        robustness = monitor.step()
        if not math.isnan(value):
            assert robustness == value
    assert monitor.verdict is rtamt.Verdict.VIOLATED
    assert monitor.violated_at == next(i for i, value in enumerate(expected) if value < 0)


def height(_model: Any, data: Any) -> float:
    return float(data.qpos[4])


def test_a_callable_reads_model_and_data() -> None:
    model, data = arm()
    specs = {"named": "always(z > 0.2)", "called": "always(w > 0.2)"}
    monitor = StepMonitor(model, data, specs, {"z": "qpos[4]", "w": height})
    monitor.run(2.0)
    named, called = (monitor.details[name] for name in specs)
    assert named == called
    assert monitor.violated_by == "named"


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda each: pickle.loads(pickle.dumps(each))])
@pytest.mark.parametrize("view", ["episode", "step"])
def test_a_copy_in_mid_run_continues_as_the_original(
    clone: Callable[[Any], Any], view: View
) -> None:
    model, data = arm("RK4")
    specs = {"z": "z < 0.2 implies eventually[0:0.1](z > 0.2)", "w": "w < 9"}
    if view == "episode":
        specs = {name: f"always({text})" for name, text in specs.items()}
    monitor = StepMonitor(model, data, specs, {"z": "qpos[4]", "w": height}, view=view)
    monitor.run(0.2, swing)
    twin = clone(monitor)
    assert twin.data is not data
    assert twin.samples == monitor.samples
    for _ in range(30):
        assert twin.details == monitor.details
        for each in (twin, monitor):
            swing(each.model, each.data)
            each.step()
    assert np.array_equal(twin.data.qpos, data.qpos)
    assert twin.violated_at == monitor.violated_at
