"""From a specification to the programs of a unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rtamt.errors import Argument
from rtamt.export.program_file import (
    DenseFile,
    EpisodeBounds,
    Named,
    ProgramFile,
    SampledFile,
)
from rtamt.language.specification import Specification
from rtamt.language.traced import Traced
from rtamt.monitors.options import Options, SampleOptions, compiled, compiled_dense
from rtamt.program.dense_lowering import DenseProgram
from rtamt.program.encoding import clock_of, encoded_dense, encoded_discrete, encoded_episode
from rtamt.program.instructions import Const, Window
from rtamt.program.memory import limit_discrete, limit_episode
from rtamt.program.polarity import positive
from rtamt.program.program import Program
from rtamt.program.timing import Period

__all__ = ["Programs", "dense_programs", "sampled_programs"]


@dataclass(frozen=True)
class Programs:
    """The programs that a unit runs, and what its model description says of them.

    Attributes:
        written: The programs as the file of a unit has them.
        program: The program that has all registers.
        step: Seconds between samples; None over dense time.
        said: For each named formula, what is said of its value behind the formula.
    """

    written: SampledFile | DenseFile
    program: Program
    step: float | None
    said: Mapping[str, str]

    def file(self, *, token: str, stop: bool) -> ProgramFile:
        """The file of the unit."""
        spec = self.program.specification
        variables = [Named(name, spec.defaults.get(name, 0.0)) for name in self.program.variables]
        constants = [Named(name, value) for name, value in spec.constants.items()]
        used = self._constants()
        return ProgramFile(
            token=token,
            inputs=variables,
            formulas=list(self.said),
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
    step = Fraction(seconds or 1)
    running = program.running(*program.specification.formulas.values())
    late = {name: running.latencies[register] for name, register in running.outputs.items()}
    monitor = _monitor(running, [name for name, latency in late.items() if latency is not None])
    # The others, for which no monitor can wait, have an episode of their own.
    episodes, judges = _readings(program), dict[int, int]()
    judges[program.result] = len(episodes) - 1
    sources: list[int | None] = []
    said = dict[str, str]()
    for name, latency in late.items():
        if latency is None:
            register = program.outputs[name]
            if register not in judges:
                judges[register] = len(episodes)
                episodes.append(_readings(replace(program, result=register))[-1])
            sources.append(judges[register])
            said[name] = "as if the run ended now"
        else:
            sources.append(None)
            said[name] = _late(latency * step)
    written = SampledFile(
        period=step.as_integer_ratio(),
        readings=judges[program.result] + 1,
        episodes=[encoded_episode(each) for each in episodes],
        monitor=None if monitor is None else encoded_discrete(monitor),
        observed=[]
        if monitor is None
        else [(register, late[name] or 0) for name, register in monitor.outputs.items()],
        sources=sources,
    )
    return Programs(written, program, float(step), said)


def _readings(program: Program) -> list[Program]:
    """The program of an episode; two if it has neutral predicates, with -0.0 and with 0.0."""
    limit_episode(program)
    if not program.neutral:
        return [program]
    plain = positive(program)
    return [plain.reading(-0.0), plain.reading(0.0)]


def _monitor(program: Program, names: Sequence[str]) -> Program | None:
    """The program of these named formulas, each with a latency; None without named formulas.

    It has all terms, so that it refuses every sample that an episode refuses.
    """
    if not program.outputs:
        return None
    outputs = {name: program.outputs[name] for name in names}
    kept = sorted({*range(program.terms), *program.needed(*outputs.values())})
    part = replace(program, result=0, outputs=outputs).reordered(kept, program.terms)
    limit_discrete(part)
    return part


def dense_programs(
    caller: Callable[..., object], spec: Specification, resolution: Period, options: Options
) -> Programs:
    """The program of a unit over dense time; ``spec`` has traced constants."""
    *_, whole = compiled_dense(caller, spec, resolution, options, online=False)
    program = whole.program.running(*whole.program.specification.formulas.values())
    online = program.online(
        "an FMU over dense time", Argument("dense", words="use a period, which takes samples")
    )
    dense = DenseProgram(online, whole.resolution)
    # The simulator's time is in seconds, whatever the unit of the specification is.
    encoded = encoded_dense(dense)._replace(clock=clock_of(dense.resolution))
    written = DenseFile(encoded, _bounds(whole.program), list(online.outputs.values()))
    late = {
        name: _late((online.latencies[register] or 0) * dense.resolution)
        for name, register in online.outputs.items()
    }
    return Programs(written, online, None, late)


def _late(time: Fraction) -> str:
    return f"late by {float(time):g} s" if time else ""


def _bounds(program: Program) -> EpisodeBounds:
    """How the robustness over dense time bounds the robustness of the whole episode."""
    if program.neutral:
        return "none"
    root = program.instructions[program.result]
    if isinstance(root, Window) and root.hi is None:
        return "least" if root.fold == "min" else "greatest"
    return "first"
