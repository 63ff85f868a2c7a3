"""Searches for violations: results violate on any machine, and seeds repeat them."""

import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import rtamt_envs  # noqa: F401 - registers the scenarios

import rtamt
from rtamt_gym import Parameter, Signal, falsify, simulate
from rtamt_gym.results import Falsification
from rtamt_gym.search.falsification.optimizers import OPTIMIZERS, OptimizerLike
from rtamt_gym.search.falsification.points import Evaluate

TRANSMISSION = "rtamt/AutomaticTransmission-v0"

SPACE = [Parameter("inflow", 0.1, 0.3), Parameter("leak", 0.1, 0.2)]


def tank(inflow: float, leak: float) -> Iterator[Mapping[str, float]]:
    level = 1.0
    for _ in range(20):
        yield {"level": level}
        level += inflow - leak * level


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_every_optimizer_finds_a_violation_that_fills_an_eighth_of_the_space(
    optimizer: str,
) -> None:
    found = falsify(tank, "always(level < 2)", SPACE, period=1, optimizer=optimizer, seed=3)
    assert found.falsified
    assert found.optimizer == optimizer
    assert found.simulations == len(found.record) <= 300
    assert [row.outcomes["spec"].verdict.name for row in found.record].count("VIOLATED") == 1
    run = found.replay()
    assert run.histories["spec"].verdict is rtamt.Verdict.VIOLATED
    levels = [sample["level"] for sample in tank(**found.input)]  # type: ignore[arg-type]
    assert max(levels) >= 2


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("requirement", ["AT1", "AT6a", "AT54"])
def test_what_is_found_violates_in_a_simulation_and_on_the_recorded_trace(requirement: str) -> None:
    found = falsify(TRANSMISSION, requirement, budget=300, seed=5)
    assert found.falsified
    env = gym.make(TRANSMISSION)
    spec = env.unwrapped.requirements[requirement]  # type: ignore[attr-defined]
    for case in (found.input, found.unreduced):
        run = simulate(env, spec, case=case, stop="end", seed=found.row.seed)
        assert run.histories[requirement].verdict is rtamt.Verdict.VIOLATED
        height = rtamt.evaluate(spec, run.signals, run.period)[0]
        assert np.signbit(height)
        judged = rtamt.judge(spec, run.signals, run.period, end="cut")
        assert judged.verdict is rtamt.Verdict.VIOLATED


def spared(
    inflow: Callable[[float], float],
    leak: float,
    spare: Callable[[float], float],
    dud: float,
    still: float,
) -> Iterator[Mapping[str, float]]:
    level = 1.0
    for time in range(20):
        yield {"level": level}
        level += inflow(time) - leak * level + 0 * (spare(time) + dud + still)


@pytest.mark.parametrize(("limit", "falsified"), [(2, True), (9, False)])
@pytest.mark.parametrize("options", [{}, {"n_jobs": 1}])
def test_inputs_without_effect_are_listed(
    limit: int, options: dict[str, Any], *, falsified: bool
) -> None:
    space = [
        Signal("inflow", 0.1, 0.3, points=3),
        Parameter("leak", 0.1, 0.2),
        Signal("spare", 0, 1, points=3),
        Parameter("dud", values=(1, 2)),
        Parameter("still", 1, 1),
    ]

    given = {"period": 1, "duration": 20, "budget": 12, **options}
    found = falsify(spared, f"always(level < {limit})", space, **given)
    assert found.falsified is falsified
    assert found.effects.without == ("spare", "dud")
    assert found.effects.simulations == 1 + 4 + 1 + 2
    assert "note: no effect on the robustness: spare, dud (each" in " ".join(str(found).split())
    kept = json.loads(found.to_json())
    assert (kept["without_effect"], kept["effect_simulations"]) == (["spare", "dud"], 8)


def test_an_effect_on_another_simulation_counts() -> None:
    # At the best simulation both inputs are 1, and lowering one alone changes nothing.
    def either(one: float, other: float) -> Iterator[Mapping[str, float]]:
        yield {"level": max(one, other)}

    space = [Parameter("one", 0, 1), Parameter("other", 0, 1)]
    found = falsify(either, "always(level < 2)", space, period=1, budget=8)
    assert found.input == {"one": 1, "other": 1}
    assert found.effects == ((), 6)
    assert "no effect" not in str(found)


def test_random_systems_have_no_inputs_without_effect() -> None:
    rng = np.random.default_rng(1)

    def noisy(x: float) -> Iterator[Mapping[str, float]]:
        yield {"level": rng.random() + 0 * x}

    found = falsify(noisy, "always(level < 2)", [Parameter("x", 0, 1)], period=1, budget=4)
    assert found.effects.without == ()


def outcome(found: Falsification) -> tuple[object, ...]:
    return found.record, found.input, found.requirement, found.reductions, found.scales


def test_a_seed_repeats_a_search_and_environments_change_nothing() -> None:
    by_batch = [
        falsify(TRANSMISSION, "AT6a", budget=60, seed=2, batch=batch, scales=None)
        for batch in (100, 7)
    ]
    assert outcome(by_batch[0]) == outcome(by_batch[1])
    assert by_batch[0].record == falsify(TRANSMISSION, "AT6a", budget=60, seed=2).record


def test_the_text_says_how_simple_how_far_and_how_long() -> None:
    space = [Parameter("inflow", 0.1, 0.25), Parameter("leak", 0.1, 0.2)]

    def told(requirement: str, budget: int, optimizer: OptimizerLike = "portfolio") -> list[str]:
        found = falsify(tank, requirement, space, period=1, budget=budget, optimizer=optimizer)
        return str(found).splitlines()

    def six(evaluate: Evaluate, dimension: int, rng: np.random.Generator) -> None:
        evaluate(rng.random((6, dimension)))

    assert told("always(level < 9)", 6)[3] == (
        "6 simulations; 114 simulated seconds, optimizer portfolio, seed 0"
    )
    assert told("always(level < 9)", 30, six)[3] == (
        "6 simulations of 30; 114 simulated seconds, optimizer six, seed 0"
    )
    assert told("always[30:40](level < 9)", 6)[2] == (
        "no sample of any simulation counts; windows may lie beyond its end"
    )
    assert "no simpler one found by 1 more simulation" in told("always(level < 2)", 30)
    rounded = told("always(level < 1.5)", 30, "random")
    assert any(line.startswith("rounded by ") for line in rounded)
