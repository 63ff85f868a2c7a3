"""Compiles a specification over dense time.

Operators and instructions have the same meaning as over samples. Offsets and times of events are
whole numbers of ticks; a tick has the length of the resolution.

For exact values at every instant a program runs over regions: everything is constant on each
instant t and on each open interval (t, t + 1). Instant t has position 2t, the interval after it 2t
+ 1. A window [a, b] from any point of a region meets the regions at offsets 2a to 2b, so a formula
over dense time is a formula over positions, and isolated instants count.

A witness of `until` inside an interval needs p on the rest of that interval too. The pairs of
``WINDOW until`` and of the other folds of two operands are therefore q at an instant, and q and p
at an interval (q or p for the dual folds). A window with an odd last offset ends before an instant:
`until[a:b]` and its dual have one before any witness.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rtamt.errors import Advice, Argument, InputTypeError, Message, SpecificationError
from rtamt.language.interval import UNITS
from rtamt.language.node import Node
from rtamt.language.operators import Bounds
from rtamt.language.specification import Specification
from rtamt.program.instructions import Window, operands
from rtamt.program.interface import STANDARD, Interface
from rtamt.program.lowering import ProgramBuilder, cached_by_text, refuse_rates
from rtamt.program.program import Program
from rtamt.program.timing import Period, as_period, seconds_text

MAX_TICKS = 2**62
"""Times, bounds and sums of nested bounds are below this: the sum of two is an int64."""

_ZEROS = 9  # more zeros at the end of a number become an exponent
NANOSECOND = Fraction(1, 10**9)
"""The default resolution, in seconds."""


def as_resolution(resolution: Period) -> Fraction:
    """Return the length of a tick in seconds, which is read as `as_period` reads a period."""
    seconds = as_period(resolution, "resolution")
    if seconds is None:
        raise InputTypeError('expected a resolution in seconds or as text such as "1ns", got None')
    return seconds


def duration_text(seconds: Fraction) -> str:
    """Return the shortest text that `as_resolution` reads as this duration.

    Example:
        >>> [duration_text(Fraction(1, 10**9)), duration_text(Fraction(3, 10))]
        ['1ns', '300ms']
    """
    units = [unit for unit, length in UNITS.items() if (seconds / length).denominator == 1]
    unit = units[0] if units else "s" if seconds > UNITS["ps"] else "ps"
    text = seconds_text(seconds / UNITS[unit])
    digits = text.rstrip("0")
    zeros = len(text) - len(digits)
    return f"{digits}e{zeros}{unit}" if zeros > _ZEROS else f"{text}{unit}"


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class DenseProgram:
    """A compiled specification over dense time; offsets and latencies are ticks."""

    program: Program
    resolution: Fraction

    @property
    def tick(self) -> Fraction:
        """The length of a tick in the specification's unit."""
        return self.resolution / UNITS[self.program.specification.unit]

    def time(self, ticks: int) -> float:
        """Return a number of ticks as a time in the specification's unit."""
        return float(ticks * self.tick)

    def bounds(self, node: Node) -> Bounds:
        """Return the bounds of an operator's interval in ticks."""
        first, last = self.program.specification.bounds(node.interval)
        return int(first / self.tick), None if last is None else int(last / self.tick)

    def latency(self, register: int) -> float:
        """Return the delay of a register; inf if it needs the whole future."""
        ticks = self.program.latencies[register]
        return math.inf if ticks is None else self.time(ticks)

    def result_alone(self) -> DenseProgram:
        """Return the program without the registers that only named formulas need."""
        result = self.program.result
        return replace(self, program=self.program.restricted(result, {}))


@dataclass(frozen=True, eq=False, slots=True)
class RegionProgram(DenseProgram):
    """A compiled specification with positions as offsets, two in a tick.

    ``reach`` is the largest distance in ticks between a time and the times that its result reads.
    """

    reach: int

    def of(self, register: int) -> RegionProgram:
        """Return the program with another result."""
        program = replace(self.program, result=register)
        return replace(self, program=program, reach=_reach(program))


