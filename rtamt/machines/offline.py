"""Evaluates whole traces with online machines, in one pass forwards or backwards if possible.

A program of finite latency runs over the n samples and as many more as its latency. With futures
without an end, but no past without a begin, it runs backwards as the mirrored program. With both, a
window without an end is cut out: its operands are computed first, then folded backwards by the
mirrored window. The folded values become one more variable.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

from rtamt.errors import InputError
from rtamt.inputs.arrays import Floats
from rtamt.inputs.samples import SampleReader
from rtamt.machines.protocols import DiscreteMachine
from rtamt.program.instructions import Load, Window
from rtamt.program.program import Program

_T = TypeVar("_T")

MakeMachine = Callable[[Program, SampleReader, Sequence[int]], DiscreteMachine]


class _Cut(NamedTuple):
    """A window without an end, cut out of a program: its operands, and their fold backwards."""

    operands: Program
    fold: Program


class _Plan(NamedTuple):
    """The programs of the passes over a trace: the windows that are cut out, and the rest.

    The last program has a variable in place of each of these windows.
    """

    cut: tuple[_Cut, ...]
    last: Program
    backwards: bool


class Passes:
    """The machines that evaluate the named formulas of a program, one trace after the other."""

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

    def run(self, columns: Sequence[Floats], n: int) -> dict[str, Floats]:
        """Return the named formulas at every sample of a trace."""
        known = list(columns)
        for args, fold in self._cut:
            known += fold.evaluate(args.evaluate(known, n), n, backwards=True)
        values = self._last.evaluate(known, n, backwards=self._backwards)
        return dict(zip(self._names, values, strict=True))


def run_offline(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Floats], n: int
) -> Floats:
    """Return the robustness at every sample of a trace of n samples.

    The machine looks for nan on its way: a separate pass over the columns would double the cost.
    """
    passes = Passes(result_alone(program), reader, machine, n)
    return without_nan(reader, columns, lambda known: passes.run(known, n)[""])


def without_nan(
    reader: SampleReader, columns: Sequence[Floats], run: Callable[[Sequence[Floats]], _T]
) -> _T:
    """Run a machine on columns, and again without nan if it meets a nan that the reader allows."""
    try:
        return run(columns)
    except InputError:
        known = reader.without_nan(columns)
        if all(held is column for held, column in zip(known, columns, strict=True)):
            raise
    return run(known)


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def result_alone(program: Program) -> Program:
    """Return the program whose only output is the result, under an empty name."""
    return program.restricted(program.result, {"": program.result})


@functools.lru_cache(maxsize=512)
def _planned(program: Program, n: int) -> _Plan:
    """Return the passes for traces of at most n samples, or any trace if no bound exceeds n."""
    program = program.clamped(n)
    first = next(iter(program.outputs.values()))
    program = program.restricted(first, program.outputs)
    windows = program.windows
    if all(window.lo is not None for window in windows):
        backwards = any(window.hi is None for window in windows)
        return _Plan((), program.mirrored() if backwards else program, backwards)
    cut, program = _cut_out(program)
    first = next(iter(program.outputs.values()))
    return _Plan(cut, program.restricted(first, program.outputs), backwards=False)


def _cut_out(program: Program) -> tuple[tuple[_Cut, ...], Program]:
    """Return the windows without an end, and the program with variables in their place.

    A window may need the variables of earlier ones; its own variable comes after them.
    """
    cut: list[_Cut] = []
    # Everything before the first window without end has a latency.
    for register, before in enumerate(program.instructions):
        if not isinstance(before, Window) or before.hi is not None:
            continue
        window = program.window(register)  # the variables of those before are in front of it
        operands = {str(i): register for i, register in enumerate(window.args)}
        part = program.restricted(window.args[0], operands)
        cut.append(_Cut(part, _folding(program, window)))
        # A variable of a specification cannot have such a name.
        program = _with_variable(program, register, f"#{len(program.variables)}")
    return tuple(cut), program


def _folding(program: Program, window: Window) -> Program:
    """Return the program that folds the operands of a window without an end, backwards."""
    width = len(window.args)
    names = tuple(str(i) for i in range(width))
    last = replace(window, args=tuple(range(width))).mirrored()
    return replace(
        program,
        instructions=(*map(Load, names), last),
        terms=width,
        result=width,
        outputs={"": width},
        variables=names,
        rates={},
        sources=program.sources[-1:] * (width + 1),
    )


def _with_variable(program: Program, cut: int, name: str) -> Program:
    """Return the program with a window replaced by a variable, which becomes its first register."""
    instructions = list(program.instructions)
    instructions[cut] = Load(name)
    variables = (*program.variables, name)
    loaded = replace(program, instructions=tuple(instructions), variables=variables)
    others = (r for r in range(len(instructions)) if r != cut)
    return loaded.reordered([cut, *others], program.terms + 1)


@functools.lru_cache(maxsize=512)
def _greatest_bound(program: Program) -> int:
    """Return the largest number of samples that a window reaches back or ahead."""
    return max((abs(b) for w in program.windows for b in (w.lo, w.hi) if b is not None), default=0)
