"""In every entry the clocks in C++ count like the definition in Python."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from bits import bits
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt.internal import OperatorClock, OperatorClocks
from rtamt.machines.backend import BACKENDS

NUM, PARTS = 3, 3
VALUES = [-2.0, -0.0, 0.0, 1.0, np.inf, -np.inf]

EVENTS = {
    "oldest": ["holds", "fails", "until", "unless"],
    "newest": ["holds", "until", "unless"],
    "last": ["holds", "fails", "since"],
}


KINDS = [(kind, event) for kind, events in EVENTS.items() for event in events]


@st.composite
def clock(draw: Any, kind: Any, event: Any) -> OperatorClock:  # noqa: ANN401
    late = draw(st.integers(0, 3))
    begin = late + draw(st.integers(0, 3))
    waits = st.integers(0, late)
    count = 1 if event in {"holds", "fails"} else 2
    return OperatorClock(
        kind,
        event,
        begin,
        draw(st.none() | st.integers(begin, begin + 4)),
        late,
        tuple((draw(st.integers(0, PARTS - 1)), draw(waits)) for _ in range(count)),
        draw(st.none() | st.integers(0, PARTS - 1)),
        draw(st.booleans()),
    )


CLOCKS = st.sampled_from(KINDS).flatmap(lambda of: clock(*of))


def same(one: OperatorClocks, two: OperatorClocks) -> bool:
    shown = [(each.fractions, each.margins, each.samples) for each in (one, two)]
    return all(
        a.shape == b.shape and bits(a.ravel().tolist()) == bits(b.ravel().tolist())
        for a, b in zip(*shown, strict=True)
    )


@pytest.mark.parametrize(("kind", "event"), KINDS)
@given(data=st.data(), seed=st.integers(0, 10**6))
def test_all_back_ends_count_as_the_definition(
    kind: str, event: str, data: st.DataObject, seed: int
) -> None:
    """Also entries without an update or reset, and copies of the state."""
    clocks = data.draw(st.lists(clock(kind, event), min_size=1, max_size=4))
    rng = np.random.default_rng(seed)
    made = [OperatorClocks(clocks, PARTS, NUM, backend=name) for name in BACKENDS]
    for step in range(14):
        if step == 7:
            made = [pickle.loads(pickle.dumps(each)) for each in made]
        values, left, fed = rng.choice(VALUES, (PARTS, NUM)), rng.random(NUM), rng.random(NUM) < 0.8
        for each in made:
            each.reset(left < 0.1)
            each.feed(values, None if fed.all() else fed)
        assert all(same(made[0], each) for each in made)


@given(clocks=st.lists(CLOCKS, min_size=1, max_size=3), seed=st.integers(0, 10**6))
def test_a_reset_forgets_everything(clocks: list[OperatorClock], seed: int) -> None:
    rng = np.random.default_rng(seed)
    used, new = (OperatorClocks(clocks, PARTS, NUM) for _ in range(2))
    for _ in range(6):
        used.feed(rng.choice(VALUES, (PARTS, NUM)))
    used.reset()
    assert same(used, new)
    values = rng.choice(VALUES, (5, PARTS, NUM))
    for row in values:
        used.feed(row)
        new.feed(row)
        assert same(used, new)


def test_what_is_not_known_yet_neither_holds_nor_fails() -> None:
    for event in ("holds", "fails"):
        clocks = OperatorClocks([OperatorClock("oldest", event, 0, 3, 0, ((0, 0),))], 1, 1)
        clocks.feed([[np.nan]])
        clocks.feed([[np.nan]])
        assert clocks.fractions.tolist() == [[0.5]]
        assert clocks.margins.tolist() == [[0.0]]


@pytest.mark.parametrize("backend", BACKENDS)
def test_without_clocks_samples_are_counted(backend: Any) -> None:  # noqa: ANN401
    clocks = OperatorClocks([], 0, 2, backend)
    clocks.feed(np.empty((0, 2)), np.array([True, False]))
    assert (clocks.fractions.shape, clocks.margins.shape) == ((0, 2), (0, 2))
    assert clocks.samples.tolist() == [1, 0]


ONE = OperatorClock("oldest", "holds", 0, 3, 0, ((0, 0),))


@pytest.mark.parametrize("backend", BACKENDS)
def test_copies_go_on_by_themselves(backend: Any) -> None:  # noqa: ANN401
    clocks = OperatorClocks([ONE], 1, 2, backend)
    clocks.feed([[-1, -1]])
    other = copy.deepcopy(clocks)
    other.feed([[-1, 1]])
    assert clocks.fractions.tolist() == [[0.25, 0.25]]
    assert other.fractions.tolist() == [[0.5, 0.0]]
    assert repr(other) == "<OperatorClocks: 1 over 1 parts in 2 batch entries>"


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_clock_that_is_full_goes_on_from_its_state(backend: Any) -> None:  # noqa: ANN401
    clocks = OperatorClocks([ONE], 1, 1, backend)
    for _ in range(5):
        clocks.feed([[-1.0]])
    copied = pickle.loads(pickle.dumps(clocks))
    assert copied.fractions.tolist() == clocks.fractions.tolist() == [[1.0]]


OUT_OF_ORDER = (
    "expected operands that wait 0 samples or more, late no less, begin no less than late, and end "
    "no less than begin, got OperatorClock(kind='oldest', event='holds', begin=0, end=3, late=0, "
    "operands=((0, 1),), asked=None, first=False)"
)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (
            lambda clocks: clocks.feed([[1, 2, 3]]),
            "expected values of the shape (1, 2), a row for each part, got (1, 3)",
        ),
        (
            lambda clocks: clocks.feed([[1, 2]], np.array([1, 0])),
            "expected a mask of 2 booleans, one for each batch entry, got int64 of the shape (2,)",
        ),
        (
            lambda clocks: clocks.reset(np.array([True])),
            "expected a mask of 2 booleans, one for each batch entry, got bool of the shape (1,)",
        ),
        (
            lambda _: OperatorClocks([ONE, ONE._replace(asked=1)], 1, 2),
            "expected clocks of the parts 0 to 0, got part 1",
        ),
        (
            lambda _: OperatorClocks([ONE._replace(event="until")], 1, 2),
            "expected 2 operands for 'until', got 1",
        ),
        (lambda _: OperatorClocks([ONE._replace(operands=((0, 1),))], 1, 2), OUT_OF_ORDER),
    ],
)
def test_mistakes_are_told(backend: Any, ask: Any, message: str) -> None:  # noqa: ANN401
    clocks = OperatorClocks([ONE], 1, 2, backend)
    with pytest.raises(rtamt.InputError) as raised:
        ask(clocks)
    assert str(raised.value) == message


def test_states_of_other_clocks_and_damaged_ones_change_nothing() -> None:
    batch = BACKENDS["native"].clock_batch if "native" in BACKENDS else None
    if batch is None:  # the states of Python machines are lists of fields
        return
    used = batch([ONE], 1, 2)
    used.feed(np.array([[-1.0, -1.0]]))
    state, shown = used.state(), used.fractions.tolist()
    far = np.int64(2**40).tobytes()
    damaged = [
        state[:-1],
        state + b"0",
        b"",
        batch([ONE], 1, 3).state(),
        state[:24] + far + state[32:],
    ]
    for each in damaged:
        with pytest.raises(ValueError, match="expected a"):
            used.restore(each)
        assert used.fractions.tolist() == shown