class DenseBuilder(ProgramBuilder):
    """Writes instructions over intervals of time instead of samples."""

    def __init__(
        self, specification: Specification, resolution: Fraction, interface: Interface
    ) -> None:
        super().__init__(specification, None, interface)
        self._resolution = resolution
        self._reaches: dict[Node, int] = {}

    def bounds(self, node: Node) -> Bounds:
        """Return the bounds of an operator's interval, in ticks."""
        first, last = self.specification.bounds(node.interval)
        begin = self._ticks(node, first)
        return begin, None if last is None else self._ticks(node, last)

    def _ticks(self, node: Node, bound: Fraction) -> int:
        unit = self.specification.unit
        seconds = bound * UNITS[unit]
        ticks = seconds / self._resolution
        text = f"{seconds_text(bound)} {unit}"
        if ticks.denominator != 1:
            finer = duration_text(_common(seconds, self._resolution))
            raise self.specification.error(
                node,
                f"bound {text} is not a whole number of ticks of {duration_text(self._resolution)}",
                Advice("give ", Argument("resolution", finer)),
            )
        if ticks >= MAX_TICKS:
            raise self._too_far(node, f"bound {text} is", ticks)
        return int(ticks)

    def _too_far(self, node: Node, what: str, ticks: Fraction | int) -> SpecificationError:
        coarser = self._resolution
        while ticks * self._resolution >= MAX_TICKS * coarser:
            coarser *= 10
        bounds = [
            bound * UNITS[self.specification.unit]
            for other in self.specification.nodes()
            for bound in self.specification.bounds(other.interval)
            if bound
        ]
        if all((bound / coarser).denominator == 1 for bound in bounds):
            hint: str = Message(
                Advice("give ", Argument("resolution", duration_text(coarser)), ", or "),
                "write smaller bounds",
            )
        else:
            hint = "write smaller bounds"
        return self.specification.error(
            node, f"{what} 2**62 ticks of {duration_text(self._resolution)} or more", hint
        )

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
        """Until: p on [t, t'): up to the start of the interval, and from there to t'."""
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
            if symbol == "rate":
                refuse_rates(self.specification, "dense time, in which values change in steps,")
            forms = "eventually[0:d]" if node.op.future else "once[0:d]"
            raise self.specification.error(
                node,
                f"'{symbol}' reads the next or previous sample, and dense time has events only",
                Message(
                    f"look a time d away with {forms}, or ",
                    Argument("dense", words="use Monitor with a period"),
                ),
            )
        register = super().lower(node, known)
        reach = max((self._reaches[a] for a in node.args), default=0)
        if node.op is not None and node.op.timed:
            begin, end = DenseBuilder.bounds(self, node)
            reach += begin if end is None else end
            if reach >= MAX_TICKS:
                raise self._too_far(node, "the bounds nested here are together", reach)
        self._reaches[node] = reach
        return register


def _common(a: Fraction, b: Fraction) -> Fraction:
    """Return the largest common divisor of two durations."""
    scale = math.lcm(a.denominator, b.denominator)
    return Fraction(math.gcd(int(a * scale), int(b * scale)), scale)


@cached_by_text
def compile_dense(
    specification: Specification,
    resolution: Fraction = NANOSECOND,
    *,
    interface: Interface = STANDARD,
    online: bool = False,
) -> DenseProgram:
    """Return the program of a specification over dense time."""
    if online:
        offline = compile_dense(specification, resolution, interface=interface)
        instead = Argument("dense", words="use rtamt.dense.evaluate()")
        program = offline.program.online("rtamt.dense.Monitor", instead)
        return DenseProgram(program, resolution)
    program = DenseBuilder(specification, resolution, interface).program()
    if not program.variables:
        raise specification.error(
            specification.formula,
            "a formula without variables has no events to set the start and end of a trace",
            "use evaluate() with n=, or a formula of a variable",
        )
    return DenseProgram(program, resolution)


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
        reach = max((reaches[a] for a in operands(instruction)), default=0)
        if isinstance(instruction, Window):
            reach += max(abs(instruction.lo or 0), abs(instruction.hi or 0))
        reaches.append(reach)
    return (reaches[program.result] + 1) // 2


@cached_by_text
def compile_regions(
    specification: Specification,
    resolution: Fraction,
    *,
    interface: Interface = STANDARD,
    named: bool = False,
) -> RegionProgram:
    """Return the program of a specification over the regions of dense time."""
    compile_dense(specification, resolution, interface=interface)  # raises its errors
    program = _RegionBuilder(specification, resolution, interface).program()
    if not named:
        program = program.restricted(program.result, {})
    return RegionProgram(program, resolution, _reach(program))
