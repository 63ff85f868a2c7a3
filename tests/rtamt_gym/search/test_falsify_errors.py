"""Mistakes in a search are errors at once and complete; results of a search are never lost."""

import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

import numpy as np
import pytest

from rtamt import InputError, InputTypeError, RtamtError
from rtamt_gym import Parameter, falsify
from rtamt_gym.search.falsification.falsify import IrreproducibleWarning
from rtamt_gym.search.falsification.points import Evaluate
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

X = [Parameter("x", 0, 1)]


def plain(x: float) -> Iterator[Mapping[str, float]]:
    yield {"y": x}


def asks(points: Any) -> Callable[..., None]:  # noqa: ANN401 - mistakes too
    def mistaken(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:  # noqa: ARG001 - an optimizer's
        evaluate(points)

    return mistaken


def idle(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
    """A system without an evaluation."""


COMMON: dict[str, Any] = {"space": X, "period": 1, "budget": 20}

CLIP = "points.clip(0, 1) moves points into it"


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (
            {"optimizer": "portfolo"},
            InputError,
            (
                "unknown optimizer 'portfolo'; the optimizers are 'portfolio', 'random', 'sobol', "
                "'corners', 'cma', 'dual_annealing', 'differential_evolution', 'tpe'; "
                "did you mean 'portfolio'?"
            ),
        ),
        (
            {"optimizer": 3},
            InputTypeError,
            "expected optimizer= as a name or a function (evaluate, dimension, rng), got 3",
        ),
        ({"budget": 0}, InputError, "expected budget= as 1 or more, got 0"),
        ({"budget": 1.5}, InputTypeError, "expected budget= as a whole number, got 1.5"),
        ({"seed": -1}, InputError, "expected seed= as a whole number, 0 or more, got -1"),
        (
            {"space": None},
            InputError,
            (
                "plain does not declare a space of parameters; give a space, as in "
                'falsify(system, requirements, [Parameter("mass", 1, 2)], ...)'
            ),
        ),
        ({"space": []}, InputError, "expected at least one signal or parameter, got none"),
        ({"fixed": {"x": 1}}, InputError, "expected 'x' varied or fixed, got both"),
        (
            {"scales": "none"},
            InputError,
            'expected scales= as {"rpm < 3000": 1000}, None or "plain", got \'none\'',
        ),
        (
            {"scales": {"z < 1": 2}},
            InputError,
            "scales= names an unknown predicate 'z < 1'; the predicates are 'y >= 0'",
        ),
        (
            {"scales": {"y >= 0": 0}},
            InputError,
            "expected scales['y >= 0']= as a finite number above 0, got 0",
        ),
        (
            {"optimizer": idle},
            InputError,
            (
                "the optimizer idle evaluated no point; it is called with evaluate, the dimension "
                "and a generator, and calls evaluate(points) until that ends it"
            ),
        ),
        (
            {"optimizer": asks([[0.5], [1.5]])},
            InputError,
            (
                "expected the optimizer to evaluate points of the unit cube, got 1.5 in coordinate "
                f"0 of point 1; {CLIP}"
            ),
        ),
        (
            {"optimizer": asks([[np.nan]])},
            InputError,
            (
                "expected the optimizer to evaluate points of the unit cube, got nan in coordinate "
                f"0 of point 0; {CLIP}"
            ),
        ),
        (
            {"optimizer": asks([0.5])},
            InputError,
            (
                "expected the optimizer to evaluate points of shape (k, 1), a row for each point, "
                "got shape (1,)"
            ),
        ),
        (
            {"optimizer": asks([[0.5], [0.5, 0.5]])},
            InputError,
            (
                "expected the optimizer to evaluate points of shape (k, 1), a row for each point, "
                "got [[0.5], [0.5, 0.5]]"
            ),
        ),
    ],
)
def test_mistakes_are_told(options: dict[str, Any], error: type[RtamtError], message: str) -> None:
    with pytest.raises(error) as told:
        falsify(plain, "always(y >= 0)", **{**COMMON, **options})
    assert str(told.value) == message


def car(gain: float) -> Iterator[Mapping[str, float]]:
    """Reach a speed of 40 after 10 s, in steps of 0.1 s."""
    for step in range(200):
        yield {"speed": 0.4 * step * gain}


@pytest.mark.parametrize(
    ("period", "message"),
    [
        (None, r"duration=20.0 can mean 20 s or 20 steps, since car .* give period= in seconds"),
        (100, r"duration=20.0 is shorter than a step of 100 s.* period='100ms'"),
    ],
)
def test_short_duration_error(period: float | None, message: str) -> None:
    space = [Parameter("gain", 0.1, 1)]
    with pytest.raises(InputError, match=message):
        falsify(car, "always(speed < 30)", space, duration=20, period=period, budget=5)
    found = falsify(car, "always(speed < 30)", space, duration=20, period="100ms", budget=5)
    assert found.falsified


def test_steps_without_period() -> None:
    found = falsify(car, "always(speed < 90)", [Parameter("gain", 0.1, 1)], budget=2)
    assert "2 simulations; 398 steps, optimizer" in str(found)


