"""Open minima and maxima of the episode machine in C++, against its definition."""

from __future__ import annotations

import copy
import math
import pickle
import random
from collections.abc import Callable, Iterator

import pytest
from bits import bits
from hypothesis import given
from hypothesis import strategies as st

from rtamt import EpisodeMonitor
from rtamt.typing import End

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Row = tuple[float, float]
Rows = Callable[[int], Iterator[Row]]

ENDS: tuple[End, ...] = ("complete", "cut", "open")
VALUES = (0.0, -0.0, 1.0, -1.0, 2.0, -2.0, math.inf, -math.inf)

SETTLED = (
    "x > 0",
    "y > 0",
    "not(x >= 0)",
    "once[0:3](x > 0)",
    "once[2:5](y > 0)",
    "historically(y > 0)",
    "(x > 0) since[1:4] (y > 0)",
    "prev(x > 0)",
    "(x > 0) and (y > 0)",
    "(x > 1) or (y < 1)",
)
OTHER = ("next(x > 0)", "eventually[0:2](x > 0)", "always(y > 0)", "(x > 0) until[0:3] (y > 0)")


@st.composite
def windows(draw: st.DrawFn, depth: int = 1) -> str:
    """Windows of up to 24 samples, sometimes over another one."""
    begin, width = draw(st.sampled_from((0, 0, 1, 3))), draw(st.sampled_from((0, 1, 2, 5, 20)))
    inner = st.sampled_from(SETTLED)
    operand = draw(st.one_of(inner, inner, windows(depth - 1)) if depth else inner)
    if draw(st.integers(0, 9)) == 0:
        operand = f"({draw(inner)}) or ({operand})"
    name = draw(st.sampled_from(("eventually", "always")))
    return f"{name}[{begin}:{begin + width}]({operand})"


@st.composite
def formulas(draw: st.DrawFn) -> str:
    """Folds over all times of parts with a window."""
    settled, window, other = st.sampled_from(SETTLED), windows(), st.sampled_from(OTHER)
    shape = draw(
        st.sampled_from(
            (
                *["({0}) implies {2}", "({0}) and {2}"] * 3,
                "({0}) implies (({1}) or {2})",
                "({0}) and {2} and ({1})",
                *["(({0}) implies {2}) and (({1}) implies {3})"] * 2,
                "(({0}) and {2}) or (({1}) and {3})",
                "{2} or {3}",
                "{2} and ({0} or {3})",
                "({4}) implies {2}",
                "({4}) and {2}",
            )
        )
    )
    body = shape.format(draw(settled), draw(settled), draw(window), draw(window), draw(other))
    root = draw(st.sampled_from(("always", "eventually")))
    around = ("{}", "{}", "{}", "not {}", "{} and eventually[0:9](x > 1)", "always[0:12] {}")
    return draw(st.sampled_from(around)).format(f"{root}({body})")


def feed(monitor: EpisodeMonitor, row: Row) -> None:
    values = dict(zip("xy", row, strict=True))
    monitor.update({name: values[name] for name in monitor.variables})


def offered(monitor: EpisodeMonitor) -> list[int]:
    """Return robustness, lower and upper bound, bit by bit."""
    return bits([monitor.robustness, monitor.lower, monitor.upper])


def both(text: str) -> list[EpisodeMonitor]:
    """Return the definition, and the tested machine."""
    return [EpisodeMonitor(text, backend="python"), EpisodeMonitor(text, backend="native")]


def assert_the_ends_agree(expected: EpisodeMonitor, monitor: EpisodeMonitor) -> None:
    for end in ENDS:
        ended, defined = copy.copy(monitor), copy.copy(expected)
        ended.finish(end)
        defined.finish(end)
        assert offered(ended) == offered(defined), end


value = st.sampled_from(VALUES)


@given(
    text=formulas(),
    rows=st.lists(st.tuples(value, value), min_size=1, max_size=40),
    before=st.lists(st.tuples(value, value), max_size=12),
    seed=st.integers(0, 999),
)
def test_every_formula_equals_its_definition(
    text: str, rows: list[Row], before: list[Row], seed: int
) -> None:
    expected, monitor = both(text)
    for row in before:
        feed(monitor, row)
    monitor.reset()
    now = random.Random(seed)
    for i, row in enumerate(rows):
        feed(expected, row)
        feed(monitor, row)
        assert offered(monitor) == offered(expected), i
        if now.randrange(8) == 0:
            monitor = pickle.loads(pickle.dumps(monitor))
        if now.randrange(8) == 0 or i == len(rows) - 1:
            assert_the_ends_agree(expected, monitor)


