"""Tables of evaluations and comparisons, in a terminal of 80 columns."""

import math
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO

import pytest
from evaluations import FAILED, evaluation_of
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt_gym import compare
from rtamt_gym.evaluation.evaluation import evaluation_table, show
from rtamt_gym.results import Record
from rtamt_gym.results.trial import RunEnd

LONG = "never_closer_than_the_braking_distance_allows_at_any_time"


def test_an_evaluation_is_a_table_of_its_requirements() -> None:
    evaluation = evaluation_of(
        {"near": [0.5, -0.25, 1.0, 2.0], "slow": [1.0, 2.0, 3.0, math.inf]},
        seeds=[5, 6, 7, 8],
        policy="sb3:ppo.zip",
        rewards=[10.0, 20.0, 30.0, 40.0],
        decision={"near": "undecided after 4", "slow": "meets 0.9"},
    )
    assert str(evaluation).splitlines() == [
        "Task-v0 under sb3:ppo.zip",
        "4 episodes, seeds 5 to 8",
        "",
        "requirement  satisfied   95% interval  violated  minimum  median",
        "near             75.0%   19.4 to 99.4         1    -0.25     0.5",
        "slow            100.0%  39.8 to 100.0         0        1       2",
        "all              75.0%   19.4 to 99.4         1    -0.25     0.5",
        "minimum, median: of the robustness",
        "95% interval: holds the true rate in at least 95 of 100 evaluations",
        "",
        "near: always(near > 0)",
        "slow: always(slow > 0)",
        "",
        "worst seeds of near: 6 (-0.25), 5 (0.5), 7 (1)",
        "  violated at 2.5 s",
        "return 25 on average, length 5 s on average",
        "",
        "near: undecided after 4",
        "slow: meets 0.9",
    ]


def test_columns_of_open_and_failed_episodes_stand_where_there_are_some() -> None:
    mixed = evaluation_of({"near": [0.5, FAILED, 1.0]}, undecided=[2])
    assert evaluation_table(mixed).splitlines()[3:5] == [
        "requirement  satisfied  95% interval  violated  open  failed  minimum  median",
        "near             33.3%   0.8 to 90.6         0     1       1      0.5     0.5",
    ]
    assert evaluation_table(mixed).endswith(
        "1 of 3 episodes failed, which counts as not satisfied; the first with seed 1:\n"
        "  ValueError: no"
    )


def test_the_mean_return_leaves_out_episodes_that_failed() -> None:
    mixed = evaluation_of({"near": [0.5, FAILED, 1.0]}, rewards=[10.0, -500.0, 30.0])
    assert "return 20 on average, length 5 s on average" in evaluation_table(mixed).splitlines()
    failed = evaluation_of({"near": [FAILED, FAILED]}, rewards=[1.0, 2.0])
    assert "return" not in evaluation_table(failed)


def test_the_row_of_all_requirements_is_named_whole_beside_all_columns() -> None:
    heights = [-1.23456e-7, FAILED, -123456.7]
    mixed = evaluation_of({"near": heights, LONG: heights}, undecided=[2])
    _, head, _, long, every = evaluation_table(mixed).splitlines()[2:7]
    assert head.split()[-4:] == ["violated", "open", "failed", "median"]  # no space for the minimum
    assert "..." in long
    assert every.startswith("all  ")


@pytest.mark.parametrize(
    ("ended", "said"),
    [("violation", " (at the stop in 2 open episodes)"), ("truncated", ""), ("duration", "")],
)
def test_robustness_at_an_early_stop_of_open_episodes_is_marked(ended: RunEnd, said: str) -> None:
    made = evaluation_of({"near": [0.5, 2.0, 1.0], "slow": [0.5, 2.0, 1.0]}, undecided=[0, 2])
    rows = [replace(row, ended=ended) for row in made.record]
    stopped = replace(made, record=Record(rows, made.record.requirements, made.system))
    assert f"minimum, median: of the robustness{said}" in str(stopped).splitlines()


def test_an_evaluation_whose_episodes_all_failed_has_a_table() -> None:
    failed = evaluation_of({"near": [FAILED, FAILED]})
    assert evaluation_table(failed).splitlines()[3:5] == [
        "requirement  satisfied  95% interval  violated  failed  minimum  median",
        "near              0.0%   0.0 to 84.2         0       2        -       -",
    ]


names = st.lists(
    st.text("abc_", min_size=1, max_size=60).filter(str.isidentifier),
    min_size=1,
    max_size=4,
    unique=True,
)
values = st.sampled_from([-math.inf, -1.23456e-7, -123456.0, 0.0, 1e300, math.inf, FAILED])


@settings(max_examples=examples(30))
@given(names, st.data())
def test_every_line_fits_80_columns(names: list[str], data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 5))
    rows = {name: data.draw(st.lists(values, min_size=count, max_size=count)) for name in names}
    evaluation = evaluation_of(
        rows, policy="module.of.a.rather.long.path:function_of_a_rather_long_name" * 2
    )
    for text in (str(evaluation), str(compare(evaluation, evaluation))):
        assert max(map(len, text.splitlines())) <= 80
        assert "\x1b" not in text


def test_long_names_and_formulas_are_shortened_with_a_mark() -> None:
    evaluation = evaluation_of({LONG: [1.0, -1.0]}, formulas={LONG: "always(gap > 1) and " * 9})
    lines = str(evaluation).splitlines()
    assert lines[4].startswith("never_closer_than_the_bra...")
    assert "..." in lines[4]
    assert lines[8].endswith("...")


def test_what_is_shown_in_a_pipe_is_the_plain_text() -> None:
    evaluation = evaluation_of({"near": [1.0, -1.0], "slow[0]": [1.0, 1.0]})
    file = StringIO()
    with redirect_stdout(file):
        show(evaluation)
    assert file.getvalue() == f"{evaluation}\n"


def test_a_comparison_is_a_table_and_sentences() -> None:
    a = evaluation_of({"near": [-1.0] * 30 + [1.0] * 70}, policy="old")
    b = evaluation_of({"near": [-1.0] * 5 + [2.0] * 95}, policy="new")
    assert str(compare(a, b)).splitlines() == [
        "A: old",
        "B: new",
        "Task-v0, 100 pairs of episodes, seeds 0 to 99",
        "",
        "requirement    A    B  B - A         95%       p  robustness           95%",
        "near         70%  95%    +25  +18 to +34  <0.001        +1.4  +1.3 to +1.6",
        "",
        "B satisfies `near` in 25 points more of the episodes (95%: 18 to 34; p < 0.001).",
        "Its robustness is 1.45 greater on average (95%: 1.28 to 1.64).",
    ]
