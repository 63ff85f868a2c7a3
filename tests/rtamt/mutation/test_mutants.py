"""Mutants of requirements: each has one change at one place of the text."""

import re
import subprocess
import sys
from fractions import Fraction
from math import nan
from typing import Any, get_args

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, traces

import rtamt
from rtamt import Formula, InputError, RtamtError, Specification, Verdict, judge, mutants
from rtamt.language.interval import UNITS
from rtamt.mutation import MUTATIONS, Mutant, killed
from rtamt.typing import End, SemanticsName

CONSTANTS = "const float LIMIT = 35; const float FLOOR = 3; always(v < LIMIT and w > FLOOR)"

EXPECTED = {
    "bound": (
        "always[2:5](x < 1)",
        ["[2:5] -> [1:5]", "[2:5] -> [3:5]", "[2:5] -> [2:4]", "[2:5] -> [2:6]"],
    ),
    "window": (
        "always[2:5](x < 1)",
        [
            "[2:5] -> [1:5]",
            "[2:5] -> [4:5]",
            "[2:5] -> [2:2]",
            "[2:5] -> [2:10]",
            "[2:5] -> [2:50]",
        ],
    ),
    "threshold": ("always(v < 35)", ["v < 35 -> v < 34", "v < 35 -> v < 36"]),
    "tenth": ("always(v < 35)", ["v < 35 -> v < 31.5", "v < 35 -> v < 38.5"]),
    "strictness": (
        "always(v < 35 and v >= 0 or v == 9)",
        ["v < 35 -> v <= 35", "v >= 0 -> v > 0"],
    ),
    "direction": (
        "always(v < 35 and v >= 0 or v == 9)",
        ["v < 35 -> v > 35", "v >= 0 -> v <= 0", "v == 9 -> v != 9"],
    ),
    "junction": ("always(a & b or c)", ["& -> |", "or -> and"]),
    "operator": (
        "G(F[0:2] a) and (b U c) and historically(d) and rise(a) and next(prev(b))",
        [
            "G -> F",
            "F[0:2] -> G[0:2]",
            "U -> W",
            "historically -> once",
            "rise -> fall",
            "next -> s_next",
            "prev -> s_prev",
        ],
    ),
    "implication": (
        "always((a > 1) -> eventually[0:2](b))",
        [
            "(a > 1) -> not (a > 1)",
            "-> -> <->",
            "eventually[0:2](b) -> not (eventually[0:2](b))",
        ],
    ),
    "part": (
        "always(p and q or not (r) and (s implies t))",
        [
            "p and -> nothing",
            "p and q or -> nothing",
            "and q -> nothing",
            "or not (r) and (s implies t) -> nothing",
            "not -> nothing",
            "not (r) and -> nothing",
            "and (s implies t) -> nothing",
            "s implies -> nothing",
        ],
    ),
    "constant": (CONSTANTS, ["v < LIMIT -> v < FLOOR", "w > FLOOR -> w > LIMIT"]),
}
"""A requirement for each kind, with all its changes."""


def changes(result: tuple[Mutant, ...]) -> list[str]:
    return [f"{item.before} -> {item.after or 'nothing'}" for item in result]


@pytest.mark.parametrize("kind", MUTATIONS)
def test_each_kind_changes_what_it_says(kind: str) -> None:
    text, expected = EXPECTED[kind]
    result = changes(mutants(text, kinds=[kind]))
    assert sorted(result) == sorted(expected)
    before, after = MUTATIONS[kind].example.split(" -> ")
    everything = {
        item
        for known, _ in EXPECTED.values()
        for item in changes(mutants(known.replace("[2:5]", "[0:5]").replace("->", "implies")))
    }
    assert f"{before} -> {after}" in everything


