"""Statistics of requirements: each is a row, and the conditional value at risk by definition."""

import json
import math
from fractions import Fraction
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from evaluations import FAILED, evaluation_of
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt import Verdict
from rtamt.monitors import TriggerCount
from rtamt_gym import Case
from rtamt_gym.results.outcome import Moment, Outcome
from rtamt_gym.results.statistics import STATISTICS, expected_shortfall, mean_progress, result_of
from rtamt_gym.results.trial import RunEnd, Trial

NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=90)
SHARES = st.sampled_from([0.05, 0.25, 0.5, 1.0])


def shortfall(values: list[float], share: Fraction) -> float:
    """Return the same from its definition: the mean of the quantiles below the share."""
    ordered, count = sorted(values), len(values)
    share = max(share, Fraction(1, count))
    total = Fraction(0)
    for i, value in enumerate(ordered):
        piece = min(share, Fraction(i + 1, count)) - min(share, Fraction(i, count))
        total += piece * Fraction(value)
    return float(total / share)


@settings(max_examples=examples(60))
@given(NUMBERS, SHARES)
def test_cvar_is_mean_of_lowest_quantiles(values: list[float], share: float) -> None:
    expected = shortfall(values, Fraction(share).limit_denominator(100))
    assert expected_shortfall(values, share) == pytest.approx(expected, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize(
    ("values", "share", "expected"),
    [
        ([-math.inf, math.inf, 1.0], 1.0, -math.inf),
        ([-math.inf] + [1.0] * 99, 0.05, -math.inf),
        ([1.0] * 19 + [math.inf], 0.05, 1.0),
        ([1.0, 2.0, math.inf], 1.0, math.inf),
        ([math.inf] * 3, 0.05, math.inf),
    ],
)
def test_cvar_of_infinities(values: list[float], share: float, expected: float) -> None:
    assert expected_shortfall(values, share) == expected


@given(st.lists(st.sampled_from([0.0, 0.25, 0.5, 1.0]), min_size=1, max_size=20))
def test_mean_progress_is_1_only_if_all_are(values: list[float]) -> None:
    found = mean_progress(values)
    assert found == pytest.approx(sum(map(Fraction, values)) / len(values))
    assert (found == 1) == (set(values) == {1.0})


def test_no_progress_without_trials() -> None:
    assert mean_progress([]) is None


@pytest.mark.parametrize(
    ("ended", "decided", "limit", "saved"),
    [
        ("violation", 5.0, 12.0, 7.0),
        ("violation", 2.5, 12.0, 0.0),  # another requirement stopped it
        ("decided", 5.0, 12.0, 7.0),
        ("known", 2.5, 12.0, 7.0),
        ("truncated", 5.0, 12.0, 0.0),
        ("violation", 5.0, None, 0.0),
    ],
)
def test_early_stop_saves_time_to_limit(
    ended: RunEnd, decided: float, limit: float | None, saved: float
) -> None:
    outcome = Outcome(-1.0, -1.0, -1.0, Verdict.VIOLATED, Moment(50, decided))
    trial = Trial(Case({}), 0, {"near": outcome}, ended, 5.0, 0.0)
    assert result_of("near", "always(x > 0)", [trial], [outcome], limit).saved == saved


def test_triggered_counts_judged_trials() -> None:
    (asked,) = (each for each in STATISTICS if each.key == "asked")
    never = TriggerCount("req > 0 implies gnt > 0", 50, 0, None, vacuous=True)
    outcome = Outcome(1.0, 1.0, 1.0, Verdict.SATISFIED, Moment(50, 5.0), triggers=(never,))
    trials = [Trial(Case({}), seed, {}, "truncated", 5.0, 0.0) for seed in range(3)]
    found = result_of("near", "req > 0 implies gnt > 0", trials, [outcome, outcome, None])
    assert asked.cell(found) == "0 of 2"


def test_statistics_are_columns_of_data_frame() -> None:
    evaluation = evaluation_of({"near": [float(i) for i in range(40)] + [FAILED]})
    frame = evaluation.statistics()
    result = evaluation.requirements["near"]
    for each in STATISTICS:
        if each.key != "interval":
            assert frame.loc["near", each.key] == each.of(result)
    assert (frame.loc["near", "low"], frame.loc["near", "high"]) == result.interval
    assert frame.loc["near", "cvar"] == 0.5


def test_statistics_are_in_files(tmp_path: Path) -> None:
    evaluation = evaluation_of({"near": [float(i) for i in range(40)]})
    evaluation.record.save(tmp_path / "r.parquet")
    (kept,) = pq.read_schema(tmp_path / "r.parquet").metadata.values()
    in_parquet, in_json = json.loads(kept), json.loads(evaluation.to_json())
    for found in (in_parquet["results"]["near"], in_json["results"]["near"]):
        assert {each.key for each in STATISTICS} <= set(found)
        assert found["cvar"] == 0.5


def test_cvar_column_from_twenty_episodes() -> None:
    few, many = (evaluation_of({"near": [1.0, *range(1, n)]}) for n in (19, 20))
    assert "CVaR 5%" not in str(few)
    assert "minimum  CVaR 5%  median" in str(many)
    assert "minimum, CVaR 5%, median: of the robustness" in str(many).splitlines()


def test_no_robustness_if_all_failed() -> None:
    failed = evaluation_of({"near": [FAILED, FAILED]})
    cells = {each.key: each.cell(failed.requirements["near"]) for each in STATISTICS}
    assert {key for key, cell in cells.items() if cell == "-"} == {
        "asked",
        "progress",
        "least",
        "cvar",
        "median",
        "greatest",
    }


def test_repr_of_result() -> None:
    found = evaluation_of({"near": [-1.0, 1.0, 0.5, 2.0], "far": [1.0] * 4}).requirements
    assert [repr(each) for each in found.values()] == [
        "<near: 3 of 4 episodes satisfy it, 1 violated>",
        "<far: 4 of 4 episodes satisfy it>",
    ]


def test_trial_without_outcomes_failed() -> None:
    assert Trial(Case({}), None, {}, "error", 0.0, 0.0).word == "failed"
