"""`compare_methods`: its numbers, its file, its picture, and its errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_results import evaluation, row, wave
from matplotlib.image import imread

from rtamt import InputError, InputTypeError
from rtamt_gym import compare_methods
from rtamt_gym.results import MethodComparison
from rtamt_gym.results.method_scores import permutation_p

PLAIN = [0.0, 0.1, 0.0, 0.2, 0.1]
SHAPED = [0.9, 1.0, 0.2, 1.0, 1.0, 0.95]


def compared(**options: Any) -> MethodComparison:  # noqa: ANN401
    return compare_methods({"plain": PLAIN, "shaped": SHAPED, "same": PLAIN}, **options)


def test_every_number_counts_runs() -> None:
    found = compared()
    assert found.baseline == "plain"
    assert list(found.methods) == ["plain", "shaped", "same"]
    plain, shaped, same = found.methods.values()
    assert [each.runs for each in (plain, shaped, same)] == [5, 6, 5]
    assert shaped.mean.value == pytest.approx(np.mean(SHAPED))
    assert shaped.interquartile_mean.value == pytest.approx(np.mean([0.9, 0.95, 1.0, 1.0]))
    assert shaped.quartiles[0] == 0.2
    assert shaped.quartiles[4] == 1.0
    assert shaped.improvement is not None
    # The failed run equals one run of five and is above the others.
    assert shaped.improvement.value == pytest.approx((5 * 5 + 4.5) / 30)
    assert (plain.improvement, plain.p, plain.adjusted) == (None, None, None)
    assert same.improvement is not None
    assert same.improvement.value == 0.5
    assert same.p == same.adjusted == 1.0
    p = permutation_p(np.array(SHAPED)[:, None], np.array(PLAIN)[:, None])
    assert shaped.p == p
    assert shaped.adjusted == pytest.approx(2 * p)
    for each in found.methods.values():
        for estimate in (each.mean, each.interquartile_mean, *each.profile):
            assert estimate.interval[0] <= estimate.value <= estimate.interval[1]
    assert len(shaped.profile) == len(found.thresholds)
    for least, share in zip(found.thresholds, shaped.profile, strict=True):
        assert share.value == pytest.approx(np.mean(np.array(SHAPED) > least))


def test_methods_are_named_where_one_looks_at_a_comparison() -> None:
    assert repr(compared()) == "<Comparison of 3 methods: 'plain', 'shaped', 'same'>"


def test_the_sentence_says_what_is_shown_and_what_is_not() -> None:
    assert compared().sentence == (
        "shaped has 0.762 more mean satisfaction than plain (p = 0.013). "
        "No difference is shown between same and plain (p = 1)."
    )


def test_the_same_arguments_give_the_same_and_another_baseline_turns_it_around() -> None:
    assert compared() == compared() == compared(seed=0)
    ahead, behind = compared(), compared(baseline="shaped")
    one, other = ahead.methods["shaped"], behind.methods["plain"]
    assert one.improvement is not None
    assert other.improvement is not None
    assert one.improvement.value + other.improvement.value == pytest.approx(1.0)
    assert one.p == other.p


def test_a_wider_confidence_gives_wider_intervals() -> None:
    narrow, wide = (
        compared(confidence=level).methods["shaped"].mean.interval for level in (0.5, 0.99)
    )
    assert wide[0] < narrow[0] < narrow[1] < wide[1]


def test_the_last_point_of_a_curve_is_the_score_of_its_run() -> None:
    curves = {
        "plain": np.outer(PLAIN, [0.0, 0.5, 1.0]),
        "shaped": np.outer(SHAPED, [0.1, 0.6, 1.0]),
    }
    found = compare_methods(curves, steps=[0, 500, 1000])
    ends = compare_methods({"plain": PLAIN, "shaped": SHAPED})
    assert found.steps == (0.0, 500.0, 1000.0)
    for name, method in found.methods.items():
        assert method.scores == ends.methods[name].scores
        assert method.mean == ends.methods[name].mean == method.curve[-1]
        assert [each.value for each in method.curve] == pytest.approx(curves[name].mean(axis=0))


def test_tasks_weigh_the_same() -> None:
    runs: dict[str, Any] = {
        "plain": {"near": [0.0, 0.2], "far": [0.1, 0.1]},
        "shaped": {"far": [0.5, 0.7], "near": [1.0, 1.0]},
    }
    found = compare_methods(runs)
    assert found.tasks == ("near", "far")
    assert found.methods["shaped"].scores == ((1.0, 0.5), (1.0, 0.7))
    assert found.methods["shaped"].mean.value == pytest.approx(0.8)
    assert "over 2 tasks" in str(found)


def test_evaluations_are_scores() -> None:
    def evaluated(satisfied: int) -> Any:  # noqa: ANN401
        heights = [1.0] * satisfied + [-1.0] * (4 - satisfied)
        rows = [row({"low": height, "seen": 1.0}, seed=k) for k, height in enumerate(heights)]
        return evaluation(rows, {"low": (wave(30),)})

    found = compare_methods({"a": [evaluated(1), evaluated(2)], "b": [evaluated(4), evaluated(3)]})
    assert found.methods["a"].scores == ((0.25,), (0.5,))
    assert found.methods["b"].scores == ((1.0,), (0.75,))


def test_scores_beyond_one_have_thresholds_too() -> None:
    found = compare_methods({"a": [-3.0, 5.0], "b": [2.0, 9.0]}, score="return")
    assert (found.thresholds[0], found.thresholds[-1]) == (-3.0, 9.0)
    assert str(found).startswith("return, a run for each training seed")


def test_what_is_drawn_has_seed_0_if_none_is_given() -> None:
    found = compared(resamples=200)
    assert found.seed == 0
    assert found == compared(resamples=200, seed=0)
    assert found != compared(resamples=200, seed=1)


def test_a_file_holds_all_of_it(tmp_path: Path) -> None:
    curves = {"plain": np.outer(PLAIN, [0.5, 1.0]), "shaped": np.outer(SHAPED, [0.5, 1.0])}
    found = compare_methods(curves, steps=[5, 10], confidence=0.9, resamples=500, seed=3)
    found.save(tmp_path / "methods.json")
    assert MethodComparison.load(tmp_path / "methods.json") == found


def test_the_table_fits_a_terminal_and_shows_the_least_run() -> None:
    lines = str(compare_methods({"plain": PLAIN, "shaped": SHAPED})).splitlines()
    assert lines[2].split()[:5] == ["method", "runs", "mean", "95", "%"]
    assert lines[-1].split()[:3] == ["shaped", "6", "0.842"]
    assert "0.2" in lines[-1].split()


@pytest.mark.parametrize("steps", [None, [1, 2]])
def test_a_picture_shows_it(steps: list[int] | None, tmp_path: Path) -> None:
    runs = {"plain": PLAIN, "shaped": SHAPED}
    curves = (
        runs if steps is None else {name: np.outer(each, [0.5, 1]) for name, each in runs.items()}
    )
    found = compare_methods(curves, steps=steps)
    found.plot(tmp_path / "methods.png")
    height, width, _ = imread(tmp_path / "methods.png").shape
    assert width > height * (1.8 if steps is None else 2.6)
    with pytest.raises(InputError, match=r"expected a name that ends in \.png"):
        found.plot(tmp_path / "methods.txt")


REFUSED: list[tuple[Any, dict[str, Any], str]] = [
    ({}, {}, "expected at least one method, got none"),
    ({"a": []}, {}, "expected a score for each run, shape (runs,), of 'a', got shape (0,)"),
    ({"a": {}}, {}, "expected at least one task of 'a', got none"),
    (
        {"a": [[0.1, 0.2]]},
        {},
        "expected a score for each run, shape (runs,), of 'a', got shape (1, 2)",
    ),
    (
        {"a": [0.1, 0.2]},
        {"steps": [1, 2, 3]},
        "expected a curve for each run, shape (runs, 3) as steps= has, of 'a', got shape (2,)",
    ),
    (
        {"a": [0.1, float("nan")]},
        {},
        (
            "expected finite scores of 'a', got nan or inf in run 1; give a failed run a score, "
            "such as 0"
        ),
    ),
    (
        {"a": {"x": [1.0]}, "b": {"y": [1.0]}},
        {},
        "expected the same tasks of all methods, got 'x' of 'a' and 'y' of 'b'",
    ),
    (
        {"a": {"x": [1.0], "y": [1.0, 0.5]}},
        {},
        (
            "expected as many runs of 'a' in each task, got {'x': 1, 'y': 2}; compare tasks with "
            "other numbers of runs separately"
        ),
    ),
    (
        {"plain": [0.1], "shaped": [0.2]},
        {"baseline": "plane"},
        "expected baseline= as a method ('plain', 'shaped'), got 'plane'; did you mean 'plain'?",
    ),
    (
        {"a": [0.1]},
        {"confidence": 95},
        "expected confidence= between 0 and 1, such as 0.95, got 95",
    ),
]


@pytest.mark.parametrize(("runs", "options", "message"), REFUSED, ids=range(len(REFUSED)))
def test_what_cannot_be_compared_is_refused(
    runs: Any,  # noqa: ANN401
    options: dict[str, Any],
    message: str,
) -> None:
    with pytest.raises(InputError) as caught:
        compare_methods(runs, **options)
    assert str(caught.value) == message


def test_runs_that_are_no_mapping_are_refused() -> None:
    runs: Any = [PLAIN, SHAPED]
    with pytest.raises(InputTypeError, match=r"expected the runs as a mapping, .* got list"):
        compare_methods(runs)
    words: Any = {"a": ["much"]}
    with pytest.raises(InputError, match="expected numbers for each run of 'a'"):
        compare_methods(words)
