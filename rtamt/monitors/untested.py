"""What the verdict on a trace needs and the trace does not have."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from rtamt.language.node import Node
from rtamt.machines.bounds import TraceBounds
from rtamt.machines.protocols import End
from rtamt.program.instructions import Map, Window

__all__ = ["Untested", "found_untested"]


@dataclass(frozen=True, slots=True)
class Untested:
    """A formula whose value at a time needs more than was recorded.

    ``str`` gives it in words, as in ``always[20:30](x > 5): not recorded: 20 s to 30 s``.

    Attributes:
        formula: The formula as text.
        at: The time at which its value is needed, in seconds; in samples without a period.
        begin: Begin of the interval that was not recorded, in the same unit.
        end: End of that interval; None: it has none.
        unit: ``"s"`` or ``"samples"``.
    """

    formula: str
    at: float
    begin: float
    end: float | None
    unit: str

    def __str__(self) -> str:
        where = f" at {self._moment(self.at)}" if self.at else ""
        return f"{self.formula}{where}: not recorded: {self._interval()}"

    def _interval(self) -> str:
        if self.end is None:
            return f"{self._moment(self.begin)} and later"
        if self.end == self.begin:
            return self._moment(self.begin)
        if self.unit == "s":
            return f"{self._moment(self.begin)} to {self._moment(self.end)}"
        return f"samples {self.begin:.12g} to {self.end:.12g}"

    def _moment(self, time: float) -> str:
        return f"{time:.12g} s" if self.unit == "s" else f"sample {time:.12g}"


def found_untested(bounds: TraceBounds, period: Fraction | None, end: End) -> tuple[Untested, ...]:
    """What an undecided verdict hangs on: the outermost formulas that need more than was recorded.

    It goes from the root to operands that are undecided, and to the first time at which they are.
    """
    walk = _Walk(bounds, end)
    walk.walk()
    unit, step = ("samples", Fraction(1)) if period is None else ("s", period)

    def moment(sample: int) -> float:
        time = sample * step
        return int(time) if time.denominator == 1 else float(time)

    return tuple(
        Untested(str(node), moment(at), moment(begin), None if end is None else moment(end), unit)
        for (node, at), (begin, end) in sorted(walk.found.items(), key=lambda item: item[0][1])
    )


class _Walk:
    """From the root of the formulas down to what was not recorded."""

    def __init__(self, bounds: TraceBounds, end: End) -> None:
        self._bounds = bounds
        self._end = end
        self._n = bounds.n
        self.found: dict[tuple[Node, int], tuple[int, int | None]] = {}

    def walk(self) -> None:
        program = self._bounds.split.formulas
        stack, seen = [(program.result, 0)], set[tuple[int, int]]()
        while stack:
            place = register, time = stack.pop()
            if place in seen:
                continue
            seen.add(place)
            instruction = program.instructions[register]
            if isinstance(instruction, Map):
                flags = self._bounds.undecided(instruction.args, self._end)
                operands = zip(instruction.args, flags, strict=True)
                stack += [(operand, time) for operand, its in operands if its.at(time)]
            elif isinstance(instruction, Window):
                stack += self._through(register, instruction, time)

    def _through(self, register: int, window: Window, time: int) -> list[tuple[int, int]]:
        """The operands of a window that are undecided at recorded times; notes what is beyond."""
        n = self._n
        begin = 0 if window.lo is None else max(0, time + window.lo)
        cut = self._end == "cut"
        missing = window.hi is None and (not cut or begin >= n)
        if window.endless:
            missing = cut and time + window.begin >= n
        if not cut:  # an unseen element may not be there, except at the window's own time
            missing |= window.hi is not None and time + window.hi >= max(n, time + 1)
        deeper = []
        flags = self._bounds.undecided(window.args, self._end)
        for operand, its in zip(window.args, flags, strict=True):
            end = n - 1 if window.hi is None else time + window.hi
            first = its.first(begin, min(end, n - 1))
            if first is not None:
                deeper.append((operand, first))
            missing = missing or its.first(max(begin, n), end) is not None
        if missing:
            self._note(register, time)
        return deeper

    def _note(self, register: int, at: int) -> None:
        """Note what a window needs of the time after the trace."""
        program = self._bounds.split.exact
        node, window = program.sources[register], program.window(register)
        begin = max(self._n, at + (window.lo or 0))
        end = None if window.hi is None else at + window.hi
        if end is not None:  # a window that begins late and has no end is a shift of another
            inner = program.instructions[window.args[-1]]
            its = program.sources[window.args[-1]]
            if its is node and isinstance(inner, Window) and inner.hi is None:
                end = None
        before = self.found.get((node, at))
        if before is not None:
            begin = min(begin, before[0])
            end = None if end is None or before[1] is None else max(end, before[1])
        self.found[node, at] = begin, end