def test_an_optimizer_that_returns_ends_the_search() -> None:
    found = falsify(plain, "always(y >= 0)", X, period=1, optimizer=asks([[0.5], [0.25]]))
    assert (found.falsified, found.simulations, found.robustness) == (False, 2, 0.25)
    assert found.input == {"x": 0.25}


def test_the_error_of_an_optimizer_brings_what_was_found() -> None:
    def breaks(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:  # noqa: ARG001 - an optimizer's
        evaluate([[0.5], [0.25]])
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as broken:
        falsify(plain, "always(y >= 0)", X, period=1, optimizer=breaks)
    partial: Any = broken.value
    assert partial.falsification.simulations == 2
    assert partial.falsification.input == {"x": 0.25}
    assert partial.__notes__ == ["error.falsification holds 2 simulations"]


def test_ctrl_c_brings_what_was_found() -> None:
    calls = iter(range(100))

    def interrupted(x: float) -> Iterator[Mapping[str, float]]:
        if next(calls) == 5:
            raise KeyboardInterrupt
        yield {"y": x}

    with pytest.raises(KeyboardInterrupt) as pressed:
        falsify(interrupted, "always(y >= 0)", X, period=1, optimizer="random")
    partial: Any = pressed.value
    assert partial.falsification.simulations == 5
    assert partial.falsification.robustness == min(
        row.outcomes["spec"].robustness for row in partial.falsification.record
    )


def test_a_simulation_that_fails_keeps_its_error_and_the_search_goes_on() -> None:
    values = []

    def fails(x: float) -> Iterator[Mapping[str, float]]:
        yield {"y": 1.0}
        if x < 0.5:
            raise ValueError(x)
        yield {"y": x - 0.9}

    def watches(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:  # noqa: ARG001 - an optimizer's
        values.extend(evaluate([[0.25], [0.95], [0.75]]).tolist())

    told = "1 of 3 simulations failed, the first with x=0.25: ValueError: 0.25"
    with pytest.warns(FailedSimulationWarning, match=told):
        found = falsify(fails, "eventually(y > 0.2)", X, period=1, optimizer=watches)
    assert values == [1e12, 0.8, 0.8]
    assert [row.error for row in found.record] == ["ValueError: 0.25", "", ""]
    assert str(found).splitlines()[-2:] == [
        "1 of 3 simulations failed, the first with x=0.25:",
        "  ValueError: 0.25",
    ]
    assert (found.judged, found.failed, found.coverage.simulations) == (2, 1, 2)


def test_if_all_simulations_fail_the_first_error_is_told() -> None:
    def fails(x: float) -> Iterator[Mapping[str, float]]:
        if x >= 0:
            raise ValueError(x)
        yield {}

    with pytest.raises(InputError) as told:
        falsify(fails, "always(y > 0)", X, period=1, optimizer=asks([[0.25], [0.5]]))
    assert str(told.value) == "all 2 simulations failed, the first with ValueError: 0.25"


@pytest.mark.parametrize("optimizer", ["portfolio", "random", "dual_annealing"])
@pytest.mark.parametrize("scales", [None, "plain"])
def test_simulations_that_fail_alike_before_they_begin_are_few(
    optimizer: str, scales: Literal["plain"] | None
) -> None:
    formula = "always(y > 0) and always(z > 0)"
    with pytest.raises(InputError) as told:
        falsify(plain, formula, X, period=1, optimizer=optimizer, scales=scales)
    assert str(told.value).startswith("all 8 simulations failed, the first with InputError: ")


def test_simulations_that_fail_at_extremes_alone_do_not_end_a_search() -> None:
    def brittle(x: float, z: float, u: float) -> Iterator[Mapping[str, float]]:
        if {x, z, u} <= {0.0, 1.0}:
            raise ValueError(x)
        yield {"y": x}

    space = [Parameter(name, 0, 1) for name in "xzu"]
    with pytest.warns(
        FailedSimulationWarning, match="8 of .* simulations failed, the first with x=0"
    ):
        found = falsify(brittle, "always(y > 0.2)", space, period=1)
    assert found.falsified
    assert [bool(row.error) for row in found.record[:9]] == [True] * 8 + [False]


def test_a_violation_that_does_not_come_again_is_told() -> None:
    calls = iter(range(100))

    def moody(x: float) -> Iterator[Mapping[str, float]]:
        yield {"y": x - 2 * (next(calls) == 3)}

    told = "the input that violated spec did not do so a second time: moody is not the same"
    with pytest.warns(IrreproducibleWarning, match=told):
        found = falsify(moody, "always(y >= 0)", X, period=1)
    assert (found.falsified, found.simulations, found.reductions) == (True, 4, 0)


def test_an_optimizer_whose_package_is_missing_names_the_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(ModuleNotFoundError) as told:
        falsify(plain, "always(y >= 0)", X, period=1, optimizer="tpe")
    assert str(told.value) == (
        "optimizer='tpe' needs optuna, which is not installed; "
        "from the checkout: pip install '.[optuna]'"
    )
