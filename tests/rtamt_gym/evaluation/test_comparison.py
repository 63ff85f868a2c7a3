"""Comparisons: pairs by seed, errors, texts, and files."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from evaluations import FAILED, evaluation_of
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt import InputError, InputTypeError
from rtamt_gym import compare, evaluate_policy
from rtamt_gym.results import Comparison, Evaluation, Record

INF = math.inf
heights = st.sampled_from([-INF, -1.5, -0.0, 0.5, 2.0, INF, FAILED])
episodes = st.dictionaries(st.integers(0, 12), st.tuples(heights, heights, st.booleans()))


def made(rows: dict[int, tuple[float, float, bool]]) -> Evaluation:
    return evaluation_of(
        {"near": [row[0] for row in rows.values()], "slow": [row[1] for row in rows.values()]},
        seeds=list(rows),
        undecided=[place for place, row in enumerate(rows.values()) if row[2]],
    )


def satisfies(row: tuple[float, float, bool], which: tuple[int, ...]) -> bool:
    failed = any(math.isnan(each) for each in row[:2])
    return not failed and not row[2] and all(row[i] > 0 for i in which)


@settings(max_examples=examples(30))
@given(episodes, episodes)
def test_episodes_are_paired_by_their_seeds(
    of_a: dict[int, tuple[float, float, bool]], of_b: dict[int, tuple[float, float, bool]]
) -> None:
    seeds = [seed for seed in of_a if seed in of_b]
    if not seeds:
        return
    found = compare(made(of_a), made(of_b))
    assert sorted(found.seeds) == sorted(seeds)
    for compared, which in zip(found.results, ((0,), (1,), (0, 1)), strict=True):
        pairs = [(satisfies(of_a[s], which), satisfies(of_b[s], which)) for s in seeds]
        assert compared.both == pairs.count((True, True))
        assert compared.only_a == pairs.count((True, False))
        assert compared.only_b == pairs.count((False, True))
        assert compared.neither == pairs.count((False, False))
        assert compared.pairs == len(seeds)
        assert compared.difference == pytest.approx(compared.rate_b - compared.rate_a)
        assert compared.sentence
    known = [s for s in seeds if not any(math.isnan(h) for h in (*of_a[s][:2], *of_b[s][:2]))]
    near = found.requirements["near"].robustness
    assert sorted(near.pairs if near else ()) == sorted((of_a[s][0], of_b[s][0]) for s in known)
    assert max(map(len, str(found).splitlines())) <= 80


@given(episodes.filter(bool))
def test_an_evaluation_is_no_different_from_itself(
    rows: dict[int, tuple[float, float, bool]],
) -> None:
    found = compare(made(rows), made(dict(reversed(rows.items()))))
    for compared in found.results:
        assert (compared.difference, compared.p, compared.adjusted) == (0.0, 1.0, 1.0)
        assert "No difference is shown" in compared.sentence
        assert compared.robustness is None or compared.robustness.value == 0.0


@settings(max_examples=examples(30))
@given(episodes, episodes)
def test_a_file_gives_an_equal_comparison_back(
    tmp_path_factory: pytest.TempPathFactory,
    of_a: dict[int, tuple[float, float, bool]],
    of_b: dict[int, tuple[float, float, bool]],
) -> None:
    if not of_a.keys() & of_b.keys():
        return
    path = tmp_path_factory.mktemp("files") / "compared.json"
    found = compare(made(of_a), made(of_b))
    found.save(path)
    assert Comparison.load(path) == found
    assert str(Comparison.load(path)) == str(found)
    json.loads(path.read_text(), parse_constant=pytest.fail)


def test_what_is_shown_is_said() -> None:
    a = evaluation_of({"near": [-1.0] * 30 + [1.0] * 70}, policy="old")
    b = evaluation_of({"near": [-1.0] * 5 + [2.0] * 95}, policy="new")
    assert compare(a, b).sentence == (
        "B satisfies `near` in 25 points more of the episodes (95%: 18 to 34; p < 0.001). "
        "Its robustness is 1.45 greater on average (95%: 1.28 to 1.64)."
    )
    assert compare(b, a).sentence == (
        "B satisfies `near` in 25 points less of the episodes (95%: 18 to 34; p < 0.001). "
        "Its robustness is 1.45 less on average (95%: 1.28 to 1.64)."
    )


def test_what_is_not_shown_is_said_too() -> None:
    a = evaluation_of({"near": [-1.0, 1.0] * 50})
    b = evaluation_of({"near": [1.0, -1.0, -1.0, -1.0] + [-1.0, 1.0] * 48})
    assert compare(a, b).sentence == (
        "No difference is shown for `near`: -1 point, -6 to 4 (95%; p = 1). "
        "No difference of its robustness is shown: -0.02 on average (95%: -0.1 to 0.04)."
    )
    assert compare(a, a).sentence == (
        "No difference is shown for `near`: A and B agree in all 100 episodes "
        "(95%: -4 to 4 points). Its robustness is the same in each pair."
    )


def test_several_requirements_are_adjusted_and_all_at_once_is_not() -> None:
    a = evaluation_of({"near": [-1.0] * 7 + [1.0] * 13, "slow": [1.0] * 20, "far": [1.0] * 20})
    b = evaluation_of({"near": [1.0] * 20, "slow": [1.0] * 20, "far": [1.0] * 20})
    found = compare(a, b)
    assert found.requirements["near"].p == pytest.approx(2 / 2**7)
    assert found.requirements["near"].adjusted == pytest.approx(6 / 2**7)
    assert found.success.adjusted == found.success.p == pytest.approx(2 / 2**7)
    assert [each.name for each in found.results] == ["near", "slow", "far", "all requirements"]


def test_an_infinite_robustness_is_compared_by_its_median() -> None:
    a = evaluation_of({"near": [INF] * 4 + [1.0] * 16})
    b = evaluation_of({"near": [INF] * 2 + [3.0] * 18})
    found = compare(a, b).requirements["near"].robustness
    assert found is not None
    assert (found.statistic, found.value, found.interval) == ("median", 2.0, (2.0, 2.0))
    assert compare(a, b).sentence.endswith(
        "Its robustness is 2 greater in the median (95%: 2 to 2)."
    )


def test_a_time_limit_that_is_not_known_may_be_the_same() -> None:
    assert compare(evaluation_of(NEAR), replace(evaluation_of(NEAR), limit=None)).notes


def test_returns_of_episodes_that_failed_are_not_compared() -> None:
    a = evaluation_of({"near": [1.0, FAILED, 1.0]}, rewards=[3.0, 50.0, 3.0])
    b = evaluation_of({"near": [1.0, 1.0, 1.0]}, rewards=[5.0, 5.0, 5.0])
    returns = compare(a, b).returns
    assert returns is not None
    assert (returns.value, returns.interval) == (2.0, (2.0, 2.0))


def test_a_stop_of_one_side_alone_is_noted() -> None:
    a = evaluation_of({"near": [1.0] * 9})
    stopped = [replace(row, ended="violation") for row in a.record]
    of = (a.record.requirements, a.system, a.record.provenance)
    b = replace(a, record=Record(stopped, *of))
    assert compare(a, a).notes == compare(b, b).notes == ()
    (note,) = compare(a, b).notes
    assert note == (
        "only one side stopped episodes early, which leaves requirements open and changes "
        "robustness and returns; compare evaluations with the same stop="
    )
    assert compare(b, a).notes == (note,)


def test_notes_tell_what_a_reader_should_know_of_the_pairs() -> None:
    a = evaluation_of({"near": [1.0, FAILED, 1.0]}, seeds=[0, 1, 2])
    b = evaluation_of({"near": [1.0, 1.0]}, seeds=[1, 2], decision={"near": "meets 0.9"})
    assert compare(a, b).notes == (
        "1 episode of A is left out: B has no episode with the same seed",
        (
            "1 episode of A failed, which counts as not satisfied; the first with seed 1: "
            "ValueError: no"
        ),
        (
            "B stopped once its answer was known, so its rate may be biased towards that answer; "
            "compare fixed numbers of episodes"
        ),
        "2 pairs cannot show a difference of rates, however they end",
    )


def test_a_requirement_that_was_never_asked_is_noted_of_each_side() -> None:
    asked: dict[str, Any] = {
        "specs": {"far": "always(x > 9 implies x < 0)"},
        "signals": {"x": "obs[0]"},
        "episodes": 3,
        "at_termination": "complete",
    }
    notes = compare("zero", lean, "CartPole-v1", **asked).notes
    said = "never triggered: far in 0 of 3 episodes"
    assert notes[:2] == (f"{said} of A", f"{said} of B")


def test_returns_are_compared() -> None:
    a = evaluation_of({"near": [1.0] * 4}, rewards=[1.0, 2.0, 3.0, 4.0])
    b = evaluation_of({"near": [1.0] * 4}, rewards=[2.0, 3.0, 4.0, 5.0])
    returns = compare(a, b).returns
    assert returns is not None
    assert (returns.value, returns.interval) == (1.0, (1.0, 1.0))
    assert "The return is 1 greater on average (95%: 1 to 1)." in str(compare(a, b))
    assert compare(a, evaluation_of({"near": [1.0] * 4})).returns is None


def test_a_frame_has_a_row_for_each_result() -> None:
    a = evaluation_of({"near": [-1.0, 1.0], "slow": [1.0, 1.0]})
    frame = compare(a, a).to_frame()
    assert list(frame.index) == ["near", "slow", "all requirements"]
    assert frame.loc["near", ["A", "B", "difference", "both", "neither"]].tolist() == [
        0.5,
        0.5,
        0.0,
        1,
        1,
    ]


NEAR = {"near": [1.0, 1.0]}


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            lambda: evaluation_of(NEAR, system="Other-v0"),
            "cannot compare: the system is Task-v0 of A and Other-v0 of B",
        ),
        (
            lambda: evaluation_of(NEAR, period=Fraction(1, 5)),
            "cannot compare: the period is 1/10 of A and 1/5 of B",
        ),
        (
            lambda: replace(evaluation_of(NEAR), limit=7.0),
            "cannot compare: the time limit is 5.0 of A and 7.0 of B",
        ),
        (
            lambda: evaluation_of({"far": [1.0]}),
            (
                "cannot compare: the requirements are 'near' of A and 'far' of B; evaluate both "
                "with the same"
            ),
        ),
        (
            lambda: evaluation_of(NEAR, formulas={"near": "always(x > 1)"}),
            "cannot compare: near is always(near > 0) of A and always(x > 1) of B",
        ),
        (
            lambda: evaluation_of(NEAR, seeds=[7, 8]),
            (
                "cannot pair the episodes: A has the seeds 0 to 1, B has the seeds 7 to 8, none in "
                "common; evaluate both with the same seed="
            ),
        ),
    ],
)
def test_what_cannot_be_paired_is_refused(other: Callable[[], Evaluation], message: str) -> None:
    with pytest.raises(InputError) as refused:
        compare(evaluation_of(NEAR), other())
    assert str(refused.value) == message


def test_two_policies_are_evaluated_on_the_same_seeds() -> None:
    asked: dict[str, Any] = {
        "specs": {"upright": "always(abs(angle) < 0.2)"},
        "signals": {"angle": "obs[2]"},
        "episodes": 8,
        "seed": 40,
        "at_termination": "failure",
    }
    found = compare("zero", lean, "CartPole-v1", **asked)
    a, b = (evaluate_policy(policy, "CartPole-v1", **asked) for policy in ("zero", lean))
    assert found == compare(a, b)
    places = [asked.pop(name) for name in ("specs", "signals")]
    assert found == compare("zero", lean, "CartPole-v1", *places, **asked)
    assert found.seeds == tuple(range(40, 48))
    assert repr(found) == "<Comparison of zero and lean: 8 pairs>"
    assert found.requirements["upright"].only_b == 8


def lean(observation: list[float]) -> int:
    return int(observation[2] + 0.3 * observation[3] > 0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: compare("zero", "random"),
            (
                "expected two evaluations, or two policies and an environment, as in compare(old, "
                "new, 'CartPole-v1', ...), got str and str without an environment; "
                "Evaluation.load reads a file"
            ),
        ),
        (
            lambda: compare(evaluation_of(NEAR), "random", "CartPole-v1"),
            (
                "expected two evaluations, or two policies and an environment, as in compare(old, "
                "new, 'CartPole-v1', ...), got Evaluation and str with an environment; "
                "Evaluation.load reads a file"
            ),
        ),
        (
            lambda: compare(evaluation_of(NEAR), evaluation_of(NEAR), "CartPole-v1", episodes=5),
            (
                "two evaluations have run already, got further arguments: env, episodes; leave "
                "them out"
            ),
        ),
        (
            lambda: compare("zero", "random", "CartPole-v1", target=0.9),
            "target= would stop each policy at another episode; pass the same episodes= for both",
        ),
    ],
)
def test_other_arguments_are_refused(call: Callable[[], object], message: str) -> None:
    with pytest.raises((InputError, InputTypeError)) as refused:
        call()
    assert str(refused.value) == message


def test_files_that_hold_no_comparison_are_refused(tmp_path: Path) -> None:
    a = evaluation_of(NEAR)
    texts = {
        "words.json": ("{", "got no JSON: Expecting property name enclosed in double quotes: "),
        "other.json": (
            '{"format": "rtamt result", "version": 2, "kind": "evaluation"}',
            "holds no comparison but a result of kind 'evaluation': expected a file that ",
        ),
        "newer.json": (
            '{"format": "rtamt result", "version": 3, "kind": "comparison"}',
            "holds a result of version 3, and rtamt ",
        ),
        "torn.json": (
            '{"format": "rtamt result", "version": 2, "kind": "comparison"}',
            "it is not a result of kind 'comparison' from rtamt compare --save and ",
        ),
    }
    for name, (text, message) in texts.items():
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError) as refused:
            Comparison.load(tmp_path / name)
        assert message in str(refused.value)
    with pytest.raises(InputError) as refused:
        compare(a, a).save(tmp_path / "compared.txt")
    assert str(refused.value) == (
        f"cannot write {tmp_path / 'compared.txt'}: expected a name that ends in .json"
    )
