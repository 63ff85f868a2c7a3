"""Patterns against definitions on arrays; the catalogue and its page; stages."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from paths import ROOT
from profiles import examples
from strategies import formulas

import rtamt
import rtamt.language.words
from rtamt import Formula, Verdict, patterns
from rtamt.patterns import CATALOGUE, Pattern, in_order, prefixes, stages
from rtamt.typing import End

Floats = NDArray[np.float64]
INF = np.inf
T = 2
X, Y, Z = (rtamt.variable(name) for name in "xyz")
ENDS: tuple[End, ...] = ("complete", "cut")


def least(values: Floats) -> float:
    return float(np.min(values, initial=INF))


def greatest(values: Floats) -> float:
    return float(np.max(values, initial=-INF))


def rises(p: Floats) -> Floats:
    """Return the rise of p at each sample."""
    return np.minimum(p, np.concatenate(([INF], -p[:-1])))


def whenever(requested: Floats, answered: Floats) -> float:
    return least(np.maximum(-requested, answered))


def ahead(p: Floats, steps: int, of: Callable[[Floats], float]) -> Floats:
    return np.array([of(p[i : i + steps + 1]) for i in range(len(p))])


def lasted(p: Floats, steps: int) -> Floats:
    """The minimum of p over the last steps and now; -inf before that many steps."""
    return np.array(
        [least(p[i - steps : i + 1]) if i >= steps else -INF for i in range(len(p))],
    )


def settled(away: Floats, steps: int) -> float:
    """The maximum over start times of the minimum of p up to the end."""
    return greatest(np.minimum.accumulate(-away[::-1])[::-1][: steps + 1])


def chained(stages: list[Floats], steps: int | None = None) -> float:
    """The maximum over ordered times of the minimum of the stages at these times."""
    best = stages[0]
    for stage in stages[1:]:
        far = len(best) if steps is None else steps
        reached = [greatest(best[max(0, i - far) : i + 1]) for i in range(len(best))]
        best = np.minimum(stage, reached)
    return greatest(best)


def between(p: Floats, begin: Floats, end: Floats) -> float:
    worst = INF
    for i in range(len(p)):
        lasting = max(min(float(end[j]), least(-p[i:j])) for j in range(i, len(p)))
        worst = min(worst, max(-min(float(begin[i]), greatest(end[i:])), lasting))
    return worst


def first_before(first: Floats, later: Floats) -> float:
    witnesses = (min(float(first[j]), least(-later[:j])) for j in range(len(first)))
    return max(least(-later), *witnesses)


DEFINITIONS: dict[str, tuple[Formula, Callable[[Floats, Floats, Floats], float]]] = {
    "never": (patterns.never(X > 1), lambda x, *_: least(1 - x)),
    "limits": (
        patterns.within_limits(X, -2, 3),
        lambda x, *_: least(np.minimum(x + 2, 3 - x)),
    ),
    "limits of signals": (
        patterns.within_limits(X, "y", "z + 1"),
        lambda x, y, z: least(np.minimum(x - y, z + 1 - x)),
    ),
    "minimum duration": (
        patterns.minimum_duration(X > 0, T),
        lambda x, *_: whenever(rises(x), ahead(x, T, least)),
    ),
    "response": (
        patterns.response(X > 0, Y > 0, T),
        lambda x, y, _: whenever(x, ahead(y, T, greatest)),
    ),
    "precedence": (patterns.precedence(X > 0, Y > 0), lambda x, y, _: first_before(x, y)),
    "in order": (
        patterns.in_order(X > 0, Y > 0, Z > 0),
        lambda x, y, z: chained([x, y, z]),
    ),
    "in order within": (
        patterns.in_order(X > 0, Y > 0, Z > 0, within=T),
        lambda x, y, z: chained([x, y, z], T),
    ),
    "absence between": (patterns.absence_between(X > 0, Y > 0, Z > 0), between),
    "settling time": (
        patterns.settling_time(X, 1, 2, T),
        lambda x, *_: 2 + settled(abs(x - 1), T),
    ),
    "settling time after": (
        patterns.settling_time(X, Y, 2, T, after=Z > 0),
        lambda x, y, z: whenever(
            z, np.array([2 + settled(abs(x - y)[i:], T) for i in range(len(x))])
        ),
    ),
    "overshoot": (patterns.overshoot(X, 1, 0.5), lambda x, *_: least(1.5 - x)),
    "overshoot, falling": (
        patterns.overshoot(X, Y, 0.5, falling=True),
        lambda x, y, _: least(0.5 - (y - x)),
    ),
    "overshoot after": (
        patterns.overshoot(X, 1, 0.5, after=Z > 0),
        lambda x, _, z: whenever(z, np.array([least(1.5 - x[i:]) for i in range(len(x))])),
    ),
    "rise time": (
        patterns.rise_time(X, -1, 2, T),
        lambda x, *_: whenever(rises(x + 1), ahead(x - 2, T, greatest)),
    ),
    "rate limit": (patterns.rate_limit(X, 2), lambda x, *_: least(2 - abs(x))),
    "recurrence": (
        patterns.recurrence(X > 0, T),
        lambda x, *_: least(np.array([greatest(x[i - T : i + 1]) for i in range(T, len(x))])),
    ),
    "any": (patterns.success(X > 0), lambda x, *_: greatest(x)),
    "last": (patterns.success(X > 0, kept=True), lambda x, *_: float(x[-1])),
    "held": (patterns.success(X > 0, T), lambda x, *_: greatest(lasted(x, T))),
    "kept": (patterns.success(X > 0, T, kept=True), lambda x, *_: float(lasted(x, T)[-1])),
}
"""Each pattern, and its robustness at the first sample of a complete trace."""

_columns = st.integers(1, 12).flatmap(
    lambda n: st.lists(
        st.lists(st.integers(-16, 16).map(lambda k: (2 * k + 1) / 4), min_size=n, max_size=n),
        min_size=3,
        max_size=3,
    )
)


@pytest.mark.parametrize("backend", ["native", "python"])
@pytest.mark.parametrize("name", DEFINITIONS)
def test_a_pattern_is_its_definition(name: str, backend: Literal["native", "python"]) -> None:
    formula, define = DEFINITIONS[name]

    @settings(max_examples=examples(30))
    @given(_columns)
    def check(columns: list[list[float]]) -> None:
        trace = dict(zip("xyz", columns, strict=True))
        expected = define(*(np.array(column) for column in columns))
        assert rtamt.evaluate(formula, trace, 1, backend=backend)[0] == expected
        monitor = rtamt.EpisodeMonitor(formula, 1, backend=backend)
        for i in range(len(columns[0])):
            monitor.update({name: trace[name][i] for name in formula.variables})
        assert monitor.finish() == expected

    check()


@pytest.mark.parametrize("name", DEFINITIONS)
def test_pattern_formula_and_words(name: str) -> None:
    formula, _ = DEFINITIONS[name]
    assert rtamt.parse(str(formula)).formula is formula
    assert rtamt.language.words.in_words(formula)


@pytest.mark.parametrize("name", ["any", "last", "held", "kept", "recurrence"])
def test_end_mode_keeps_verdicts_of_past_windows(name: str) -> None:
    formula, _ = DEFINITIONS[name]

    @given(_columns)
    def check(columns: list[list[float]]) -> None:
        trace = dict(zip("xyz", columns, strict=True))
        complete, cut = (rtamt.judge(formula, trace, 1, end=end) for end in ENDS)
        if name == "recurrence" and len(columns[0]) <= T:  # its window is empty
            assert (complete.verdict, cut.verdict) == (Verdict.SATISFIED, Verdict.UNDECIDED)
        else:
            assert complete.verdict is cut.verdict is not Verdict.UNDECIDED

    check()


def _name(pattern: Pattern) -> str:
    return pattern.name


@pytest.mark.parametrize("pattern", CATALOGUE, ids=_name)
def test_an_example_is_what_it_says(pattern: Pattern) -> None:
    written = eval(pattern.written, dict(vars(patterns)))  # noqa: S307 - text of our own
    assert written is pattern.formula
    assert rtamt.parse(str(pattern.formula)).formula is pattern.formula
    for trace, verdict in (
        (pattern.satisfying, Verdict.SATISFIED),
        (pattern.violating, Verdict.VIOLATED),
    ):
        assert set(trace) == set(pattern.formula.variables)
        for end in ENDS:
            assert rtamt.judge(pattern.formula, dict(trace), 1, end=end).verdict is verdict
        with pytest.raises(TypeError):
            trace["x"] = ()  # type: ignore[index]


@pytest.mark.parametrize("pattern", CATALOGUE, ids=_name)
def test_an_example_demands_something_with_every_part(pattern: Pattern) -> None:
    worst = rtamt.check(pattern.formula, 1)
    assert worst.answer == "yes"
    (requirement,) = worst.requirements.values()
    assert requirement.satisfiable.answer == requirement.falsifiable.answer == "yes"
    assert requirement.redundant == ()


def test_times_keep_their_units() -> None:
    recurring = patterns.recurrence("x > 0", "500ms")
    assert str(recurring) == "always[500:inf ms] once[0:500ms](x > 0)"
    held = patterns.success("x > 0", "0.5 s")
    assert str(held) == "eventually(x > 0 since[0.5:0.5s] x > 0)"
    for formula in (recurring, held, patterns.response("x > 0", "y > 0", "20 ms")):
        assert rtamt.parse(str(formula)).formula is formula


def test_operands_are_formulas_terms_or_their_texts() -> None:
    x, goal = rtamt.variable("x"), rtamt.variable("goal")
    assert patterns.never("x > 3") is patterns.never(x > 3)
    assert patterns.within_limits("x + 1", "0", "goal") is patterns.within_limits(x + 1, 0, goal)
    assert patterns.settling_time(x, goal, 0.1, 2) is patterns.settling_time("x", "goal", 0.1, "2")


PAGE = (ROOT / "docs" / "patterns.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("pattern", CATALOGUE, ids=lambda pattern: pattern.name)
def test_the_page_has_the_row_of_a_pattern(pattern: Pattern) -> None:
    row = f"**{pattern.name}** {pattern.wanted}"
    assert f"| {row} | `{pattern.written}` | `{pattern.formula}` |" in PAGE


FORMS = {
    "eventually(a > 0 and eventually(b > 0))": ("a > 0", "b > 0"),
    "eventually[0:9](a > 0 and eventually[2:5](b > 0))": ("a > 0", "b > 0"),
    "eventually(a > 0 and b > 0 and eventually(c > 0 and a > 1))": (
        "a > 0 and b > 0",
        "c > 0 and a > 1",
    ),
    "near = a > 0; done = b > 0; task = eventually(near and eventually done)": ("a > 0", "b > 0"),
    "eventually(a > 0 and eventually always[0:2](b > 0))": ("a > 0", "always[0:2](b > 0)"),
    "eventually(a > 0)": (),
    "eventually(eventually(a > 0))": (),
    "eventually(eventually(b > 0) and a > 0)": (),
    "always(a > 0 and eventually(b > 0))": (),
    "eventually(a > 0 and eventually(b > 0)) and c > 0": (),
    "a > 0": (),
}


@pytest.mark.parametrize("text", FORMS)
def test_one_shape_has_stages(text: str) -> None:
    assert tuple(map(str, stages(text))) == FORMS[text]
    assert stages(rtamt.parse(text)) == stages(rtamt.parse(text).formula) == stages(text)


@given(st.lists(formulas(1), min_size=2, max_size=5), st.sampled_from([None, 2, "500ms"]))
def test_the_arguments_of_in_order_are_the_stages(
    parts: list[Formula], within: int | str | None
) -> None:
    plain = [part.rise() for part in parts]  # no eventually that could be another stage
    chain = in_order(*plain, within=within)
    assert stages(chain) == tuple(plain)
    worst = prefixes(str(chain))
    assert worst[0] is plain[0].eventually()
    assert worst[-1] is chain
    assert worst[1:] == tuple(in_order(*plain[:n], within=within) for n in range(2, len(plain) + 1))
