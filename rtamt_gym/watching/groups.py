"""The groups of a stream: their names, ends, lost starts and periods."""

from __future__ import annotations

import heapq
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Final

import numpy as np

from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.parts import group_name
from rtamt_gym.recorded.recording import whole_number
from rtamt_gym.recorded.times import HOLE
from rtamt_gym.tables import counted, number
from rtamt_gym.watching.rows import ColumnCells, RowBlock, RowFault, cell_text

_KINDS: Final[Mapping[type, str]] = {
    str: "a text",
    bool: "a truth value",
    int: "a number",
    float: "a number",
}
"""The kinds of values in JSON; null is of any kind."""


class GroupNames:
    """Reads the names of groups from the columns of ``--by``.

    The name of a group is the text of its column, or of several columns ``car=7,lap=2``.

    Example:
        >>> block = RowBlock([2, 3], {"car": ["7", "8"], "lap": ["2", "2"]})
        >>> GroupNames(["car"]).of(block), GroupNames(["car", "lap"]).of(block)
        (['7', '8'], ['car=7,lap=2', 'car=8,lap=2'])
    """

    def __init__(self, by: Sequence[str]) -> None:
        self._by = by
        self._kinds: dict[str, str] = {}
        self._names: dict[tuple[str, ...], str] = {}
        self._texts: dict[str, set[str]] = {}
        self._numbers: dict[tuple[str, str], str] = {}
        """The first text of each number in each column."""

    def check(self, source: str, names: Sequence[str], times: Sequence[str]) -> None:
        """Check that a stream has the columns, and that they are not its times."""
        for column in self._by:
            if column in times:
                raise InputError(
                    f"{source}: expected a column of objects for --by, got '{column}', the times "
                    "of the rows"
                )
            if column not in names:
                raise InputError(
                    f"{source}: no column '{column}', which --by names; the columns are "
                    f"{listed(names, column)}{nearest(column, names)}"
                )

    def of(self, block: RowBlock) -> list[str]:
        """Return the name of the group of each row."""
        faults, texts = list[RowFault](), []
        for column in self._by:
            cells = block.columns[column]
            try:
                self._check_kinds(column, cells)
            except RowFault as fault:
                faults.append(fault)
            texts.append([cell_text(cell).strip() for cell in cells])
            if "" in texts[-1]:
                row = texts[-1].index("")
                faults.append(RowFault(row, f"column '{column}': expected a group, got none"))
            faults += self._two_writings(column, texts[-1])
        if faults:
            raise min(faults, key=lambda fault: fault.row)
        if len(texts) == 1:
            return texts[0]
        return list(map(self._name, zip(*texts, strict=True)))

    def at(self, block: RowBlock, row: int) -> str | None:
        """Return the group of a bad row; None without groups, or if a cell is not a name."""
        texts = []
        for column in self._by:
            cell = block.columns[column][row]
            if _KINDS.get(type(cell), "") != self._kinds.get(column, ""):
                return None
            texts.append(cell_text(cell).strip())
        return self._name(tuple(texts)) if texts and all(texts) else None

    def _two_writings(self, column: str, texts: Sequence[str]) -> list[RowFault]:
        """Return the fault of a row that writes a number otherwise than a row before it."""
        known = self._texts.setdefault(column, set())
        for text in dict.fromkeys(texts):
            if text in known:
                continue
            whole = whole_number(text)
            other = self._numbers.get((column, whole), text)
            if other != text and whole in (other, text):
                return [
                    RowFault(
                        texts.index(text),
                        f"column '{column}': got '{text}' after '{other}', which may be one object "
                        "or two. Write the number in one way.",
                        skippable=False,
                    )
                ]
            self._numbers[column, whole] = other
            known.add(text)
        return []

    def _name(self, texts: tuple[str, ...]) -> str:
        if len(texts) == 1:
            return texts[0]
        if texts not in self._names:
            parts = dict(zip(self._by, texts, strict=True))
            self._names[texts] = group_name("", parts).removeprefix("[").removesuffix("]")
        return self._names[texts]

    def _check_kinds(self, column: str, cells: ColumnCells) -> None:
        """Check that the names of groups in JSON are of one kind, as 7 and "7" are not."""
        kinds, known = {_KINDS.get(type(cell), "") for cell in cells}, self._kinds.get(column, "")
        if kinds <= {"", known}:
            return
        for row, cell in enumerate(cells):
            kind = _KINDS.get(type(cell), "")
            known = known or kind
            if kind not in ("", known):
                raise RowFault(
                    row,
                    f"column '{column}': expected {known}, as in the first row, got "
                    f"{json.dumps(cell)}, {kind}. Write all names of groups as texts.",
                )
        self._kinds[column] = known


