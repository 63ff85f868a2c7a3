"""The laws of trace ends, on formulas and integer traces with many zeros.

For a formula and a trace, each prefix of which may be the complete trace:

* bounds never widen; * the complete value of a prefix, and of every longer one, lies inside its
open bounds; * a decided open verdict is the sign of the complete value at every later end of the
trace; * the bounds of a prefix that was cut lie inside the open ones; * the robustness after
`finish` is the complete value, moved to the bounds.

Zeros have a sign: -0.0 is below 0.0. ``python tests/support/end_laws.py 20000`` checks every
machine on this number of cases.
"""

from __future__ import annotations

import copy
import math
import random
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import fmu_calls
import oracle
from end_oracle import ended
from oracle import order

from rtamt import EpisodeMonitor, SpecificationError, VectorEpisodeMonitor, judge, parse
from rtamt.program.lowering import compile_program
from rtamt.program.placement import place

Bounds = tuple[float, float, float]
"""Robustness, lower and upper bound."""
Trace = Mapping[str, Sequence[float]]
Backend = Literal["native", "python"]
ENDS: tuple[Literal["complete", "cut"], ...] = ("complete", "cut")

_ATOMS = ("a > 0", "b >= 1", "a == b", "abs(a - b) < 2", "c != 0", "a", "true", "false")
_UNARY = ("not", "next", "s_next", "prev", "s_prev", "rise", "fall")
_BINARY = ("and", "or", "implies", "iff", "xor")
_WINDOWS = ("always", "eventually", "historically", "once")
_PAIRS = ("until", "unless", "since")
_VALUES = (0.0, 0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 3.0)


@dataclass
class Told:
    """What a machine says of a trace: after each sample, and of each beginning that ends there.

    Attributes:
        open: Robustness and bounds after every sample.
        complete: The same of every beginning as a whole; empty if the machine ends no trace.
        cut: The same of every beginning that was cut; empty if the machine ends no trace.
    """

    open: list[Bounds]
    complete: list[Bounds]
    cut: list[Bounds]


Machine = Callable[[str, Trace], Told]
Draw = Callable[[random.Random], str]


@dataclass
class Count:
    """The results of many cases.

    Attributes:
        cases: The number of pairs of a formula and a trace.
        zeros: The number of complete values that are 0.
        faults: Broken laws, and differences from the definition.
    """

    cases: int = 0
    zeros: int = 0
    faults: list[str] = field(default_factory=list)


# Formulas. ---------------------------------------------------------------------------------------


def any_formula(choose: random.Random, depth: int = 3) -> str:
    """Formulas in which future operators contain past ones and vice versa."""
    if depth == 0 or choose.random() < 0.12:
        return f"({choose.choice(_ATOMS)})"

    def inner() -> str:
        return any_formula(choose, depth - 1)

    match choose.random():
        case x if x < 0.2:
            return f"{choose.choice(_UNARY)}({inner()})"
        case x if x < 0.4:
            return f"({inner()} {choose.choice(_BINARY)} {inner()})"
        case x if x < 0.8:
            return f"({choose.choice(_WINDOWS)}{_interval(choose)} {inner()})"
        case _:
            return f"({inner()} {choose.choice(_PAIRS)}{_interval(choose)} {inner()})"


def _interval(choose: random.Random) -> str:
    if choose.random() < 0.3:
        return choose.choice(("", "", f"[{choose.randint(1, 3)}:inf]"))
    begin = choose.randint(0, 3)
    return f"[{begin}:{begin + choose.randint(0, 3)}]"


def column_formula(choose: random.Random) -> str:
    """Formulas of the form that entries run as columns, with constants and guards."""

    def part(depth: int) -> str:
        if depth == 0:
            return f"({choose.choice(_ATOMS)})"
        return f"({part(depth - 1)} {choose.choice(('and', 'or', 'implies'))} {part(0)})"

    def window() -> str:
        return (
            f"{choose.choice(_WINDOWS[:2])}[0:{choose.randint(1, 3)}]{part(choose.randint(0, 1))}"
        )

    def root() -> str:
        inner = choose.choice(
            (part(1), f"({part(1)} or {window()})", f"({part(0)} and {window()})")
        )
        begin = choose.randint(0, 2)
        bounds = choose.choice(("", f"[{begin}:{begin + choose.randint(0, 4)}]"))
        return f"{choose.choice(_WINDOWS[:2])}{bounds}{inner}"

    guarded = f"({part(0)} until[{(k := choose.randint(1, 3))}:{k}] {part(0)})"
    return choose.choice((root(), f"({root()} and {root()})", f"({root()} or {guarded})"))


