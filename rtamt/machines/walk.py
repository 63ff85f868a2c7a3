"""The registers of a program over a whole trace and after it, column by column.

`EpisodeMachine` bounds the robustness of an episode sample by sample. This module computes the same
values from whole columns, for every register at every time. It serves both back-ends, and formulas
that the machine refuses.

After its terms, a program of bounds has no negations (`rtamt.program.placement`), only minima and
maxima. Columns hold the integers of `rtamt.program.algebra.ordered`, because NumPy's minimum and
maximum of integers order -0.0 below 0.0.

`rtamt.machines.protocols.World` explains what follows the trace.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.machines.protocols import World
from rtamt.program.algebra import FOLDS, LatticeFold, ordered
from rtamt.program.instructions import Const, Load, Map, Window
from rtamt.program.program import Program

Keys = NDArray[np.int64]
"""Numbers from `ordered`."""

FoldPairs = Callable[[Keys, Keys, int, bool, bool], Keys]
"""``(p, q, before, is_max, backwards)``: max(q, min(p, before)) of each pair (p, q).

The value of a pair is `before` of the next one or, ``backwards``, of the previous one. Without
``is_max``, min and max are exchanged.
"""

_FLIP = np.iinfo(np.int64).max
# The number of elements in one fold: the arrays of a window fit into a fast cache.
_BLOCK = 1 << 15
_PREFIX_BLOCK = 1 << 17


def to_keys(numbers: NDArray[np.float64]) -> Keys:
    """Return the integers of a column of numbers, in the memory of the numbers."""
    keys = numbers.view(np.int64)
    for begin in range(0, len(keys), _BLOCK):
        part = numbers[begin : begin + _BLOCK]
        keys[begin : begin + _BLOCK] = ordered(part)
    return keys


def number_of(key: int) -> float:
    """Return the number of an integer."""
    bits = key ^ _FLIP if key < 0 else key
    return float(np.int64(bits).view(np.float64))


def numbers_of(keys: Keys) -> NDArray[np.float64]:
    """Return the numbers of a column of integers."""
    return (keys ^ ((keys >> 63) & _FLIP)).view(np.float64)


def _key(number: float) -> int:
    return int(ordered(np.array([number]))[0])


_UNSEEN = {best: np.array([_key(math.inf if best else -math.inf)]) for best in (False, True)}
_NOTHING = {name: tuple(map(_key, fold.identity)) for name, fold in FOLDS.items()}


class _Tail(NamedTuple):
    """The values of a register in one world.

    Attributes:
        settled: The number of first values that equal the values of the complete trace.
        rest: The values after them; the last one stays for ever.
    """

    settled: int
    rest: Keys

    @property
    def last(self) -> int:
        """The time from which the value stays."""
        return self.settled + len(self.rest) - 1


class Walk:
    """The values of a program's registers over a trace."""

    def __init__(
        self,
        program: Program,
        columns: Sequence[Keys],
        n: int,
        fold_pairs: FoldPairs | None = None,
    ) -> None:
        self._program = program
        self._fold_pairs = fold_pairs
        self._columns = dict(zip(program.variables, columns, strict=True))
        self._n = n
        self._complete: dict[int, Keys] = {}
        self._tails: dict[tuple[int, World], _Tail] = {}
        # Folds of a window's first elements, by register and how many they are.
        self._totals: dict[tuple[int, int], tuple[int, ...]] = {}

    def at_zero(self, world: World) -> float:
        """Return the program's result at time 0."""
        values: dict[int, int] = {}
        for register in initial_registers(self._program):
            match self._program.instructions[register]:
                case Const(value):
                    values[register] = _key(value)
                case Load(variable):
                    values[register] = int(self._columns[variable][0])
                case Map(function, args):
                    choose = min if function == "min" else max
                    values[register] = choose(values[a] for a in args)
                case Window() as window:
                    values[register] = self._window_at_zero(register, window, world)
        return number_of(values[self._program.result])

    def recorded(self, register: int, world: World) -> Keys:
        """Return the values of a register at the recorded times, one object if all settle."""
        if world is World.NOW or self._tail(register, world).settled == self._n:
            return self._of_complete(register)
        return self._between(register, world, 0, self._n)

    def beyond(self, register: int, world: World) -> Keys:
        """Return the values of a register after the trace; the last value stays for ever."""
        tail = self._tail(register, world)
        return tail.rest[self._n - tail.settled :]

    def _window_at_zero(self, register: int, window: Window, world: World) -> int:
        """Return a window at time 0 only, without a column."""
        n, fold = self._n, FOLDS[window.fold]
        if world.cut and window.endless and window.begin >= n:
            world = world.opened
        last = n - 1
        if not world.ends(window):
            last = max(self._tail(a, world).last for a in window.args)
        begin = max(0, window.lo or 0)
        if last >= n:  # later elements are all the same, and fold to one of them
            last = max(begin, last)
        end = last if window.hi is None else min(last, window.hi)
        if begin > end:
            return _NOTHING[fold.name][-1]
        settled = 0
        if window.hi is None:
            settled = min(n, *(self._settled(a, world) for a in window.args))
        if settled <= begin:
            columns = [self._between(a, world, begin, end + 1) for a in window.args]
            return self._total(fold, columns)[-1]
        if (register, settled) not in self._totals:
            columns = [self._of_complete(a)[begin:settled] for a in window.args]
            self._totals[register, settled] = self._total(fold, columns)
        total = self._totals[register, settled]
        if settled <= end:
            remainder = [self._between(a, world, settled, end + 1) for a in window.args]
            total = fold.made(min, max)(total, self._total(fold, remainder))
        return total[-1]

    def _settled(self, register: int, world: World) -> int:
        if world is World.NOW:
            late = self._program.latencies[register]  # as in the other worlds, to share a fold
            return self._n if late is None else max(0, self._n - late)
        return self._tail(register, world).settled

    def _between(self, register: int, world: World, begin: int, end: int) -> Keys:
        """Return the values at times from begin to before end, possibly after the trace."""
        if begin >= end:
            return _UNSEEN[world.best][:0]
        if world is World.NOW:
            return self._of_complete(register)[begin:end]
        settled, remainder = self._tail(register, world)
        parts = []
        if begin < settled:
            parts.append(self._of_complete(register)[begin : min(end, settled)])
        if end > settled:
            first = max(begin, settled) - settled
            parts.append(remainder[first : end - settled])
            missing = end - settled - max(first, len(remainder))
            if missing > 0:
                parts.append(np.full(missing, remainder[-1]))
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _of_complete(self, register: int) -> Keys:
        """Return the values at all times of a complete trace."""
        if register not in self._complete:
            for operand in _needed(self._program, register):
                if operand not in self._complete:
                    self._complete[operand] = self._made_complete(operand)
        return self._complete[register]

    def _made_complete(self, register: int) -> Keys:
        match self._program.instructions[register]:
            case Load(variable):
                return self._columns[variable]
            case Const(value):
                return np.broadcast_to(np.int64(_key(value)), self._n)
            case Map(function, args):
                return _mapped(function, [self._complete[a] for a in args])
            case Window(fold, _, None, args):
                return self._suffixes(FOLDS[fold], [self._complete[a] for a in args])
            case Window(fold, None, hi, args):
                folds = self._prefixes(FOLDS[fold], [self._complete[a] for a in args])
                late = min(-(hi or 0), self._n)
                return np.concatenate([np.full(late, _NOTHING[fold][-1]), folds[: self._n - late]])
            case Window() as window:
                return self._sliding(window, World.NOW, 0, self._n, self._n)

    def _tail(self, register: int, world: World) -> _Tail:
        """Return the values in a world other than ``NOW``."""
        if (register, world) not in self._tails:
            for operand in _needed(self._program, register):
                if (operand, world) not in self._tails:
                    self._tails[operand, world] = self._made_tail(operand, world)
        return self._tails[register, world]

    def _made_tail(self, register: int, world: World) -> _Tail:
        n, instruction = self._n, self._program.instructions[register]
        if isinstance(instruction, Load):
            return _Tail(n, _UNSEEN[world.best])
        if isinstance(instruction, Const):
            return _Tail(n, np.array([_key(instruction.value)]))
        tails = [self._tail(a, world) for a in instruction.args]
        known, last = min(t.settled for t in tails), max(t.last for t in tails)
        match instruction:
            case Map(function, args):
                columns = [self._between(a, world, known, last + 1) for a in args]
                return _Tail(known, _mapped(function, columns))
            case Window(_, _, None) as window:
                return self._future(register, window, world, known)
            case Window(_, None, hi) as window:
                return self._past(register, window, hi or 0, world, known, last)
            case Window(fold, lo, hi, args) as window:
                settled = min(n, max(0, known - (hi or 0)))
                if world.ends(window):
                    folds = self._sliding(window, world, settled, n, n)
                    later = np.array(_NOTHING[fold][-1:])
                    if not lo:  # of an unseen time, which is there if it is read
                        later = self._between(args[-1], world, n, last + 1)
                    return _Tail(settled, np.concatenate([folds, later]))
                end = max(n, last - (lo or 0)) + 1
                folds = self._sliding(window, world, settled, end, None)
                if world.cut and window.endless:
                    sample, opened = max(settled, n - window.begin), world.opened
                    end = max(n, self._tail(register, opened).last) + 1
                    later = self._between(register, opened, sample, end)
                    folds = np.concatenate([folds[: sample - settled], later])
                return _Tail(settled, folds)

    def _future(self, register: int, window: Window, world: World, known: int) -> _Tail:
        """Return a window without an end that starts now."""
        n, fold, args = self._n, FOLDS[window.fold], window.args
        opened, skips = world.opened, world.opened.ends(window)
        end = max(self._tail(a, opened).last for a in args) + 1
        later = [self._between(a, opened, n, end) for a in args]
        beyond = later[-1] if skips else self._suffixes(fold, later)
        if world.ends(window):
            if known == n:
                return _Tail(n, beyond)
            recorded = self._suffixes(fold, [self._between(a, world, 0, n) for a in args])
            return _Tail(0, np.concatenate([recorded, beyond]))
        if fold.width > 1 or known < n:
            return _Tail(0, self._suffixes(fold, [self._between(a, world, 0, end) for a in args]))
        if beyond[0] == -1 - _NOTHING[fold.name][0]:  # it decides every fold that it is in
            return _Tail(0, np.concatenate([np.full(n, beyond[0]), beyond]))
        recorded = _mapped(fold.name, [self._of_complete(register), beyond[:1]])
        return _Tail(0, np.concatenate([recorded, beyond]))

    def _past(
        self, register: int, window: Window, hi: int, world: World, known: int, last: int
    ) -> _Tail:
        """Return a window over all times up to an offset."""
        fold, args, nothing = FOLDS[window.fold], window.args, _NOTHING[window.fold]
        settled = min(self._n, known - hi)
        folded = max(0, settled + hi)  # elements in the value of the last settled time
        end = max(self._n, last) - hi + 1
        columns = [self._between(a, world, folded, end + hi) for a in args]
        if folded:  # of an older element such folds read its result alone
            before = int(self._of_complete(register)[settled - 1])
            older = (*nothing[:-1], before)
            columns = [np.concatenate([[e], c]) for e, c in zip(older, columns, strict=True)]
        folds = self._prefixes(fold, columns)[1 if folded else 0 :]
        early = np.full(end - settled - len(folds), nothing[-1])  # before the first element
        return _Tail(settled, np.concatenate([early, folds]))

    def _sliding(
        self, window: Window, world: World, begin: int, end: int, limit: int | None
    ) -> Keys:
        """Return a window with both bounds at times from begin to before end."""
        lo, hi = window.lo or 0, window.hi or 0
        fold, folds = FOLDS[window.fold], np.empty(end - begin, np.int64)
        step = max(_BLOCK, hi - lo)
        for first in range(begin, end, step):
            after = min(first + step, end)
            low, high = first + lo, after + hi
            start = min(max(0, low), high)
            stop = max(start, high if limit is None else min(high, limit))
            columns = []
            for argument, nothing in zip(window.args, _NOTHING[window.fold], strict=True):
                column = self._between(argument, world, start, stop)
                if (start, stop) != (low, high):
                    missing = start - low, high - stop
                    before, behind = (np.full(count, nothing) for count in missing)
                    column = np.concatenate([before, column, behind])
                columns.append(column)
            folds[first - begin : after - begin] = _slid(fold, columns, hi - lo + 1)
        return folds

    def _total(self, fold: LatticeFold, columns: Sequence[Keys]) -> tuple[int, ...]:
        """Return the fold of one element or more."""
        if fold.width == 1:
            reduce = np.minimum if fold.identity[-1] > 0 else np.maximum
            return (int(reduce.reduce(columns[0])),)
        combine, choose, total = _combine(fold), fold.made(min, max), _NOTHING[fold.name]
        if self._fold_pairs is not None:
            (p, q), last = columns, total[-1]
            ahead = fold.name in ("until", "release")
            begins = range(0, len(p), _BLOCK)
            for begin in reversed(begins) if ahead else begins:
                block = slice(begin, begin + _BLOCK)
                folds = self._fold_pairs(p[block], q[block], last, fold.identity[-1] < 0, ahead)
                last = int(folds[0 if ahead else -1])
            reduce = np.minimum if fold.identity[0] > 0 else np.maximum
            return int(reduce.reduce(p)), last
        for begin in range(0, len(columns[0]), _BLOCK):
            run = tuple(c[begin : begin + _BLOCK] for c in columns)
            while len(run[0]) > 1:
                pairs = len(run[0]) // 2 * 2
                odd = tuple(c[pairs:] for c in run)
                run = combine(tuple(c[0:pairs:2] for c in run), tuple(c[1:pairs:2] for c in run))
                if len(odd[0]):
                    run = tuple(np.concatenate(both) for both in zip(run, odd, strict=True))
            total = choose(total, tuple(int(c[0]) for c in run))
        return total

    def _scanned(self, fold: LatticeFold, columns: Sequence[Keys], *, backwards: bool) -> Keys:
        assert self._fold_pairs is not None  # noqa: S101 - the callers ask
        (p, q), before = columns, _NOTHING[fold.name][-1]
        return self._fold_pairs(p, q, before, fold.identity[-1] < 0, backwards)

    def _suffixes(self, fold: LatticeFold, columns: Sequence[Keys]) -> Keys:
        """Return the folds from each element to the last one; for pairs, of the future."""
        if fold.width > 1 and self._fold_pairs is not None:
            return self._scanned(fold, columns, backwards=True)
        return self._prefixes(FOLDS[fold.mirror], [column[::-1] for column in columns])[::-1]

    def _prefixes(self, fold: LatticeFold, columns: Sequence[Keys]) -> Keys:
        """Return the folds from the first element to each one; for pairs, of the past."""
        if fold.width == 1:
            accumulate = (np.minimum if fold.identity[-1] > 0 else np.maximum).accumulate
            return accumulate(columns[0])
        if self._fold_pairs is not None:
            return self._scanned(fold, columns, backwards=False)
        total, blocks = _NOTHING[fold.name], [columns[-1][:0]]
        for begin in range(0, len(columns[0]), _PREFIX_BLOCK):
            values, total = _prefixes_of_block(
                fold, total, [column[begin : begin + _PREFIX_BLOCK] for column in columns]
            )
            blocks.append(values)
        return np.concatenate(blocks)


