"""Matched violations of two recordings, against a judgement of every instant."""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt_gym.results.span_matching import RecordedSpans, Status, TimeSpan, match_spans

SWAPPED = {"new": "gone", "gone": "new", "longer": "shorter", "shorter": "longer"}
words = st.lists(st.sampled_from("vvsssu"), min_size=1, max_size=12)
tolerances = st.sampled_from([0, 1, 2, 3])


def runs(letters: Sequence[str], letter: str, offset: int) -> list[TimeSpan]:
    result, place = [], offset
    for key, group in itertools.groupby(letters):
        length = len(list(group))
        if key == letter:
            result.append(TimeSpan(place, place + length, place + length == offset + len(letters)))
        place += length
    return result


def recorded(letters: Sequence[str], offset: int = 0) -> RecordedSpans:
    """Return a recording with a letter for each second: violated, satisfied or unknown."""
    return RecordedSpans(
        runs(letters, "v", offset),
        runs(letters, "u", offset),
        TimeSpan(offset, offset + len(letters)),
    )


def brute_pairs(a: RecordedSpans, b: RecordedSpans, tolerance: float) -> set[tuple[int, int]]:
    """Return all candidates one by one, always the best of the remaining ones."""
    free_a, free_b = set(range(len(a.violated))), set(range(len(b.violated)))
    pairs = set()
    for near in (False, True):
        while True:
            best = None
            for i, j in itertools.product(free_a, free_b):
                one, two = a.violated[i], b.violated[j]
                common = {*range(int(one.start), int(one.stop))}
                common &= {*range(int(two.start), int(two.stop))}
                gap = abs(one.start - two.start)
                if not (gap <= tolerance if near else common):
                    continue
                ends = () if near else (-len(common), gap, abs(one.stop - two.stop))
                key = (*ends, gap, min(one.start, two.start), max(one.start, two.start))
                if best is None or key < best[0]:
                    best = key, i, j
            if best is None:
                break
            pairs.add(best[1:])
            free_a.remove(best[1])
            free_b.remove(best[2])
    return pairs


def letter_at(letters: Sequence[str], offset: int, second: int) -> str:
    return letters[second - offset] if 0 <= second - offset < len(letters) else "o"


@settings(max_examples=examples(300))
@given(words, words, st.integers(0, 4), tolerances)
def test_pairs_match_brute_force(a: list[str], b: list[str], offset: int, tolerance: int) -> None:
    one, two = recorded(a), recorded(b, offset)
    found = match_spans(one, two, tolerance)
    assert set(found.pairs) == brute_pairs(one, two, tolerance)
    assert len({i for i, _ in found.pairs}) == len({j for _, j in found.pairs}) == len(found.pairs)


def seconds_of(span: TimeSpan) -> range:
    return range(int(span.start), int(span.stop))


class Letters(NamedTuple):
    """A recording as letters from a second on, and the tolerance of the comparison."""

    letters: Sequence[str]
    begin: int
    tolerance: int

    def at(self, second: int) -> str:
        return letter_at(self.letters, self.begin, second)

    def covers(self, span: TimeSpan, wanted: str) -> bool:
        """Return whether all seconds have a wanted letter, except the tolerance at each end.

        Seconds that are not recorded have no tolerance.
        """
        seconds = seconds_of(span)
        for first, last in itertools.combinations_with_replacement(seconds, 2):
            letters = {self.at(second) for second in range(first, last + 1)}
            ends = max(first - seconds[0], seconds[-1] - last)
            limit = 0 if letters == {"o"} else self.tolerance
            if letters <= {*wanted} and ends <= limit:
                return True
        return False

    def alone(self, span: TimeSpan, word: Status) -> Status:
        if self.covers(span, "v"):
            return "part"
        return "undecided" if self.covers(span, "vuo") else word

    def satisfied(self, span: TimeSpan) -> int:
        return sum(self.at(second) == "s" for second in seconds_of(span))


def partner_status(own: TimeSpan, span: TimeSpan, a: Letters, b: Letters) -> Status:
    tolerance = a.tolerance
    growth = (span.stop - span.start) - (own.stop - own.start)
    later = span.stop - own.stop
    ends = abs(later) <= tolerance
    ends |= (own.censored and later >= 0) or (span.censored and later <= 0)
    if ends and abs(span.start - own.start) <= tolerance:
        return "same"
    if growth > tolerance and a.satisfied(span) > tolerance:
        return "longer"
    if -growth > tolerance and b.satisfied(own) > tolerance:
        return "shorter"
    return "moved"


@settings(max_examples=examples(300))
@given(words, words, st.integers(0, 4), tolerances)
def test_statuses_match_every_second(
    a: list[str], b: list[str], offset: int, tolerance: int
) -> None:
    one, two = recorded(a), recorded(b, offset)
    found = match_spans(one, two, tolerance)
    of_a, of_b = Letters(a, 0, tolerance), Letters(b, offset, tolerance)
    partners = dict(found.pairs)
    backwards = {j: i for i, j in found.pairs}
    for i, span in enumerate(one.violated):
        if i not in partners:
            assert found.of_a[i] == of_b.alone(span, "gone")
    for j, span in enumerate(two.violated):
        if j not in backwards:
            assert found.of_b[j] == of_a.alone(span, "new")
            continue
        own = one.violated[backwards[j]]
        assert found.of_b[j] == found.of_a[backwards[j]]
        assert found.of_b[j] == partner_status(own, span, of_a, of_b)
    assert found.open_b == sum(not of_a.covers(span, "vuo") for span in two.unknown)


