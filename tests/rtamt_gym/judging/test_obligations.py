"""Clocks and margins of temporal operators: equal to their definition, and sufficient to judge."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from bits import bits
from hypothesis import example, given, settings
from hypothesis import strategies as st
from obligations_oracle import Expected, clock, margin
from profiles import examples

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.judging.obligations import Obligations, SingleObligations, obligations_of

P, Q, R = "p > 0", "q > 0", "r > 0"
COLUMNS = ["p", "q", "r"]
Pattern = tuple[str, list[Expected]]


def window(draw: Any, least: int = 0) -> tuple[int, int | None, str]:  # noqa: ANN401
    """The start and the end of a window, and its text."""
    begin = draw(st.integers(least, 3))
    end = draw(st.none() | st.integers(begin, begin + 4))
    if end is None:
        return begin, None, "" if begin == 0 else f"[{begin}:inf]"
    return begin, end, f"[{begin}:{end}]"


@st.composite
def single(draw: Any) -> Pattern:  # noqa: ANN401
    """One operator below the top, triggered everywhere, where r holds, or at the first sample."""
    name = draw(st.sampled_from(["eventually", "always", "until", "unless"]))
    begin, end, text = window(draw)
    two = name in {"until", "unless"}
    formula = f"{P} {name}{text} {Q}" if two else f"{name}{text}({Q})"
    operands = (P, Q) if two else (Q,)
    whole, kinds, asked = draw(
        st.sampled_from(
            [
                ("always({})", ("oldest", "newest"), None),
                (f"always({R} implies ({{}}))", ("oldest", "newest"), R),
                (f"always(({{}}) or not ({R}) or p > 2)", ("oldest", "newest"), f"{R} and p <= 2"),
                ("eventually({})", ("newest", "oldest"), None),
                (f"eventually({R} and ({{}}))", ("newest", "oldest"), R),
                ("not eventually({})", ("newest", "oldest"), None),
                (f"always({R} implies not ({{}}))", ("newest", "oldest"), R),
                (f"({{}}) or eventually[0:9]({R})", ("oldest", "oldest"), "first"),
                (f"always({R} implies next({{}}))", ("oldest", "newest"), f"s_prev({R})"),
            ]
        )
    )
    kind = kinds[name in {"always", "unless"}]
    found = [Expected(formula, name, kind, begin, end, operands, asked)]
    if asked == "first":
        found.append(Expected(f"eventually[0:9]({R})", "eventually", "oldest", 0, 9, (R,), asked))
    if "next" in whole:
        if end is None:  # the operand of next is never known
            return whole.format(formula), found
        found.insert(0, Expected(f"next({formula})", "always", "newest", 1, 1, (formula,), R))
    return whole.format(formula), found


@st.composite
def nested(draw: Any) -> Pattern:  # noqa: ANN401
    """An operator in the window of another one: its values are late."""
    outer, inner = draw(st.tuples(*[st.sampled_from(["eventually", "always"])] * 2))
    begin, end, text = window(draw)
    first, last = draw(st.sampled_from([(0, 0), (0, 2), (1, 3)]))
    below = f"{inner}[{first}:{last}]({Q})"
    formula = f"{outer}{text}({below})"
    whole, asked = draw(
        st.sampled_from([("always({})", None), (f"always({R} implies {{}})", R)]),
    )
    kind = "newest" if outer == "always" else "oldest"
    # Below always every instant of the inner operator counts, below eventually one is enough.
    kind_below = "newest" if inner == outer else "oldest"
    return whole.format(formula), [
        Expected(formula, outer, kind, begin, end, (below,), asked),
        Expected(below, inner, kind_below, first, last, (Q,)),
    ]


@st.composite
def past(draw: Any) -> Pattern:  # noqa: ANN401
    """An operator of the past."""
    name = draw(st.sampled_from(["once", "historically", "since", "prev", "rise", "fall"]))
    if name in {"prev", "rise", "fall"}:
        formula = f"{name}({Q})"
        return f"always({R} implies {formula})", [Expected(formula, name, "last", 1, 1, (Q,))]
    begin, end, text = window(draw)
    operands = (P, Q) if name == "since" else (Q,)
    formula = f"{P} since{text} {Q}" if name == "since" else f"{name}{text}({Q})"
    found = [Expected(formula, name, "last", begin, end, operands)]
    return f"always({R} implies ({formula}))", found


@st.composite
def both_ways(draw: Any) -> Pattern:  # noqa: ANN401
    """An operator that must hold if r holds (or not), and must fail otherwise."""
    name = draw(st.sampled_from(["eventually", "always", "until", "unless"]))
    begin, end, text = window(draw)
    two = name in {"until", "unless"}
    formula = f"{P} {name}{text} {Q}" if two else f"{name}{text}({Q})"
    around = draw(st.sampled_from(["always", "eventually"]))
    relation = draw(st.sampled_from(["iff", "xor"]))
    first = draw(st.booleans())
    sides = f"({formula}) {relation} {R}" if first else f"{R} {relation} ({formula})"
    where, elsewhere = (R, f"not ({R})") if relation == "iff" else (f"not ({R})", R)
    lasts = name in {"always", "unless"}
    holds = "newest" if lasts is (around == "always") else "oldest"
    fails = "oldest" if holds == "newest" else "newest"
    operands = (P, Q) if two else (Q,)
    found = [
        Expected(formula, name, kind, begin, end, operands, at)
        for at, kind in ((where, holds), (elsewhere, fails))
    ]
    late = around == "always" if first else where != R  # the second comes first
    return f"{around}({sides})", found[::-1] if late else found


values = st.sampled_from([-2.0, -1.0, -0.0, 0.0, 1.0, 3.0])
traces = st.lists(st.tuples(values, values, values), min_size=1, max_size=10)


def made(text: str, num: int) -> Obligations:
    return Obligations({"spec": rtamt.parse(text)}, num, EvaluationOptions(period=1), COLUMNS)


class One:
    """The clocks of one environment."""

    def __init__(self, text: str) -> None:
        self.obligations = SingleObligations(
            {"spec": rtamt.parse(text)}, EvaluationOptions(period=1)
        )
        self.samples = 0
        self._feed = self.obligations.feeder(COLUMNS)

    def feed(self, row: Sequence[float]) -> None:
        self._feed(row)
        self.samples += 1

    def reset(self) -> None:
        self.obligations.reset()
        self.samples = 0

    def owed(self) -> list[tuple[float, list[float]]]:
        return [(each.clock, list(each.margins)) for each in self.obligations.owed()[0]]


def entry(obligations: Obligations, number: int) -> list[tuple[float, list[float]]]:
    return [
        (owed.clock[number], [m[number] for m in owed.margins]) for owed in obligations.owed()[0]
    ]


NEGATED = (
    f"always({R} implies not eventually[0:3]({Q}))",
    [Expected(f"eventually[0:3]({Q})", "eventually", "newest", 0, 3, (Q,), R)],
)


@given(pattern=single() | nested() | past() | both_ways(), rows=traces)
@example(pattern=NEGATED, rows=[(1.0, -1.0, 1.0), (1.0, 1.0, 1.0)])
def test_clocks_and_margins_match_the_oracle(
    pattern: Pattern, rows: list[tuple[float, ...]]
) -> None:
    text, expected = pattern
    one, many = One(text), made(text, 1)
    formulas = [rtamt.parse(each.formula).formula for each in expected]
    assert [each.formula for each in one.obligations.found[0]] == formulas
    assert one.obligations.found == many.found
    trace = {name: [row[i] for row in rows] for i, name in enumerate(COLUMNS)}
    for t, row in enumerate(rows):
        one.feed(row)
        many.feed(np.array([row]))
        for each, found, of_many in zip(expected, one.owed(), entry(many, 0), strict=True):
            assert found[0] == pytest.approx(clock(each, trace, t)), (each, t)
            assert found[1] == [margin(p, trace, t) for p in each.operands]
            assert bits([found[0], *found[1]]) == bits([of_many[0], *of_many[1]])


@settings(max_examples=examples(50))
@given(pattern=single() | nested() | past() | both_ways(), rows=traces, seed=st.integers(0, 99))
def test_environments_have_own_clocks(
    pattern: Pattern, rows: list[tuple[float, ...]], seed: int
) -> None:
    """Masks and resets of some environments do not change the others."""
    text, _ = pattern
    rng = np.random.default_rng(seed)
    num = 3
    together, alone = made(text, num), [One(text) for _ in range(num)]
    for row in rows:
        table = np.array([row, row[::-1], row[1:] + row[:1]])
        resets, fed = rng.random(num) < 0.15, rng.random(num) < 0.8
        if resets.any():
            together.reset(resets)
        together.feed(table, None if fed.all() else fed)
        for number, each in enumerate(alone):
            if resets[number]:
                each.reset()
            if fed[number]:
                each.feed(table[number].tolist())
        for number, each in enumerate(alone):
            if each.samples:
                for found, of_many in zip(each.owed(), entry(together, number), strict=True):
                    assert bits([found[0], *found[1]]) == bits([of_many[0], *of_many[1]])


# ---- what is enough ----

ENOUGH = [
    f"always(eventually[0:3]({Q}))",
    f"always(eventually[1:3]({Q}))",
    f"always({R} implies eventually[0:4]({Q}))",
    f"always({R} implies eventually[1:4]({Q}))",
    f"always({R} implies always[0:3]({Q}))",
    f"always({R} implies always[1:3]({Q}))",
    f"eventually(always[0:3]({Q}))",
    f"eventually({R} and always[0:3]({Q}))",
    f"always({P} until[0:3] {Q})",
    f"always({R} implies ({P} until[0:3] {Q}))",
    f"always({R} implies ({P} until {Q}))",
    f"always({R} implies ({P} unless {Q}))",
    f"always({R} implies next({Q}))",
    f"always(eventually[0:4](always[0:2]({Q})))",
    f"always({R} implies once[0:3]({Q}))",
    f"always({R} implies historically[0:3]({Q}))",
    f"always({R} implies ({P} since[0:3] {Q}))",
    f"always({R} implies rise({Q}))",
    f"always({R} implies eventually[0:3]({Q})) and always({P} or next({P}))",
    f"always({R} iff eventually[0:3]({Q}))",
    f"always({R} xor eventually[0:3]({Q}))",
    f"always(({P} until[0:3] {Q}) xor {R})",
    f"eventually({R} iff always[0:3]({Q}))",
    f"eventually({R} xor always[0:3]({Q}))",
    f"next(eventually[0:3]({Q}))",
]

NOT_ENOUGH = [
    f"always({R} implies eventually[3:5]({Q}))",
    f"always({R} implies always[3:5]({Q}))",
    f"always(eventually[0:3]({Q}) or eventually[0:5]({P}))",
    f"always({R} implies once[2:4]({Q}))",
]


def told_apart(text: str) -> bool:
    """Return whether two equal-looking histories have different futures.

    Random histories of different lengths continue in the same ways. If verdict and clocks are
    equal, and the last margins have the same signs, the verdicts must be equal.
    """
    entries, longest, ahead, ways = 1000, 9, 7, 25
    rng = np.random.default_rng(5)
    often = np.array([[0.6, 0.5, 0.3], [0.2, 0.4, 0.3]])[rng.integers(0, 2, entries)]
    judge = rtamt.VectorEpisodeMonitor(text, entries, 1)
    obligations = made(text, entries)
    starts = rng.integers(0, longest, entries)
    pick = [COLUMNS.index(name) for name in judge.variables]
    for step in range(longest):
        table = np.where(rng.random((entries, 3)) < often, 1.0, -1.0)
        fed = starts <= step
        judge.update(table[:, pick], fed)
        obligations.feed(table, fed)
    owed = obligations.owed()[0]
    seen = [judge.verdict, *(np.round(1e6 * each.clock) for each in owed)]
    seen += [np.sign(m) for each in owed for m in each.margins]
    _, group = np.unique(np.array(seen), axis=1, return_inverse=True)
    first = np.unique(group, return_index=True)[1]  # a history of each group
    for way in range(ways):
        then = deepcopy(judge)
        for _ in range(ahead):
            row = np.where(rng.random(3) < often[way], 1.0, -1.0)
            then.update(np.tile(row, (entries, 1))[:, pick])
            verdict = then.verdict
            if (verdict != verdict[first][group]).any():
                return True
    return False


@pytest.mark.slow(keep=8)
@pytest.mark.parametrize("text", ENOUGH)
def test_obligations_determine_future_verdicts(text: str) -> None:
    assert not told_apart(text)


@pytest.mark.parametrize("text", NOT_ENOUGH)
def test_known_limits_of_obligations(text: str) -> None:
    assert told_apart(text)


@pytest.mark.parametrize(
    "text", ["always(p > 0)", "eventually[0:5](p > 0)", f"{P} until {Q}", f"not eventually({P})"]
)
def test_top_operator_has_no_clock(text: str) -> None:
    assert obligations_of(rtamt.parse(text), EvaluationOptions(period=1)) == []


def test_unknown_operand_omits_operator() -> None:
    (found,) = obligations_of(
        rtamt.parse(f"always(eventually(always({Q})))"), EvaluationOptions(period=1)
    )
    assert (str(found.formula), found.kind) == (f"always({Q})", "oldest")


def test_windows_are_rounded_to_samples() -> None:
    spec = rtamt.parse("always(eventually[0.1:0.25](q > 0))")
    (found,) = obligations_of(spec, EvaluationOptions(period=0.05))
    assert (found.begin, found.end) == (2, 5)
    (found,) = obligations_of(spec, EvaluationOptions(period=0.1, align="outward"))
    assert (found.begin, found.end) == (1, 3)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("next(eventually[0:2](q > 0))", [0, 1 / 3, 0, 0, 0]),
        ("p > 0 or s_next(eventually[0:2](q > 0))", [0, 1 / 3, 0, 0, 0]),
        ("always(next(eventually[0:2](q > 0)))", [0, 1 / 3, 0, 1 / 3, 2 / 3]),
    ],
)
def test_next_shifts_instants_by_one_sample(text: str, expected: list[float]) -> None:
    one, many = One(text), made(text, 1)
    found = []
    for q in (1.0, -1.0, 1.0, -1.0, -1.0):
        one.feed([-1.0, q, -1.0])
        many.feed(np.array([[-1.0, q, -1.0]]))
        assert bits([one.owed()[-1][0]]) == bits([entry(many, 0)[-1][0]])
        found.append(one.owed()[-1][0])
    assert found == pytest.approx(expected)
