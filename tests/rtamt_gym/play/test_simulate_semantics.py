"""`semantics=` of `simulate`, `StepMonitor` and rollouts, and in their results."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from mujoco import rollout
from mujoco_models import arm

import rtamt
from rtamt.typing import SemanticsName
from rtamt_gym import StepMonitor, simulate
from rtamt_gym.mujoco import evaluate_rollouts
from rtamt_gym.results import Run, Snapshot

SEMANTICS = get_args(SemanticsName)
SPECS = {
    "granted": "always(req >= 3 implies eventually[0:2](gnt >= 3))",
    "asked": "eventually(req >= 4)",
}
ROLES: Any = {"inputs": ["req"], "outputs": ["gnt"]}
TRACE = [{"req": req, "gnt": gnt} for req, gnt in ((0, 0), (4, 0), (0, 1), (0, 0), (5, 3), (1, 6))]
COLUMNS = {name: np.array([row[name] for row in TRACE], np.float64) for name in ("req", "gnt")}


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_a_run_has_the_robustness_of_its_semantics_and_is_replayed_under_it(
    semantics: SemanticsName, tmp_path: Path
) -> None:
    run = simulate(TRACE, SPECS, period=1, stop="end", semantics=semantics, **ROLES)
    for name, text in SPECS.items():
        known: Any = {k: [n for n in v if n in text] for k, v in ROLES.items()}
        options: Any = {"semantics": semantics, **known}
        ends = [
            float(rtamt.evaluate(text, {n: c[:end] for n, c in COLUMNS.items()}, 1, **options)[0])
            for end in range(1, len(TRACE) + 1)
        ]
        assert run.histories[name].robustness.tolist() == ends
        assert run.histories[name].semantics == semantics
        assert run.replay()[name].tolist() == rtamt.evaluate(text, COLUMNS, 1, **options).tolist()
    run.save(tmp_path / "run.parquet")
    again = Run.load(tmp_path / "run.parquet")
    assert again == run
    for name, values in run.replay().items():
        assert np.array_equal(again.replay()[name], values)


def test_the_roles_of_a_run_are_those_that_its_texts_declare() -> None:
    text = """
    input float req
    output float gnt
    busy = gnt >= 3
    always(req >= 3 implies eventually[0:2](busy))
    """
    message = simulate(TRACE, text, period=1, stop="end", semantics="output-robustness")
    named = simulate(
        TRACE, SPECS["granted"], period=1, stop="end", semantics="output-robustness", **ROLES
    )
    ((_, course),) = message.histories.items()
    assert (course.inputs, course.outputs) == (("req",), ("gnt",))
    assert course.robustness.tolist() == named.histories["spec"].robustness.tolist()
    assert message.replay()["spec"][0] == course.final


def test_runs_under_different_semantics_differ() -> None:
    standard = simulate(TRACE, SPECS["asked"], stop="end")
    assert standard != simulate(
        TRACE, SPECS["asked"], stop="end", semantics="input-vacuity", **_ASKS
    )


_ASKS: Any = {"inputs": ["req"]}


def test_a_semantics_that_does_not_fit_is_refused_before_the_run() -> None:
    def never(_time: float) -> dict[str, float]:
        raise AssertionError

    with pytest.raises(rtamt.InputError) as raised:
        simulate(never, SPECS, period=1, duration=3, semantics="output-robustness", outputs=["g"])
    assert str(raised.value) == (
        "'g' in outputs is not a variable of a specification; the specifications read 'gnt', 'req'"
    )


SIGNALS = {"angle": "joint:shoulder.qpos", "rate": "joint:shoulder.qvel"}
ARM = "always(rate > 0.1 implies eventually[0:0.02](angle > 0.05))"


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_a_step_monitor_judges_under_its_semantics(semantics: SemanticsName) -> None:
    model, data = arm("Euler")
    options: Any = {"semantics": semantics, "inputs": ["rate"], "outputs": ["angle"]}
    monitor = StepMonitor(model, data, ARM, SIGNALS, **options)
    twin = rtamt.EpisodeMonitor(ARM, float(model.opt.timestep), **options)
    data.qvel[:] = 1.0
    monitor.reset()
    for _ in range(40):
        twin.update(**monitor.values)
        assert (monitor.robustness, monitor.lower, monitor.upper) == (
            *(twin.robustness, twin.lower, twin.upper),
        )
        assert monitor.details["spec"]["verdict"] == twin.verdict.name
        monitor.step()


def test_a_snapshot_of_another_semantics_is_refused() -> None:
    model, data = arm("Euler")
    options: Any = {"inputs": ["rate"], "outputs": ["angle"]}
    first, second = (
        StepMonitor(model, data, ARM, SIGNALS, semantics=semantics, **options)
        for semantics in ("output-robustness", "standard")
    )
    first.reset()
    second.reset()
    with pytest.raises(rtamt.InputError) as refused:
        Snapshot.of(first).restore(second)
    formula = str(rtamt.parse(ARM))
    assert str(refused.value) == (
        f"expected a state of the specifications {{'spec': '{formula}'}}, got a state of "
        f"{{'spec': '{formula} under output-robustness, input rate, output angle'}}"
    )


@pytest.mark.parametrize("semantics", SEMANTICS)
def test_rollouts_are_evaluated_under_their_semantics(semantics: SemanticsName) -> None:
    model, data = arm("Euler")
    start = np.zeros((2, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    start[:, 1:3] = [[0.2, 0.1], [-0.2, 0.3]]
    states, _ = rollout.rollout(model, data, start, nstep=30)
    specs = {"one": ARM, "two": "always(angle > 0.1)"}
    options: Any = {"semantics": semantics, "inputs": ["rate"], "outputs": ["angle"]}
    result = evaluate_rollouts(model, specs, SIGNALS, states, **options)
    plain = evaluate_rollouts(
        model, {"a": "always(angle > -9)", "r": "always(rate > -9)"}, SIGNALS, states
    )
    assert set(plain) == {"a", "r"}
    place = model.joint("shoulder").qposadr[0], model.nq + model.joint("shoulder").dofadr[0]
    columns = {"angle": states[:, :, 1 + place[0]], "rate": states[:, :, 1 + place[1]]}
    period = float(model.opt.timestep)
    expected = rtamt.evaluate(ARM, columns, period, **options)
    assert np.array_equal(result["one"], expected)
    options["inputs"] = []
    expected = rtamt.evaluate(specs["two"], columns, period, **options)
    assert np.array_equal(result["two"], expected)
