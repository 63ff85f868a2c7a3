"""The laws of lattice folds hold for every row, and the check finds folds that break them."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fold_laws import broken_law, broken_relation, reads_one_number

from rtamt import parse
from rtamt.program.algebra import FOLDS, FUNCTIONS, LatticeFold, greater, lesser
from rtamt.program.interface import STANDARD
from rtamt.program.lowering import ProgramBuilder

INF = math.inf
NUMBERS = (-INF, -2.5, -0.0, 0.0, 1.0, INF)

Numbers = tuple[Any, ...]
Combine = Callable[[Numbers, Numbers], Numbers]


def row(
    name: str,
    combine: Combine,
    identity: Numbers = (INF,),
    mirror: str | None = None,
    dual: str | None = None,
    arrays: Combine | None = None,
) -> LatticeFold:
    """Return a row whose functions accept numbers and arrays."""
    width = len(identity)
    return LatticeFold(
        name,
        width,
        identity,
        mirror or name,
        dual or name,
        combine,
        arrays or combine,
        lambda _lesser, _greater: combine,
    )


def least(x: Numbers, y: Numbers) -> Numbers:
    return (lesser(x[0], y[0]),)


def agm(x: Any, y: Any) -> Any:  # noqa: ANN401 - numbers or arrays
    """The arithmetic-geometric mean robustness of a conjunction (Mehdipour et al., ACC 2019)."""
    positive = np.sqrt((1 + np.maximum(x, 0)) * (1 + np.maximum(y, 0))) - 1
    negative = (np.where(x <= 0, x, 0.0) + np.where(y <= 0, y, 0.0)) / 2
    return np.where(np.minimum(x, y) > 0, positive, negative)


@pytest.mark.parametrize("fold", FOLDS.values(), ids=FOLDS)
def test_laws_of_each_fold(fold: LatticeFold) -> None:
    assert broken_law(fold) is None


def test_duals_and_mirrors_of_the_table() -> None:
    assert broken_relation(FOLDS.values()) is None
    assert all(name == fold.name for name, fold in FOLDS.items())


@pytest.mark.parametrize(
    ("name", "combine", "identity", "reason"),
    [
        (
            "sum",
            lambda x, y: (x[0] + y[0],),
            (0.0,),
            "it is not idempotent (of 2.0 twice it makes 4.0)",
        ),
        (
            "mean",
            lambda x, y: ((x[0] + y[0]) / 2,),
            (0.0,),
            "it does not choose among the numbers of its elements (of 2.0 and 3.0 it makes 2.5)",
        ),
        # The mean as a monoid: the sum and the number of the elements.
        (
            "mean",
            lambda x, y: (x[0] + y[0], x[1] + y[1]),
            (0.0, 0.0),
            "it is not idempotent (of (2.0, 2.0) twice it makes (4.0, 4.0))",
        ),
        (
            "agm",
            lambda x, y: (agm(x[0], y[0]),),
            (INF,),
            (
                "it does not choose among the numbers of its elements "
                "(of 2.0 and 3.0 it makes 2.4641016151377544)"
            ),
        ),
        (
            "farthest",
            lambda x, y: (np.where(np.abs(x[0]) >= np.abs(y[0]), x[0], y[0]),),
            (0.0,),
            "it does not act on each threshold by itself (of 2.0 and -inf it makes -inf)",
        ),
        # Without an order of zeros.
        (
            "min",
            lambda x, y: (np.where(x[0] <= y[0], x[0], y[0]),),
            (INF,),
            "it does not act on each threshold by itself (of 0.0 and -0.0 it makes 0.0)",
        ),
        (
            "max",
            lambda x, y: (np.where(x[0] >= y[0], x[0], y[0]),),
            (-INF,),
            "it does not act on each threshold by itself (of -0.0 and 0.0 it makes -0.0)",
        ),
        ("min", least, (0.0,), "(0.0,) is not its identity"),
        ("latest", lambda _, y: y, (INF,), "(inf,) is not its identity"),
        (
            "max",
            lambda x, y: (greater(x[0], y[0]), greater(lesser(x[0], x[1]), y[1])),
            (-INF, -INF),
            "(-inf, -inf) is not its identity",
        ),
        (
            "held",
            lambda x, y: (
                greater(x[0], y[0]),
                greater(lesser(x[1], y[1]), lesser(lesser(x[0], x[1]), y[0])),
            ),
            (-INF, INF),
            "it is not associative",
        ),
    ],
)
def test_check_finds_the_broken_law(
    name: str, combine: Combine, identity: Numbers, reason: str
) -> None:
    assert broken_law(row(name, combine, identity)) == reason


def test_check_compares_numbers_with_arrays() -> None:
    fold = row("min", lambda x, y: (max(x[0], y[0]),), (INF,), arrays=least)
    assert broken_law(fold) == "combine and combine_arrays differ"


def test_check_compares_every_pair_of_a_fold_of_one_operand() -> None:
    numbers = (2.0, 3.0, -1.0, -0.0, 0.0, -INF, INF)
    for pair in itertools.permutations(numbers, 2):

        def combine(x: Numbers, y: Numbers, pair: Numbers = pair) -> Numbers:
            wrong = str((x[0], y[0])) == str(pair)
            return (5.0,) if wrong else FOLDS["min"].combine(x, y)

        fold = row("min", combine, arrays=least)
        assert broken_law(fold) == "combine and combine_arrays differ"


def test_check_finds_a_wrong_dual_and_a_wrong_mirror() -> None:
    assert broken_relation([row("min", least)]) == "'min' is not the dual of 'min'"
    until, release = FOLDS["until"], FOLDS["release"]
    crooked = LatticeFold(
        "until",
        2,
        until.identity,
        "until",
        "release",
        until.combine,
        until.combine_arrays,
        until.made,
    )
    table = [crooked, release, FOLDS["since"], FOLDS["trigger"]]
    assert broken_relation(table) == "'until' is not the mirror of 'until'"


def test_check_finds_a_fold_that_needs_two_numbers_of_the_future() -> None:
    def joined(x: Numbers, y: Numbers) -> Numbers:
        both = greater(lesser(x[0], x[1]), lesser(y[0], y[1]))
        return greater(x[0], y[0]), greater(both, lesser(x[1], y[1]))

    def opposite(x: Numbers, y: Numbers) -> Numbers:
        both = lesser(greater(x[0], x[1]), greater(y[0], y[1]))
        return lesser(x[0], y[0]), lesser(both, greater(x[1], y[1]))

    rows = (
        row("joined", joined, (-INF, INF), "joined", "opposite"),
        row("opposite", opposite, (INF, -INF), "opposite", "joined"),
    )
    assert broken_relation(rows) == (
        "'joined' and its mirror read more than the last number of a younger element"
    )


@pytest.mark.parametrize("name", FOLDS)
def test_what_is_still_to_come_is_one_number_for_a_fold_or_its_mirror(name: str) -> None:
    assert reads_one_number(FOLDS[name]) == (name not in {"since", "trigger"})


def test_an_operator_folds_by_a_row_of_the_table() -> None:
    builder = ProgramBuilder(parse("x > 0"), None, STANDARD)
    with pytest.raises(AssertionError) as refused:
        builder.window("mean", 0, 3, 0)
    assert str(refused.value) == (
        "'mean' is not a lattice fold: expected min, max, until, release, since, trigger; for "
        "others see the laws in rtamt/program/algebra.py"
    )


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "pow"])
def test_function_of_nan_is_nan(name: str) -> None:
    """Any other function is named in rtamt/native/discrete/columns.hpp, like pow."""
    function = FUNCTIONS[name]
    for place in range(function.arity):
        for number in (0.0, -0.0, 1.0, -2.0, math.inf, -math.inf):
            operands = [number] * function.arity
            operands[place] = math.nan
            assert math.isnan(function.apply(*operands)), operands