def original_text(mutant: Mutant) -> str:
    """Return the text of the mutant with the change undone, from the common parts of both texts."""
    old, new = mutant.requirement.text, mutant.specification.text
    head = next((i for i, pair in enumerate(zip(old, new, strict=False)) if len({*pair}) > 1), None)
    head = min(len(old), len(new)) if head is None else head
    tail = 0
    while tail < min(len(old), len(new)) - head and old[-1 - tail] == new[-1 - tail]:
        tail += 1
    return new[:head] + old[head : len(old) - tail] + new[len(new) - tail :]


@given(formulas(), st.sampled_from([None, "0.5", "0.1"]))
def test_mutants_change_one_place(formula: Formula, period: str | None) -> None:
    spec = Specification.of(formula)
    result = mutants(spec, period, limit=15)
    assert len({item.specification.formula for item in result}) == len(result)
    for mutant in result:
        changed = mutant.specification
        assert changed.formula is not spec.formula
        assert rtamt.parse(str(changed)) == changed
        assert {*changed.variables} <= {*spec.variables}
        # One part of the text differs, and the mutant shows it.
        assert original_text(mutant) == spec.text
        assert mutant.line == 1
        assert len(changed.text) - len(spec.text) == len(mutant.after) - len(mutant.before)
        begins = [m.start() for m in re.finditer(re.escape(mutant.before), spec.text)]
        assert any(
            begin < mutant.column <= begin + len(mutant.before)
            and changed.text
            == spec.text[:begin] + mutant.after + spec.text[begin + len(mutant.before) :]
            for begin in begins
        )


@given(formulas())
def test_symbols_and_words_are_exchanged(formula: Formula) -> None:
    text = str(formula)
    words = re.findall(r"\w+|[<>=!]+", text)
    for kind, one, other in (
        ("strictness", "<", "<="),
        ("direction", "==", "!="),
        ("operator", "always", "eventually"),
        ("operator", "since", None),
        ("operator", "until", "unless"),
    ):
        of_one = [
            item.specification.formula
            for item in mutants(text, kinds=[kind])
            if one in re.findall(r"\w+|[<>=!]+", item.before)
            and (other is None or other in re.findall(r"\w+|[<>=!]+", item.after))
        ]
        if other is None:
            assert not of_one
            continue
        wanted = set()
        for begin in (m.start() for m in re.finditer(rf"(?<![\w<>=!]){one}(?![\w<>=!])", text)):
            wanted.add(rtamt.parse(text[:begin] + other + text[begin + len(one) :]).formula)
        assert {*of_one} == wanted - {formula}, (words, kind)


@given(formulas(), st.sampled_from(["ms", "s"]), st.sampled_from([1, 2, 5]))
def test_bounds_stay_whole_numbers_of_periods(formula: Formula, unit: str, samples: int) -> None:
    period = UNITS[unit] / samples
    spec = rtamt.parse(str(formula), unit=unit)
    for mutant in mutants(spec, period, kinds=["bound", "window"], limit=10):
        for node in mutant.specification.formula.nodes():
            if node.interval is not None:
                for bound in {node.interval.begin, node.interval.end} - {None}:
                    assert bound is not None
                    assert (bound * UNITS[unit] / period).denominator == 1


def test_a_bound_moves_by_a_sample_in_its_own_unit() -> None:
    result = mutants("always[0.2:1s](x) and once[100:300ms](y)", "100ms", kinds=["bound"])
    assert changes(result) == [
        "[0.2:1s] -> [0.1:1s]",
        "[0.2:1s] -> [0.3:1s]",
        "[0.2:1s] -> [0.2:0.9s]",
        "[0.2:1s] -> [0.2:1.1s]",
        "[100:300ms] -> [0:300ms]",
        "[100:300ms] -> [200:300ms]",
        "[100:300ms] -> [100:200ms]",
        "[100:300ms] -> [100:400ms]",
    ]


def test_period_of_a_third_keeps_decimal_bounds() -> None:
    result = mutants("always[0:1](x)", Fraction(1, 3), kinds=["bound", "window"])
    assert changes(result) == ["[0:1] -> [0:2]", "[0:1] -> [0:10]"]