SHAPES = (
    "always((x > 0) implies eventually[0:7](y > 0))",
    "eventually((x > 0) and always[2:9](y > 0))",
    "always((x > 0) implies always[0:7](y > 0))",
    "always((x > 0) implies always[3:4](y > 0))",
    "always[1:inf]((x > 0) implies eventually[0:4](y > 0))",
    "eventually((x > 0) and eventually[3:3](y > 0))",
    "always((x > 0) implies eventually[0:6] always[0:9](y > 0))",
    "always((x > 0) implies eventually[2:9] always[1:4](y > 0))",
    "always((x > 0) implies eventually[0:9] always[0:3](y > 0))",
    "eventually((x > 0) and always[1:3] eventually[0:8](y > 0))",
    "always((x > 0) implies eventually[0:6] eventually[0:9](y > 0))",
    "always(((x > 0) implies eventually[0:7](y > 0)) and ((y > 0) implies always[2:5](x > 0)))",
    "eventually((y > 0) or x < 0 or eventually[1:6](x > 1))",
    "always(x > 0 or eventually[0:6] always[0:9](y > 0) or y > 1)",
    "eventually((x > 0) and y < 1 and always[4:4] eventually[5:5](y > 0))",
)


def rising(n: int) -> Iterator[Row]:
    """No window is dominated by a later one, and the last one is answered first, or none is."""
    for i in range(n):
        yield i / 4 - 3, (-3.0 if i % 16 < 12 else i / 4)


def falling(n: int) -> Iterator[Row]:
    """Each window is dominated by the next, or answered by all samples."""
    for i in range(n):
        yield 5 - i / 4, (4 - i / 4 if i % 20 < 10 else 4.0)


def mixed(n: int) -> Iterator[Row]:
    """Few values, so that equal ones meet."""
    rng = random.Random(n)
    for _ in range(n):
        yield rng.choice(VALUES), rng.choice(VALUES)


def rare(n: int) -> Iterator[Row]:
    """A request now and then, and answers that last for some samples."""
    rng = random.Random(n)
    y = 0.0
    for i in range(n):
        if i % 4 == 0:
            y = rng.uniform(-3, 3)
        yield (rng.uniform(0, 3) if i % 13 == 5 else -9.0), y + i % 4 / 8


def late(n: int) -> Iterator[Row]:
    """One request, whose better answer comes with the end of its window; then a bad end."""
    for i in range(n):
        yield (9.0 if i == 0 else -9.0), (1.0 if i < 9 else 5.0 if i < 20 else -8.0)


@pytest.mark.slow(keep=15)
@pytest.mark.parametrize(
    "rows", [rising, falling, mixed, rare, late], ids=lambda rows: rows.__name__
)
@pytest.mark.parametrize("shape", SHAPES)
def test_every_length_of_a_trace_ends_as_its_definition_says(shape: str, rows: Rows) -> None:
    expected, monitor = both(shape)
    twin = EpisodeMonitor(shape, backend="native")
    for i, row in enumerate(rows(70)):
        feed(expected, row)
        feed(monitor, row)
        feed(twin, row)
        assert offered(monitor) == offered(expected), i
        assert_the_ends_agree(expected, monitor)
        twin = copy.copy(twin)  # after every sample: its own state is sufficient
        assert offered(twin) == offered(expected), i
        assert twin._machine.state() == monitor._machine.state()


@pytest.mark.parametrize("shape", SHAPES)
def test_a_reset_leaves_nothing_of_the_trace_before(shape: str) -> None:
    monitor = EpisodeMonitor(shape, backend="native")
    new = monitor._machine.state()
    first = []
    for row in mixed(30):
        feed(monitor, row)
        first.append(offered(monitor))
    monitor.reset()
    assert monitor._machine.state() == new
    for row, before in zip(mixed(30), first, strict=True):
        feed(monitor, row)
        assert offered(monitor) == before