@functools.lru_cache(maxsize=1024)  # programs are cached, and differ by identity
def _needed(program: Program, register: int) -> tuple[int, ...]:
    """Return the registers that a register is computed from, operands first, itself last."""
    return tuple(sorted(program.needed(register)))


def _combine(fold: LatticeFold) -> Callable[[tuple[Keys, ...], tuple[Keys, ...]], tuple[Keys, ...]]:
    return fold.made(np.minimum, np.maximum)


def _mapped(function: str, columns: Sequence[Keys]) -> Keys:
    first, second = columns
    return np.minimum(first, second) if function == "min" else np.maximum(first, second)


def _slid(fold: LatticeFold, columns: Sequence[Keys], length: int) -> Keys:
    """Return the folds of all runs of this length.

    Folds of runs whose length is a power of 2 are folded in pairs. The last pair overlaps, which is
    harmless because folds are idempotent.
    """
    combine, run, known = _combine(fold), tuple(columns), 1
    while known < length:
        more = min(known, length - known)
        run = combine(tuple(c[:-more] for c in run), tuple(c[more:] for c in run))
        known += more
    return run[-1]


def _prefixes_of_block(
    fold: LatticeFold, total: tuple[int, ...], columns: Sequence[Keys]
) -> tuple[Keys, tuple[int, ...]]:
    """Return the folds of the total before and the first elements, and the fold of all.

    Elements stand in rows of a table. Rows are folded side by side, then each one with the fold of
    all previous ones.
    """
    combine, choose = _combine(fold), fold.made(min, max)
    n = len(columns[0])
    width = math.isqrt(n - 1) + 1
    rows = -(-n // width)
    tables = []
    for column, nothing in zip(columns, _NOTHING[fold.name], strict=True):
        padded = np.concatenate([column, np.full(rows * width - n, nothing)])
        tables.append(padded.reshape(rows, width).T.copy())  # a fold needs contiguous rows
    for i in range(1, width):
        folded = combine(tuple(t[i - 1] for t in tables), tuple(t[i] for t in tables))
        for table, row in zip(tables, folded, strict=True):
            table[i] = row
    before: list[tuple[int, ...]] = []
    for element in zip(*(table[-1].tolist() for table in tables), strict=True):
        before.append(total)
        total = choose(total, element)
    older = tuple(np.array(column) for column in zip(*before, strict=True))
    return combine(older, tuple(tables))[-1].T.reshape(-1)[:n], total


@functools.lru_cache(maxsize=512)
def initial_registers(program: Program) -> tuple[int, ...]:
    """Return the registers that are read only at time 0, in order; the last is the result."""
    registers = {program.result}
    for register in range(program.result, -1, -1):
        instruction = program.instructions[register]
        if register in registers and isinstance(instruction, Map):
            registers.update(instruction.args)
    return tuple(sorted(registers))
