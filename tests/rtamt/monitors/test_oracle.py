"""The oracle against the golden files, which were computed by a separate program."""

import math

from golden_cases import cases, length
from oracle import episode, horizon, robustness

import rtamt


def test_oracle_agrees_with_the_golden_discrete_cases_at_every_sample() -> None:
    golden = cases("discrete.json")
    assert len(golden) == 400
    for case in golden:
        formula = rtamt.parse(case["formula"]).formula
        expected = [float(value) for value in case["robustness"]]
        assert robustness(formula, case["trace"], length(case)) == expected, case["formula"]


def test_oracle_agrees_with_the_golden_horizons() -> None:
    for case in cases("discrete.json"):
        expected = math.inf if case["horizon"] is None else case["horizon"]
        assert horizon(rtamt.parse(case["formula"]).formula) <= expected, case["formula"]


def test_oracle_agrees_with_the_golden_episodes_after_every_sample() -> None:
    golden = cases("episode.json")
    assert len(golden) == 300
    for case in golden:
        formula = rtamt.parse(case["formula"]).formula
        for n, after in enumerate(case["after"], start=1):
            assert episode(formula, case["trace"], n) == tuple(map(float, after)), case["formula"]
