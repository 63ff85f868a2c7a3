"""The table of operators, its words in the grammar, and rows as all that a new operator needs."""

from __future__ import annotations

import dataclasses
import math
import random
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Literal, cast

import pytest
from paths import ROOT

import rtamt
from rtamt import Formula, Term, variable
from rtamt.errors import ParseError, SpecificationError
from rtamt.language import parser
from rtamt.language.formula import make
from rtamt.language.operators import KEYWORDS, OPERATORS, Operator, _function
from rtamt.program.algebra import FUNCTIONS, Function, monotone

Add = Callable[[Operator], None]

GRAMMAR = ROOT / "rtamt" / "language" / "grammar"

LATER = Operator(
    ("later", "lX"),
    "prefix",
    7,
    "p(i+1); at the last sample +inf",
    lambda b, p: b.window("min", 1, 1, p),
    sampled=True,
    future=True,
)
NAND = Operator(
    ("nand",), "infix", 5, "-min(p, q)", lambda b, p, q: b.map("neg", b.map("min", p, q)), (2, 2)
)
REGAINED = Operator(
    ("regained",),
    "infix",
    6,
    "not p until[a:b] always[a:b] q",
    lambda b, bounds, p, q: b.until(bounds, b.map("neg", p), b.window("min", *bounds, q)),
    (2, 2),
    timed=True,
    future=True,
)
RETAINED = Operator(
    ("retained",),
    "infix",
    6,
    "once[a:b] p since[a:b] (eventually[a:b] q and q)",
    lambda b, bounds, p, q: b.since(
        bounds,
        b.window("max", -bounds[1], -bounds[0], p),
        b.map("min", b.window("max", *bounds, q), q),
    ),
    (2, 2),
    timed=True,
    future=True,
)
LASTING = Operator(
    ("lasting",),
    "infix",
    6,
    "always[a:b] (p until[a:b] q)",
    lambda b, bounds, p, q: b.window("min", *bounds, b.until(bounds, p, q)),
    (2, 2),
    timed=True,
    future=True,
)
LASTED = Operator(
    ("lasted",),
    "infix",
    6,
    "once[a:b] (p since[a:b] not (q and true))",
    lambda b, bounds, p, q: b.window(
        "max",
        -bounds[1],
        -bounds[0],
        b.since(bounds, p, b.map("neg", b.map("min", q, b.constant(math.inf)))),
    ),
    (2, 2),
    timed=True,
)
TWICE = _function("twice", "2 x")

x, y = variable("x"), variable("y")
TRACE = {"x": [1.0, 3.0, -2.0, 0.5], "y": [0.0, 2.0, 4.0, -1.0]}


@pytest.fixture
def add() -> Iterator[Add]:
    """Add a row to the table until the end of the test."""
    rows = tuple(OPERATORS.values())
    yield lambda row: OPERATORS.replace((*rows, row))
    OPERATORS.replace(rows)
    parser._cached.cache_clear()


def formula(text: str) -> Formula:
    return rtamt.parse(text).formula