@settings(max_examples=examples(200))
@given(words, words, st.integers(0, 4), tolerances)
def test_exchanged_sides_exchange_the_result(
    a: list[str], b: list[str], offset: int, tolerance: int
) -> None:
    one, two = recorded(a), recorded(b, offset)
    found, other = match_spans(one, two, tolerance), match_spans(two, one, tolerance)
    assert {(j, i) for i, j in found.pairs} == set(other.pairs)
    assert [SWAPPED.get(word, word) for word in found.of_a] == list(other.of_b)
    assert [SWAPPED.get(word, word) for word in found.of_b] == list(other.of_a)
    assert (found.open_a, found.open_b) == (other.open_b, other.open_a)


@settings(max_examples=examples(100))
@given(words, tolerances)
def test_equal_recordings_are_the_same(a: list[str], tolerance: int) -> None:
    found = match_spans(recorded(a), recorded(a), tolerance)
    assert set(found.of_a) | set(found.of_b) <= {"same"}
    assert found.open_a == found.open_b == 0


@settings(max_examples=examples(100))
@given(words, words, st.integers(0, 3), st.sampled_from([1.7e9, 0.1, 12345.7]))
def test_rounding_changes_nothing(a: list[str], b: list[str], tolerance: int, base: float) -> None:
    def moved(spans: RecordedSpans, sign: int) -> RecordedSpans:
        def shift(span: TimeSpan) -> TimeSpan:
            start, stop = (
                math.nextafter(base + 0.1 * end, sign * math.inf) for end in (span.start, span.stop)
            )
            return TimeSpan(start, stop, span.censored)

        return RecordedSpans(
            [*map(shift, spans.violated)], [*map(shift, spans.unknown)], shift(spans.recorded)
        )

    exact = match_spans(recorded(a), recorded(b), tolerance)
    rounded = match_spans(moved(recorded(a), 1), moved(recorded(b), -1), 0.1 * tolerance)
    assert exact == rounded


@pytest.mark.parametrize("tolerance", [0, 1e-3])
def test_single_instants_of_dense_time(tolerance: float) -> None:
    def instant(time: float) -> TimeSpan:
        return TimeSpan(time, math.nextafter(time, math.inf))

    span = TimeSpan(0, 100)
    a = RecordedSpans([TimeSpan(2, 5), instant(10)], [], span)
    b = RecordedSpans([TimeSpan(2, 4), instant(5), instant(10), instant(20)], [], span)
    found = match_spans(a, b, tolerance)
    assert found.pairs == ((0, 0), (1, 2))
    # the half-open violation of A ends before 5 s, so the instant is a violation of its own
    assert found.of_b == ("shorter", "new", "same", "new")


def test_violation_after_the_recording() -> None:
    span = TimeSpan(0, 10)
    ahead = RecordedSpans([TimeSpan(10, 11, censored=True)], [], span, ahead=0)
    satisfied = RecordedSpans([], [], span, satisfied=True)
    undecided = RecordedSpans([], [], span)
    assert match_spans(satisfied, ahead, 0).of_b == ("new",)
    assert match_spans(undecided, ahead, 0).of_b == ("undecided",)
    assert match_spans(ahead, satisfied, 0).of_a == ("gone",)
    assert match_spans(ahead, ahead, 0).of_a == ("same",)
    longer = RecordedSpans([TimeSpan(10, 14)], [], TimeSpan(0, 20))
    assert match_spans(ahead, longer, 0).of_b == ("same",)


def test_split_violation_is_not_new() -> None:
    span = TimeSpan(0, 100)
    long = RecordedSpans([TimeSpan(0, 100, censored=True)], [], span)
    pieces = RecordedSpans([TimeSpan(10 * i, 10 * i + 8) for i in range(10)], [], span)
    found = match_spans(long, pieces, 0)
    assert sorted(found.of_b) == ["part"] * 9 + ["shorter"]
    # but a part that extends beyond the violation of A is
    short = RecordedSpans([TimeSpan(0, 10)], [], span)
    reaching = RecordedSpans([TimeSpan(0, 6), TimeSpan(9, 90)], [], span)
    assert match_spans(short, reaching, 1).of_b == ("shorter", "new")


def test_tolerance_does_not_excuse_neighbours() -> None:
    span = TimeSpan(0, 10)
    one = RecordedSpans([TimeSpan(5, 6)], [], span)
    three = RecordedSpans([TimeSpan(4, 4.5), TimeSpan(5, 6), TimeSpan(6.5, 7)], [], span)
    assert match_spans(one, three, 1).of_b == ("new", "same", "new")
    assert match_spans(three, one, 1).of_a == ("gone", "same", "gone")
    unknown = RecordedSpans([], [TimeSpan(4, 4.5), TimeSpan(6.5, 7)], span)
    assert match_spans(unknown, one, 1).of_b == ("new",)
    assert match_spans(one, unknown, 1).open_b == 2


def test_tolerance_does_not_fill_a_gap() -> None:
    span = TimeSpan(0, 20)
    a = RecordedSpans([TimeSpan(0, 6), TimeSpan(6.5, 12)], [], span)
    b = RecordedSpans([TimeSpan(0, 5.8), TimeSpan(5.9, 6.9), TimeSpan(7, 12.2)], [], span)
    assert match_spans(a, b, 0.3).of_b == ("same", "new", "moved")
    # at its own end, a violation may extend beyond the other by the tolerance
    assert match_spans(a, b, 0.6).of_b == ("same", "part", "same")
