"""The maximum memory of a monitor's windows, and its limit."""

from __future__ import annotations

import functools
from collections import Counter
from typing import cast

import numpy as np

from rtamt import limits
from rtamt.errors import InputError, brief
from rtamt.program.algebra import FOLDS
from rtamt.program.instructions import Const, Load, Window
from rtamt.program.placement import Placement, place
from rtamt.program.program import Delay, Program, schedule

_DOUBLE = 8
_WORLDS = 3


def limit_discrete(program: Program, entries: int = 1) -> None:
    """Refuse a program whose windows and delays, in all entries, exceed `limits.window_bytes`."""
    _limit(program, discrete_numbers(program), entries, _where(entries))


def limit_episode(program: Program, entries: int = 1, *, unknown: bool = False) -> None:
    """Refuse a program whose streams, in all entries, exceed `limits.window_bytes`."""
    where = _where(entries) + " with samples that are not known" * unknown
    machines = _machines(program, unknown=unknown)
    _limit(place(program).program, machines * _episode_needs(program), entries, where)


def intervals_fit(program: Program, entries: int = 1) -> bool:
    """Return whether `limit_episode` allows uncertain values."""
    needed = _machines(program, unknown=True) * _episode_needs(program) * entries * _DOUBLE
    return needed <= limits.window_bytes


def limit_beyond(program: Program, n: int, *, unknown: bool = False) -> None:
    """Refuse a program whose windows reach too far beyond a trace for `limits.window_bytes`."""
    numbers = _most_beyond(program)
    if (2 if unknown else 1) * numbers * _DOUBLE > _checked_limit():
        clamped = program.clamped(sufficient(program, n))
        where = " with samples that are not known" * unknown
        _limit(clamped, (2 if unknown else 1) * _beyond(clamped, n), 1, where)


def _beyond(program: Program, n: int) -> int:
    """Return the numbers that windows beyond a trace of n samples keep."""
    windows = program.windows
    beyond = sum(max(0, abs(b) - n) for w in windows for b in (w.lo, w.hi) if b is not None)
    # Each variable and each window keeps them, in both worlds of each reading of the predicates.
    return 2 * beyond * (len(program.variables) + len(windows))


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def _most_beyond(program: Program) -> int:
    return _beyond(program, 0)


@functools.lru_cache(maxsize=512)  # programs are cached, and differ by identity
def discrete_numbers(program: Program) -> int:
    """Count the doubles that a program keeps while it runs sample by sample."""
    numbers = 0
    for _, scheduled in schedule(program):
        if isinstance(scheduled, Delay):
            numbers += scheduled.length
        elif isinstance(scheduled, Window) and (scheduled.length or 0) > 1:
            numbers += (scheduled.length or 0) * FOLDS[scheduled.fold].width
    return numbers


def episode_numbers(placement: Placement) -> Counter[int]:
    """Count the most doubles that each register keeps while a machine bounds an episode.

    A stream keeps settled values at every corner of its unknowns, and open ones in each world.
    """
    program, numbers = placement.program, Counter[int]()
    late, past, open_ended = Counter[int](), Counter[int](), set[int]()
    for register in sorted({*placement.streams, *placement.initial}):
        instruction = program.instructions[register]
        if isinstance(instruction, Load | Const) or register < program.terms:
            continue
        args = instruction.args
        reach, before = max(late[a] for a in args), max(past[a] for a in args)
        if open_ended.intersection(args) or register in placement.unknowns:
            open_ended.add(register)
        oldest = 0
        if isinstance(instruction, Window):
            lo, hi = instruction.lo, instruction.hi
            if register not in placement.streams:  # one fold of all that has settled
                hi = lo = 0
            if hi is not None:
                oldest = hi if lo is None else lo
                reach, before = max(0, reach + hi), max(0, before - oldest)
        elif register not in placement.streams:
            continue
        late[register], past[register] = reach, before
        for a in args:
            numbers[a] = max(numbers[a], reach - late[a] - oldest)
    corners = 2 ** len(placement.unknowns)
    return Counter(
        {
            r: numbers[r] * (corners if r in open_ended else 1) + _WORLDS * (late[r] + past[r])
            for r in placement.streams
        }
    )


@functools.lru_cache(maxsize=512)
def _episode_needs(program: Program) -> int:
    return episode_numbers(place(program)).total()


def _machines(program: Program, *, unknown: bool) -> int:
    """Return the number of machines of an episode; see `rtamt.machines.episode.machine`."""
    return 1 + program.neutral + unknown


def _where(entries: int) -> str:
    return f" in {entries} batch entries" if entries > 1 else ""


def _checked_limit() -> float:
    limit: object = limits.window_bytes  # which anybody may set
    if (
        isinstance(limit, bool)
        or not isinstance(limit, int | float | np.integer | np.floating)
        or not limit >= 0
    ):
        msg = f"expected a number of bytes as rtamt.limits.window_bytes, got {brief(limit)}"
        raise InputError(msg)
    return cast("float", limit)


def _limit(program: Program, numbers: int, entries: int, where: str = "") -> None:
    limit = _checked_limit()
    needed = numbers * entries * _DOUBLE
    if needed <= limit:
        return
    windows = [
        (max(abs(bound) for bound in (i.lo, i.hi) if bound is not None), register)
        for register, i in enumerate(program.instructions)
        if isinstance(i, Window)
    ]
    _, longest = max(windows)
    raise program.specification.error(
        program.sources[longest],
        f"the windows need {needed} bytes{where}, and this one is the longest; "
        f"the limit is {limit}",
        "write shorter windows, take samples further apart, or raise rtamt.limits.window_bytes",
    )


def sufficient(program: Program, n: int) -> int:
    """Return a number to which bounds may be cut for a trace of n samples or less.

    From some sample on, all unseen ones are equal, and their number does not matter.
    """
    memory, greatest = _memory_and_bound(program)
    return min(n + memory, greatest)


@functools.lru_cache(maxsize=512)
def _memory_and_bound(program: Program) -> tuple[int, int]:
    """Return after how many unseen samples all later ones are equal, and the largest bound."""
    windows = program.windows
    before = [max(0, -_begin(window)) for window in windows]
    if not any(window.hi is None for window in windows):
        # No time after this one is read, so that no window reaches back further than it.
        last = sum(max(0, window.hi or 0) for window in windows)
        before = [min(last + 1, reach) for reach in before]
    return sum(before), max(
        (abs(b) for w in windows for b in (w.lo, w.hi) if b is not None), default=0
    )


def _begin(window: Window) -> int:
    """Return the offset from which a window must read one number to have a constant value."""
    # Folds are idempotent: a window without begin needs it at its end.
    return window.lo if window.lo is not None else window.hi or 0
