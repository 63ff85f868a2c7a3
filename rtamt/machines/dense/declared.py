"""Declared values of variables in dense time: each lasts until the first event of the variable."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rtamt.program.program import Program

__all__ = ["DeclaredValues", "declared_of"]


class DeclaredValues:
    """The values that variables have before their first events, and the trace that follows.

    Nothing waits for a variable with a declared value: the trace begins when the last of the others
    does, and ends where the first of those that have events does. If all variables have declared
    values, it begins with the first event of all.

    Args:
        variables: Names of the variables.
        defaults: The declared values.
    """

    __slots__ = ("_free", "before")

    def __init__(self, variables: Sequence[str], defaults: Mapping[str, float]) -> None:
        self.before = [defaults.get(name, math.nan) for name in variables]
        """The value of each variable before its first event; nan if none is declared."""
        self._free = [name in defaults for name in variables]

    def begin(self, first: Sequence[float]) -> float:
        """The begin of the trace.

        Args:
            first: Tick of every variable's first event; inf where there was none.
        """
        awaited = [tick for tick, free in zip(first, self._free, strict=True) if not free]
        return max(awaited) if awaited else min(first)

    def end(self, last: Sequence[float]) -> float:
        """The last tick that is known.

        Args:
            last: Tick of every variable's last event; -inf where there was none.
        """
        ends = zip(last, self._free, strict=True)
        return min(
            (tick for tick, free in ends if not (free and math.isinf(tick))), default=-math.inf
        )

    def after(self, first: Sequence[float], last: Sequence[float]) -> list[float]:
        """The ticks that the next events of each variable have to be later than.

        A variable that has its declared value still has it at all ticks that are known.
        """
        end = self.end(last)
        known = end if self.begin(first) <= end else -math.inf
        silent = [free and math.isinf(tick) for tick, free in zip(last, self._free, strict=True)]
        return [known if still else tick for tick, still in zip(last, silent, strict=True)]


def declared_of(program: Program) -> DeclaredValues:
    """The declared values of the variables of a program."""
    return DeclaredValues(program.variables, program.specification.defaults)
