"""The arithmetic over the present sample, the first part of every machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Generic, NoReturn, Protocol, TypeVar

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.samples import SampleReader
from rtamt.machines.state import Retiring, StateFields
from rtamt.program.algebra import FUNCTIONS, of_ends
from rtamt.program.instructions import Const, Load, Map
from rtamt.program.program import Program, ranges_of

Registers = list[float]
Operation = Callable[[Registers], None]
"""Computes one register from others."""
_Place = TypeVar("_Place")


class Terms(Generic[_Place]):
    """Evaluates the terms of a program on one sample."""

    def __init__(self, program: Program, refuse: Callable[[list[float], _Place], NoReturn]) -> None:
        self._refuse: Callable[[list[float], _Place], NoReturn] = refuse
        self._loads: list[tuple[int, int]] = []
        self._operations: list[Operation] = []
        self._constants: Registers = [0.0] * program.terms
        for out in range(program.terms):
            match program.term(out):
                case Load(variable):
                    self._loads.append((out, program.variables.index(variable)))
                case Const(value):
                    self._constants[out] = value
                case Map(function, args):
                    self._operations.append(map_operation(out, function, args))

    @property
    def initial(self) -> Registers:
        """The registers before the first sample, with the constants in their places."""
        return self._constants[:]

    def __call__(self, values: list[float], place: _Place) -> Registers:
        """Return the registers of the terms, without changes to the machine."""
        registers = self._constants[:]
        for out, variable in self._loads:
            registers[out] = values[variable]
        for operation in self._operations:
            operation(registers)
        for value in registers:
            if value != value:  # noqa: PLR0124 - nan
                self._refuse(values, place)
        return registers


def map_operation(out: int, function: str, args: tuple[int, ...]) -> Operation:
    """Return the operation of a MAP, which writes the register ``out``."""
    apply = FUNCTIONS[function].apply
    if len(args) == 1:
        (a,) = args

        def operation(r: Registers) -> None:
            r[out] = apply(r[a])

    else:
        a, b = args

        def operation(r: Registers) -> None:
            r[out] = apply(r[a], r[b])

    return operation


class PythonSampleMachine(Retiring, StateFields):
    """The base of the Python machines on samples."""

    reader: SampleReader

    def __init__(self, program: Program, reader: SampleReader) -> None:
        self.program = program
        self.reader = reader
        self._terms: Terms[int] = Terms(program, reader.refuse)

    def terms(self, values: list[float]) -> Registers:
        """Return the terms of the next sample, without changes to the machine; nan is refused."""
        return self._terms(values, self.samples)

    def take(self, terms: Registers, values: list[float]) -> None:
        """Take a sample whose terms are known."""
        raise NotImplementedError

    def reset(self) -> None:
        self.samples = 0
        self.inputs: list[float] = []


FloatColumns = Sequence[Floats]


class RefusesRanges(Protocol):
    """Raises the error of a term without a value."""

    def refuse_between(
        self, lower: Iterable[float], upper: Iterable[float], sample: int
    ) -> NoReturn: ...


FindRanges = Callable[
    [Program, RefusesRanges, Sequence[int], FloatColumns, FloatColumns, int],
    tuple[list[Floats], list[Floats]],
]


def term_ranges(
    program: Program,
    reader: RefusesRanges,
    observed: Sequence[int],
    lower: FloatColumns,
    upper: FloatColumns,
    n: int,
) -> tuple[list[Floats], list[Floats]]:
    """Return the smallest and the largest values of some terms at each of n samples."""
    least, greatest = np.empty((2, len(observed), n))
    for i in range(n):
        ends = [(float(a[i]), float(b[i])) for a, b in zip(lower, upper, strict=True)]
        ranges = ranges_of(program, [of_ends(*pair) for pair in ends])
        if len(ranges) < program.terms:
            reader.refuse_between((low for low, _ in ends), (high for _, high in ends), i)
        for k, register in enumerate(observed):
            least[k, i], greatest[k, i] = ranges[register][:2]
    return list(least), list(greatest)