class LostStarts:
    """Bad lines that came before the first good row of their group.

    Example:
        >>> lost = LostStarts(most=10)
        >>> lost.add(None, "stdin, line 4: expected 3 cells, got 2")
        >>> lost.count_start("b")
        >>> lost.notes()[0][:66]
        '1 group starts after a bad line that may have been its first row, '
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._bad: dict[str, str] = {}
        self._unknown = self._first = ""
        self._doubtful = 0

    def add(self, group: str | None, message: str) -> None:
        """Note a bad line of a group that has not started; None if its group is not known."""
        if group is not None and len(self._bad) < self._most:
            self._bad.setdefault(group, message)
        else:
            self._unknown = self._unknown or message

    def check_start(self, group: str, row: int) -> None:
        """Check that a group starts with its first row."""
        if message := self._bad.get(group):
            raise RowFault(
                row,
                f"group {shown(group)!r} starts with a bad line, {message} (--skip-bad needs a "
                "good first row of each group)",
                skippable=False,
            )

    def count_start(self, group: str) -> None:
        """Note that a group has started; a bad line may have been its first row."""
        if self._unknown:
            self._doubtful += 1
            self._first = self._first or f"{shown(group)!r} after {self._unknown}"

    def failures(self, source: str) -> list[str]:
        """Return a sentence on groups without a good row at the end; an empty list without any."""
        if not self._bad:
            return []
        (name, message), more = next(iter(self._bad.items())), len(self._bad) - 1
        others = f" (and {counted(more, 'more group')})" if more else ""
        group = f"group {shown(name)!r} has bad lines only, the first: {message}{others}"
        return [f"{source}: {group}. Correct the line, or remove the group."]

    def notes(self) -> list[str]:
        """Return a sentence on groups that may lack their first row; an empty list without any."""
        if not self._doubtful:
            return []
        groups = counted(self._doubtful, "group")
        verb, pronoun = ("starts", "its") if self._doubtful == 1 else ("start", "their")
        lost = f"a bad line that may have been {pronoun} first row"
        return [f"{groups} {verb} after {lost}, the first: {self._first}"]


_ENDED: Final = 10_000_000
"""The maximum number of ended groups that are stored by name."""


_ROUNDED: Final = 1e-10
"""The part of the idle time by which a distance of rounded times may differ from it."""


class IdleGroups:
    """The last time of each group, and the names of ended groups.

    Example:
        >>> groups = IdleGroups(2.0, "stdin")
        >>> for time, group in ((0.0, "a"), (1.0, "b"), (2.5, "b")):
        ...     groups.add(group, time)
        ...     print([*groups.ended_at(time)])
        []
        []
        ['a']
    """

    def __init__(self, idle: float, source: str) -> None:
        self._source = source
        # A distance of rounded times, such as 1.1 - 0.4, is not longer than the time that it shows.
        self._idle = idle * (1 + _ROUNDED)
        self._queue: list[tuple[float, str]] = []
        self._last: dict[str, float] = {}
        self._newest = -math.inf
        self._ended: set[str] = set()
        self._late: dict[str, int] = {}

    def __contains__(self, group: str | None) -> bool:
        return group in self._ended

    def check(self, group: str, row: int) -> None:
        """Check that a group has not ended."""
        if group in self._ended:
            raise RowFault(row, f"group {shown(group)!r} has already ended by --group-idle")

    def add_late(self, group: str) -> None:
        """Note that a row of a group that has ended was left out."""
        self._late[group] = self._late.get(group, 0) + 1

    def late_text(self) -> str:
        """Return a sentence on rows that came after the end of their groups; empty without one."""
        if not self._late:
            return ""
        (first, rows), groups = next(iter(self._late.items())), len(self._late)
        more = f" (and {counted(groups - 1, 'more group')})" if groups > 1 else ""
        return (
            f"group {shown(first)!r} got {counted(rows, 'row')} after --group-idle had ended "
            f"it{more}: these rows were left out. Give a longer --group-idle to evaluate them."
        )

    def add(self, group: str, time: float) -> None:
        """Note the time of a row."""
        last = self._last.get(group)
        if last is None:
            heapq.heappush(self._queue, (time, group))
        self._last[group] = time if last is None else max(last, time)

    def ended_at(self, time: float) -> Iterator[str]:
        """Yield the groups that end at the time of a row."""
        self._newest = max(self._newest, time)
        while self._queue and self._newest - self._queue[0][0] > self._idle:
            _, group = heapq.heappop(self._queue)
            if self._newest - self._last[group] <= self._idle:
                heapq.heappush(self._queue, (self._last[group], group))
                continue
            del self._last[group]
            self._ended.add(group)
            yield group
            if len(self._ended) > _ENDED:
                raise InputError(f"{self._source}: more than {_ENDED} groups have ended")


class GroupPeriods:
    """The periods of groups, to find a group whose only two rows may have a gap between them.

    Example:
        >>> periods = GroupPeriods()
        >>> periods.add("a", Fraction(1), 6)
        >>> periods.add("b", Fraction(5), 2)
        >>> periods.fault().partition(":")[0]
        "group 'b'"
    """

    def __init__(self) -> None:
        self._counts = Counter[Fraction]()
        self._widest, self._group = Fraction(0), ""

    def add(self, group: str, period: Fraction, samples: int) -> None:
        """Add a group that has ended, with two samples or more."""
        self._counts[period] += samples - 1
        if samples == 2 and period > self._widest:
            self._widest, self._group = period, group

    def fault(self) -> str:
        """Return the error for the two rows that are farthest apart; empty without a gap."""
        steps = sorted(self._counts)
        ends = np.cumsum([self._counts[step] for step in steps])
        usual = steps[int(np.searchsorted(ends, ends[-1] / 2))] if steps else Fraction(0)
        if self._widest < HOLE * usual or not self._widest:
            return ""
        own, other = number(float(self._widest)), number(float(usual))
        return (
            f"group {self._group!r}: expected samples at even distances, got two rows {own} s "
            f"apart, elsewhere {other} s. Give --dense to take rows as events, or watch this group "
            f"alone with --period {own}s if {own} s is its step."
        )