def response_formula(choose: random.Random) -> str:
    """Responses and durations, whose request or answer may read the past."""

    def side() -> str:
        atom = f"({choose.choice(_ATOMS[:6])})"
        back = choose.choice(("once", "historically", "prev"))
        bounds = "" if back == "prev" else f"[{choose.randint(0, 1)}:{choose.randint(1, 3)}]"
        return choose.choice((atom, atom, f"{back}{bounds}{atom}"))

    begin = choose.randint(0, 2)
    bounds = f"[{begin}:{begin + choose.randint(1, 3)}]"
    inner = choose.choice(("", "", f"{choose.choice(_WINDOWS[:2])}[0:{choose.randint(1, 2)}]"))
    answer = f"{choose.choice(_WINDOWS[:2])}{bounds} {inner}{side()}"
    joint = choose.choice(("implies", "and", "or"))
    return f"{choose.choice(_WINDOWS[:2])}({side()} {joint} {answer})"


def trace_of(choose: random.Random, most: int = 8) -> dict[str, list[float]]:
    """Return a trace of up to a number of samples."""
    n = choose.randint(1, most)
    return {name: [choose.choice(_VALUES) for _ in range(n)] for name in "abc"}


# Machines. ---------------------------------------------------------------------------------------


def definition(text: str, trace: Trace) -> Told:
    """Return the values of the definition."""
    formula = parse(text).formula
    beginnings = range(1, len(trace["a"]) + 1)
    return Told(
        [oracle.episode(formula, trace, n) for n in beginnings],
        *([ended(formula, trace, n, end) for n in beginnings] for end in ENDS),
    )


def monitors(backend: Backend) -> Machine:
    """Return the values of `EpisodeMonitor`."""

    def run(text: str, trace: Trace) -> Told:
        told, monitor = Told([], [], []), EpisodeMonitor(text, backend=backend)
        for sample in _samples(trace):
            monitor.update({name: sample[name] for name in monitor.variables})
            told.open.append((monitor.robustness, monitor.lower, monitor.upper))
            for end in ENDS:
                its = copy.copy(monitor)
                its.finish(end)
                getattr(told, end).append((its.robustness, its.lower, its.upper))
        return told

    return run


def entries(backend: Backend) -> Machine:
    """Return the values of the second of three entries of `VectorEpisodeMonitor`."""

    def run(text: str, trace: Trace) -> Told:
        told, vector = Told([], [], []), VectorEpisodeMonitor(text, 3, backend=backend)

        def second(its: VectorEpisodeMonitor) -> Bounds:
            return float(its.robustness[1]), float(its.lower[1]), float(its.upper[1])

        for sample in _samples(trace):
            row = [sample[name] for name in vector.variables]
            vector.update([row, row, [-x for x in row]])
            told.open.append(second(vector))
            for end in ENDS:
                its = copy.copy(vector)
                its.finish([False, True, True], end=end)
                getattr(told, end).append(second(its))
        return told

    return run


def judgements(backend: Backend) -> Machine:
    """Return the values of `judge` for every prefix."""

    def run(text: str, trace: Trace) -> Told:
        def told(n: int, end: Literal["open", "complete", "cut"]) -> Bounds:
            part = {name: values[:n] for name, values in trace.items()}
            found = judge(text, part, end=end, n=n, backend=backend)
            return found.robustness, found.lower, found.upper

        beginnings = range(1, len(trace["a"]) + 1)
        opened = [told(n, "open") for n in beginnings]
        return Told(opened, *([told(n, end) for n in beginnings] for end in ENDS))

    return run


def exported(text: str, trace: Trace) -> Told:
    """Return the values of an FMU of FMI 2.0, whose simulation is open at every step."""
    told, names = Told([], [], []), parse(text).variables
    with TemporaryDirectory() as folder:
        fmu_calls.write(Path(folder), fmu_calls.sampled(text))
        with fmu_calls.unit(2, Path(folder)) as unit:
            unit.begin()
            for time, sample in enumerate(_samples(trace)):
                first = fmu_calls.FIRST
                unit.set(range(first, first + len(names)), [sample[name] for name in names])
                unit.step(float(time), 1.0)
                now, lower, upper = unit.get(fmu_calls.ROBUSTNESS, fmu_calls.LOWER, fmu_calls.UPPER)
                told.open.append((now, lower, upper))
    return told


