"""Bounds of the robustness at the first sample of a whole trace, however it ends."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.backend import Factories
from rtamt.machines.offline import without_nan
from rtamt.machines.protocols import End, World, worlds_of
from rtamt.machines.segments import FOREVER, PlaceRuns
from rtamt.machines.walk import FoldPairs, Keys, Walk, initial_registers, to_keys
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.memory import limit_beyond, sufficient
from rtamt.program.placement import positive
from rtamt.program.program import Program


class TraceBounds:
    """Bounds of the robustness at the first sample of a trace, however it ends.

    The programs for the lower and the upper bound differ only with neutral predicates. ``least``
    and ``greatest`` are the values of each predicate, one object if all are known.
    """

    def __init__(
        self,
        worst: SplitProgram,
        best: SplitProgram,
        least: Sequence[Keys],
        greatest: Sequence[Keys],
        n: int,
        fold_pairs: FoldPairs | None,
    ) -> None:
        self.split = worst
        self.n = n
        self._best_split = best
        self._predicates = least, greatest
        self._fold_pairs = fold_pairs

        def walk(program: SplitProgram, predicates: Sequence[Keys]) -> Walk:
            return Walk(program.formulas, predicates, n, fold_pairs)

        self._worst = walk(worst, least)
        self._given = self._worst if best is worst else walk(best, least)
        self._best = self._given if greatest is least else walk(best, greatest)

    @classmethod
    def of(
        cls,
        program: Program,
        reader: SampleReader,
        machines: Factories,
        columns: tuple[Sequence[NDArray[np.float64]], Sequence[NDArray[np.float64]]],
        n: int,
        *,
        everywhere: bool = False,
    ) -> TraceBounds:
        """Return the bounds for a program and a trace; windows may have no end."""
        bound = sufficient(program, n)
        lower, upper = columns
        limit_beyond(program, n, unknown=upper is not lower)
        worst, best = _both(program, bound)
        needed = n if everywhere else min(n, worst.needed or n)
        terms = worst.predicates
        observed = tuple(terms.outputs.values())
        least: list[Keys] = []
        greatest = least
        if terms.outputs and upper is not lower:
            ranges = machines.term_ranges(terms, reader, observed, lower, upper, n)
            least, greatest = ([to_keys(column[:needed]) for column in end] for end in ranges)
        elif terms.outputs:
            machine = machines.discrete_machine(terms, SampleReader(terms), observed)
            values = without_nan(reader, lower, lambda known: machine.evaluate(known, n))
            least = greatest = [to_keys(column[:needed]) for column in values]
        return cls(worst, best, least, greatest, needed, machines.fold_pairs)

    def part(self, program: Program) -> TraceBounds:
        """Return the bounds for another program on the trace, which reads no other predicates.

        Its semantics and variables are the same.
        """
        worst, best = _both(program, sufficient(program, self.n))
        places = outputs_among(worst.predicates, self.split.predicates)
        least, greatest = self._predicates
        low = [least[position] for position in places]
        high = low if greatest is least else [greatest[position] for position in places]
        return TraceBounds(worst, best, low, high, self.n, self._fold_pairs)

    def until(self, n: int) -> TraceBounds:
        """Return the bounds for the first n samples."""
        least, greatest = self._predicates
        low = [column[:n] for column in least]
        high = low if greatest is least else [column[:n] for column in greatest]
        return TraceBounds(self.split, self._best_split, low, high, n, self._fold_pairs)

    def robustness(self) -> float:
        """Return the robustness of the complete trace, the smallest one for uncertain values."""
        return self._given.at_zero(World.NOW)

    def bounds(self, end: End) -> tuple[float, float]:
        """Return the smallest and the largest robustness that a reading of the end leaves possible.

        Both are the robustness of a complete trace, unless neutral predicates or uncertain values
        matter.
        """
        lower, upper = worlds_of(end)
        return self._worst.at_zero(lower), self._best.at_zero(upper)

    def fails(self, end: End) -> NDArray[np.bool_]:
        """Return whether the result fails for certain, at every sample."""
        result = self._best_split.formulas.result
        return self._best.recorded(result, worlds_of(end)[1]) < 0

    def holds(self, end: End) -> NDArray[np.bool_]:
        """Return whether the result holds for certain, at every sample."""
        return self._worst.recorded(self.split.formulas.result, worlds_of(end)[0]) >= 0

    def recorded(self, end: End) -> tuple[Keys, Keys, Keys]:
        """Return robustness, lower and upper bound of the result at every sample.

        They are one object if the values are known.
        """
        lower, upper = worlds_of(end)
        worst, best = self.split.formulas.result, self._best_split.formulas.result
        robustness = self._given.recorded(best, World.NOW)
        return robustness, self._worst.recorded(worst, lower), self._best.recorded(best, upper)

    def around_end(self, end: End) -> tuple[tuple[Keys, Keys], tuple[Keys, Keys]]:
        """Return the lower and the upper bound of the result at every sample, and after them.

        After the trace the last value stays.
        """
        lower, upper = worlds_of(end)
        worst, best = self.split.formulas.result, self._best_split.formulas.result
        return (
            (self._worst.recorded(worst, lower), self._worst.beyond(worst, lower)),
            (self._best.recorded(best, upper), self._best.beyond(best, upper)),
        )

    def operand_beyond(self, end: End) -> Keys:
        """Return the upper bound of the operand of a root ``always`` after the trace.

        The last value stays. The root has no end, so that no bound below it is cut.
        """
        program = self._best_split.formulas
        root = program.instructions[program.result]
        register = root.args[-1] if isinstance(root, Window) else program.result
        return self._best.beyond(register, worlds_of(end)[1])

    def undecided(self, register: int, end: End) -> PlaceRuns:
        """Return where a register of the formulas may have either sign, on a trace that goes on."""
        lower, upper = worlds_of(end)
        worst, best, r = self._worst, self._best, register
        recorded = _differ(worst.recorded(r, lower), best.recorded(r, upper))
        beyond = _differ(worst.beyond(r, lower), best.beyond(r, upper))
        return PlaceRuns.where(np.concatenate([recorded, beyond]), None, FOREVER)


def needed_samples(program: Program, n: int) -> int:
    """Return how many of n samples the bounds of a program depend on."""
    return min(n, split(program, sufficient(program, n), best=False).needed or n)


def _both(program: Program, bound: int) -> tuple[SplitProgram, SplitProgram]:
    """Return the programs for the lower and the upper bound."""
    worst = split(program, bound, best=False)
    return worst, split(program, bound, best=True) if program.neutral else worst


def _differ(low: Keys, high: Keys) -> NDArray[np.bool_]:
    """Return where the signs differ; the last values stay."""
    length = max(len(low), len(high))
    low, high = (_extended(a, length) for a in (low, high))
    differ: NDArray[np.bool_] = (low < 0) != (high < 0)
    return differ


def _extended(values: Keys, length: int) -> Keys:
    """Return values extended to a length by the last value."""
    missing = length - len(values)
    return np.concatenate([values, np.full(missing, values[-1])]) if missing else values


@dataclass(frozen=True, eq=False, slots=True)
class SplitProgram:
    """A program for bounds, in two parts: the variables of its formulas are its predicates.

    ``exact`` has the registers of the formulas with bounds that are not cut to the trace; the
    bounds depend on ``needed`` samples, or on all.
    """

    predicates: Program
    formulas: Program
    exact: Program
    needed: int | None


@functools.lru_cache(maxsize=256)  # programs are cached, and differ by identity
def split(program: Program, n: int, *, best: bool) -> SplitProgram:
    """Return the programs that bound the result of a program."""
    zero = 0.0 if best else -0.0
    exact, program = (positive(p).with_zero(zero) for p in (program, program.clamped(n)))
    after = range(program.terms, len(program.instructions))
    read = {a for r in after for a in program.formula(r).args} | {program.result}
    # The constants stay: they keep their value at unseen samples.
    inputs = [
        r
        for r in sorted(read)
        if r < program.terms and not isinstance(program.instructions[r], Const)
    ]
    names = {r: f"#{i}" for i, r in enumerate(inputs)}  # no variables of a specification
    first = inputs[0] if inputs else program.result
    predicates = program.restricted(first, {names[r]: r for r in inputs})
    instructions = [Load(names[r]) if r in names else i for r, i in enumerate(program.instructions)]
    formulas = replace(
        program, instructions=tuple(instructions), variables=tuple(names.values()), rates={}
    )
    needed: int | None = 1
    for register in initial_registers(formulas):
        if isinstance(instructions[register], Window):
            late = formulas.latencies[register]
            needed = None if late is None or needed is None else max(needed, late + 1)
    return SplitProgram(predicates, formulas, exact, needed)


@functools.lru_cache(maxsize=512)
def outputs_among(part: Program, other: Program) -> tuple[int, ...]:
    """Return the places of a program's outputs among the outputs of another, which has them all.

    The programs have the same variables and the same semantics.
    """
    known: dict[tuple[object, ...], int] = {}

    def numbered(program: Program) -> list[int]:
        """Return a number for every term; equal ones for equal terms."""
        numbers: list[int] = []
        for register in range(program.terms):
            match program.term(register):
                case Load(variable):
                    key: tuple[object, ...] = "load", variable
                case Const(value):
                    key = "const", repr(value)  # repr distinguishes 0.0 from -0.0
                case Map(function, args):
                    key = function, *(numbers[a] for a in args)
            numbers.append(known.setdefault(key, len(known)))
        return numbers

    numbers = numbered(other)
    places = {numbers[r]: index for index, r in enumerate(other.outputs.values())}
    numbers = numbered(part)
    return tuple(places[numbers[r]] for r in part.outputs.values())
