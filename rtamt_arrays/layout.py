"""What an episode machine on arrays keeps of a program, and at which offsets it finds streams."""

from __future__ import annotations

from typing import NamedTuple

from rtamt.errors import SpecificationError
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import Placement
from rtamt_arrays.worlds import Offsets

__all__ = ["Cells", "Layout"]

_LONGEST = 2**30


class Cells(NamedTuple):
    """Rows of a table of the state.

    Attributes:
        depends: Whether they depend on unknowns, and so lie in ``kept``.
        begin: The first row.
        end: The row behind the last one.
        identity: What they are where a lane begins; None if they are not read there.
    """

    depends: bool
    begin: int
    end: int
    identity: float | None


class Layout:
    """Where the state of an episode has what.

    Attributes:
        depends: Whether each stream depends on an unknown.
        shapes: The offsets of each stream.
        sizes: The rows that depend on no unknown, and those that do.
        folds: Of each window of a stream, the folds of its settled elements, for each number.
        histories: The settled values of streams that others read.
        initial: The folds of windows that are read at time 0.
        firsts: The terms that are read at time 0.
        windows: The windows among the instructions.
        oldest: The age from which on a lane's age no longer matters.
    """

    def __init__(self, placement: Placement) -> None:
        self._placement = placement
        self.program = placement.program
        self.windows = dict(self._windows())
        self.depends = self._dependent()
        self.shapes = self._offsets()
        self.sizes = {False: 0, True: 0}  # rows that depend on no unknown, and others
        self.folds: dict[int, list[Cells]] = {}
        self.histories: dict[int, Cells] = {}
        for r in self._placement.streams:
            window = self.program.instructions[r]
            if isinstance(window, Window) and window.hi is not None:
                rows = 1 if window.length is None else window.length - 1
                self.folds[r] = self._placed(window, rows, depends=self.depends[r])
            shape = self.shapes[r]
            if shape.back > shape.late and not self._is_constant(r):
                rows = shape.back - shape.late
                self.histories[r] = self._cells(rows, None, depends=self.depends[r])
        self.initial: dict[int, list[Cells]] = {}
        for r, window in self.windows.items():
            if r in self._placement.initial:
                depends = any(self.depends[a] for a in window.args)
                self.initial[r] = self._placed(window, 1, depends=depends)
        self.firsts = [r for r in self._placement.initial if r < self.program.terms]
        self.oldest = self._last_age()

    def newest(self, register: int, window: Window) -> int:
        """The offset of the element that settles into the folds of a stream."""
        late = self.shapes[register].late
        return -late if window.hi is None else window.hi - late

    def _is_constant(self, register: int) -> bool:
        return isinstance(self.program.instructions[register], Const)

    def _windows(self) -> list[tuple[int, Window]]:
        instructions = enumerate(self.program.instructions)
        return [(r, each) for r, each in instructions if isinstance(each, Window)]

    def _placed(self, window: Window, rows: int, *, depends: bool) -> list[Cells]:
        return [self._cells(rows, e, depends=depends) for e in FOLDS[window.fold].identity]

    def _cells(self, rows: int, identity: float | None, *, depends: bool) -> Cells:
        begin = self.sizes[depends]
        self.sizes[depends] += rows
        return Cells(depends, begin, begin + rows, identity)

    def _dependent(self) -> dict[int, bool]:
        """Whether each stream depends on an unknown."""
        depends: dict[int, bool] = {}
        for r in self._placement.streams:
            args = self.program.formula(r).args if r >= self.program.terms else ()
            depends[r] = r in self._placement.unknowns or any(depends[a] for a in args)
        return depends

    def _offsets(self) -> dict[int, Offsets]:
        late, past, back = dict[int, int](), dict[int, int](), dict[int, int]()
        for r in self._placement.streams:
            late[r] = past[r] = back[r] = 0
            if r < self.program.terms:
                continue
            instruction = self.program.formula(r)
            late[r] = max(late[a] for a in instruction.args)
            past[r] = max(past[a] for a in instruction.args)
            if isinstance(instruction, Window) and instruction.hi is not None:
                late[r] = max(0, late[r] + instruction.hi)
                lo = instruction.hi if instruction.lo is None else instruction.lo
                past[r] = max(0, past[r] - lo)
        for r in range(self.program.terms, len(self.program.instructions)):
            instruction = self.program.formula(r)
            if isinstance(instruction, Map) and r not in late:
                continue
            oldest = max(late[a] for a in instruction.args)
            if r in late and isinstance(instruction, Window) and instruction.hi is not None:
                oldest = late[r] - instruction.hi
            elif r in late:
                oldest = late[r]
            for a in instruction.args:
                back[a] = max(back[a], late[a], oldest)
        return {r: Offsets(late[r], past[r], max(late[r], back[r])) for r in late}

    def _last_age(self) -> int:
        bounds = [b for w in self.windows.values() for b in (w.lo, w.hi) if b is not None]
        reach = max((sum(shape) for shape in self.shapes.values()), default=0)
        last = 2 + reach + max(map(abs, bounds), default=0)
        if last > _LONGEST:
            formula = self.program.specification.formula
            raise SpecificationError(
                f"{formula} reaches over {last} samples; arrays count up to {_LONGEST}"
            )
        return last
