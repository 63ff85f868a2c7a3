"""Requirements in words: every formula has a sentence that can be read back to the formula."""

import re
from collections import Counter

import pytest
from hypothesis import given, settings
from profiles import examples
from strategies import formulas, rooted
from words_reader import read

import rtamt
from rtamt import Formula, Interval
from rtamt.language import words
from rtamt.language.formula import make
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS
from rtamt.language.words import in_words

PATTERNS = {
    "always(speed < 120)": "speed stays below 120 at all times",
    "always[0:20](speed < 120)": "speed stays below 120 during the first 20 s",
    "always(not (v > 3))": "v is never above 3",
    "eventually(x >= 1)": "x reaches at least 1 at some time",
    "eventually[0:20](x > 1)": "x gets above 1 within the first 20 s",
    "always(req >= 3 implies eventually[0:5](gnt >= 3))": (
        "whenever req is at least 3, gnt reaches at least 3 within 5 s"
    ),
    "always(a > 1 implies eventually(b > 1))": (
        "whenever a is above 1, b gets above 1 at some time from then on"
    ),
    "eventually always(abs(e) < 0.1)": (
        "at some time, the absolute value of e stays below 0.1 from then on"
    ),
    "always eventually(x > 1)": "at all times, x gets above 1 at some time from then on",
    "always(rise(step > 0) implies eventually[0:2] always[0:5](abs(e) < 0.1))": (
        "whenever step becomes above 0, within 2 s, the absolute value of e stays below 0.1 for "
        "the next 5 s; where the first sample counts as changed"
    ),
    "slow = v < 9; always(fall(slow) implies x > 2)": (
        "whenever slow ceases to hold, x is above 2; where slow means that v is below 9; "
        "the first sample counts as changed"
    ),
    "always(rise(r > 1) implies always[0:500ms](y < 1.2))": (
        "whenever r becomes above 1, y stays below 1.2 for the next 500 ms; "
        "where the first sample counts as changed"
    ),
    "always(g > 0 implies once[0:5](r > 0) and historically(v < 9))": (
        "whenever g is above 0, r was above 0 within the last 5 s and v has been below 9 at all "
        "times so far"
    ),
    "x > 1 and (y > 1 or z > 1)": "at the start, x is above 1 and (y is above 1 or z is above 1)",
    "x > 1 until[0:5](y > 1)": "x is above 1 until, within the first 5 s, y is above 1",
    "x > 1 unless y > 1": (
        "x stays above 1 at all times, or only until, at some time, y is above 1"
    ),
    "x > 1 since[2:5] y > 1": (
        "at the start, x is above 1 ever since, at some time from 5 s to 2 s earlier, y is above 1"
    ),
    "always[2:inf](next x > 1)": "from 2 s on, at the next sample if there is one, x is above 1",
    "x - 2 * abs(y) >= min(a, b + 1)": (
        "at the start, x - 2 * abs(y) is at least the smallest of (a, b + 1)"
    ),
    "not (x > 1 iff y > 1)": (
        "at the start, it is not true that (x is above 1 exactly when y is above 1)"
    ),
    "always(x > 1 and (y > 1 or (z > 1 and w > 1)))": (
        "at all times, x is above 1 and [1] holds; where [1] means that y is above 1 or (z is "
        "above 1 and w is above 1)"
    ),
    "speed < 30": "at the start, speed is below 30",
    "speed < 30 implies gap > 5": "at the start, if speed is below 30, then gap is above 5",
    "x > 1 and always(y > 1)": ("at the start, x is above 1 and y stays above 1 at all times"),
    "always[0:5](x > 1) or eventually(y > 1)": (
        "x stays above 1 during the first 5 s or y gets above 1 at some time"
    ),
    "calm = always(x < 1); calm or eventually(y > 1)": (
        "at the start, calm holds or y gets above 1 at some time; where calm means that x stays "
        "below 1 from then on"
    ),
    "next(x > 1)": "at the start, at the next sample if there is one, x is above 1",
    "once[0:2](x > 1)": "at the start, x was above 1 within the last 2 s",
    "always(((x > 1 or y > 1) until z > 1) or w > 1)": (
        "at all times, [1] holds or w is above 1; where [1] means that (x is above 1 or y is above "
        "1) until, at some time from then on, z is above 1"
    ),
    "gap = x - y; calm = gap > 1; always(calm implies gap < 9)": (
        "whenever calm holds, gap is below 9; where calm means that gap is above 1; gap is x - y"
    ),
}


@pytest.mark.parametrize("text", PATTERNS)
def test_common_patterns_have_natural_sentences(text: str) -> None:
    assert in_words(text) == PATTERNS[text]
    assert read(in_words(text)) is rtamt.parse(text).formula


