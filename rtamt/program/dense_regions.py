"""Compiles a specification over the regions of dense time, where every value is exact.

Times and bounds are whole ticks, so everything is constant on each instant t and on each open
interval (t, t + 1). Instant t has position 2t, the interval after it 2t + 1. A window [a, b] from
any point of a region meets the regions at offsets 2a to 2b, so a formula over dense time is a
formula over positions, and isolated instants count.

A witness of `until` inside an interval needs p on the rest of that interval too. So the pairs of
``WINDOW until`` and of the other folds of two operands are: q at an instant, q and p at an interval
(for the dual folds: q or p). A window whose last offset is odd ends before an instant:
`until[a:b]` and its dual have one before any witness.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from fractions import Fraction

from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.language.specification import Specification
from rtamt.program.dense_lowering import DenseBuilder, compile_dense
from rtamt.program.instructions import Instruction, Map, Window
from rtamt.program.interface import STANDARD, Interface
from rtamt.program.program import Program


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class RegionProgram:
    """A compiled specification with positions as offsets, two in a tick.

    Attributes:
        program: The instructions.
        resolution: The length of a tick in seconds.
        reach: The largest distance in ticks between a time and the times that its result reads.
    """

    program: Program
    resolution: Fraction
    reach: int

    def of(self, register: int) -> RegionProgram:
        """Return the program with another result."""
        program = replace(self.program, result=register)
        return replace(self, program=program, reach=_reach(program))


class _RegionBuilder(DenseBuilder):
    """Writes instructions over positions."""

    def bounds(self, node: Node) -> Bounds:
        begin, end = super().bounds(node)
        return 2 * begin, None if end is None else 2 * end

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        """Since: p on (t', t]; the operator's own time needs no p."""
        begin, end = bounds
        if end == 0:
            return q
        fold = self.emit(Window("since", None if end is None else begin - end, 0, (p, q)))
        if begin == 0:
            return self.map("max", q, fold)
        held = self.window("min", 1 - begin, 0, p)
        return self.map("min", held, self.window("max", -begin, -begin, fold))

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        """Until: p on [t, t'); the operator's own time needs no p."""
        begin, end = bounds
        if end == 0:
            return q
        fold = self.emit(Window("until", 0, None if end is None else end - begin, (p, q)))
        if begin == 0:
            return self.map("max", q, fold)
        endless = end is None
        guard = self.emit(Window("min", 0, begin - 1, (p,), guard=True, endless=endless))
        late = self.emit(Window("max", begin, begin, (fold,), endless=endless))
        return self.map("min", guard, late)


def _reach(program: Program) -> int:
    """Return the sum of the longest offsets on a path of windows, in ticks."""
    reaches: list[int] = []
    for instruction in program.instructions:
        reaches.append(_own_reach(instruction, reaches))
    return (reaches[program.result] + 1) // 2


def _own_reach(instruction: Instruction, reaches: list[int]) -> int:
    if not isinstance(instruction, Map | Window):
        return 0
    reach = max(reaches[a] for a in instruction.args)
    if isinstance(instruction, Window):
        reach += max(abs(instruction.lo or 0), abs(instruction.hi or 0))
    return reach


def compile_regions(
    specification: Specification,
    resolution: Fraction,
    *,
    interface: Interface = STANDARD,
    named: bool = False,
) -> RegionProgram:
    """Return the program of a specification over the regions of dense time."""
    # Equal specifications may differ in their text, and errors point at the text.
    return _cached(specification, specification.text, resolution, interface, named)


@functools.lru_cache(maxsize=512)
def _cached(
    specification: Specification,
    text: str,  # noqa: ARG001 - a key of the cache
    resolution: Fraction,
    interface: Interface,
    named: bool,  # noqa: FBT001 - a key of the cache
) -> RegionProgram:
    compile_dense(specification, resolution, interface=interface)  # raises its errors
    program = _RegionBuilder(specification, resolution, interface).program()
    if not named:
        program = program.restricted(program.result, {})
    return RegionProgram(program, resolution, _reach(program))


def regions_of_all(
    specification: Specification, resolution: Fraction, *, interface: Interface
) -> RegionProgram:
    """Return the program of `compile_regions` with the registers of other named formulas."""
    program = _RegionBuilder(specification, resolution, interface).program()
    return RegionProgram(program, resolution, _reach(program))
