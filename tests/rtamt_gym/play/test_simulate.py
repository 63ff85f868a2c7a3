"""`simulate`: the systems that it runs, when it stops, and its agreement with monitors."""

import itertools
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from environments import CASES, Case
from hypothesis import given
from hypothesis import strategies as st
from strategies import INFINITIES, Trace, formulas, length, sample, traces

import rtamt
from rtamt import EpisodeMonitor, Formula, InputError, Monitor, Verdict
from rtamt_gym import StepMonitor, StlMonitor, simulate
from rtamt_gym.options.evaluation import View
from rtamt_gym.play.history import Stop
from rtamt_gym.results import Run
from rtamt_gym.systems.system import SystemEnd

INF = math.inf
PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.01" integrator="RK4"/>
  <worldbody>
    <body name="pole" pos="0 0 1">
      <joint name="hinge" type="hinge" axis="0 1 0"/>
      <geom name="rod" type="capsule" size=".02" fromto="0 0 0 0 0 .6"/>
      <site name="tip" pos="0 0 .6"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
</mujoco>
"""


def samples(trace: Trace) -> Iterator[dict[str, float]]:
    return (sample(trace, i) for i in range(length(trace)))


def pendulum(angle: float = 0.1) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    return model, data


# What is recorded. -------------------------------------------------------------------------------


@given(formula=formulas(depth=2, endless=True), trace=traces(values=INFINITIES))
def test_a_run_says_what_an_episode_monitor_says(formula: Formula, trace: Trace) -> None:
    if not rtamt.Specification.of(formula).looks_ahead:
        formula = formula.always()
    monitor = EpisodeMonitor(formula)
    message = []
    try:
        for item in samples(trace):
            monitor.update({name: item[name] for name in monitor.variables})
            message.append((monitor.robustness, monitor.lower, monitor.upper))
    except rtamt.InputError:  # a difference of infinities
        return
    run = simulate(samples(trace), formula, stop="end", period=1)
    (course,) = run.histories.values()
    monitor.finish()
    message[-1] = (monitor.robustness, monitor.lower, monitor.upper)
    assert list(zip(course.robustness, course.lower, course.upper, strict=True)) == message
    assert (course.final, course.verdict) == (monitor.robustness, monitor.verdict)
    signs = [(math.copysign(1.0, low), math.copysign(1.0, high)) for _, low, high in message]
    assert course.verdicts.tolist() == [(low > 0) - (high < 0) for low, high in signs]
    assert (run.ended, run.steps) == ("terminated", length(trace) - 1)
    assert {name: values.tolist() for name, values in run.signals.items()} == {
        name: trace[name] for name in monitor.variables
    }


@given(
    formula=formulas(depth=2, endless=True),
    trace=traces(),
    stop=st.sampled_from(("violation", "decided", "end")),
)
def test_what_was_monitored_equals_what_is_evaluated_offline(
    formula: Formula, trace: Trace, stop: Stop
) -> None:
    run = simulate(samples(trace), formula.always(), stop=stop, period=1)
    (course,) = run.histories.values()
    for n in range(1, run.steps + 2):
        prefix = {name: values[:n] for name, values in run.signals.items()}
        offline = rtamt.evaluate(course.formula, prefix, run.period, n=n)
        assert offline[0] == course.robustness[n - 1]
    ((offline),) = run.replay().values()
    assert offline[0] == course.final


@given(formula=formulas(depth=2), trace=traces())
def test_the_view_of_every_step_equals_evaluation_without_its_latency(
    formula: Formula, trace: Trace
) -> None:
    run = simulate(samples(trace), formula, stop="end", view="step", period=1)
    ((name, course),) = run.histories.items()
    latency = Monitor(formula).latency
    known = max(0, run.steps + 1 - latency)
    assert run.replay()[name][:known].tolist() == course.robustness[latency:].tolist()


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.env_id)
@pytest.mark.parametrize("view", ["episode", "step"])
def test_a_run_of_an_environment_is_what_the_wrapper_sees(case: Case, view: View) -> None:
    env = case.bare()
    actions = [env.action_space.sample() for _ in range(12)]
    acting = iter(actions)
    run = simulate(
        env,
        case.specs,
        case.signals,
        policy=lambda _obs: next(acting),
        seed=3,
        duration=12 * float(StlMonitor(env, case.specs, case.signals).period or 1),
        stop="end",
        view=view,
        at_termination="complete",
        at_truncation="open",
    )
    wrapped = case.monitored(
        details=True,
        on_violation="report",
        view=view,
        at_termination="complete",
        at_truncation="open",
    )
    _, info = wrapped.reset(seed=3)
    message = [info["stl"]]
    over = False
    for action in actions:
        if not over:
            _, _, terminated, truncated, info = wrapped.step(action)
            message.append(info["stl"])
            over = terminated or truncated
    for name, course in run.histories.items():
        for curve in ("robustness", "lower", "upper"):
            assert getattr(course, curve).tolist() == [item[name][curve] for item in message]
        assert course.verdict.name == message[-1][name]["verdict"]
    if view == "episode":
        for name, offline in run.replay().items():
            assert offline[0] == run.histories[name].final


@pytest.mark.parametrize("read", ["qpos[0]", "sensor:angle", "site:tip.xpos[0]"])
def test_a_run_of_a_model_is_what_the_step_monitor_sees(read: str) -> None:
    model, data = pendulum()
    spec, signals = "always[0:2](x < 0.5)", {"x": read}

    def push(model: Any, data: Any) -> None:  # noqa: ANN401
        assert model.nu == 1
        data.ctrl[0] = -0.1 * data.qpos[0]

    run = simulate((model, data), spec, signals, policy=push, duration=1.0, stop="end")
    twin = pendulum()
    monitor = StepMonitor(*twin, spec, signals, forward=True)
    monitor.reset()
    message = [(monitor.values["x"], monitor.robustness)]
    for _ in range(100):
        push(*twin)
        robustness = monitor.step()
        message.append((monitor.values["x"], robustness))
    assert list(zip(run.signals["x"], run.histories["spec"].robustness, strict=True)) == message
    assert (run.system, run.period, run.duration) == ("pendulum", monitor.period, 1.0)
    assert np.array_equal(data.qpos, twin[1].qpos)


def test_a_model_is_sampled_every_period() -> None:
    every = simulate(pendulum(), "always(x < 9)", {"x": "qpos[0]"}, duration=1)
    fifth = simulate(pendulum(), "always(x < 9)", {"x": "qpos[0]"}, duration=1, period="50ms")
    assert fifth.signals["x"].tolist() == every.signals["x"][::5].tolist()
    assert (every.steps, fifth.steps) == (100, 20)


def test_a_function_is_called_at_the_times_of_the_samples() -> None:
    called = []

    def ramp(t: float) -> dict[str, float]:
        called.append(t)
        return {"x": 2 * t, "unused": "?"}  # type: ignore[dict-item]

    run = simulate(ramp, "always(x < 5)", period=0.1, duration=1)
    assert called == [i / 10 for i in range(11)] == run.times.tolist()
    assert run.signals["x"].tolist() == [2 * t for t in called]
    assert (run.system, run.ended, run.duration) == ("ramp", "duration", 1.0)


def test_a_function_that_gives_nothing_has_ended() -> None:
    run = simulate(lambda t: {"x": 1} if t < 3 else None, "always(x > 0)", period=1, duration=INF)
    assert (run.ended, run.steps, run.verdict) == ("terminated", 2, Verdict.SATISFIED)


def test_variables_read_what_signals_say_and_else_their_own_name() -> None:
    rows = [{"level of tank": 3, "x": 2}, {"level of tank": 4, "x": True}]
    run = simulate(rows, "always(level > x)", {"level": "level of tank"})
    assert {name: values.tolist() for name, values in run.signals.items()} == {
        "level": [3.0, 4.0],
        "x": [2.0, 1.0],
    }


def test_a_generator_is_closed_when_the_run_stops() -> None:
    closed = []

    def counting() -> Iterator[dict[str, float]]:
        try:
            for i in itertools.count():
                yield {"x": float(i)}
        finally:
            closed.append(True)

    assert simulate(counting(), "always(x < 3)").steps == 3
    assert closed == [True]


def test_a_generator_function_begins_anew_with_every_run() -> None:
    def counting() -> Iterator[dict[str, float]]:
        return (yield from ({"x": float(i)} for i in range(3)))

    first = simulate(counting, "always(x < 9)")
    assert first == simulate(counting, "always(x < 9)")
    assert (first.system, first.ended, first.steps) == ("counting", "terminated", 2)


class Countdown:
    """A user's own system."""

    name, period, needs_period, limit, endless = "countdown", 0.5, True, 9, False
    ended: SystemEnd = ""
    closed = 0

    def bind(self, variables: Any, signals: Any, period: Any) -> None:  # noqa: ANN401
        self.bound = (list(variables), signals, period)

    def start(self) -> list[float]:
        self.left, self.ended = 3.0, ""
        return [self.left]

    def advance(self) -> list[float]:
        self.left -= 1.0
        self.ended = "" if self.left else "truncated"
        return [self.left]

    def close(self) -> None:
        self.closed += 1