@pytest.mark.parametrize("backend", ["python", "auto"])
def test_an_operator_is_one_row(add: Add, backend: Literal["python", "auto"]) -> None:
    add(LATER)
    built = cast("Formula", make("later", (x > 1,)))
    assert formula("later(x > 1)") is formula("lX x > 1") is built
    assert str(built & (y > 0)) == "later(x > 1) and y > 0"
    assert formula(str(built.always(0, 2))) is built.always(0, 2)
    assert rtamt.parse("always[0:2] later(x > 1)").horizon == 3
    values = rtamt.evaluate(built, TRACE, backend=backend)
    assert values.tolist() == [2.0, -3.0, -0.5, math.inf]
    explanation = rtamt.explain(built, TRACE, sample=1, backend=backend)
    assert [(str(step.formula), step.sample) for step in explanation.steps] == [
        ("later(x > 1)", 1),
        ("x > 1", 2),
    ]
    with pytest.raises(ParseError, match="did you mean 'later'"):
        formula("lather(x > 1)")
    with pytest.raises(SpecificationError, match="'lX' is the operator 'later' and cannot name"):
        variable("lX")
    with pytest.raises(ParseError, match="'later' reads the next or previous sample"):
        rtamt.dense.Monitor("later(x > 1)")


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize(
    ("row", "spelled"),
    [
        (REGAINED, "not (x > 0) until[{0}:{1}] always[{0}:{1}](y > 0)"),
        (RETAINED, "once[{0}:{1}](x > 0) since[{0}:{1}] (eventually[{0}:{1}](y > 0) and y > 0)"),
        (LASTING, "always[{0}:{1}](x > 0 until[{0}:{1}] y > 0)"),
        (LASTED, "once[{0}:{1}](x > 0 since[{0}:{1}] not (y > 0))"),
    ],
    ids=["regained", "retained", "lasting", "lasted"],
)
def test_new_row_explained_in_dense_time(add: Add, row: Operator, spelled: str) -> None:
    add(row)
    draw = random.Random(7)
    for _ in range(100):
        begin = draw.randint(0, 3)
        end = begin + draw.randint(0, 3)
        times = {name: sorted({0, 9, *draw.sample(range(1, 9), 5)}) for name in "xy"}
        trace = {name: [(t, draw.randint(-6, 6)) for t in times[name]] for name in times}
        time = draw.randint(0, 9)
        built, other = f"x > 0 {row.symbol}[{begin}:{end}] y > 0", spelled.format(begin, end)
        assert rtamt.dense.evaluate(built, trace) == rtamt.dense.evaluate(other, trace)
        one, two = (
            rtamt.dense.explain(text, trace, time, resolution="1s") for text in (built, other)
        )
        assert (one.robustness, one.causes) == (two.robustness, two.causes)
        if rtamt.holds(one.robustness):
            built, other = f"not ({built})", f"not ({other})"
            one = rtamt.dense.explain(built, trace, time, resolution="1s")
        signs = named(one, trace)
        for share in (0.2, 0.5, 0.8):
            changed = {
                name: [(t, draw.choice((-1, 1)) if draw.random() < share else v) for t, v in its]
                for name, its in trace.items()
            }
            if named(one, changed) == signs:
                after = rtamt.dense.explain(other, changed, time, resolution="1s")
                assert not rtamt.holds(after.robustness)


def named(why: rtamt.dense.Explanation, trace: Mapping[str, list[tuple[int, int]]]) -> list[bool]:
    """Return the signs of the predicates at the causes of a violation."""
    spans = [(item.formula, *item.window, item.open_end) for item in why.contributions]
    if why.steps[-1].outside is None:
        spans.append((why.steps[-1].formula, why.steps[-1].time, why.steps[-1].time, False))
    return [
        [value for t, value in trace[formula.variables[0]] if t <= time][-1] > 0
        for formula, first, last, ends in spans
        for time in range(int(first), int(last) + 1 - (ends and first < last))
    ]


def test_an_infix_operator_is_one_row(add: Add) -> None:
    add(NAND)
    built = cast("Formula", make("nand", (x > 1, y > 0)))
    assert formula("x > 1\nnand y > 0") is built
    assert formula(str(built.implies(built))) is built.implies(built)
    assert rtamt.evaluate(built, TRACE).tolist() == [0.0, -2.0, 3.0, 1.0]
    with pytest.raises(ParseError, match=r"'nand' does not chain; write \(x nand y\) nand z or"):
        formula("x nand y nand z")


def test_a_function_is_a_row_here_and_one_in_the_algebra(
    add: Add, monkeypatch: pytest.MonkeyPatch
) -> None:
    add(TWICE)
    row = Function("twice", 1, lambda x: 2 * x, monotone("+"))
    monkeypatch.setitem(cast("dict[str, Function]", FUNCTIONS), "twice", row)
    built = cast("Term", make("twice", (x,))) > 0.25
    assert formula("twice(x) > 0.25") is built
    assert str(built.always()) == "always(twice(x) > 0.25)"
    assert formula(str(built)) is built
    expected = [2 * value - 0.25 for value in TRACE["x"]]
    assert rtamt.evaluate(built, TRACE, backend="python").tolist() == expected
    monitor = rtamt.EpisodeMonitor(built.always(), backend="python", history=True)
    for value in TRACE["x"]:
        monitor.update(x=value)
    assert [(c.variable, c.sample) for c in monitor.explain().causes] == [("x", 2)]
    assert formula("twice > 1") is (variable("twice") > 1)
    with pytest.raises(ParseError, match=r"hint: write twice\(x\)"):
        formula("1 < twice x")
    with pytest.raises(ParseError, match=r"functions are abs, .*, twice"):
        formula("foo(x) > 1")


def test_a_row_that_is_gone_leaves_nothing_behind() -> None:
    assert formula("later > 1") is (variable("later") > 1)
    with pytest.raises(ParseError, match="unknown function 'twice'"):
        formula("twice(x) > 0.25")


@pytest.mark.parametrize("word", ["next", "X", "min", "inf"])
def test_a_word_has_one_meaning(add: Add, word: str) -> None:
    with pytest.raises(AssertionError, match=f"one meaning for a word, got several for {word}"):
        add(Operator(("weak", word), "prefix", 7, "", lambda _, p: p))
    assert "weak" not in OPERATORS
    assert formula("weak > 1") is (variable("weak") > 1)


