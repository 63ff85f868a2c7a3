"""Whole traces: the online machine, run to the end; unbounded future in passes over reversed time.

A program of finite latency is run over n samples and its latency more. A window without end is
cut out: its operands are computed first, folded over the reversed trace by the mirrored window
(future is past with time flipped), and read back as one more variable by what uses it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rtamt.algebra import MONOIDS
from rtamt.inputs import SampleReader
from rtamt.program import Instruction, Load, Program, Window, latencies_of

__all__ = ["RunMachine", "run_offline", "run_outputs"]

Array = NDArray[np.float64]


class RunMachine(Protocol):
    """A machine as `run_offline` needs it."""

    def run(self, columns: Sequence[Array], n: int, *, final: bool) -> list[Array]:
        """The observed registers at times 0 to n - 1."""


MakeMachine = Callable[[Program, SampleReader, Sequence[int]], RunMachine]


def run_offline(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Array], n: int
) -> Array:
    """The robustness at every sample of a trace of n samples.

    Args:
        program: With or without unbounded future.
        reader: For the errors of terms that are nan.
        machine: Makes the machine of a back-end.
        columns: For every variable its n values.
        n: Length of the trace, 1 or more.
    """
    alone = program.restricted(program.result, {"": program.result})
    return run_outputs(alone, reader, machine, columns, n)[""]


def run_outputs(
    program: Program, reader: SampleReader, machine: MakeMachine, columns: Sequence[Array], n: int
) -> dict[str, Array]:
    """The named formulas at every sample of a trace of n samples; the arguments are the same."""
    program = program.clamped(n)
    known = dict(zip(program.variables, columns, strict=True))
    while None in program.latencies:
        # Everything before the first window without end has a latency.
        cut = next(
            r for r, i in enumerate(program.instructions) if isinstance(i, Window) and i.hi is None
        )
        window = program.instructions[cut]
        assert isinstance(window, Window)  # noqa: S101 - for the type checker
        args = _run(program, reader, machine, window.args, known, n)
        name = f"#{len(known)}"  # no variable of a specification is named so
        known[name] = _reversed_fold(program, machine, window, args, n)
        program = _with_variable(program, cut, name)
    values = _run(program, reader, machine, tuple(program.outputs.values()), known, n)
    return dict(zip(program.outputs, values, strict=True))


def _run(
    program: Program,
    reader: SampleReader,
    machine: MakeMachine,
    registers: Sequence[int],
    known: Mapping[str, Array],
    n: int,
) -> list[Array]:
    names = {str(i): r for i, r in enumerate(registers)}
    part = program.restricted(registers[0], names)
    checked = SampleReader(part, reader.nan)
    observed = [part.outputs[str(i)] for i in range(len(registers))]
    return machine(part, checked, observed).run(list(known.values()), n, final=True)


def _reversed_fold(
    program: Program, machine: MakeMachine, window: Window, args: Sequence[Array], n: int
) -> Array:
    inputs: tuple[Instruction, ...] = tuple(Load(str(i)) for i in range(len(args)))
    lo = window.lo or 0
    mirrored = Window(MONOIDS[window.monoid].mirror, None, -lo, tuple(range(len(args))))
    source = program.sources[-1]
    part = replace(
        program,
        instructions=(*inputs, mirrored),
        terms=len(inputs),
        latencies=(0,) * (len(inputs) + 1),
        result=len(inputs),
        outputs={},
        variables=tuple(str(i) for i in range(len(args))),
        sources=(source,) * (len(inputs) + 1),
    )
    backwards = [np.ascontiguousarray(a[::-1]) for a in args]
    (folded,) = machine(part, SampleReader(part), (part.result,)).run(backwards, n, final=True)
    return folded[::-1]


def _with_variable(program: Program, cut: int, name: str) -> Program:
    """The program that reads a variable, first of all, where it had a window."""
    instructions = list(program.instructions)
    instructions[cut] = Load(name)
    loaded = replace(
        program,
        instructions=tuple(instructions),
        latencies=latencies_of(instructions),
        variables=(*program.variables, name),
    )
    return loaded.reordered(
        [cut, *(r for r in range(len(instructions)) if r != cut)], program.terms + 1
    )
