"""psy-taliro, which searches for inputs that violate a requirement, on the released classes.

It was written for the released library and imports `StlDiscreteTimeSpecification` and
`StlDenseTimeSpecification` from `rtamt`.
"""

from collections.abc import Callable
from typing import Any

import pytest
import staliro
from staliro.models import Trace
from staliro.optimizers import UniformRandom
from staliro.specifications import rtamt as requirements

import rtamt

COLUMNS = {"gap": 0, "speed": 1}
KEEPS_APART = "always[0:5](gap > 0.5)"
RESPONSE = "always[0:2]((gap < 6) implies eventually[0:3](speed < 0.5))"
STEP = 0.25


@staliro.model  # type: ignore[untyped-decorator]  # it has no types here
def braking(inputs: staliro.Inputs[staliro.Sample]) -> Trace[list[float]]:
    """A car that brakes 0.75 s too late for an obstacle."""
    gap, speed = inputs.static["gap"], inputs.static["speed"]
    states = {}
    for k in range(25):
        states[k * STEP] = [gap, speed]
        gap -= STEP * speed
        if k >= 3:
            speed = max(0.0, speed - STEP * 2.0)
    return Trace(states)


def trace_of(gap: float, speed: float) -> Trace[list[float]]:
    """Return the trace of the model from a state."""
    sample = staliro.Sample([gap, speed])
    inputs = OPTIONS.parse_sample(sample)
    return braking.simulate(inputs).value


OPTIONS = staliro.TestOptions(
    tspan=(0.0, 6.0),
    static_inputs={"gap": (5.0, 20.0), "speed": (0.0, 8.0)},
    iterations=200,
    seed=2020,
)
Parse = Callable[[str, dict[str, int]], staliro.Specification[Any, float, None]]
PARSERS: dict[str, Parse] = {
    "discrete": requirements.parse_discrete,
    "dense": requirements.parse_dense,
}


@pytest.mark.parametrize("time", PARSERS)
def test_it_finds_an_input_that_violates_the_requirement(time: str) -> None:
    requirement = PARSERS[time](KEEPS_APART, COLUMNS)
    (run,) = staliro.test(braking, requirement, UniformRandom(min_cost=0.0), OPTIONS)
    *others, last = run.evaluations
    assert last.cost < 0.0
    assert 1 < len(run.evaluations) < OPTIONS.iterations, "it stops with the first violation"
    assert all(evaluation.cost >= 0.0 for evaluation in others)
    gaps = [state[0] for time, state in last.extra.trace if time <= 5.0]
    assert last.cost == min(gaps) - 0.5


@pytest.mark.parametrize("state", [(20.0, 1.0), (6.0, 8.0), (9.5, 4.0), (5.0, 0.0)])
@pytest.mark.parametrize("requirement", [KEEPS_APART, RESPONSE, "gap > speed"])
def test_costs_are_the_robustness_at_the_start(
    requirement: str, state: tuple[float, float]
) -> None:
    trace = trace_of(*state)
    columns = {name: [s[i] for s in trace.states] for name, i in COLUMNS.items()}
    cost = requirements.parse_discrete(requirement, COLUMNS).evaluate(trace).value
    assert cost == rtamt.evaluate(requirement, columns, STEP)[0]
    events = {name: list(zip(trace.times, columns[name], strict=True)) for name in columns}
    cost = requirements.parse_dense(requirement, COLUMNS).evaluate(trace).value
    assert cost == rtamt.dense.evaluate(requirement, events)[0][1]


def test_states_may_have_names() -> None:
    trace = trace_of(6.0, 8.0)
    named = Trace({time: dict(zip(COLUMNS, state, strict=True)) for time, state in trace})
    by_name = requirements.parse_discrete(KEEPS_APART).evaluate(named).value
    assert by_name == requirements.parse_discrete(KEEPS_APART, COLUMNS).evaluate(trace).value
    by_name = requirements.parse_dense(KEEPS_APART).evaluate(named).value
    assert by_name == requirements.parse_dense(KEEPS_APART, COLUMNS).evaluate(trace).value


def test_a_period_that_it_rounds_to_nothing_does_no_harm_without_bounds() -> None:
    trace = Trace({i / 1000: [x, 0.0] for i, x in enumerate([3.0, 2.0, 4.0])})
    assert requirements.parse_discrete("always(gap > 0)", COLUMNS).evaluate(trace).value == 2.0


def test_its_mistakes_are_told_in_our_words() -> None:
    trace = trace_of(6.0, 8.0)
    with pytest.raises(rtamt.RTAMTException, match="expected an operand after '>'"):
        requirements.parse_discrete("gap >", COLUMNS).evaluate(trace)
    with pytest.raises(rtamt.RTAMTException, match=r"bound 0\.3 s is not a multiple"):
        requirements.parse_discrete("always[0:0.3](gap > 0)", COLUMNS).evaluate(trace)
