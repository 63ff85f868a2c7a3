"""Where a part of a formula holds or fails for certain, at every sample of a trace.

Most parts take one pass of a machine over the trace and the few unseen samples that its end reads;
those that read unseen samples otherwise than a machine does take `Foresight.part`.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.samples import SampleReader
from rtamt.machines.foresight import Foresight
from rtamt.machines.protocols import End
from rtamt.program.instructions import Load
from rtamt.program.outlook import (
    Outlook,
    look_out,
    otherwise_read,
    outputs_among,
    past,
    planned,
    read_beyond,
    sufficient,
)
from rtamt.program.program import Program

__all__ = ["PartSigns"]

Array = NDArray[np.float64]
_Flags = NDArray[np.bool_]


class _Pass(NamedTuple):
    """A program over predicates that a machine evaluates in one pass.

    Attributes:
        program: The program, of one output; None: it is the predicate.
        places: Where its predicates are among those of the whole formula.
        late: How many later samples a value needs; 0 if the trace is all there is.
        past: How many earlier ones; None: all.
    """

    program: Program | None
    places: tuple[int, ...]
    late: int
    past: int | None


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _pass(program: Program, n: int, whole: Outlook, end: End, *, best: bool) -> _Pass | None:
    """The pass that finds the result of a program at every recorded time; None: there is none.

    Args:
        program: The program.
        n: What `sufficient` gives for the trace.
        whole: Has all predicates of the program.
        end: The reading of the end.
        best: Whether it is the greatest result.
    """
    outlook = look_out(program, n, best=best)
    places = outputs_among(outlook.predicates, whole.predicates)
    formulas = outlook.formulas
    result = formulas.instructions[formulas.result]
    if isinstance(result, Load):
        place = places[formulas.variables.index(result.variable)]
        return _Pass(None, (place,), 0, 0)
    registers, others = (formulas.result,), frozenset[int]()
    if end != "complete":
        read = read_beyond(formulas, registers, also=end != "cut")
        others = otherwise_read(formulas, registers, best=best, cut=end == "cut", read=read)
    windows, last = planned(formulas, registers, others)
    (register,) = last.outputs.values()
    late = last.latencies[register]
    if windows or late is None:
        return None
    return _Pass(last, places, 0 if end == "complete" else late, past(last))


class PartSigns:
    """The signs of another program on a trace, which reads no other predicates.

    Args:
        foresight: The trace.
        program: The program; it has the semantics and the variables of the foresight's.
        end: The reading of the end.
    """

    def __init__(self, foresight: Foresight, program: Program, end: End) -> None:
        self._foresight, self._program, self._end = foresight, program, end
        self._fails: _Flags | None = None

    def fails(self) -> _Flags:
        """Whether it fails for certain, at every sample."""
        if self._fails is None:
            found = self._values(best=True)
            if found is None:
                self._fails = self._foresight.part(self._program).fails(self._end)
            else:
                self._fails = np.signbit(found)
        return self._fails

    def holds(self) -> _Flags:
        """Whether it holds for certain, at every sample."""
        found = self._values(best=False)
        if found is None:
            return self._foresight.part(self._program).holds(self._end)
        return ~np.signbit(found)

    def _values(self, *, best: bool) -> Array | None:
        """The greatest or the least result at every sample, if one pass finds it."""
        foresight, program = self._foresight, self._program
        n = foresight.n
        bound = sufficient(program, n)
        found = _pass(program, bound, foresight.outlook, self._end, best=best)
        if found is None:
            return None
        columns = foresight.predicates(best=best)
        known = [columns[place] for place in found.places]
        last, late = found.program, found.late
        if last is None:
            return known[0]
        machine = foresight.machine(last, SampleReader(last), tuple(last.outputs.values()))
        # The last values depend on unseen samples, and on few of those before.
        first = 0 if found.past is None else max(0, n - late - found.past)
        values = np.empty(0)
        if first or not late:
            (values,) = machine.evaluate(known, n)
        if late:
            unseen = np.full(late, math.inf if best else -math.inf)
            more = [np.concatenate([column[first:], unseen]) for column in known]
            (ends,) = machine.evaluate(more, n - first + late)
            settled = max(0, n - late) if first else 0
            values = np.concatenate([values[:settled], ends[settled - first : n - first]])
        return values