def _samples(trace: Trace) -> Iterable[Mapping[str, float]]:
    for values in zip(*trace.values(), strict=True):
        yield dict(zip(trace, values, strict=True))


# Laws. -------------------------------------------------------------------------------------------


def count(machine: Machine, draw: Draw, cases: int, seed: int = 0) -> Count:
    """Run a machine on a number of cases, and compare it with the definition and the laws."""
    choose, found = random.Random(seed), Count()
    while found.cases < cases:
        text, trace = draw(choose), trace_of(choose)
        try:
            place(compile_program(parse(text)))
        except SpecificationError:
            continue  # too many nested unbounded futures
        found.cases += 1
        expected, told = definition(text, trace), machine(text, trace)
        found.zeros += sum(value == 0 for value, _, _ in expected.complete)
        for fault in (*differences(told, expected), *broken_laws(told)):
            found.faults.append(f"{text} on {trace}: {fault}")
    return found


def differences(told: Told, expected: Told) -> list[str]:
    """Return the differences of a machine from the definition, in any bit."""
    return [
        f"{name} after sample {n}: {got}, expected {wanted}"
        for name in ("open", "complete", "cut")
        for n, (got, wanted) in enumerate(
            zip(getattr(told, name), getattr(expected, name), strict=False)
        )
        if not _same(got, wanted)
    ]


def broken_laws(told: Told) -> list[str]:
    """Return the laws that a machine breaks on a trace."""
    found = []

    def law(holds: object, name: str) -> None:
        if not holds:
            found.append(name)

    before = -math.inf, math.inf
    for n, (now, lower, upper) in enumerate(told.open):
        law(_inside(before[0], lower, upper) and _inside(lower, upper, before[1]), f"wider at {n}")
        law(_inside(lower, now, upper), f"the robustness is outside at {n}")
        for end, (value, _, _) in enumerate(told.open[n:], n):
            law(_inside(lower, value, upper), f"outside the bounds at {n}: the value at {end}")
            if _holds(lower) == _holds(upper):
                law(_holds(value) == _holds(lower), f"decided at {n}, otherwise at {end}")
        before = lower, upper
    for n, ((now, lower, upper), complete) in enumerate(
        zip(told.open, told.complete, strict=False)
    ):
        law(_same(complete, (now, now, now)), f"complete at {n} is not the robustness")
        value, least, greatest = told.cut[n]
        law(_inside(lower, least, greatest), f"cut at {n} is below")
        law(_inside(least, greatest, upper), f"cut at {n} is above")
        moved = max(least, min(now, greatest, key=order), key=order)
        law(_same((value,), (moved,)), f"the robustness of a cut trace at {n} was not moved")
    return found


def _holds(value: float) -> bool:
    return math.copysign(1.0, value) > 0


def _inside(*values: float) -> bool:
    """Return whether numbers rise, -0.0 below 0.0."""
    return sorted(values, key=order) == [*values] and _same(sorted(values, key=order), values)


def _same(some: Sequence[float], others: Sequence[float]) -> bool:
    return [*map(order, some)] == [*map(order, others)]


MACHINES: Mapping[str, tuple[Machine, Draw]] = {
    "Python": (monitors("python"), any_formula),
    "C++": (monitors("native"), any_formula),
    "responses": (monitors("native"), response_formula),
    "entries": (entries("native"), any_formula),
    "columns": (entries("native"), column_formula),
    "entries in Python": (entries("python"), column_formula),
    "judge": (judgements("native"), any_formula),
    "judge in Python": (judgements("python"), any_formula),
    "FMU": (exported, any_formula),
}


def main(cases: int, names: Sequence[str]) -> int:
    """Run all machines or the named ones; return the number of faults."""
    faults = 0
    for seed, (name, (machine, draw)) in enumerate(MACHINES.items()):
        if names and name not in names:
            continue
        found = count(machine, draw, cases, seed)
        faults += len(found.faults)
        sys.stdout.write(
            f"{name}: {found.cases} cases, {found.zeros} zeros, {len(found.faults)} exceptions\n"
        )
        sys.stdout.writelines(f"  {fault}\n" for fault in found.faults[:3])
        sys.stdout.flush()
    return faults


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), sys.argv[2:]) > 0)