def test_a_system_of_ones_own_is_run_and_closed() -> None:
    system = Countdown()
    run = simulate(system, "always(x > -1)", {"x": "left"})
    assert system.bound == (["x"], {"x": "left"}, Fraction(1, 2))
    assert run.signals["x"].tolist() == [3.0, 2.0, 1.0, 0.0]
    assert (run.ended, run.limit, run.duration, system.closed) == ("truncated", 9, 1.5, 1)
    with pytest.raises(InputError):
        simulate(system, "always(sqrt(x - 2) >= 0)")
    assert system.closed == 2


def test_a_unit_of_the_specification_is_that_of_its_replay() -> None:
    spec = rtamt.parse("always(x < 3 implies eventually[0:20](x > 2))", unit="ms")
    rows = [{"x": x} for x in (0.0, 0.0, 3.0, 3.0)]
    run = simulate(rows, spec, period="10ms", stop="end")
    assert run.replay()["spec"][0] == run.histories["spec"].final == 1.0


def test_a_formula_without_variables_is_run_too() -> None:
    run = simulate([{}, {}, {}], "always(1 < 2)", stop="end")
    assert (run.steps, run.signals, run.replay()["spec"].tolist()) == (2, {}, [1.0, 1.0, 1.0])


def test_a_signal_that_is_nan_can_be_held_and_is_recorded_as_held() -> None:
    rows = [{"x": x, "y": 1.0} for x in (2.0, math.nan, math.nan, 1.0)]
    run = simulate(rows, "always(x > y)", nan="hold", stop="end")
    assert run.signals["x"].tolist() == [2.0, 2.0, 2.0, 1.0]
    assert run.replay()["spec"][0] == run.histories["spec"].final