def test_a_symbol_has_one_meaning_in_a_notation(add: Add) -> None:
    with pytest.raises(AssertionError, match=r"one meaning for a word, got several for \('!', "):
        add(Operator(("!",), "prefix", 7, "", lambda _, p: p, name="again"))
    assert "again" not in OPERATORS
    assert formula("!(x > 1)") is formula("not (x > 1)")


@pytest.mark.parametrize("word", sorted({*OPERATORS.words, *KEYWORDS}))
def test_text_and_python_agree_on_the_names_of_variables(word: str) -> None:
    row = OPERATORS.words.get(word)
    if row is None or row.notation != "call":
        with pytest.raises(SpecificationError, match=f"'{word}' is .* and cannot name a variable"):
            variable(word)
        for text in (f"input float {word}; x > 0", f"{word} = x > 0", f"x > {word}"):
            with pytest.raises(ParseError):
                rtamt.parse(text)
        return
    named = (variable(word) + 1 > variable(word)) & (x > -variable(word))
    assert str(named) == f"{word} + 1 > {word} and x > -{word}"
    assert formula(str(named)) is named
    text = f"float {word}\n({word} > 0)\n and {word}/2 > 1"
    assert rtamt.parse(text).variables == (word,)
    assert str(formula(f"const float {word} = 3; G[0:{word}] x > {word}")) == "always[0:3](x > 3)"
    assert list(rtamt.parse(f"{word} = x > 1\nx > 0 or {word}").formulas) == [word]


@pytest.mark.parametrize(
    "changes",
    [
        {"notation": "prefix", "arity": (2, 2)},
        {"notation": "prefix", "grouping": "left"},
        {"notation": "infix", "arity": (3, 3)},
        {"notation": "call", "timed": True},
        {"operands": "term", "timed": True},
    ],
)
def test_a_row_that_contradicts_itself_is_a_bug(changes: dict[str, object]) -> None:
    with pytest.raises(AssertionError, match=r"^the row of later contradicts itself$"):
        dataclasses.replace(LATER, **changes)  # type: ignore[arg-type]


def test_a_row_is_shown_by_its_name() -> None:
    assert repr(LATER) == "<operator later>"


CAPPED = Operator(
    ("capped",),
    "prefix",
    7,
    "min(p, 1), held for a sample",
    lambda b, p: b.window("max", -1, 0, b.window("min", 0, 1, b.map("min", p, b.constant(1.0)))),
    sampled=True,
    future=True,
)


@pytest.mark.parametrize("backend", ["python", "auto"])
def test_a_row_of_windows_over_a_constant_is_explained(
    add: Add, backend: Literal["python", "auto"]
) -> None:
    add(CAPPED)
    capped = rtamt.parse("always capped(x > 0)")
    for x in ([3.0, 0.5, 2.0, 4.0], [3.0, -2.0, -0.5, 4.0], [5.0, 6.0, 7.0]):
        value = rtamt.evaluate(capped, {"x": x}, backend=backend)[0]
        held = [min(*(min(v, 1.0) for v in x[i : i + 2]), 1.0) for i in range(len(x))]
        expected = min(max(held[max(0, i - 1) : i + 1]) for i in range(len(x)))
        assert value == expected
        result = rtamt.explain(capped, {"x": x}, backend=backend)
        assert result.robustness == expected
        if expected != 1.0:
            assert [x[cause.sample] for cause in result.causes] == [expected]


def test_grammar_and_table_know_the_same_symbols() -> None:
    rules = re.findall(
        r"^(?:SYMBOL|MINUS|SLASH)\s*:([^;]*);", (GRAMMAR / "Stl.g4").read_text(), re.MULTILINE
    )
    symbols = {s for rule in rules for s in re.findall(r"'([^']+)'", rule)}
    spellings = {s for row in OPERATORS.values() for s in row.spellings if s}
    assert symbols == spellings - OPERATORS.words.keys()


def test_the_grammar_has_the_keywords_and_no_other_word() -> None:
    words = re.findall(r"'([A-Za-z_]+)'", (GRAMMAR / "Stl.g4").read_text())
    assert set(words) == KEYWORDS


def test_the_committed_parser_holds_no_path_of_a_machine() -> None:
    paths = [path for path in (GRAMMAR / "generated").glob("*.py") if path.name != "__init__.py"]
    assert len(paths) == 2
    for path in paths:
        assert "from Stl.g4" in path.read_text().splitlines()[0]
