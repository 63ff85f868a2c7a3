"""Compiles a specification over dense time.

Operators and instructions mean what they mean over samples. Offsets are exact: whole numbers of
ticks, where a tick is the greatest time that divides every bound. They become floats when a machine
is made.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rtamt.language.node import Node
from rtamt.language.specification import Specification
from rtamt.language.table import Bounds
from rtamt.program.interface import STANDARD, Interface
from rtamt.program.lowering import ProgramBuilder
from rtamt.program.program import Program

__all__ = ["DenseProgram", "compile_dense"]


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class DenseProgram:
    """A compiled specification over dense time.

    Attributes:
        program: The instructions, with offsets and latencies in ticks.
        tick: The length of a tick in the specification's unit.
    """

    program: Program
    tick: Fraction

    def time(self, ticks: int) -> float:
        """A number of ticks as a time in the specification's unit."""
        return float(ticks * self.tick)

    def latency(self, register: int) -> float:
        """The time by which a register is late; inf if it needs the whole future."""
        ticks = self.program.latencies[register]
        return math.inf if ticks is None else self.time(ticks)

    def result_alone(self) -> DenseProgram:
        """The program without what only other named formulas need."""
        result = self.program.result
        return replace(self, program=self.program.restricted(result, {}))


class _DenseBuilder(ProgramBuilder):
    """Writes instructions over intervals of time instead of samples."""

    def __init__(self, specification: Specification, tick: Fraction, interface: Interface) -> None:
        super().__init__(specification, None, interface)
        self._tick = tick

    def bounds(self, node: Node) -> Bounds:
        """The bounds of an operator's interval, in ticks."""
        begin, end = self.specification.bounds(node.interval)
        return int(begin / self._tick), None if end is None else int(end / self._tick)

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        """Since: p on (t', t]; if t' lies inside a step, p is needed on the rest of that step."""
        begin, end = bounds
        oldest = None if end is None else begin - end
        if oldest == 0:
            recent = q
        else:
            fold = self.window("since", oldest, 0, p, self.map("min", p, q))
            recent = self.map("max", q, fold)
        if begin == 0:
            return recent
        held = self.window("min", -begin, 0, p)
        return self.map("min", held, self.window("max", -begin, -begin, recent))

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        """Until: p on [t, t'): up to the begin of the interval, and from there to t'."""
        begin, end = bounds
        # [t, t + begin] in place of [t, t + begin): another value at isolated instants only.
        reached = self.window("until", 0, None if end is None else end - begin, p, q)
        if begin == 0:
            return reached
        held = self.window("min", 0, begin, p)
        return self.map("min", held, self.window("max", begin, begin, reached))

    def lower(self, node: Node, known: Mapping[Node, int]) -> int:
        """Write one node; operators on neighbouring samples are refused."""
        if node.op is not None and node.op.sampled:
            symbol = node.op.symbol
            ways = "eventually[0:d]" if node.op.future else "once[0:d]"
            raise self.specification.error(
                node,
                f"'{symbol}' speaks of neighbouring samples, and dense time has none",
                f"look a time d away with {ways}, or use Monitor with a period",
            )
        return super().lower(node, known)


def compile_dense(
    specification: Specification, *, interface: Interface = STANDARD, online: bool = False
) -> DenseProgram:
    """The program of a specification over dense time.

    Args:
        specification: What to compile.
        interface: Whose robustness it computes; see `rtamt.program.interface`.
        online: Whether every register must have a latency; see `Program.online`.

    Raises:
        SpecificationError: On operators on neighbouring samples (`prev`, `next`, `rise`, `fall`),
            or a formula without variables; with ``online``, also on a future without end.
    """
    # Equal specifications may differ in their text, at which errors point.
    return _cached(specification, specification.text, interface, online)


@functools.lru_cache(maxsize=512)
def _cached(
    specification: Specification,
    text: str,
    interface: Interface,
    online: bool,  # noqa: FBT001 - a key of the cache
) -> DenseProgram:
    if online:
        offline = _cached(specification, text, interface, online=False)
        program = offline.program.online("DenseMonitor", "evaluate_dense()")
        return DenseProgram(program, offline.tick)
    tick = _tick(specification)
    program = _DenseBuilder(specification, tick, interface).program()
    if not program.variables:
        raise specification.error(
            specification.formula,
            "without variables there are no events, which give a trace its begin and end",
            "use evaluate() with n=, or a formula of a variable",
        )
    return DenseProgram(program, tick)


def _tick(specification: Specification) -> Fraction:
    """The greatest time of which every bound is a multiple."""
    intervals = {node.interval for node in specification.nodes()}
    bounds = [b for i in intervals for b in specification.bounds(i) if b]
    if not bounds:
        return Fraction(1)
    scale = math.lcm(*(b.denominator for b in bounds))
    return Fraction(math.gcd(*(int(b * scale) for b in bounds)), scale)
