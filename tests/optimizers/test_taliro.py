"""psy-taliro searches our systems, and our searches run its models, with the same bits."""

import math
from typing import Any

import numpy as np
import pytest
import staliro
from hypothesis import given, settings
from hypothesis import strategies as st
from staliro.optimizers import DualAnnealing, Sample, UniformRandom
from staliro.signals import (
    Interval,
    SignalInput,
    harmonic,
    pchip,
    piecewise_constant,
    piecewise_linear,
)
from staliro.specifications import rtamt as theirs

import rtamt
from rtamt_gym import Case, Parameter, Runner, Signal, Waveform, falsify, simulate
from rtamt_gym.results import Run
from rtamt_gym.search.falsification.taliro import TaliroProblem, TaliroSystem

PERIOD = 0.25
FACTORIES = {"hold": piecewise_constant, "linear": piecewise_linear, "pchip": pchip}


@staliro.model  # type: ignore[untyped-decorator]  # it has no types here
def cart(inputs: staliro.Inputs[Sample]) -> staliro.Trace[list[float]]:
    """A cart that is pushed: its position and its speed, four times a second for four seconds."""
    at, speed = inputs.static["at"], 0.0
    states = {}
    for step in range(17):
        time = PERIOD * step
        states[time] = [at, speed]
        at += PERIOD * speed
        if "push" in inputs.signals and time <= 3.0:
            speed += PERIOD * inputs.signals["push"].at_time(time)
    return staliro.Trace(states)


COLUMNS = {"at": 0, "speed": 1}
NEAR = "always[0:4](at < 9 or speed < 1)"


def options(**signals: Any) -> staliro.TestOptions:  # noqa: ANN401
    return staliro.TestOptions(
        tspan=(0.0, 4.0),
        static_inputs={"at": (0.0, 5.0)},
        signals=signals,
        iterations=60,
        seed=5,
    )


def push(points: Any, kind: str) -> SignalInput:  # noqa: ANN401
    return SignalInput(control_points=points, factory=FACTORIES[kind])


@pytest.mark.parametrize("kind", FACTORIES)
@pytest.mark.parametrize(
    "points",
    [
        [(-2, 2)] * 4,
        {0: (-2, 2), 1: (-2, 2), 2: (-2, 2), 3: (-2, 2)},
        {0: (-2, 2), 0.5: (-2, 2), 4: (-2, 2)},
        [(-2, 2), (0, 2), (1, 2), (1, 3)],
    ],
)
@settings(max_examples=8)
@given(data=st.data())
def test_a_model_gives_what_it_gives_to_psy_taliro(points: Any, kind: str, data: Any) -> None:  # noqa: ANN401
    given_ = options(push=push(points, kind))
    system = TaliroSystem(cart, given_, period=PERIOD, columns=COLUMNS)
    coordinates = data.draw(
        st.lists(st.floats(0, 1), min_size=1 + len(points), max_size=1 + len(points))
    )
    assert system.space.dimension == len(coordinates)
    case = system.space.case(coordinates)
    values = [
        interval.start + share * (interval.end - interval.start)
        for interval, share in zip(given_.intervals(), coordinates, strict=True)
    ]
    assert [*case.columns().values()] == pytest.approx(values, abs=1e-12)
    inputs = given_.parse_sample(Sample([*case.columns().values()]))
    trace = cart.simulate(inputs).value
    run = simulate(system, NEAR, case=case, stop="end")
    assert np.array_equal([run.signals["at"], run.signals["speed"]], np.array([*trace.states]).T)
    assert run.times.tolist() == [*trace.times]
    cost = theirs.parse_discrete(NEAR, COLUMNS).evaluate(trace).value
    assert run.histories["spec"].final == cost


