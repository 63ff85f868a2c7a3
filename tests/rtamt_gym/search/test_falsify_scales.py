"""Predicates of different units are made comparable; verdicts and reports stay as they are."""

from collections.abc import Iterator, Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt_gym import Parameter, falsify
from rtamt_gym.play.history import SimulatedTrace
from rtamt_gym.search.falsification.points import Evaluate
from rtamt_gym.search.falsification.scales import checked_scales, in_scales, spreads

SPEC = rtamt.parse("slow = always(rpm < 3000); slow implies always(v < 35 and v > -5)")

SPACE = [Parameter("a", 0, 1), Parameter("b", 0, 1)]


def car(a: float, b: float) -> Iterator[Mapping[str, float]]:
    for share in (0.0, 0.5, 1.0):
        yield {"rpm": 1000 + 4000 * a * share, "v": 60 * b * share - 2}


def test_scales_are_the_ranges_over_all_traces_one_for_the_same_variables() -> None:
    traces = [
        SimulatedTrace({"rpm": np.array([1000.0, 2000.0]), "v": np.array([0.0, 10.0])}, None),
        SimulatedTrace({"rpm": np.array([500.0, 600.0]), "v": np.array([-2.0, 4.0])}, None),
    ]
    assert spreads({"a": SPEC}, traces) == {"rpm < 3000": 1500, "v < 35": 12, "v > -5": 12}


def test_a_predicate_that_never_changes_has_no_scale() -> None:
    traces = [SimulatedTrace({"rpm": np.array([1000.0, 1000.0]), "v": np.array([0.0, 10.0])}, None)]
    assert spreads({"a": SPEC}, traces) == {"v < 35": 10, "v > -5": 10}


def test_one_unit_needs_no_scales() -> None:
    assert checked_scales(None, {"a": SPEC}) is None
    assert checked_scales(None, {"a": rtamt.parse("always(x < 1) and eventually(x > 3)")}) == {}
    two = {"a": rtamt.parse("always(x < 1)"), "b": rtamt.parse("always(y < 1)")}
    assert checked_scales(None, two) is None


@given(st.lists(st.tuples(st.floats(0, 6000), st.floats(-20, 80)), min_size=1, max_size=5))
def test_scaled_requirements_have_the_same_verdicts(samples: list[tuple[float, float]]) -> None:
    scales = {"rpm < 3000": 1500.0, "v < 35": 12.0, "v > -5": 12.0}
    scaled = in_scales({"a": SPEC}, scales)["a"]
    rpm, v = np.array(samples).T
    own = rtamt.evaluate(SPEC, {"rpm": rpm, "v": v})[0]
    other = rtamt.evaluate(scaled, {"rpm": rpm, "v": v})[0]
    assert np.signbit(own) == np.signbit(other)
    expected = max((rpm / 1500 - 2).max(), min((35 - v).min(), (v + 5).min()) / 12)
    assert other == pytest.approx(expected)


@pytest.mark.parametrize("batch", [1, 8, 30])
def test_an_optimizer_gets_the_robustness_in_scales_also_of_the_first_runs(batch: int) -> None:
    asked, got = [], []

    def watches(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
        while True:
            points = rng.random((batch, dimension))
            values = evaluate(points)
            asked.extend(points.tolist())
            got.extend(values.tolist())

    slow = [Parameter("a", 0, 1), Parameter("b", 0, 0.5)]
    found = falsify(car, SPEC, slow, period=1, optimizer=watches, budget=60)
    assert not found.falsified
    rpm, v, low = found.scales.values()
    assert list(found.scales) == ["rpm < 3000", "v < 35", "v > -5"]
    assert v == low
    for (a, half), value in zip(asked, got, strict=True):
        b = half / 2
        assert value == pytest.approx(
            max((4000 * a - 2000) / rpm, min(37 - 60 * b, 3) / v), abs=1e-9
        )
    # The report is in the requirement's own units.
    a, b = found.input["a"], found.input["b"]
    assert isinstance(a, float)
    assert isinstance(b, float)
    assert found.robustness == pytest.approx(max(4000 * a - 2000, min(37 - 60 * b, 3)))


def test_given_scales_are_used_and_plain_are_none() -> None:
    given_scales = {"rpm < 3000": 500, "v<35": 7}
    found = falsify(car, SPEC, SPACE, period=1, scales=given_scales, budget=20)
    assert found.scales == {"rpm < 3000": 500, "v < 35": 7}
    assert falsify(car, SPEC, SPACE, period=1, scales="plain", budget=20).scales == {}


def test_the_first_violated_of_several_requirements_ends_the_search() -> None:
    both = {"fast": "always(v < 50)", "high": "always(rpm < 4900)"}
    found = falsify(car, both, SPACE, period=1)
    assert found.falsified
    row = found.record[-1]
    violated = [name for name in both if row.outcomes[name].verdict is rtamt.Verdict.VIOLATED]
    assert found.requirement in violated
    assert all(len(each.outcomes) == 2 for each in found.record)
    assert not any(
        outcome.verdict is rtamt.Verdict.VIOLATED
        for each in found.record[:-1]
        for outcome in each.outcomes.values()
    )
