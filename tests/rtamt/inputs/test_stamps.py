"""The classes of stamps, against an oracle that reads all messages at once."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from rtamt.inputs.stamps import StampOrder

SECOND = 10**9
# Milliseconds since the previous arrival, and the offset of the stamp in tenths of a second.
MESSAGES = st.lists(
    st.tuples(st.integers(0, 1500), st.one_of(st.integers(-25, 25), st.just(0))), max_size=30
)


def classified(messages: list[tuple[int, int]]) -> list[str]:
    """Return the class of each message by the rule: in, late, stray, held or jump."""
    classes = [""] * len(messages)
    since = 0  # the first message after the last jump
    for n, (stamp, arrival) in enumerate(messages):
        accepted = [m for k, m in enumerate(messages[:n]) if k >= since and classes[k] in _COUNTS]
        newest = max((s for s, _ in accepted), default=stamp)
        largest = max((s - a for s, a in accepted), default=stamp - arrival)
        held = n - 1 if n and classes[n - 1] == "held" else None
        if newest - stamp <= SECOND and stamp - arrival <= largest + SECOND:
            if held is not None:
                classes[held] = "stray"
            classes[n] = "late" if stamp < newest else "in"
            continue
        classes[n] = "held"
        if held is not None:
            first = messages[held]
            if abs((stamp - arrival) - (first[0] - first[1])) <= SECOND:
                since = held
                classes[held], classes[n] = "jump", "late" if stamp < first[0] else "in"
            else:
                classes[held] = "stray"
    return classes


_COUNTS = ("in", "jump")


@given(MESSAGES)
def test_order_is_the_rule(messages: list[tuple[int, int]]) -> None:
    times, arrival = [], 100 * SECOND
    for wait, offset in messages:
        arrival += wait * 10**6
        times.append((arrival + offset * 10**8, arrival))
    order = StampOrder()
    accepted = [each for n, m in enumerate(times) for each in order.take(*m, n)]
    classes = classified(times)
    assert [each.message for each in accepted] == [n for n, c in enumerate(classes) if c in _COUNTS]
    assert [bool(each.jump) for each in accepted] == [
        classes[each.message] == "jump" for each in accepted
    ]
    assert (order.late, order.strays) == (classes.count("late"), classes.count("stray"))
    assert (order.held is not None) == ("held" in classes)


@given(MESSAGES)
def test_counts_add_up(messages: list[tuple[int, int]]) -> None:
    order, arrival, accepted = StampOrder(strict=True), 0, 0
    for wait, offset in messages:
        arrival += wait * 10**6
        accepted += len(order.take(arrival + offset * 10**8, arrival, None))
    assert accepted + order.late + order.strays + (order.held is not None) == len(messages)
