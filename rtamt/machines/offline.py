"""Evaluates whole traces with online machines, in one pass forwards or backwards if they can.

A program of finite latency runs over the n samples and as many more as its latency. One that has
futures without end, but no past without begin, runs backwards as the mirrored program: future is
past with time flipped. In a program that has both, a window without end is cut out: its operands
are computed first, then folded backwards by the mirrored window. The folded values become one more
variable.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import InputError
from rtamt.inputs.samples import SampleReader
from rtamt.machines.protocols import DiscreteMachine
from rtamt.program.instructions import Window
from rtamt.program.passes import Folded, folded_apart
from rtamt.program.program import Program

__all__ = ["MakeMachine", "Passes", "result_alone", "run_offline", "run_outputs", "without_nan"]

Array = NDArray[np.float64]


_T = TypeVar("_T")

MakeMachine = Callable[[Program, SampleReader, Sequence[int]], DiscreteMachine]


class _Plan(NamedTuple):
    """The programs of the passes over a trace.

    Attributes:
        cut: The windows without end that are cut out.
        last: The program that has a variable in place of each of these windows.
        backwards: Whether the last program runs backwards.
    """

    cut: tuple[Folded, ...]
    last: Program
    backwards: bool


class Passes:
    """The machines that evaluate the named formulas of a program, one trace after the other.

    Args:
        program: The program; its windows may have no end.
        reader: Raises the errors of terms that are nan.
        machine: Makes the discrete machines of a back-end.
        n: Length of the longest trace, 1 or more.
    """

    def __init__(
        self, program: Program, reader: SampleReader, machine: MakeMachine, n: int
    ) -> None:
        def made(part: Program) -> DiscreteMachine:
            return machine(part, SampleReader(part, reader.nan), tuple(part.outputs.values()))

        plan = _planned(program, min(n, _greatest_bound(program)))
        self._cut = [(made(window.operands), made(window.fold)) for window in plan.cut]
        self._last = made(plan.last)
        self._backwards = plan.backwards
        self._names = tuple(program.outputs)

    def run(self, columns: Sequence[Array], n: int) -> dict[str, Array]:
        """The named formulas at every sample of a trace.

        Args:
            columns: For every variable its n values.
            n: Length of the trace, 1 or more.
        """
        known = list(columns)
        for args, fold in self._cut:
            known += fold.evaluate(args.evaluate(known, n), n, backwards=True)
        values = self._last.evaluate(known, n, backwards=self._backwards)
        return dict(zip(self._names, values, strict=True))


def run_offline(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Array], n: int
) -> Array:
    """The robustness at every sample of a trace of n samples.

    The machine looks for nan on its way: a pass over the columns before costs as much as its own.

    Args:
        program: The program; its windows may have no end.
        reader: Raises the errors of terms that are nan.
        machine: Makes the discrete machines of a back-end.
        columns: For every variable its n values, nan among them as the reader allows.
        n: Length of the trace, 1 or more.
    """
    passes = Passes(result_alone(program), reader, machine, n)
    return without_nan(reader, columns, lambda known: passes.run(known, n)[""])


def without_nan(
    reader: SampleReader, columns: Sequence[Array], run: Callable[[Sequence[Array]], _T]
) -> _T:
    """What a run of a machine makes of columns in which it may find nan, as the reader allows it.

    Raises:
        InputError: On a nan that the reader refuses, or an error of the run that is not about one.
    """
    try:
        return run(columns)
    except InputError:
        known = reader.without_nan(columns)
        if all(held is column for held, column in zip(known, columns, strict=True)):
            raise
    return run(known)


def run_outputs(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Array], n: int
) -> dict[str, Array]:
    """The named formulas at every sample of a trace; `run_offline` describes the arguments."""
    return Passes(program, reader, machine, n).run(columns, n)


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def result_alone(program: Program) -> Program:
    """The program whose only output is the result, under an empty name."""
    return program.restricted(program.result, {"": program.result})


@functools.lru_cache(maxsize=512)
def _planned(program: Program, n: int) -> _Plan:
    """The passes for a trace of at most n samples; n >= the greatest bound fits every trace."""
    program = program.clamped(n)
    first = next(iter(program.outputs.values()))
    program = program.restricted(first, program.outputs)
    windows = [i for i in program.instructions if isinstance(i, Window)]
    if all(window.lo is not None for window in windows):
        backwards = any(window.hi is None for window in windows)
        return _Plan((), program.mirrored() if backwards else program, backwards)
    cut, program = folded_apart(program)
    first = next(iter(program.outputs.values()))
    return _Plan(cut, program.restricted(first, program.outputs), backwards=False)


@functools.lru_cache(maxsize=512)
def _greatest_bound(program: Program) -> int:
    """The number of samples by which a window reaches back or ahead at most."""
    windows = [i for i in program.instructions if isinstance(i, Window)]
    return max((abs(b) for w in windows for b in (w.lo, w.hi) if b is not None), default=0)