def test_every_operator_has_words_in_one_table() -> None:
    timed = {"always", "eventually", "historically", "once"}
    tables = [
        *(words.ADJECTIVES, words.FUNCTIONS, words.ARITHMETIC, words.CONSTANTS),
        *(words.NEGATIONS, words.INFIX, ["implies"], words.NEIGHBOURS, words.MOMENTS),
        timed,
    ]
    # The rows of difference and sum have their symbols as names.
    assert Counter(name for table in tables for name in table) == Counter(list(OPERATORS))
    assert timed == set(words.VERBS)


@pytest.mark.parametrize("name", OPERATORS)
def test_words_of_every_operator_read_back(name: str) -> None:
    @settings(max_examples=examples(20))
    @given(rooted(name, depth=1, endless=True))
    def check(formula: Formula) -> None:
        assert read(in_words(formula)) is formula

    check()


@given(formulas(5, endless=True))
def test_words_of_generated_formulas_read_back(formula: Formula) -> None:
    words = in_words(formula)
    assert read(words) is formula
    assert re.fullmatch(r'["([\w-].*["\w)\]]', words), words
    assert not re.search(r"  | ,|,,|; $|\bNone\b|->|[&|=!<]", words), words
    assert words.count("(") == words.count(")")


def _of_the_start(formula: Node) -> bool:
    """Return whether only the first sample decides some part, so that no window states the time."""
    match formula.op and formula.op.name:
        case "always" | "eventually" | "until" | "unless" | "true" | "false":
            return False
        case "not" | "and" | "or" | "implies" | "iff" | "xor":
            return any(_of_the_start(entry) for entry in formula.args)
    return True


@given(formulas(3, endless=True))
def test_start_is_not_a_standing_rule(formula: Formula) -> None:
    assert in_words(formula).startswith("at the start, ") == _of_the_start(formula)
    assert not in_words(formula.always()).startswith("at the start, ")


@given(formulas(3, endless=True))
def test_no_word_of_a_sentence_is_the_name_of_a_variable(formula: Formula) -> None:
    renamed = str(formula)
    for name, word in {"a": "start", "b": "holds", "c": "reaches"}.items():
        renamed = re.sub(rf"\b{name}\b", word, renamed)
    spec = rtamt.parse(renamed)
    assert read(in_words(spec)) is spec.formula


@pytest.mark.parametrize("begin", [0, 2])
@pytest.mark.parametrize("end", ["2ms", "7.5 us", "inf ms"])
@pytest.mark.parametrize("name", ["always", "eventually", "historically", "once", "unless"])
def test_bounds_keep_their_units(name: str, begin: int, end: str) -> None:
    x, y = (rtamt.variable(name) > 1 for name in "xy")
    args = (x, y) if name == "unless" else (x & y,)
    formula = make(name, args, Interval.of(begin, end))
    assert isinstance(formula, Formula)
    assert read(in_words(formula)) is formula
    assert read(in_words(formula.eventually())) is formula.eventually()


def test_unit_in_words() -> None:
    assert in_words(rtamt.parse("always[0:5](x > 1)", unit="ms")).endswith("first 5 ms")
    assert in_words("always[0:5](x > 1)", unit="steps").endswith("during the first 5 steps")
    assert in_words("always[0:1](x > 1)", unit="steps").endswith("during the first 1 step")
    assert in_words("always[0:1ms](x > 1)", unit="steps").endswith("during the first 1 ms")


def test_variables_have_the_names_that_are_given() -> None:
    names = {"v": "the speed", "w": "not used"}
    assert in_words("always(v - x < 3)", names) == "the speed - x stays below 3 at all times"
    with pytest.raises(rtamt.InputTypeError) as caught:
        in_words("v > 1", {"v": 3})  # type: ignore[dict-item]
    assert str(caught.value) == "expected names= with a text for 'v', got 3"


@pytest.mark.parametrize(
    "text",
    [
        "calm = x < 1; slow = y < 2; always(calm or slow)",
        "a = x > 1; b = rise(a) and not a; c = eventually[0:3] b; always[0:9](c implies a)",
        "gap = x - y; gap > 1 and always(abs(gap) < 9) and -gap < min(gap, 2)",
        "p = always(x > 1 or (y > 1 and (z > 1 or once x < 1))); always(p iff (p and x > 3))",
        "specification whole; rule = x > 1 until y > 1; always rule",
        "near = x < 1; near",
    ],
)
def test_names_of_a_specification_are_said_once(text: str) -> None:
    spec = rtamt.parse(text)
    words = in_words(spec)
    assert read(words) is spec.formula
    for name in spec.formulas:
        assert words.count(f"{name} means that") + words.count(f"{name} is ") <= (
            9 if name == "gap" else 1
        )


def test_the_deepest_and_the_widest_formulas_have_words() -> None:
    deep = rtamt.variable("x") > 0
    for i in range(198):
        deep = deep.eventually(0, i + 1) if i % 3 else deep.implies(rtamt.variable("y") > i)
    assert read(in_words(deep)) is deep
    wide = rtamt.conjunction(rtamt.variable("x") > i for i in range(2000))
    assert in_words(wide).count(" and ") == 1999
