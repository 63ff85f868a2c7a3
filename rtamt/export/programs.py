"""From a specification to the programs of a unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rtamt.errors import SpecificationError
from rtamt.export.program_file import (
    Bounds,
    DenseFile,
    Named,
    ProgramFile,
    SampledFile,
)
from rtamt.language.specification import Specification
from rtamt.language.traced import Traced
from rtamt.monitors.options import Options, SampleOptions, compiled, compiled_dense
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.encoding import clock_of, encoded_dense, encoded_discrete, encoded_episode
from rtamt.program.memory import limit_discrete, limit_episode
from rtamt.program.polarity import positive
from rtamt.program.program import Const, Program, Window
from rtamt.program.timing import Period

__all__ = ["Programs", "dense_programs", "sampled_programs"]


@dataclass(frozen=True)
class Programs:
    """What a unit runs, and what of it is said in a model description.

    Attributes:
        written: The programs as the file of a unit has them.
        program: The program that has all registers.
        step: Seconds between samples; None over dense time.
        late: For each named formula that is an output, the time by which its value is late.
    """

    written: SampledFile | DenseFile
    program: Program
    step: float | None
    late: Mapping[str, str]

    def file(self, *, token: str, stop: bool) -> ProgramFile:
        """The file of the unit."""
        spec = self.program.specification
        variables = []
        for name in self.program.variables:
            declared = spec.declaration(name)
            default = None if declared is None else declared.default
            variables.append(Named(name, default or 0.0))
        constants = [Named(name, value) for name, value in spec.constants.items()]
        used = self._constants()
        return ProgramFile(
            token=token,
            inputs=variables,
            formulas=list(self.late),
            parameters=[c for c in constants if c.name in used - spec.bounding],
            fixed=[c for c in constants if c.name in spec.bounding],
            stop=stop,
            programs=self.written,
        )

    def _constants(self) -> frozenset[str]:
        """The constants on which numbers of the program depend."""
        numbers = [i.value for i in self.program.instructions if isinstance(i, Const)]
        traced = [number for number in numbers if isinstance(number, Traced)]
        return frozenset[str]().union(*(number.constants for number in traced))


def sampled_programs(
    caller: Callable[..., object], spec: Specification, period: Period, options: SampleOptions
) -> Programs:
    """The programs of a unit that takes samples; ``spec`` has traced constants."""
    *_, seconds, program = compiled(caller, spec, period, options, online=False)
    limit_episode(program)
    readings = [program]
    if program.neutral:
        plain = positive(program)
        readings = [plain.reading(-0.0), plain.reading(0.0)]
    named = _named(program)
    late = {} if named is None else {n: named.latencies[r] or 0 for n, r in named.outputs.items()}
    if named is not None:
        limit_discrete(named)
    step = Fraction(seconds or 1)
    written = SampledFile(
        period=step.as_integer_ratio(),
        episodes=[encoded_episode(each) for each in readings],
        monitor=None if named is None else encoded_discrete(named),
        observed=[] if named is None else [(named.outputs[n], late[n]) for n in late],
    )
    return Programs(written, program, float(step), {n: _seconds(k * step) for n, k in late.items()})


def _named(program: Program) -> Program | None:
    """The program of the named formulas, each with a latency; None without any.

    It has all terms, so that it refuses every sample that the episode refuses. The result is not
    among them if it needs the whole future: the outputs of the episode speak of it.
    """
    named = program.specification.formulas
    others = {
        name: register
        for name, register in program.outputs.items()
        if named[name] is not program.specification.formula
    }
    if others:
        several = len(program.specification.requirements) > 1
        instead = "spec.requirements, each alone" if several else "the formula unnamed"
        _part(program, others).online("the output of a named formula", instead)
    try:
        online = program.online()
    except SpecificationError:
        return _part(program, others) if others else None
    return _part(online, online.outputs) if online.outputs else None


def _part(program: Program, outputs: Mapping[str, int]) -> Program:
    """The terms of a program, and what computes these outputs."""
    kept = sorted({*range(program.terms), *program.needed(*outputs.values())})
    part = replace(program, result=next(iter(outputs.values())), outputs=outputs)
    return part.reordered(kept, program.terms)


def dense_programs(
    caller: Callable[..., object], spec: Specification, resolution: Period, options: Options
) -> Programs:
    """The program of a unit over dense time; ``spec`` has traced constants."""
    *_, whole = compiled_dense(caller, spec, resolution, options, online=False)
    online = whole.program.online("an FMU over dense time", "a period, which takes samples")
    dense = DenseProgram(online, whole.resolution)
    # The simulator's time is in seconds, whatever the unit of the specification is.
    encoded = encoded_dense(dense)._replace(clock=clock_of(dense.resolution))
    written = DenseFile(encoded, _bounds(whole.program), list(online.outputs.values()))
    late = {
        name: _seconds((online.latencies[register] or 0) * dense.resolution)
        for name, register in online.outputs.items()
    }
    return Programs(written, online, None, late)


def _seconds(time: Fraction) -> str:
    return f"{float(time):g} s" if time else ""


def _bounds(program: Program) -> Bounds:
    """What the robustness over dense time says of the bounds of the episode."""
    if program.neutral:
        return "none"
    root = program.instructions[program.result]
    if isinstance(root, Window) and root.hi is None:
        return "least" if root.fold == "min" else "greatest"
    return "first"
