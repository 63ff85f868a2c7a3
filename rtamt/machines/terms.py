"""The first part of every machine: the arithmetic over the present sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NoReturn, TypeVar, assert_never

from rtamt.program.algebra import FUNCTIONS
from rtamt.program.program import Const, Load, Map, Program, Window

__all__ = ["Registers", "Step", "Terms", "map_step"]

Registers = list[float]
Step = Callable[[Registers], None]


_Place = TypeVar("_Place", int, float)


class Terms(Generic[_Place]):
    """Evaluates the terms of a program on one sample.

    Args:
        program: Its terms.
        refuse: Raises the error of a term that is nan: for these values, at a sample or a time.
    """

    def __init__(self, program: Program, refuse: Callable[[list[float], _Place], NoReturn]) -> None:
        self._refuse: Callable[[list[float], _Place], NoReturn] = refuse
        self._loads: list[tuple[int, int]] = []
        self._steps: list[Step] = []
        self._constants: Registers = [0.0] * program.terms
        for out, instruction in enumerate(program.instructions[: program.terms]):
            match instruction:
                case Load(variable):
                    self._loads.append((out, program.variables.index(variable)))
                case Const(value):
                    self._constants[out] = value
                case Map(function, args):
                    self._steps.append(map_step(out, function, args))
                case Window():
                    msg = f"register {out} is a window among the terms"
                    raise AssertionError(msg)
                case _ as never:
                    assert_never(never)

    @property
    def initial(self) -> Registers:
        """The registers before the first sample: constants in place."""
        return self._constants[:]

    def __call__(self, values: list[float], place: _Place) -> Registers:
        """The registers of the terms; touches no state.

        Raises:
            InputError: If a term is nan.
        """
        registers = self._constants[:]
        for out, variable in self._loads:
            registers[out] = values[variable]
        for step in self._steps:
            step(registers)
        for value in registers:
            if value != value:  # noqa: PLR0124 - nan
                self._refuse(values, place)
        return registers


def map_step(out: int, function: str, args: tuple[int, ...]) -> Step:
    """What a MAP does to the registers."""
    apply = FUNCTIONS[function].apply
    if len(args) == 1:
        (a,) = args

        def step(r: Registers) -> None:
            r[out] = apply(r[a])

    else:
        a, b = args

        def step(r: Registers) -> None:
            r[out] = apply(r[a], r[b])

    return step
