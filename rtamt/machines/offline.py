"""Evaluates whole traces with online machines; futures without end by passes over reversed time.

A program of finite latency runs over the n samples and as many more as its latency. A window
without end is cut out: its operands are computed first, then folded over the reversed trace by the
mirrored window (future is past with time flipped). The folded values become one more variable.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.protocols import DiscreteMachine
from rtamt.program.algebra import FOLDS
from rtamt.program.program import Load, Program, Window, latencies_of

__all__ = ["Passes", "result_alone", "run_offline", "run_outputs"]

Array = NDArray[np.float64]


MakeMachine = Callable[[Program, SampleReader, Sequence[int]], DiscreteMachine]


class _Plan(NamedTuple):
    """The programs of the passes over a trace.

    Attributes:
        backwards: For each window without end the program of its operands, and the program that
            folds them over reversed time.
        last: The program that has a variable in place of each of these windows.
    """

    backwards: tuple[tuple[Program, Program], ...]
    last: Program


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
        self._backwards = [(made(operands), made(fold)) for operands, fold in plan.backwards]
        self._last = made(plan.last)
        self._names = tuple(program.outputs)

    def run(self, columns: Sequence[Array], n: int) -> dict[str, Array]:
        """The named formulas at every sample of a trace.

        Args:
            columns: For every variable its n values.
            n: Length of the trace, 1 or more.
        """
        known = list(columns)
        for args, fold in self._backwards:
            backwards = [np.ascontiguousarray(a[::-1]) for a in _run(args, known, n)]
            (folded,) = _run(fold, backwards, n)
            known.append(folded[::-1])
        return dict(zip(self._names, _run(self._last, known, n), strict=True))


def run_offline(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Array], n: int
) -> Array:
    """The robustness at every sample of a trace of n samples.

    Args:
        program: The program; its windows may have no end.
        reader: Raises the errors of terms that are nan.
        machine: Makes the discrete machines of a back-end.
        columns: For every variable its n values.
        n: Length of the trace, 1 or more.
    """
    return run_outputs(result_alone(program), reader, machine, columns, n)[""]


def run_outputs(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Array], n: int
) -> dict[str, Array]:
    """The named formulas at every sample of a trace; the arguments are those of `run_offline`."""
    return Passes(program, reader, machine, n).run(columns, n)


def _run(machine: DiscreteMachine, columns: Sequence[Array], n: int) -> list[Array]:
    machine.reset()
    return machine.run(columns, n, final=True)


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def result_alone(program: Program) -> Program:
    """The program whose only output is the result, under an empty name."""
    return program.restricted(program.result, {"": program.result})


@functools.lru_cache(maxsize=512)
def _planned(program: Program, n: int) -> _Plan:
    """The passes for a trace of at most n samples; n >= the greatest bound fits every trace."""
    program = program.clamped(n)
    backwards = []
    while None in program.latencies:
        # Everything before the first window without end has a latency.
        windows = ((r, i) for r, i in enumerate(program.instructions) if isinstance(i, Window))
        cut, window = next((r, window) for r, window in windows if window.hi is None)
        operands = {str(i): register for i, register in enumerate(window.args)}
        part = program.restricted(window.args[0], operands)
        backwards.append((part, _mirrored(program, window)))
        # A variable of a specification cannot have such a name.
        program = _with_variable(program, cut, f"#{len(program.variables)}")
    first = next(iter(program.outputs.values()))
    return _Plan(tuple(backwards), program.restricted(first, program.outputs))


@functools.lru_cache(maxsize=512)
def _greatest_bound(program: Program) -> int:
    """The number of samples by which a window reaches back or ahead at most."""
    windows = [i for i in program.instructions if isinstance(i, Window)]
    return max((abs(b) for w in windows for b in (w.lo, w.hi) if b is not None), default=0)


def _mirrored(program: Program, window: Window) -> Program:
    """The program that folds the operands of a window without end over reversed time."""
    width = len(window.args)
    names = tuple(str(i) for i in range(width))
    mirrored = Window(FOLDS[window.fold].mirror, None, -(window.lo or 0), tuple(range(width)))
    return replace(
        program,
        instructions=(*map(Load, names), mirrored),
        terms=width,
        latencies=(0,) * (width + 1),
        result=width,
        outputs={"": width},
        variables=names,
        sources=program.sources[-1:] * (width + 1),
    )


def _with_variable(program: Program, cut: int, name: str) -> Program:
    """The program with a window replaced by a variable, which becomes its first register."""
    instructions = list(program.instructions)
    instructions[cut] = Load(name)
    loaded = replace(
        program,
        instructions=tuple(instructions),
        latencies=latencies_of(instructions),
        variables=(*program.variables, name),
    )
    others = (r for r in range(len(instructions)) if r != cut)
    return loaded.reordered([cut, *others], program.terms + 1)