def test_numbers_move_by_a_unit_of_their_last_digit() -> None:
    result = mutants("always(x < 0.20 and y > -1e-3 and z == 0 and w < .5)", kinds=["threshold"])
    assert [item.after for item in result] == [
        *("x < 0.19", "x < 0.21"),
        *("y > -0", "y > -0.002"),
        *("z == -1", "z == 1"),
        *("w < 0.4", "w < 0.6"),
    ]


def test_constants_move_in_declaration_or_value() -> None:
    text = "const float T = 2\nconst float LOW = -0.5\nalways[0:T](x > LOW) and x > LOW"
    result = mutants(text, kinds=["bound", "threshold"])
    assert [str(item) for item in result] == [
        "1:17 T = 2 -> T = 1",
        "1:17 T = 2 -> T = 3",
        "2:19 LOW = -0.5 -> LOW = -0.6",
        "2:19 LOW = -0.5 -> LOW = -0.4",
        "3:8 [0:T] -> [1:T]",
    ]
    assert str(result[2].specification.formula) == "always[0:2](x > -0.6) and x > -0.6"
    given = mutants(rtamt.parse(text, constants={"T": 7}), kinds=["bound"])
    assert [str(item) for item in given] == [
        "3:8 [0:T] -> [1:T]",
        "3:10 T = 7 -> T = 6",
        "3:10 T = 7 -> T = 8",
    ]
    assert str(given[1].specification.formula) == "always[0:6](x > -0.5) and x > -0.5"


def test_shared_formula_changes_for_both_uses() -> None:
    text = "p = x > 1\nq = z > 0\nboth = always(p) and eventually(p)\nother = always(q)"
    both = rtamt.parse(text).requirements["both"]
    result = mutants(both, kinds=["direction"])
    assert [str(item) for item in result] == ["1:7 x > 1 -> x < 1"]
    assert str(result[0].specification.formula) == "always(x < 1) and eventually(x < 1)"
    assert result[0].specification.requirement == "both"
    dropped = mutants(both, kinds=["part"])
    assert [str(item.specification.formula) for item in dropped] == [
        "eventually(x > 1)",
        "always(x > 1)",
    ]


def test_the_most_are_the_first_of_each_kind_in_turn() -> None:
    text = "always[3:9](x > 1 implies eventually[0:4](y < 3 and z > 4))"
    every = mutants(text)
    for most in range(1, len(every) + 2):
        some = mutants(text, limit=most)
        assert len(some) == min(most, len(every))
        assert {*some} <= {*every}
        assert {*some} <= {*mutants(text, limit=most + 1)}
    kinds = [kind for kind in MUTATIONS if any(item.kind == kind for item in every)]
    assert {item.kind for item in mutants(text, limit=len(kinds))} == {*kinds}


def test_places_in_several_lines_with_comments() -> None:
    text = "// v < 35\nslow =\n  v < 35 // km/h\n  and  v >= 0\nalways(slow)"
    result = mutants(text, kinds=["junction", "part"])
    assert [str(item) for item in result] == [
        "3:3 v < 35 // km/h and -> nothing",
        "4:3 and -> or",
        "4:3 and v >= 0 -> nothing",
    ]
    assert [str(item.specification.formula) for item in result] == [
        "always(v >= 0)",
        "always(v < 35 or v >= 0)",
        "always(v < 35)",
    ]


def test_apart_fails_where_requirement_and_mutant_differ() -> None:
    (mutant,) = mutants("always[0:1](x < 3)", kinds=["window"], limit=1)
    assert str(mutant.specification.formula) == "always[0:0](x < 3)"
    for trace in ([1, 1, 1], [1, 4, 1], [4, 1, 1], [4, 4, 1]):
        one = rtamt.judge(mutant.requirement, {"x": trace}).verdict
        other = rtamt.judge(mutant.specification, {"x": trace}).verdict
        differ = rtamt.judge(mutant.distance, {"x": trace}).verdict.name == "VIOLATED"
        assert differ == (one is not other)