# When it stops. ----------------------------------------------------------------------------------

SPECS = {"low": "always(x < 3)", "soon": "eventually[0:4](x > 1)"}


@pytest.mark.parametrize(
    ("values", "stop", "ended", "steps"),
    [
        ((0, 2, 5, 1, 1, 1), "violation", "violation", 2),
        ((0, 2, 5, 1, 1, 1), "decided", "violation", 2),
        ((0, 2, 5, 1, 1, 1), "end", "terminated", 5),
        ((0, 0, 0, 0, 0, 0), "violation", "violation", 4),
        ((0, 2, 2, 1, 1, 1), "violation", "terminated", 5),
    ],
)
def test_a_run_stops_at_the_first_certain_violation(
    values: tuple[float, ...], stop: Stop, ended: str, steps: int
) -> None:
    run = simulate([{"x": x} for x in values], SPECS, stop=stop, period=1)
    assert (run.ended, run.steps) == (ended, steps)


def test_a_run_can_stop_as_soon_as_all_is_decided() -> None:
    specs = {"first": "eventually(x > 1)", "soon": "eventually[0:4](x > 2)"}
    values = [{"x": x} for x in (0, 2, 2, 3, 0, 0)]
    run = simulate(values, specs, stop="decided", period="100ms", duration=0.5)
    assert (run.ended, run.steps, run.verdict) == ("decided", 3, Verdict.SATISFIED)
    assert (run.violated_by, run.saved) == (None, 2)
    assert [course.decided_at for course in run.histories.values()] == [1, 3]