def test_even_points_of_one_range_are_a_signal_and_others_are_parameters() -> None:
    def entries(given_: SignalInput) -> list[Any]:
        return [*TaliroSystem(cart, options(push=given_), period=PERIOD).space][1:]

    even = [Interval(-2.0, 2.0)] * 4
    held = Signal("push", -2, 2, points=4, duration=4)
    joined = Signal("push", -2, 2, points=4, interpolation="pchip", duration=3)
    assert entries(push(even, "hold")) == [held]
    assert entries(push(even, "pchip")) == [joined]
    assert entries(push({0: (0, 1), 1: (0, 1), 4: (0, 1)}, "hold")) == [
        Parameter(f"push[{i}]", 0, 1) for i in range(3)
    ]
    waves = SignalInput(control_points=[(0, 1)] * 4, factory=harmonic)
    assert entries(waves) == [Parameter(f"push[{i}]", 0, 1) for i in range(4)]


@pytest.mark.parametrize("kind", FACTORIES)
def test_our_search_finds_and_reduces_a_violation_of_a_model(kind: str) -> None:
    given_ = options(push=push([(-2, 2)] * 4, kind))
    system = TaliroSystem(cart, given_, period=PERIOD, columns=COLUMNS)
    found = falsify(system, NEAR, system.space, budget=100)
    assert found.falsified
    assert len(found.input.columns()) < 5
    pushes, at = found.input["push"], found.input["at"]
    assert isinstance(pushes, Waveform)
    assert isinstance(at, float)
    # The results are its values in the four seconds.
    values = [pushes(float(second)) for second in range(4)]
    trace = cart.simulate(given_.parse_sample(Sample([at, *values]))).value
    assert theirs.parse_discrete(NEAR, COLUMNS).evaluate(trace).value < 0


@pytest.mark.parametrize("optimizer", [UniformRandom(0.0), DualAnnealing(0.0)])
@pytest.mark.parametrize(
    ("system", "requirement", "space"),
    [
        ("rtamt/RequestGrant-v0", "granted", [Parameter("limit", 0, 5), Parameter("height", 2, 8)]),
        ("rtamt/AutomaticTransmission-v0", "AT2", None),
    ],
)
def test_psy_taliro_searches_our_systems_and_its_costs_are_ours(
    optimizer: Any,  # noqa: ANN401
    system: str,
    requirement: str,
    space: Any,  # noqa: ANN401
) -> None:
    problem = TaliroProblem(system, requirement, space, seed=3)
    given_ = staliro.TestOptions(static_inputs=problem.static_inputs, iterations=25, seed=1)
    (run,) = staliro.test(problem, problem.requirement, optimizer, given_)
    cases = [problem.space.case(each.inputs.sample.values) for each in run.evaluations]
    assert cases == [each.extra.model for each in run.evaluations]
    with Runner(system, requirement) as runner:
        rows = dict(runner.run(cases, [3] * len(cases)))
    ours = [rows[i].outcomes[requirement].robustness for i in range(len(cases))]
    assert [each.cost for each in run.evaluations] == ours
    if requirement == "granted":
        text = str(runner.requirements[requirement].formula)
        named = theirs.parse_discrete(text)
        assert [named.evaluate(each.extra.trace).value for each in run.evaluations] == ours


def test_several_requirements_cost_the_least_and_fixed_entries_are_held() -> None:
    two = ["always(req < 9)", "always(gnt < 9)"]
    problem = TaliroProblem(
        "rtamt/RequestGrant-v0", two, [Parameter("height", 2, 8)], fixed={"limit": 1.0}
    )
    given_ = staliro.TestOptions(static_inputs=problem.static_inputs, iterations=3, seed=1)
    (run,) = staliro.test(problem, problem.requirement, UniformRandom(), given_)
    for each in run.evaluations:
        assert each.extra.model["limit"] == 1.0
        run_: Run = each.extra.trace.run  # a trace of ours has it
        assert each.cost == min(9 - run_.signals["req"].max(), 9 - run_.signals["gnt"].max())


