"""Truths on traces that change seldom, against the same traces sample by sample."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import formulas

from rtamt import Formula, parse
from rtamt.checking.encoding import World, change_times, truth, truth_of_runs
from rtamt.checking.graph import FALSE, TRUE, Graph, known_samples
from rtamt.language.specification import Specification
from rtamt.program.lowering import compile_program

VALUES = st.sampled_from([-1.0, -0.0, 0.0, 1.0, 2.5])


@given(formula=formulas(depth=3, endless=True), data=st.data())
def test_truths_of_runs_are_those_of_all_samples(formula: Formula, data: st.DataObject) -> None:
    lengths = data.draw(st.lists(st.integers(1, 5), min_size=1, max_size=4))
    times = [0, *itertools.accumulate(lengths[:-1])]
    columns: dict[str, list[float]] = {}
    for name in formula.variables:
        runs = [data.draw(VALUES) for _ in lengths]
        columns[name] = [value for value, n in zip(runs, lengths, strict=True) for _ in range(n)]
    program = compile_program(Specification.of(formula))
    found = truth_of_runs(Graph(), known_samples(columns), program, times)
    expected = truth(Graph(), known_samples(columns), program, sum(lengths), World.ENDLESS, loop=1)
    assert found in {TRUE, FALSE}
    assert found == expected


@pytest.mark.parametrize(
    ("text", "times"),
    [
        ("x > 0", [[0], [0, 1]]),
        ("always[0:100](x > 0)", [[0], [0, 1, 100, 101], [0, 1, 50, 100, 101]]),
        ("eventually[10:40](always[0:100](x > 0))", [[0], [0, 1, 10, 11, 40, 41, 110, 111, 140]]),
    ],
)
def test_traces_change_where_windows_begin_and_end(text: str, times: list[list[int]]) -> None:
    program = compile_program(parse(text))
    found = [*map(list, change_times([program], 141))]
    assert found[: len(times)] == times
    assert all(each == sorted({*each}) and each[-1] < 141 for each in found)


def test_a_trace_of_one_sample_does_not_change() -> None:
    assert [*change_times([compile_program(parse("always[0:100](x > 0)"))], 1)] == [(0,)]


def test_of_many_corners_some_are_tried() -> None:
    text = "x > 0"
    for power in range(9):
        text = f"eventually[{2**power}:{3**power + 2**power}]({text})"
    program = compile_program(parse(text))
    most = 1 + sum(3**power + 2**power for power in range(9))
    found = [*map(list, change_times([program], most))]
    assert found[0] == [0]
    assert all(each == sorted({*each}) and each[-1] < most for each in found)
    assert 64 <= len(found[1]) <= 129
    assert found[1][-1] > most // 2
