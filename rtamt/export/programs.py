"""The programs of a unit, compiled from a specification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rtamt.export.program_file import (
    DenseFile,
    Named,
    ProgramFile,
    RegionFile,
    SampledFile,
)
from rtamt.language.interval import Traced
from rtamt.language.specification import Specification
from rtamt.monitors.options import Options, SampleOptions, compiled, compiled_dense
from rtamt.program.dense_lowering import DenseProgram, compile_regions
from rtamt.program.encoding import (
    clock_of,
    encoded_dense,
    encoded_discrete,
    encoded_episode,
    encoded_regions,
    encoded_terms,
)
from rtamt.program.instructions import Const
from rtamt.program.lowering import refuse_rates
from rtamt.program.memory import limit_discrete, limit_episode
from rtamt.program.placement import place, variants_of
from rtamt.program.program import Program
from rtamt.program.timing import Period


@dataclass(frozen=True)
class Programs:
    """The programs of a unit, with the texts for its model description.

    Attributes:
        encoded: The programs in the form of the file.
        program: The program with all registers.
        step: Seconds between samples; None over dense time.
        notes: A note on the value of each named formula.
    """

    encoded: SampledFile | DenseFile
    program: Program
    step: float | None
    notes: Mapping[str, str]

    def file(self, *, token: str, stop: bool) -> ProgramFile:
        """Return the program file of the unit."""
        spec = self.program.specification
        variables = [Named(name, _start(spec, name)) for name in self.program.variables]
        constants = [Named(name, value) for name, value in spec.constants.items()]
        used = self._constants()
        return ProgramFile(
            token=token,
            inputs=variables,
            formulas=list(self.notes),
            parameters=[c for c in constants if c.name in used - spec.bounding],
            fixed=[c for c in constants if c.name in spec.bounding],
            stop=stop,
            programs=self.encoded,
        )

    def _constants(self) -> frozenset[str]:
        """Return the constants that numbers of the program depend on."""
        numbers = [i.value for i in self.program.instructions if isinstance(i, Const)]
        traced = [number for number in numbers if isinstance(number, Traced)]
        return frozenset[str]().union(*(number.constants for number in traced))


def _start(spec: Specification, variable: str) -> float:
    """Return the default of an input; otherwise, the number closest to 0 in its range."""
    lower, upper = spec.declared_ranges.get(variable, (0.0, 0.0))
    return spec.defaults.get(variable, min(max(0.0, lower), upper))


def sampled_programs(
    caller: Callable[..., object], spec: Specification, period: Period, options: SampleOptions
) -> Programs:
    """Return the programs of a unit on samples; ``spec`` has traced constants."""
    refuse_rates(spec, "an exported monitor")
    parts = compiled(caller, spec, period, options, online=False)
    program, step = parts.program, Fraction(parts.period or 1)
    running = program.running(*program.specification.formulas.values())
    late = {name: running.latencies[register] for name, register in running.outputs.items()}
    monitor = _monitor(running)
    registers, sources = _episodes(program, late)
    readings = variants_of(program)
    episodes = [*readings, *(variants_of(replace(program, result=r))[-1] for r in registers)]
    for episode in episodes:
        limit_episode(episode)
    if monitor is not None:
        limit_discrete(monitor)
    encoded = SampledFile(
        period=step.as_integer_ratio(),
        readings=len(readings),
        episodes=[encoded_episode(episode) for episode in episodes],
        monitor=None if monitor is None else encoded_discrete(monitor),
        observed=[]
        if monitor is None
        else [(register, late[name] or 0) for name, register in monitor.outputs.items()],
        sources=[None if source is None else source + len(readings) - 1 for source in sources],
    )
    return Programs(encoded, program, float(step), _notes(late, step))


def _episodes(
    program: Program, late: Mapping[str, int | None]
) -> tuple[list[int], list[int | None]]:
    """Return the registers of named formulas that need an episode, as no monitor can wait for them.

    Args:
        program: The program of the specification, which is episode 0.
        late: The latency of each named formula; None if it needs the whole future.

    Returns:
        The registers with an episode, and for each named formula the number of its episode, or
        None if it has a latency.
    """
    episodes = {program.result: 0}
    sources: list[int | None] = []
    for name, latency in late.items():
        source = None
        if latency is None:
            source = episodes.setdefault(program.outputs[name], len(episodes))
        sources.append(source)
    return list(episodes)[1:], sources


def _notes(late: Mapping[str, int | None], step: Fraction) -> dict[str, str]:
    """Return a note on each named formula, with latencies in steps of this length."""
    return {
        name: "as if the run ended now" if latency is None else _late(latency * step)
        for name, latency in late.items()
    }


def _monitor(program: Program) -> Program | None:
    """Return the program of the named formulas that have a latency, or None without named formulas.

    It has all terms, so that it refuses every sample or event that an episode refuses.
    """
    if not program.outputs:
        return None
    late = program.latencies
    outputs = {name: r for name, r in program.outputs.items() if late[r] is not None}
    registers = sorted({*range(program.terms), *program.needed(*outputs.values())})
    return replace(program, result=0, outputs=outputs).reordered(registers, program.terms)


def dense_programs(
    caller: Callable[..., object], spec: Specification, resolution: Period, options: Options
) -> Programs:
    """Return the programs of a unit over dense time; ``spec`` has traced constants."""
    _, interface, _, compiled_program = compiled_dense(
        caller, spec, resolution, options, online=False
    )
    program = compiled_program.program
    running = program.running(*program.specification.formulas.values())
    late = {name: running.latencies[register] for name, register in running.outputs.items()}
    monitor = _monitor(running)
    regions = compile_regions(
        program.specification, compiled_program.resolution, interface=interface, named=True
    )
    registers, sources = _episodes(regions.program, late)
    results = [regions, *(regions.of(register) for register in registers)]
    readings = [variants_of(result.program) for result in results]
    # The simulator's time is in seconds, whatever the unit of the specification is.
    clock = clock_of(compiled_program.resolution)
    encoded = DenseFile(
        clock=clock,
        readings=len(readings[0]),
        episodes=[
            RegionFile(each.reach, encoded_terms(placed.program), encoded_regions(placed))
            for i, (each, variants) in enumerate(zip(results, readings, strict=True))
            for placed in map(place, variants if i == 0 else variants[-1:])
        ],
        monitor=None
        if monitor is None
        else encoded_dense(DenseProgram(monitor, compiled_program.resolution)),
        observed=[] if monitor is None else list(monitor.outputs.values()),
        sources=sources,
    )
    return Programs(encoded, program, None, _notes(late, compiled_program.resolution))


def _late(time: Fraction) -> str:
    return f"late by {float(time):g} s" if time else ""