def test_constant_bounds_are_exchanged() -> None:
    text = "const float a = 2; const float b = 3; always[0:a](x > 1 and eventually[a:b](y > 0))"
    result = [str(m) for m in mutants(text, kinds=["constant"]) if "[" in str(m)]
    assert result == ["1:48 [0:a] -> [0:b]", "1:72 [a:b] -> [b:b]", "1:74 [a:b] -> [a:a]"]


def test_bounds_in_another_unit_keep_it_apart() -> None:
    (mutant,) = mutants(rtamt.parse("always[0:5](x < 3)", unit="ms"), kinds=["direction"])
    assert str(mutant.distance.formula) == "always[0:5ms](x < 3) iff always[0:5ms](x > 3)"


def verdict(spec: Specification, trace: Trace, end: End, options: Any) -> Verdict | None:  # noqa: ANN401
    names = {
        item: [name for name in options[item] if name in spec.variables]
        for item in ("inputs", "outputs")
    }
    try:
        return judge(spec, trace, end=end, n=length(trace), **{**options, **names}).verdict
    except RtamtError:
        return None


@given(
    formulas(),
    traces(),
    st.sampled_from(get_args(End)),
    st.sampled_from(get_args(SemanticsName)),
    st.sampled_from(["raise", "unknown"]),
)
def test_noticed_matches_single_verdicts(
    formula: Formula, trace: Trace, end: End, semantics: SemanticsName, policy: str
) -> None:
    spec = Specification.of(formula)
    inputs, outputs = spec.variables[:1], spec.variables[1:]
    assume(semantics in {"standard", "boolean"} or (inputs and outputs))
    options: Any = {"semantics": semantics, "inputs": inputs, "outputs": outputs, "nan": policy}
    if policy == "unknown":
        trace = {name: [nan, *values[1:]] for name, values in trace.items()}
    result = mutants(spec, limit=12)
    its = verdict(spec, trace, end, options)
    kills = killed(result, trace, end=end, n=length(trace), **options)
    for mutant, item in zip(result, kills, strict=True):
        if mutant.specification.variables == spec.variables:  # otherwise roles may have no variable
            other = verdict(mutant.specification, trace, end, options)
            assert item == ({its, other} == {Verdict.SATISFIED, Verdict.VIOLATED}), str(mutant)


def test_unjudged_mutant_survives() -> None:
    result = mutants("always[0:1s](x < 3)", "500ms", kinds=["bound", "threshold"])
    kills = killed(
        result, {"x": [2.5, 3.5]}, "1s"
    )  # no bound of 0.5 s is a whole number of samples
    assert [str(m) for m, item in zip(result, kills, strict=True) if item] == [
        "1:18 x < 3 -> x < 4"
    ]
    result = mutants("always(sqrt(x - 1) < 2)", kinds=["threshold"])
    kills = killed(result, {"x": [1.5, 6.0]})  # one computes the root of -0.5
    assert [str(m) for m, item in zip(result, kills, strict=True) if item] == [
        "1:22 sqrt(x - 1) < 2 -> sqrt(x - 1) < 3"
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"kinds": ["bounds"]}, "expected a kind of mutants, got 'bounds'; did you mean 'bound'?"),
        ({"kinds": ["zzz"]}, "they are"),
        ({"limit": 0}, "limit: expected 1 mutant or more, got 0"),
    ],
)
def test_what_is_no_kind_or_number_is_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        mutants("always(x > 1)", **arguments)  # type: ignore[arg-type]


def test_the_parser_is_loaded_when_mutants_are_made() -> None:
    code = "import rtamt.mutation, sys; print(any('antlr' in name for name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