def test_uneven_times_are_sampled_on_straight_lines() -> None:
    @staliro.ode(method="RK45")  # type: ignore[untyped-decorator]  # it has no types here
    def falling(inputs: staliro.OdeInputs) -> dict[str, float]:
        return {"height": inputs.state["speed"], "speed": -9.81}

    given_ = staliro.TestOptions(
        tspan=(0.0, 2.0), static_inputs={"height": (20.0, 30.0), "speed": (-1.0, 1.0)}
    )
    columns = {"height": 0, "speed": 1}
    system = TaliroSystem(falling, given_, period=0.1, columns=columns)
    case = {"height": 25.0, "speed": 0.5}
    run = simulate(system, "always(height > 0 and speed < 9)", case=case, stop="end")
    assert run.steps == 20
    trace = falling.simulate(given_.parse_sample(Sample([25.0, 0.5]))).value
    heights = [state[0] for state in trace.states]
    assert np.array_equal(
        run.signals["height"], np.interp(np.arange(21) * 0.1, [*trace.times], heights)
    )
    assert run.signals["speed"] == pytest.approx(0.5 - 9.81 * run.times, abs=1e-9)


MISTAKES = [
    (
        lambda: TaliroSystem(print, options(), period=1),
        "expected a model of psy-taliro, got <built-in function print>",
    ),
    (
        lambda: TaliroSystem(cart, {}, period=1),
        "expected staliro.TestOptions of psy-taliro, got {}",
    ),
    (
        lambda: TaliroSystem(cart, staliro.TestOptions(), period=1),
        "expected options with static_inputs= or signals=, got neither",
    ),
    (
        lambda: TaliroSystem(
            cart, staliro.TestOptions(signals={"push": push([(0, 1)], "hold")}), period=1
        ),
        "expected options with tspan=(0, 30), which signals need, got none",
    ),
    (
        lambda: simulate(TaliroSystem(cart, options(), period=PERIOD, columns=COLUMNS), NEAR),
        ("UserModel needs all of its inputs, 'at', got no 'at'; system.space.case(point) sets all"),
    ),
    (
        lambda: simulate(TaliroSystem(cart, options(), period=PERIOD), NEAR, case={"at": 1.0}),
        (
            "expected the names of the states of UserModel, which are numbers in a row; "
            'write columns={"gap": 0, ...}'
        ),
    ),
    (
        lambda: simulate(
            TaliroSystem(cart, options(), period=PERIOD, columns={"at": 0, "sped": 1}),
            NEAR,
            case={"at": 1.0},
        ),
        "UserModel has no 'speed'; it has 'at', 'sped'; did you mean 'sped'?",
    ),
    (
        lambda: simulate(TaliroSystem(cart, options(), period=PERIOD), NEAR, case={"att": 1.0}),
        "UserModel takes no 'att' of a case; it takes 'at'; did you mean 'at'?",
    ),
    (
        lambda: TaliroProblem("rtamt/RequestGrant-v0").requirement.evaluate(
            staliro.Trace({0.0: {"req": 1.0}})
        ),
        (
            "expected a trace of a TaliroProblem, which has the robustness, got another; "
            "staliro.specifications.rtamt reads any trace"
        ),
    ),
]


@pytest.mark.parametrize(("mistake", "message"), MISTAKES)
def test_mistakes_say_the_way_out(mistake: Any, message: str) -> None:  # noqa: ANN401
    with pytest.raises(rtamt.RtamtError) as raised:
        mistake()
    assert str(raised.value) == message


def test_a_case_of_a_model_may_be_constant() -> None:
    given_ = options(push=push([(-2, 2)] * 4, "hold"))
    system = TaliroSystem(cart, given_, period=PERIOD, columns=COLUMNS)
    one = simulate(system, NEAR, case=Case({"at": 1.0, "push": 1.0}), stop="end")
    held = Waveform([0.0], [1.0])
    assert one.signals["at"].tolist() == (
        simulate(system, NEAR, case={"at": 1.0, "push": held}, stop="end").signals["at"].tolist()
    )
    assert math.isclose(one.signals["speed"][-1], 13 * PERIOD)
