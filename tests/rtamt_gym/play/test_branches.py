"""Runs of a `StepMonitor` from its current state, and branches from snapshots."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from mujoco_models import BOXES, BOXES_SIGNALS, BOXES_SPECS, arm

from rtamt import InputError, InputTypeError, StateError
from rtamt_gym import StepMonitor, simulate
from rtamt_gym.options.evaluation import View
from rtamt_gym.play.history import Stop
from rtamt_gym.results import Run, Snapshot

SIGNALS: dict[str, Any] = {
    **BOXES_SIGNALS,
    "rod": "joint:rod.qpos",  # no specification reads it
    "clock": lambda _model, data: data.time,
}
FULL = mujoco.mjtState.mjSTATE_INTEGRATION


def monitored(
    integrator: str = "Euler", view: View = "episode", *, forward: bool = False
) -> StepMonitor:
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator=integrator))
    return StepMonitor(
        model, mujoco.MjData(model), BOXES_SPECS, SIGNALS, view=view, forward=forward
    )


def pushes(model: Any, data: Any) -> None:  # noqa: ANN401
    """A policy that also reads late values."""
    data.ctrl[0] = 0.7 + 0.3 * np.sin(40 * data.time) + data.sensordata[0] + 0 * model.nq


def harder(model: Any, data: Any) -> None:  # noqa: ANN401
    pushes(model, data)
    data.ctrl[0] += 5


def all_of(monitor: StepMonitor) -> Any:  # noqa: ANN401
    """Return all results of a monitor and its simulation, also values derived by MuJoCo."""
    data = monitor.data
    state = np.empty(mujoco.mj_stateSize(monitor.model, FULL))
    mujoco.mj_getState(monitor.model, data, state, FULL)
    derived = [data.qacc, data.xpos, data.sensordata, data.qfrc_constraint, data.actuator_force]
    return (
        state.tolist(),
        [array.tolist() for array in derived],
        data.contact.dist.tolist(),
        monitor.values,
        pickle.dumps(monitor.state()[0]),
        (monitor.details, monitor.outcomes, monitor.samples),
        (monitor.violated_by, monitor.violated_at),
    )


def by_hand(monitor: StepMonitor, steps: int, policy: Any) -> list[Any]:  # noqa: ANN401
    """Return the expected results of a run: values, robustness and bounds at each sample."""
    shown = []
    for step in range(steps + 1):
        if step:
            policy(monitor.model, monitor.data)
            monitor.step()
        curves = [(s["robustness"], s["lower"], s["upper"]) for s in monitor.details.values()]
        shown.append(([*monitor.values.values()], curves))
    return shown


def rows(run: Run) -> list[Any]:
    """Return the same from a run."""
    values = np.array(list(run.signals.values())).T.tolist()
    curves = [zip(c.robustness, c.lower, c.upper, strict=True) for c in run.histories.values()]
    return [(v, list(c)) for v, c in zip(values, zip(*curves, strict=True), strict=True)]


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("view", ["episode", "step"])
@pytest.mark.parametrize("forward", [False, True])
def test_a_run_goes_on_as_the_loop_of_the_monitor_does(
    integrator: str,
    view: View,
    forward: bool,  # noqa: FBT001
) -> None:
    looped, ran = (monitored(integrator, view, forward=forward) for _ in range(2))
    for monitor in (looped, ran):
        monitor.run(0.3, pushes)
    begun = ran.samples
    expected = by_hand(looped, 60, pushes)
    run = simulate(ran, policy=pushes, duration=0.3, stop="end", label="pushed")
    assert rows(run) == expected
    assert all_of(ran) == all_of(looped)
    assert list(run.signals) == list(SIGNALS)
    assert (run.first_sample, run.last_sample) == (begun - 1, begun + 59)
    assert run.times.tolist() == pytest.approx([(begun - 1 + i) / 200 for i in range(61)])
    assert run.violated_by == looped.violated_by
    assert run.violated_at == looped.violated_at
    for name, course in run.histories.items():
        assert course.decided_at == looped.outcomes[name].get("decided_at")
        assert course.final == looped.outcomes[name]["robustness"]
    assert (run.system, run.view, run.label, run.limit) == ("boxes", view, "pushed", 60)
    assert by_hand(ran, 9, harder) == by_hand(looped, 9, harder)  # both continue


def test_a_monitor_that_has_no_sample_begins_with_sample_0() -> None:
    looped, ran = monitored(), monitored()
    looped.reset()
    expected = by_hand(looped, 40, pushes)
    run = simulate(ran, policy=pushes, duration=0.2)
    assert (rows(run), run.first_sample) == (expected, 0)
    assert simulate(monitored(), duration=0.1).times[0] == 0.0
    assert float(run.replay()["stands"][0]) == run.histories["stands"].final


@pytest.mark.parametrize("stop", ["violation", "decided", "end"])
def test_a_run_stops_as_others_do(stop: Any) -> None:  # noqa: ANN401
    whole = simulate(monitored(), policy=harder, duration=2, stop=stop)
    assert whole.violated_by is not None
    monitor = monitored()
    monitor.run(0.2, harder)
    run = simulate(monitor, policy=harder, duration=1.8, stop=stop)
    assert (run.ended, run.last_sample) == (whole.ended, whole.last_sample)
    assert monitor.samples == whole.last_sample + 1
    # A run that is over at its start shows its state.
    again = simulate(monitor, policy=harder, duration=1.8, stop=stop)
    assert (again.steps == 0) == (stop != "end")


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("forward", [False, True])
def test_a_branch_leaves_monitor_and_simulation_as_they_were(
    integrator: str,
    forward: bool,  # noqa: FBT001
) -> None:
    trunk, alone = (monitored(integrator, forward=forward) for _ in range(2))
    trunk.run(0.2, pushes)
    now = Snapshot.of(trunk)
    trunk.run(0.1, pushes)
    alone.run(0.3, pushes)
    before = all_of(trunk)
    branches = [simulate(trunk, start=now, policy=p, duration=0.2) for p in (pushes, harder) * 2]
    assert branches[0] == branches[2] != branches[1] == branches[3]
    assert branches[0].first_sample == 40
    assert all_of(trunk) == before
    assert by_hand(trunk, 20, pushes) == by_hand(alone, 20, pushes)


def test_a_branch_begins_with_the_values_of_the_snapshot() -> None:
    trunk = monitored()
    trunk.run(0.3, pushes)
    values, now = trunk.values, Snapshot.of(trunk)
    trunk.run(0.2, pushes)
    run = simulate(trunk, start=pickle.loads(pickle.dumps(now)), duration=0.1)
    assert {name: curve[0] for name, curve in run.signals.items()} == values
    assert simulate(monitored(), start=now, duration=0.1) == run


def test_a_branch_from_before_sample_0_is_a_whole_run() -> None:
    monitor = monitored()
    now = Snapshot.of(monitor)
    monitor.run(0.1, pushes)
    run = simulate(monitor, start=now, policy=pushes, duration=0.1)
    assert (run.first_sample, run.steps, monitor.samples) == (0, 20, 21)
    assert run.histories["stands"].final == monitor.outcomes["stands"]["robustness"]


def test_a_policy_may_look_ahead_in_branches_of_branches() -> None:
    def least(run: Run) -> float:
        return min(float(course.upper[-1]) for course in run.histories.values())

    def looks_ahead(depth: int) -> Any:  # noqa: ANN401
        def act(_model: Any, data: Any) -> None:  # noqa: ANN401
            pushes(_model, data)
            if depth and round(data.time / 0.005) % 10 == 0:
                futures = [
                    least(simulate(seen, start=now, policy=looks_ahead(depth - 1), duration=0.08))
                    for now in [Snapshot.of(seen)]
                    for _ in range(2)
                ]
                assert futures[0] == futures[1]

        return act

    plain, seen = monitored(), monitored()
    expected = simulate(plain, policy=pushes, duration=0.2)
    assert simulate(seen, policy=looks_ahead(2), duration=0.2) == expected
    assert all_of(seen) == all_of(plain)


def test_an_error_in_a_branch_changes_nothing_and_carries_the_branch() -> None:
    monitor = monitored()
    monitor.run(0.2, pushes)
    now, before = Snapshot.of(monitor), all_of(monitor)

    def fail(model: Any, data: Any) -> None:  # noqa: ANN401
        pushes(model, data)
        if data.time > 0.25:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as crashed:
        simulate(monitor, start=now, policy=fail, duration=1)
    run: Run = crashed.value.run  # type: ignore[attr-defined]
    assert all_of(monitor) == before
    cut = simulate(monitor, start=now, policy=pushes, duration=run.steps * 0.005)
    assert (run.ended, run.first_sample, rows(run)) == ("error", 40, rows(cut))
    assert (run.histories, crashed.value.__notes__) == (
        cut.histories,
        ["error.run holds 11 samples, up to 0.25 s"],
    )
    # A monitor after a run is at the last sample, and can continue.
    with pytest.raises(ZeroDivisionError):
        simulate(monitor, policy=fail, duration=1)
    assert monitor.samples == 51
    assert monitor.step() == monitor.robustness


def test_a_signal_is_read_once_for_a_sample() -> None:
    calls = []
    model = mujoco.MjModel.from_xml_string(BOXES.format(integrator="Euler"))

    def greatest(_model: Any, data: Any) -> float:  # noqa: ANN401
        calls.append(float(data.time))
        return len(calls)

    monitor = StepMonitor(model, mujoco.MjData(model), "always(n < 99)", {"n": greatest})
    run = simulate(monitor, duration=0.05)
    assert run.signals["n"].tolist() == list(range(1, 12))


@pytest.mark.slow
def test_a_branch_is_saved_loaded_drawn_and_replayed_under_other_specifications(
    tmp_path: Path,
) -> None:
    monitor = monitored()
    monitor.run(0.2, pushes)
    run = simulate(monitor, policy=harder, duration=0.4)
    run.save(tmp_path / "run.parquet")
    assert Run.load(tmp_path / "run.parquet") == run
    run.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    assert run.replay("always(z > 0.25)")["spec"][0] == run.signals["z"].min() - 0.25
    with pytest.raises(InputError) as refused:
        run.replay()
    assert str(refused.value) == (
        "expected the samples of a whole episode, got the samples from 40 on; replay(specs) "
        "takes sample 40 for the start of an episode"
    )
    assert repr(run) == "<Run of boxes: violation of calm at 0.59 s, 79 samples>"


def test_what_a_monitor_has_of_its_own_is_refused() -> None:
    monitor = monitored()
    given: dict[str, Any] = {"specs": "always(z > 0)", "signals": {"z": "qpos[0]"}}
    for name, value in given.items():
        with pytest.raises(InputError) as refused:
            simulate(monitor, duration=1, **{name: value})
        assert str(refused.value) == (
            f"{name}= is for systems without a monitor, got {name}={value!r} for a StepMonitor, "
            "which has its own; give it to StepMonitor(...)"
        )
    other = {
        "period": (0.1, "0.005"),
        "view": ("step", "'episode'"),
        "nan": ("hold", "'raise'"),
        "align": ("nearest", "None"),
        "semantics": ("boolean", "'standard'"),
        "inputs": (("z",), "None"),
        "outputs": (("z",), "None"),
    }
    for name, (value, has) in other.items():
        with pytest.raises(InputError) as refused:
            simulate(monitor, duration=1, **{name: value})  # type: ignore[arg-type]  # any of them
        assert str(refused.value) == (
            f"{name}= comes from the StepMonitor, which has {has}, got {value!r}; leave it out"
        )
    assert monitor.samples == 0


def test_old_mujoco_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monitor = monitored()
    monitor.run(0.1)
    values = monitor.data.qpos.tolist()
    now = Snapshot.of(monitor)
    monkeypatch.delattr(mujoco, "mj_copyData")
    monkeypatch.setattr(mujoco, "__version__", "3.3.0")
    message = (
        "cases and branches of a MuJoCo model need MuJoCo 3.5 or newer, got 3.3.0; install it: "
        "pip install 'mujoco>=3.5'"
    )
    with pytest.raises(InputError) as branch:
        simulate(monitor, start=now, duration=0.1)
    assert str(branch.value) == message
    assert monitor.data.qpos.tolist() == values
    model = monitor.model, mujoco.MjData(monitor.model)
    with pytest.raises(InputError) as case:
        simulate(model, "always(z > -9)", {"z": "qpos[0]"}, duration=0.1, case={"qpos[0]": 0.1})
    assert str(case.value) == message


def test_what_cannot_begin_is_refused() -> None:
    monitor = monitored()
    monitor.run(0.1)
    now = Snapshot.of(monitor)
    other = StepMonitor(monitor.model, copy.copy(monitor.data), "always(z > 0)", {"z": "qpos[9]"})
    cases: list[tuple[Any, dict[str, Any], type[Exception], str]] = [
        (
            now,
            {"duration": 1},
            InputTypeError,
            (
                "expected a system to run, got a Snapshot, which holds no model; "
                "write simulate(monitor, start=snapshot)"
            ),
        ),
        (
            monitor,
            {"specs": now, "duration": 1},
            InputTypeError,
            (
                "expected a snapshot as start=, got it as specs; "
                "write simulate(monitor, start=snapshot)"
            ),
        ),
        (
            monitor,
            {"start": monitor.state(), "duration": 1},
            InputTypeError,
            "expected start= as a Snapshot, got ((",
        ),
        (
            (monitor.model, monitor.data),
            {"start": now, "specs": "always(z > 0)", "duration": 1},
            InputError,
            "start= is for a StepMonitor, got start=<Snapshot with 81 numbers of state> for (<",
        ),
        (
            other,
            {"start": now, "duration": 1},
            InputError,
            "expected a state of the specifications {'spec': ",
        ),
        (
            monitor,
            {},
            InputError,
            "boxes does not end by itself; give duration= in seconds, or duration=math.inf to",
        ),
        (
            monitor,
            {"seed": 1, "duration": 1},
            InputError,
            "seed= is for environments, got seed=1 for <StepMonitor of stands, calm, touches, ",
        ),
        (
            monitor,
            {"policy": 0.5, "duration": 1},
            InputTypeError,
            "expected a policy, a function of model and data that sets data.ctrl, got 0.5",
        ),
        (
            [{"x": 1.0}],
            {},
            InputTypeError,
            (
                "expected specifications for samples, got none; "
                'write simulate(system, "always(x < 1)", ...)'
            ),
        ),
    ]
    before = all_of(monitor)
    for system, named, error, message in cases:
        with pytest.raises(error) as refused:
            simulate(system, **named)
        assert str(refused.value).startswith(message)
    assert all_of(monitor) == before
    moved = monitored()
    moved.run(0.1)
    mujoco.mj_resetData(moved.model, moved.data)
    with pytest.raises(StateError, match=r"time 0\.1 s at sample 20, got 0 s: ") as lost:
        simulate(moved, duration=1)
    assert not hasattr(lost.value, "run")
    monitor.finish()
    with pytest.raises(StateError, match="expected a running simulation, got step"):
        simulate(monitor, duration=1)


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
