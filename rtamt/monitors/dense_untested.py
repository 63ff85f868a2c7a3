"""What the verdict on a trace in dense time needs and the trace does not have."""

from __future__ import annotations

from fractions import Fraction

from rtamt.language.node import Node
from rtamt.machines.dense.outlook import DenseOutlook, Places
from rtamt.monitors.untested import Untested
from rtamt.program.instructions import Window

__all__ = ["found_untested_dense"]

_Place = tuple[int, int]
"""A register, and a position at which its value is needed."""


def found_untested_dense(
    outlook: DenseOutlook, begin: int, tick: Fraction, *, cut: bool
) -> tuple[Untested, ...]:
    """What an undecided verdict hangs on: the outermost formulas that need more than was recorded.

    It goes from the root to operands that are undecided, and to the first time at which they are.

    Args:
        outlook: The bounds of the trace.
        begin: The tick at which the trace begins.
        tick: The length of a tick in seconds.
        cut: Whether the trace was cut; else anything may follow.
    """
    walk = _Walk(outlook, cut=cut)
    walk.walk()

    def moment(position: int) -> float:
        time = (begin + position // 2) * tick
        return int(time) if time.denominator == 1 else float(time)

    def last(position: int | None) -> float | None:
        return None if position is None else moment(position + 1)

    return tuple(
        Untested(str(node), moment(at), moment(since), last(end), "s")
        for (node, at), (since, end) in sorted(walk.found.items(), key=lambda item: item[0][1])
    )


class _Walk:
    """From the root of the formulas down to what was not recorded."""

    def __init__(self, outlook: DenseOutlook, *, cut: bool) -> None:
        self._cut = cut
        self._last = outlook.last
        self._program = outlook.program
        self._outlook = outlook
        self._known: dict[int, Places] = {}
        self.found: dict[tuple[Node, int], tuple[int, int | None]] = {}

    def walk(self) -> None:
        program = self._program
        stack: list[_Place] = [(program.result, 0)]
        seen = set[_Place]()
        while stack:
            place = register, at = stack.pop()
            if place in seen or register < program.terms:
                continue
            seen.add(place)
            instruction = program.formula(register)
            if isinstance(instruction, Window):
                stack += self._through(register, instruction, at)
                continue
            below = [operand for operand in instruction.args if operand >= program.terms]
            stack += [(r, at) for r in below if self._undecided(r).first(at, at) is not None]

    def _undecided(self, register: int) -> Places:
        """Where a register is undecided; found once."""
        if register not in self._known:
            self._known[register] = self._outlook.undecided(register)
        return self._known[register]

    def _through(self, register: int, window: Window, at: int) -> list[_Place]:
        """The operands of a window that are undecided at recorded times; notes what is beyond."""
        begin = 0 if window.lo is None else max(0, at + window.lo)
        end = None if window.hi is None else at + window.hi
        if self._cut:
            missing = window.endless and at + window.begin > self._last
        else:  # what was not seen may not be there
            missing = end is None or ((window.hi or 0) > 0 and end > self._last)
        deeper: list[_Place] = []
        for operand in window.args:
            its = self._undecided(operand)
            first = its.first(begin, self._last if end is None else min(end, self._last))
            if first is not None:
                deeper.append((operand, first))
            if end is not None:
                missing = missing or its.first(max(begin, self._last + 1), end) is not None
        if missing:
            self._note(register, at, max(begin, self._last), None if window.endless else end)
        return deeper

    def _note(self, register: int, at: int, begin: int, end: int | None) -> None:
        """Note what a window needs of the time after the trace."""
        node = self._program.sources[register]
        before = self.found.get((node, at))
        if before is not None:
            begin = min(begin, before[0])
            end = None if end is None or before[1] is None else max(end, before[1])
        self.found[node, at] = begin, end