def test_an_environment_without_its_time_limit_runs_on() -> None:
    env = gym.make("Pendulum-v1", max_episode_steps=5).unwrapped
    run = simulate(
        env, "always(v < 99)", {"v": "obs[2]"}, policy=lambda _: [0.0], seed=0, duration=1
    )
    assert (run.ended, run.steps) == ("duration", 20)


@given(trace=traces())
def test_a_stopped_run_is_the_beginning_of_the_whole_run(trace: Trace) -> None:
    specs = {"one": "always(a > -2)", "two": "always(b > -3 or c > 1)"}
    whole = simulate(samples(trace), specs, stop="end")
    run = simulate(samples(trace), specs)
    assert run.violated_by == whole.violated_by
    n = run.steps + 1
    for name, course in run.histories.items():
        if run.ended == "violation":
            assert course.robustness.tolist() == whole.histories[name].robustness[:n].tolist()
            assert course.upper.tolist() == whole.histories[name].upper[:n].tolist()
        else:
            assert course == whole.histories[name]


def test_a_run_is_repeated_by_its_seed() -> None:
    def run(seed: int) -> Run:
        return simulate(
            gym.make("CartPole-v1"),
            "always(abs(angle) < 0.1)",
            {"angle": "obs[2]"},
            policy=lambda _obs: 0,
            seed=seed,
        )

    first = run(4)
    assert first == run(4) != run(5)
    assert repr(first) == "<Run of CartPole-v1: violation of spec at 0.1 s, 6 samples>"


@pytest.mark.parametrize(("duration", "steps"), [(0.3, 3), (0.35, 3), (1 / 3, 3)])
def test_a_duration_is_cut_to_whole_periods(duration: float, steps: int) -> None:
    run = simulate(lambda t: {"x": t}, "always(x < 9)", period=0.1, duration=duration)
    assert run.steps == steps


def test_signals_that_no_specification_reads_are_recorded() -> None:
    rows = [{"x": float(i), "y": 10.0 * i, "z": math.nan if i == 2 else 1.0} for i in range(4)]
    signals = {"height": "y", "gap": "z"}
    run = simulate(rows, "always(x < 9)", signals)
    assert {name: list(values) for name, values in run.signals.items() if name != "gap"} == {
        "x": [0.0, 1.0, 2.0, 3.0],
        "height": [0.0, 10.0, 20.0, 30.0],
    }
    assert np.isnan(run.signals["gap"]).tolist() == [False, False, True, False]
    assert run == simulate(rows, "always(x < 9)", signals)
    held = simulate(rows, "always(x < 9)", signals, nan="hold")
    assert held.signals["gap"].tolist() == [1.0] * 4
    alone = simulate(rows, "always(x < 9)")
    assert run.histories == alone.histories
    assert run.replay({"spec": "always(height < 9)"})["spec"][0] == -21.0


def test_an_environment_and_a_model_record_what_is_beside() -> None:
    env = gym.make("CartPole-v1")
    signals = {"x": "obs[0]", "speed": "obs[1]", "push": ("action", -1.0)}
    run = simulate(env, "always(abs(x) < 1)", signals, policy=lambda _: 1, seed=0)
    assert list(run.signals) == ["x", "speed", "push"]
    assert run.signals["push"].tolist() == [-1.0] + [1.0] * run.steps
    assert (np.diff(run.signals["speed"]) > 0).all()
    model = mujoco.MjModel.from_xml_path("examples/models/cart.xml")
    pair = model, mujoco.MjData(model)
    names = {"angle": "joint:hinge.qpos", "now": "time"}
    ran = simulate(pair, "always(abs(angle) < 9)", names, duration=0.1)
    np.testing.assert_allclose(ran.signals["now"], ran.times, atol=1e-12)
