"""The machine on samples in Python: the definition that tests compare the C++ machine with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.terms import Operation, PythonSampleMachine, Registers, map_operation
from rtamt.machines.windows import DelayLine, FoldedWindow, make_window
from rtamt.program.algebra import FOLDS, Element
from rtamt.program.instructions import Map, Window
from rtamt.program.program import Delay, Program, Scheduled, schedule


class PythonDiscreteMachine(PythonSampleMachine):
    """Runs a program of registers with latencies, one sample after the other.

    After sample t the register r has its value of time t - latency(r). For times outside the trace
    a window reads the identity of its fold: that cuts it to the trace, at the start and, in
    `evaluate`, at the end.
    """

    STATE = ("samples", "inputs", "registers", "_end", "_parts")
    _end: float  # the trace has the times 0 <= time < end

    def __init__(self, program: Program, reader: SampleReader, observed: Sequence[int]) -> None:
        super().__init__(program, reader)
        self.observed = tuple(observed)
        self._late = program.latency or 0
        self._result = program.result
        self._initial = self._terms.initial
        self._operations: list[Operation] = []
        self._parts: list[DelayLine | FoldedWindow] = []
        for slot, scheduled in schedule(program):
            self._initial += [0.0] * (slot + 1 - len(self._initial))
            self._operations.append(self._compiled(slot, scheduled))
        self.reset()

    def _compiled(self, out: int, scheduled: Scheduled) -> Operation:
        match scheduled:
            case Map(function, args):
                return map_operation(out, function, args)
            case Window(name, _, _, args):
                window = make_window(FOLDS[name], scheduled.length)
                self._parts.append(window)
                return self._window(out, window, FOLDS[name].identity, args)
            case Delay(length, operand):
                line = DelayLine(length)
                self._parts.append(line)
                return _delay(out, line, operand)
            case _ as never:
                assert_never(never)

    def _window(
        self, out: int, window: FoldedWindow, identity: Element, args: tuple[int, ...]
    ) -> Operation:
        push = window.push
        start = self.program.start(out)
        if len(args) == 1:
            (a,) = args

            def operation(r: Registers) -> None:
                here = 0 <= self.samples - start < self._end
                r[out] = push((r[a],) if here else identity)[0]

        else:
            p, q = args

            def operation(r: Registers) -> None:
                here = 0 <= self.samples - start < self._end
                r[out] = push((r[p], r[q]) if here else identity)[1]

        return operation

    def update(self, *args: object, **named: object) -> float:
        values = self.reader.read(args, named, self.samples, self.inputs)
        self.require_current()  # a value may run anything when it is read
        self.take(self.terms(values), values)
        return self.result

    def take(self, terms: Registers, values: list[float]) -> None:
        registers = self.registers
        known = self.program.terms
        registers[:known] = terms[:known]
        for operation in self._operations:
            operation(registers)
        self.inputs = values
        self.samples += 1

    @property
    def result(self) -> float:
        """The robustness of time t - latency, nan before there is one."""
        return self.registers[self._result] if self.samples > self._late else math.nan

    def run(self, columns: Sequence[NDArray[np.float64]], n: int) -> list[NDArray[np.float64]]:
        late = [self.program.latencies[r] or 0 for r in self.observed]
        outputs: list[list[float]] = [[] for _ in self.observed]
        for terms, row in self._steps(columns, n):
            self.take(terms, row)
            for values, register, lag in zip(outputs, self.observed, late, strict=True):
                values.append(self.registers[register] if self.samples > lag else math.nan)
        return [np.array(values) for values in outputs]

    def evaluate(
        self, columns: Sequence[NDArray[np.float64]], n: int, *, backwards: bool = False
    ) -> list[NDArray[np.float64]]:
        late = [self.program.latencies[r] or 0 for r in self.observed]
        outputs: list[list[float]] = [[] for _ in self.observed]
        saved = self.state()
        self.reset()
        try:
            steps = self._steps(columns, n)[:: -1 if backwards else 1]
            for i in range(n + max(late, default=0)):
                if i == n:
                    self._end = n
                self.take(*(steps[i] if i < n else (self.registers, self.inputs)))
                for values, register, lag in zip(outputs, self.observed, late, strict=True):
                    if i >= lag:
                        values.append(self.registers[register])
        finally:
            self.restore(saved)
        return [np.array(values[:n][:: -1 if backwards else 1]) for values in outputs]

    def _steps(
        self, columns: Sequence[NDArray[np.float64]], n: int
    ) -> list[tuple[Registers, list[float]]]:
        """Return the terms and the variables of n samples, without changes to the machine."""
        rows = [list(row) for row in zip(*(c.tolist() for c in columns), strict=True)] or [[]] * n
        missing = np.any([np.isnan(c) for c in columns], axis=0) if columns else np.zeros(n)
        if missing.any():
            first = int(missing.argmax())
            self.reader.refuse(rows[first], self.samples + first)
        return [(self._terms(row, self.samples + i), row) for i, row in enumerate(rows)]

    def reset(self) -> None:
        super().reset()
        self._end = math.inf
        self.registers = self._initial[:]
        for part in self._parts:
            part.reset()


def _delay(out: int, line: DelayLine, operand: int) -> Operation:
    def operation(r: Registers) -> None:
        r[out] = line.push(r[operand])

    return operation
