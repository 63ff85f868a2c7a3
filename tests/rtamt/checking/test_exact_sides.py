"""Comparisons that the solver simplifies hold for the same doubles as the written ones."""

import itertools
import math
from typing import cast

import pytest

import rtamt
from rtamt.checking.graph import TermKey, exact_sides
from rtamt.program.algebra import FUNCTIONS

X: TermKey = ("load", "x", 0)
Y: TermKey = ("load", "y", 0)
DOUBLES = [
    *(0.0, -0.0, 5e-324, -5e-324, 2.0**-1022 - 5e-324, 2.0**-1022, 2.0**-1021),
    *(0.5, -0.5, 1.0, 3.0, math.nextafter(0.5, 0), 1.7976931348623157e308, -1.7976931348623157e308),
]
TERMS: list[TermKey] = [
    *(("sub", X, Y), ("add", X, Y), ("neg", X)),
    *((f, X, ("const", k)) for f in ("mul", "div") for k in (2.0, 0.5, -4.0, 3.0, 2.0**-1000)),
    *(("mul", ("const", 2.0), ("sub", X, Y)), ("neg", ("mul", ("const", -2.0), X))),
]


def value(term: TermKey, x: float, y: float) -> float:
    function, *parts = term
    if function == "load":
        return x if parts[0] == "x" else y
    if function == "const":
        return cast("float", parts[0])
    operands = (value(cast("TermKey", part), x, y) for part in parts)
    return FUNCTIONS[cast("str", function)].apply(*operands)


@pytest.mark.parametrize("term", TERMS, ids=str)
def test_exact_sides_compare_as_before(term: TermKey) -> None:
    for number, turned in itertools.product(DOUBLES, (False, True)):
        sides = (("const", number), term) if turned else (term, ("const", number))
        made = exact_sides(*sides)
        for x, y in itertools.product(DOUBLES, DOUBLES):
            a, b = (value(side, x, y) for side in sides)
            c, d = (value(side, x, y) for side in made)
            assert (a >= b, a == b) == (c >= d, c == d), (number, x, y, made)


@pytest.mark.parametrize(
    ("one", "other", "answer"),
    [
        ("2 * x > 1", "x > 0.5", "yes"),
        ("x - y > 0", "x > y", "yes"),
        ("0 <= x - y", "not (x < y)", "yes"),
        ("-4 * x == 2", "x == -0.5", "yes"),
        ("always(2 * (x - y) > 0)", "always(x > y)", "yes"),
        ("x + y > 0", "x > -y", "yes"),
        ("x / 4 > 1", "x > 4", "yes"),
        # Half of the least double above 0 is 0; 3 * x and x - y are rounded.
        ("0.5 * x > 0", "x > 0", "unknown"),
        ("3 * x > 1.5", "x > 0.5", "unknown"),
        ("x - y > 1", "x > y + 1", "unknown"),
        ("2 * x > 1", "x > 0.6", "no"),
    ],
)
def test_equivalence_of_exact_terms(one: str, other: str, answer: str) -> None:
    pytest.importorskip("z3")
    assert rtamt.equivalent(one, other).says == answer
