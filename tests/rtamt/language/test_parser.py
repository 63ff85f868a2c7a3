"""Formulas in text: spellings, precedence, intervals, chains and limits."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
import threading
from fractions import Fraction
from pathlib import Path

import pytest

import rtamt
from rtamt import Formula, Interval, ParseError, Specification, variable
from rtamt.errors import InputTypeError
from rtamt.language.formula import make
from rtamt.language.node import MAX_DEPTH
from rtamt.language.operators import OPERATORS, Operator
from rtamt.language.parser import as_specification, parse_as


def formula(text: str) -> Formula:
    return rtamt.parse(text).formula


# Spellings. --------------------------------------------------------------------------------------


def written(row: Operator, spelling: str) -> str:
    operands = ["a", "b", "c"][: row.arity[0]]
    match row.notation:
        case "infix":
            return f"a {spelling} b"
        case "prefix":
            return f"{spelling} a"
        case "call":
            return f"{spelling}({', '.join(operands)})"
        case "atom":
            return spelling


@pytest.mark.parametrize(
    ("spelling", "row"),
    [(spelling, row) for (spelling, _), row in OPERATORS.spellings.items() if row.name != "value"],
)
def test_every_spelling_of_every_row_is_that_operator(spelling: str, row: Operator) -> None:
    operands = tuple(variable(name) for name in ("a", "b")[: row.arity[0]])
    node = make(row.name, operands)
    expected = node if isinstance(node, Formula) else make("value", (node,))
    assert formula(written(row, spelling)) is expected
    if row.timed:
        timed = make(row.name, operands, Interval.of(1, 2))
        assert formula(written(row, spelling + "[1:2]")) is timed


@pytest.mark.parametrize(
    "name", ["s", "ms", "x1", "_x", "cmd.linear.x", "Gx", "e5", "topic", "a.G", "a.min"]
)
def test_units_can_name_variables(name: str) -> None:
    assert rtamt.parse(f"G[0:5 s]({name} > 0)").variables == (name,)


@pytest.mark.parametrize("text", ["5", "5.", ".5", "0.5", "5e0", "5E+3", "1e-3", ".5e1", "007"])
def test_numbers(text: str) -> None:
    assert formula(f"x > {text}") is (variable("x") > float(text))


@pytest.mark.parametrize("text", ["a<-3", "a < -3", "a < - 3", "a<(-3)", "a < -(3)"])
def test_a_minus_before_a_number_is_its_sign(text: str) -> None:
    assert formula(text) is (variable("a") < -3)


# Precedence. -------------------------------------------------------------------------------------

PRECEDENCE = """
- a * b > 0               = ((-a) * b) > 0
a + b * c > 0             = (a + (b * c)) > 0
a - b - c > 0             = ((a - b) - c) > 0
a - b + c > 0             = ((a - b) + c) > 0
a / b / c > 0             = ((a / b) / c) > 0
a / b * c > 0             = ((a / b) * c) > 0
a * b + c / d - e > 0     = (((a * b) + (c / d)) - e) > 0
a - -b > 0                = (a - (-b)) > 0
--a > 0                   = (-(-a)) > 0
a + 1 >= b * 2            = (a + 1) >= (b * 2)
not a > 0                 = not (a > 0)
not not a > 0             = not (not (a > 0))
!a & !b                   = (not a) and (not b)
G a > 0 and b > 0         = (G (a > 0)) and (b > 0)
G not a and b             = (G (not a)) and b
G F a until b             = (G (F a)) until b
not a until b             = (not a) until b
a until not b             = a until (not b)
a until G b and c         = (a until (G b)) and c
a and b until c or d      = (a and (b until c)) or d
a or b and c              = a or (b and c)
a and b or c and d        = (a and b) or (c and d)
a or b implies c or d     = (a or b) implies (c or d)
a implies b iff c         = (a implies b) iff c
a iff b implies c         = a iff (b implies c)
a iff b iff c             = (a iff b) iff c
a xor b iff c             = a xor (b iff c)
a xor b xor c             = (a xor b) xor c
next a > 0 until prev b   = (next (a > 0)) until (prev b)
G[0:5] a[.] > 0           = G[0:5] (a[.] > 0)
rise(a > 0 and b) or c    = (rise((a > 0) and b)) or c
G x                       = G (x)
G (a) > 0                 = G (a > 0)
abs(a - b) - c <= d       = ((abs(a - b)) - c) <= d
a and (b and c) and d     = a and b and c and d
(a or b) or (c or d)      = a or b or c or d
(a + b) + c > 0           = a + b + c > 0
""".replace("[.]", ".x")


@pytest.mark.parametrize("line", PRECEDENCE.strip().splitlines())
def test_precedence(line: str) -> None:
    loose, tight = re.split(r"\s+=\s", line)
    assert formula(loose) is formula(tight)


def test_operands_of_functions_are_whole_expressions() -> None:
    a, b = variable("a"), variable("b")
    assert formula("min(a + 1, -b, max(a, b)) > 0") is ((a + 1).min(-b, a.max(b)) > 0)
    assert formula("pow(a, 2) > log(b, 10)") is (a**2 > b.log(10))


# Intervals. --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "begin", "end", "unit"),
    [
        ("[1:2]", "1", "2", None),
        ("[1,2]", "1", "2", None),
        ("[ 1 : 2 ]", "1", "2", None),
        ("[0.1:0.3]", "0.1", "0.3", None),
        ("[1e-3:1e3]", "0.001", "1000", None),
        ("[1:2s]", "1", "2", "s"),
        ("[1:2 ms]", "1", "2", "ms"),
        ("[1us:2us]", "1", "2", "us"),
        ("[1ms:2s]", "0.001", "2", "s"),
        ("[0ns:2ps]", "0", "2", "ps"),
        ("[1:inf]", "1", None, None),
        ("[1,)", "1", None, None),
        ("[1:)", "1", None, None),
        ("[1:inf)", "1", None, None),
        ("[1:inf ms]", "1", None, "ms"),
        ("[1ms:inf]", "1", None, "ms"),
        ("[1s,)", "1", None, "s"),
        ("[K:M]", "0.5", "7", None),
        ("[K:M ms]", "0.5", "7", "ms"),
        ("[-N:M]", "3", "7", None),
        ("[K:1]", "0.5", "1", None),
        ("[\n1\n:\n2\n]\n", "1", "2", None),
    ],
)
def test_intervals(text: str, begin: str, end: str | None, unit: str | None) -> None:
    constants = "const float K = 0.5; const int M = 7; const int N = -3;"
    expected = Interval(Fraction(begin), None if end is None else Fraction(end), unit)
    for operator in ("always", "once", "a until"):
        assert formula(f"{constants} {operator}{text} b").interval == expected


@pytest.mark.parametrize("text", ["", "[0:inf]", "[0,)", "[0:inf ms]", "[0s:inf]", "[Z,)"])
def test_an_interval_without_bounds_is_none(text: str) -> None:
    assert formula(f"const int Z = 0; always{text} x") is formula("always x")


def test_units_are_thousandths_of_each_other() -> None:
    units = ["s", "ms", "us", "ns", "ps"]
    for number, unit in enumerate(units):
        for smaller, finer in enumerate(units[number:]):
            begin = 3 * 1000**smaller
            read = formula(f"always[{begin}{finer}:5{unit}](x > 0)").interval
            assert read == Interval(Fraction(3), Fraction(5), unit)


def test_bounds_are_exact() -> None:
    interval = formula("G[0.1:0.30000000000000000001] x").interval
    assert interval is not None
    assert interval.end == Fraction(30000000000000000001, 10**20)
    override = rtamt.parse("G[0:K] x", constants={"K": Fraction(1, 8)}).formula.interval
    assert override is not None
    assert override.end == Fraction(1, 8)


# The door. ---------------------------------------------------------------------------------------


def test_parsing_is_cached_by_text_and_arguments() -> None:
    text = "always(cached > 0)"
    assert rtamt.parse(text) is rtamt.parse(text)
    assert rtamt.parse(text) is not rtamt.parse(text, unit="ms")
    text = "always(cached > K)"
    assert rtamt.parse(text, constants={"K": 1}) is rtamt.parse(text, constants={"K": 1.0})
    assert rtamt.parse(text, constants={"K": 1}) is not rtamt.parse(text, constants={"K": 2})


def test_load_reads_a_file(tmp_path: Path) -> None:
    path = tmp_path / "req.stl"
    path.write_bytes("\ufeffx > 0 // größer\r\n".encode())
    assert rtamt.load(path) == rtamt.load(str(path)) == rtamt.parse("x > 0")


def test_as_specification() -> None:
    spec = rtamt.parse("always(x > 0)")
    assert as_specification(spec) is spec
    assert as_specification("always(x > 0)") is spec
    assert as_specification(spec.formula) == spec
    with pytest.raises(InputTypeError, match="text, Formula or Specification, got NoneType"):
        as_specification(None)  # type: ignore[arg-type]


def test_errors_of_a_file_name_it(tmp_path: Path) -> None:
    path = tmp_path / "bad.stl"
    path.write_text("always(x >", encoding="utf-8")
    with pytest.raises(rtamt.ParseError) as caught:
        rtamt.load(path)
    assert caught.value.__notes__ == [f"in {path}"]
    path.write_bytes(b"x > 0 // \xe4")
    with pytest.raises(rtamt.SpecificationError) as undecoded:
        rtamt.load(path)
    assert str(undecoded.value) == f"expected UTF-8 text in {path}, got the byte 0xe4"


def test_the_package_loads_no_parser_before_it_is_needed() -> None:
    code = (
        "import sys, rtamt; assert not any('antlr4' in m for m in sys.modules);"
        "rtamt.parse('x'); assert 'antlr4' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_threads_may_parse_at_the_same_time() -> None:
    texts = [f"G[0:{i}] (thread_{i} > {i}) and not (y until[0:{i}] z)" for i in range(1, 200)]
    failures: list[str] = []

    def run(own: list[str]) -> None:
        failures.extend(t for t in own if formula(str(formula(t))) is not formula(t))

    threads = [threading.Thread(target=run, args=(texts[i::8],)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


def test_deepest_nesting_parses_deep_inside_a_program() -> None:
    """Two calls per bracket: 200 brackets fit into the default recursion limit, 300 calls down."""
    texts = [
        "(" * MAX_DEPTH + "x" + ")" * MAX_DEPTH,
        "not (" * (MAX_DEPTH - 2) + "x" + ")" * (MAX_DEPTH - 2),
        "rise(" * (MAX_DEPTH - 2) + "x" + ")" * (MAX_DEPTH - 2),
        "not " * (MAX_DEPTH - 2) + "x",
    ]

    def down(calls: int) -> list[Specification]:
        return down(calls - 1) if calls else [rtamt.parse(t) for t in texts]

    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(1000)
    try:
        specs = down(300)
    finally:
        sys.setrecursionlimit(limit)
    assert [s.formula.depth for s in specs] == [2, MAX_DEPTH, MAX_DEPTH, MAX_DEPTH]


def test_ten_thousand_conjuncts_are_one_node() -> None:
    spec = rtamt.parse(" and ".join(f"x > {i}" for i in range(10_000)))
    assert len(spec.formula.args) == 10_000
    assert spec.formula.depth == 3
    assert rtamt.parse(str(spec)).formula is spec.formula


def test_missing_file_error(tmp_path: Path) -> None:
    (tmp_path / "speed.stl").write_text("always(x > 0)")
    missing = tmp_path / "sped.stl"
    with pytest.raises(rtamt.InputError, match=r"sped\.stl: .*; did you mean 'speed\.stl'\?") as at:
        rtamt.load(missing)
    assert isinstance(at.value, FileNotFoundError)
    assert at.value.filename == str(missing)
    assert str(pickle.loads(pickle.dumps(at.value))) == str(at.value)
    with pytest.raises(FileNotFoundError):
        rtamt.load("nowhere/at/all.stl")


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("always[0:5min](x > 0)", "always[0:5min](x > 0)"),
        ("always[0.5:2 h](x > 0)", "always[0.5:2h](x > 0)"),
        ("always[1h:2h](min(x, y) > 0)", "always[1:2h](min(x, y) > 0)"),
        # Ten seconds are not a decimal number of minutes, so both bounds get the unit of the start.
        ("always[10s:1min](x > 0)", "always[10:60s](x > 0)"),
        ("always[1min:2h](x > 0)", "always[1:120min](x > 0)"),
        ("always[1min:90s](x > 0)", "always[60:90s](x > 0)"),
        # Without a number directly before it, the name is a constant.
        ("const float h = 3; always[0:h](x > 0)", "always[0:3](x > 0)"),
        ("const float h = 3; always[0:h h](x > 0)", "always[0:3h](x > 0)"),
        ("const float min = 3; always[min:5min](x > 0)", "always[3:5min](x > 0)"),
        ("always[0:1h](h > min)", "always[0:1h](h > min)"),
    ],
)
def test_minutes_and_hours(text: str, printed: str) -> None:
    formula = rtamt.parse(text).formula
    assert str(formula) == printed
    assert rtamt.parse(printed).formula is formula


def test_bounds_in_minutes_are_exact() -> None:
    trace = {"x": [1.0] * 7 + [-1.0]}
    longest, beyond = (
        rtamt.evaluate(f"always[0:{end}](x > 0)", trace, period=10)[0] for end in ("1min", "1.5min")
    )
    assert (longest, beyond) == (1.0, -1.0)
    with pytest.raises(rtamt.ParseError, match="use 10 s or 20 s, take samples 5 s apart"):
        rtamt.evaluate("always[0:0.25min](x > 0)", trace, period=10)


@pytest.mark.parametrize(
    ("text", "grouped"),
    [
        ("p > 0 -> q > 0 -> r > 0 -> s > 0", "((p > 0 -> q > 0) -> r > 0) -> s > 0"),
        ("p -> q or r -> s", "(p -> (q or r)) -> s"),
        ("p until[0:2] q until r", "(p until[0:2] q) until r"),
        ("p since q unless[1:2] r", "(p since q) unless[1:2] r"),
        ("always p -> q -> (r -> s -> t)", "(always p -> q) -> ((r -> s) -> t)"),
    ],
)
def test_chains_group_to_the_left_where_they_are_allowed(text: str, grouped: str) -> None:
    spec = parse_as(text, "s", {}, {}, chains=True)
    assert spec.formula is rtamt.parse(grouped).formula
    assert rtamt.parse(str(spec)) == spec
    assert pickle.loads(pickle.dumps(spec)) == spec
    with pytest.raises(ParseError, match="not chain; write"):
        rtamt.parse(text)


def test_comparisons_never_chain() -> None:
    with pytest.raises(ParseError, match=r"'<' does not chain; write \(a < b\) and \(b < c\)"):
        parse_as("a < b < c", "s", {}, {}, chains=True)


def test_dialect_pickles() -> None:
    text = "const float K = 2; p = x > K -> y > K -> z > L"
    spec = parse_as(text, "ms", {"L": 3, "unused": 4}, {}, chains=True)
    again = pickle.loads(pickle.dumps(spec))
    assert (again, again.text, again.unit, again.chains) == (spec, text, "ms", True)
    assert again.constants == {"K": 2.0, "L": 3.0}
