"""Arrays of FMI 3.0, number by number: read, set and connected."""

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fmus import library, write_fmu
from hypothesis import given
from hypothesis import strategies as st

from rtamt import InputError
from rtamt_gym import Fmus, simulate
from rtamt_gym.systems.fmi_variables import start_values

LOW = "always(level < 999)"
GRID = [f"grid[{i}][{j}]" for i, j in itertools.product(range(2), range(3))]
SHOWN = [name.replace("grid", "shown") for name in GRID]


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmi3")
    return write_fmu(folder / "tank.fmu", library(3, folder), 3)


@pytest.fixture(scope="module")
def lone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a tank that is described, and cannot be run."""
    return write_fmu(tmp_path_factory.mktemp("lone") / "tank.fmu", None, 3)


def values(system: Fmus, *names: str) -> list[list[float]]:
    """Return the values of numbers without a name in formulas, over two steps."""
    signals = {f"at{k}": name for k, name in enumerate(names)}
    run = simulate(system, LOW, signals, duration=0.2)
    return [run.signals[name].tolist() for name in signals]


def test_every_number_of_an_array_is_read(tank: Path) -> None:
    first, second, third, level = values(Fmus(tank), "row[0]", "row[1]", "row[2]", "level")
    assert first == level
    assert second == [2 * x for x in level]
    assert third == [3 * x for x in level]
    assert len(set(level)) == 3


def test_numbers_may_be_read_in_any_order_and_twice(tank: Path) -> None:
    third, first, again = values(Fmus(tank), "tank.row[2]", "row[0]", "row[2]")
    assert third == again == [3 * x for x in first]


def test_a_formula_reads_a_number_by_a_signal(tank: Path) -> None:
    run = simulate(Fmus(tank), "always(deep < 2.8)", {"deep": "row[2]"}, duration=1)
    assert (run.ended, run.steps) == ("violation", 0)
    assert run.histories["spec"].final == 2.8 - 3.0


def test_all_types_are_read_with_what_they_start_with(tank: Path) -> None:
    names = "turns[0]", "turns[2]", "open[0]", "open[1]", "valves[1]", "grid[0][0]", "grid[1][2]"
    result = values(Fmus(tank), *names)
    assert [item[0] for item in result] == [4.0, 4.0, 0.0, 1.0, 0.0, 7.0, 0.0]


@given(st.dictionaries(st.sampled_from(GRID), st.floats(-9, 9)))
def test_a_matrix_is_set_row_by_row_and_keeps_the_rest(tank: Path, given: dict[str, float]) -> None:
    result = values(Fmus(tank, parameters=given), *SHOWN, *GRID)
    expected = [given.get(name, 7.0 if name == GRID[0] else 0.0) for name in GRID]
    assert [item[0] for item in result] == expected * 2


def test_inputs_of_every_type_are_set_beside_those_that_are_not(tank: Path) -> None:
    system = Fmus(tank, inputs={"turns[1]": 9, "open[0]": 1, "valves[1]": 0.5})
    names = "turns[0]", "turns[1]", "turns[2]", "open[0]", "open[1]", "valves[0]", "valves[1]"
    assert [item[2] for item in values(system, *names)] == [4.0, 9.0, 4.0, 1.0, 1.0, 0.0, 0.5]


def test_a_function_and_a_number_share_an_array(tank: Path) -> None:
    system = Fmus(tank, inputs={"valves[0]": lambda t: 5 * t, "valves[1]": 0.25})
    first, second, level = values(system, "valves[0]", "valves[1]", "level")
    assert (first, second) == ([0.0, 0.5, 1.0], [0.25] * 3)
    expected = [1.0]
    for valve in first[:2]:
        expected.append(expected[-1] + 0.1 * (1 * 0.0 + valve + 10 * 0.25 - 0.5 * expected[-1]))
    assert level == expected


def test_numbers_of_arrays_are_connected(tank: Path) -> None:
    wires: dict[str, Any] = {"b.valves[1]": "a.row[2]", "b.inflow": "a.row[1]", "a.valves[0]": 1}
    system = Fmus({"a": tank, "b": tank}, inputs=wires)
    run = simulate(system, "always(a.level < 99 and b.level < 99)", duration=1)
    a, b = [1.0], [1.0]
    for _ in range(10):
        b.append(b[-1] + 0.1 * (1 * 2 * a[-1] + 0.0 + 10 * (3 * a[-1]) - 0.5 * b[-1]) / 1.0)
        a.append(a[-1] + 0.1 * (0.0 + 1.0 - 0.5 * a[-1]) / 1.0)
    assert run.signals["a.level"].tolist() == a
    assert run.signals["b.level"].tolist() == b


def test_a_run_begins_anew_with_the_numbers_that_were_given(tank: Path) -> None:
    system = Fmus(tank, inputs={"valves[0]": lambda t: t}, parameters={"grid[1][1]": 3})
    assert values(system, *SHOWN, "level") == values(system, *SHOWN, "level")


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        ("row", "'row' is an array of 3 numbers, row[0] to row[2]; choose one element"),
        ("tank.grid", "'tank.grid' is an array of 2 x 3 numbers, tank.grid[0][0] to "),
        ("row[3]", "no 'row[3]': 'row' is an array of 3 numbers, row[0] to row[2]"),
        ("row[-1]", "no 'row[-1]': 'row' is an array of 3 numbers, row[0] to row[2]"),
        ("grid[1]", "no 'grid[1]': 'grid' is an array of 2 x 3 numbers, grid[0][0] to grid[1][2]"),
        ("grid[1,2]", "no variable 'grid[1,2]' in tank; did you mean 'grid'?"),
        ("row[0][0]", "no 'row[0][0]': 'row' is an array of 3 numbers, row[0] to row[2]"),
        ("level[0]", "no 'level[0]': 'level' is a single number"),
        ("rwo[0]", "no variable 'rwo[0]' in tank; did you mean 'row'?"),
    ],
)
def test_what_is_no_number_of_an_array_is_refused(lone: Path, signal: str, message: str) -> None:
    with pytest.raises(InputError) as refused:
        simulate(Fmus(lone), LOW, {"x": signal}, duration=1)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        (
            {"parameters": {"n": 3}},
            "'n' sets the size of arrays and cannot change from its start value 2",
        ),
        (
            {"parameters": {"grid": 1}},
            "'grid' is an array of 2 x 3 numbers, grid[0][0] to grid[1][2]; choose one element",
        ),
        ({"parameters": {"valves[0]": 1}}, "'valves[0]' is an input: give it in inputs="),
        (
            {"inputs": {"turns[0]": 0.5}},
            "expected a whole number for 'tank.turns[0]', a Int32, got 0.5",
        ),
        (
            {"inputs": {"turns[0]": "row[0]"}},
            "input 'tank.turns[0]' takes whole numbers, and 'tank.row[0]' is a Float64",
        ),
        (
            {"inputs": {"row[1]": 1}},
            "expected an input, got 'row[1]', which is of causality 'output'; the inputs are ",
        ),
    ],
)
def test_what_cannot_be_set_is_refused(lone: Path, named: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as refused:
        Fmus(lone, **named)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("kind", "start", "values"),
    [
        ("Float64", "1.5 -2 3e2", [1.5, -2.0, 300.0]),
        ("Float64", "0.5", [0.5] * 3),
        ("Int64", "9007199254740993 1 -2", [9007199254740993, 1, -2]),
        ("Boolean", "true false 1", [1, 0, 1]),
        ("Float64", None, [0.0] * 3),
    ],
)
def test_start_values_are_one_for_all_or_one_for_each(
    kind: str, start: str | None, values: list[float]
) -> None:
    array = SimpleNamespace(name="row", type=kind, start=start, shape=(3,))
    assert start_values(array) == values


def test_start_values_of_another_number_are_refused() -> None:
    array = SimpleNamespace(name="row", type="Float64", start="1 2", shape=(3,))
    with pytest.raises(InputError) as refused:
        start_values(array)
    assert str(refused.value) == "expected 3 start values of 'row' in its FMU, got 2"
