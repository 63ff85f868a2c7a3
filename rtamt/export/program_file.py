"""The programs of a functional mock-up unit and their file, ``resources/program.rtamt``.

The library (`rtamt/native/fmu/`) is the same in every unit; this file has the differences: the
programs as encoded by `rtamt.program.encoding`, the names of the value references, and the
computation of constants from parameters. It is text with one record per line and single spaces
between fields. A missing field is ``-``, a flag is 0 or 1, and a number has its ``repr``.

=========================================  =========================================================
``rtamt-program 3``                        first line: the version of the format
``token TOKEN``                            the guid (FMI 2) or instantiation token (FMI 3)
``samples NUMERATOR DENOMINATOR``          the period in seconds, of programs on samples
``ticks SCALE TICKS UNITS``                over dense time: ticks in a second, in the form of
                                           `EncodedDense.clock`
``input NAME START``                       a variable, in the order of `Program.variables`
``formula NAME EPISODE``                   a named formula: the episode that computes it, counted
                                           from 0; ``-``: the next observed register
``parameter NAME START``                   a constant that may be set
``fixed NAME VALUE``                       a constant that can only be read
``stop 0`` or ``stop 1``                   the start value of ``stop_on_violation``
``derived FUNCTION A B``                   a number that follows from parameters; the i-th is ``$i``
``episodes READINGS``                      before them: how many episodes are of the specification;
                                           two with neutral predicates, which are -0.0 in the first
                                           and 0.0 in the second (`rtamt.machines.episode.machine`)
``episode``                                an `EncodedEpisode` starts: the specification's, then one
                                           for each named formula that no monitor can wait for
``sample-row`` and the fields of a row     `DiscreteRow`: terms of an episode, rows of a monitor
``formula-row`` and the fields of a row    `FormulaRow`
``initial R ...``, ``streams R ...``       registers of the episode
``monitor TERMS``                          an `Encoded` program of named formulas starts; it has all
                                           terms, so that it refuses the same samples as an episode
``observed R LATENCY``                     the register of a named formula; over dense time without
                                           the latency
``regions REACH``                          in place of ``episode`` over dense time: an
                                           `EncodedRegions` starts, with the ticks that it looks
                                           away; ``sample-row``, ``initial``, ``streams`` as there
``region-row`` and the fields of a row     `FormulaRow`
``unknowns R ...``                         streams that never settle
``dense TERMS``                            in place of ``monitor``: an `EncodedDense` starts
``dense-row`` and the fields of a row      `DenseRow`
``end HASH``                               last line: FNV-1a, 64 bits, of all bytes before the line,
                                           in 16 hexadecimal digits
=========================================  =========================================================

A number in a row, or an operand of ``derived``, is a literal, ``%k`` for the parameter k, or ``$i``
for a derived number before it, both counted from 0. The library computes them when initialization
ends; a function of one operand has it twice. They come from `Traced` numbers of a program.

`rtamt.export.fmu` numbers the variables.

The library runs the file as follows:

- Samples are at the times start + k * period, the first at the start. ``doStep(t, h)`` adds the
  samples in [t, t + h) with the current inputs: a step of one period adds one sample, at t; a
  multiple adds several with the same inputs; another step adds one when its time comes. The inputs
  before the first step are therefore the first sample. After n steps of a period the outputs equal
  `EpisodeMonitor` after n samples; a named formula is the value of `Monitor`, or of
  `EpisodeMonitor` if `Monitor` cannot wait. Before the first step the outputs equal a new monitor:
  robustness and named formulas are nan.
- Over dense time ``doStep(t, h)`` adds an event of every variable at t; the outputs equal
  `rtamt.dense.EpisodeMonitor`; a named formula is the last value that `rtamt.dense.Monitor` has
  settled, or the value of `rtamt.dense.EpisodeMonitor` if `rtamt.dense.Monitor` cannot wait.
- With ``stop_on_violation`` the simulation ends after a step that makes the verdict -1: FMI 2
  returns fmi2Discard, with fmi2Terminated and t + h as fmi2LastSuccessfulTime; FMI 3 sets
  terminateSimulation.
- Parameters can be set until initialization ends, inputs at any time before terminate.

To add a kind of record, change this table, `program_text` and the reader in
``rtamt/native/fmu/program.cpp``. ``tests/bench/fmu.py`` measures a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

from rtamt.language.interval import Traced
from rtamt.language.specification import Specification
from rtamt.monitors.options import Options, SampleOptions, compiled, compiled_dense
from rtamt.program.dense_lowering import DenseProgram, compile_regions
from rtamt.program.encoding import (
    DiscreteRow,
    Encoded,
    EncodedDense,
    EncodedEpisode,
    EncodedRegions,
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


@dataclass(frozen=True, slots=True)
class Named:
    """A variable of the unit: its name and its start value."""

    name: str
    start: float


@dataclass(frozen=True, slots=True)
class SampledFile:
    """The programs of a unit on samples.

    Attributes:
        period: Numerator and denominator of the seconds between samples.
        readings: The number of episodes of the specification: one, or two with neutral predicates,
            which are -0.0 in the first.
        episodes: Their programs, then the programs of named formulas that no monitor can wait for.
        monitor: The program of the other named formulas; None without named formulas. It has all
            terms of the episodes, so that it refuses every sample that an episode refuses.
        observed: Register and latency of each of the other named formulas.
        sources: The index of the episode of every named formula; None: the next observed register.
    """

    period: tuple[int, int]
    readings: int
    episodes: Sequence[EncodedEpisode]
    monitor: Encoded | None
    observed: Sequence[tuple[int, int]]
    sources: Sequence[int | None]


class RegionFile(NamedTuple):
    """A program over the regions of dense time.

    Attributes:
        reach: The maximum distance in ticks of the times that a value depends on.
        terms: The terms.
        regions: The formulas.
    """

    reach: int
    terms: Sequence[DiscreteRow]
    regions: EncodedRegions


@dataclass(frozen=True, slots=True)
class DenseFile:
    """The programs of a unit over dense time.

    Attributes:
        clock: Ticks per second.
        readings: The number of episodes of the specification.
        episodes: Their programs, then the programs of named formulas that no monitor can wait for.
        monitor: The program of the other named formulas.
        observed: The register of each of the other named formulas.
        sources: The number of the episode of every named formula, where the episodes of the
            specification count as number 0; None: the next observed register.
    """

    clock: tuple[float, int, int]
    readings: int
    episodes: Sequence[RegionFile]
    monitor: EncodedDense | None
    observed: Sequence[int]
    sources: Sequence[int | None]


@dataclass(frozen=True, slots=True)
class ProgramFile:
    """The content of the file.

    Attributes:
        token: The guid or instantiation token.
        inputs: The variables, in the order of the programs.
        formulas: The names of the named formulas.
        parameters: The constants that may be set.
        fixed: The constants in bounds of intervals.
        stop: The start value of ``stop_on_violation``.
        programs: The programs.
    """

    token: str
    inputs: Sequence[Named]
    formulas: Sequence[str]
    parameters: Sequence[Named]
    fixed: Sequence[Named]
    stop: bool
    programs: SampledFile | DenseFile


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
    """Return the registers of named formulas that need an episode because a monitor cannot wait.

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
            RegionFile(result.reach, encoded_terms(placed.program), encoded_regions(placed))
            for i, (result, variants) in enumerate(zip(results, readings, strict=True))
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


def program_text(file: ProgramFile) -> str:
    """Return the text of a file, for UTF-8 and Unix line ends."""
    writer = _Writer([parameter.name for parameter in file.parameters])
    writer.add("rtamt-program", 3)
    writer.add("token", file.token)
    match file.programs:
        case SampledFile(period):
            writer.add("samples", *period)
        case DenseFile(clock):
            writer.add("ticks", *clock)
    for entry in file.inputs:
        writer.add("input", entry.name, float(entry.start))
    for name, source in zip(file.formulas, file.programs.sources, strict=True):
        writer.add("formula", name, source)
    for parameter in file.parameters:
        writer.add("parameter", parameter.name, float(parameter.start))
    for entry in file.fixed:
        writer.add("fixed", entry.name, float(entry.start))
    writer.add("stop", int(file.stop))
    match file.programs:
        case SampledFile():
            _sampled(writer, file.programs)
        case DenseFile():
            _dense(writer, file.programs)
    text = "".join(writer.lines)
    return f"{text}end {_hash(text.encode()):016x}\n"


def _sampled(writer: _Writer, programs: SampledFile) -> None:
    writer.add("episodes", programs.readings)
    for episode in programs.episodes:
        writer.add("episode")
        writer.rows("sample-row", episode.terms)
        writer.rows("formula-row", episode.formulas)
        writer.add("initial", *episode.initial)
        writer.add("streams", *episode.streams)
    if programs.monitor is not None:
        writer.add("monitor", programs.monitor.terms)
        writer.rows("sample-row", programs.monitor.rows)
        writer.rows("observed", programs.observed)


def _dense(writer: _Writer, programs: DenseFile) -> None:
    writer.add("episodes", programs.readings)
    for reach, terms, regions in programs.episodes:
        writer.add("regions", reach)
        writer.rows("sample-row", terms)
        writer.rows("region-row", regions.rows)
        writer.add("initial", *regions.initial)
        writer.add("streams", *regions.streams)
        writer.add("unknowns", *regions.unknowns)
    if programs.monitor is not None:
        writer.add("dense", programs.monitor.terms)
        writer.rows("dense-row", programs.monitor.rows)
        writer.rows("observed", ((register,) for register in programs.observed))


class _Writer:
    """The lines of a file, and its derived numbers."""

    def __init__(self, parameters: Sequence[str]) -> None:
        self.lines: list[str] = []
        self._known = {name: f"%{i}" for i, name in enumerate(parameters)}
        self._derived = 0

    def add(self, *fields: str | float | None) -> None:
        line = " ".join([self._field(field) for field in fields])
        self.lines.append(f"{line}\n")

    def rows(self, kind: str, rows: Iterable[tuple[str | float | None, ...]]) -> None:
        for row in rows:
            self.add(kind, *row)

    def _field(self, field: str | float | None) -> str:
        if isinstance(field, Traced):
            return self._number(field)
        if isinstance(field, str):
            return field or "-"
        if isinstance(field, bool):
            return str(int(field))
        return "-" if field is None else repr(field)

    def _number(self, number: Traced) -> str:
        """Write the computation of a number before the line that uses it."""
        if not number.operands:
            return self._known.get(number.source) or repr(float(number))
        if number.text not in self._known:
            operands = [self._field(operand) for operand in number.operands]
            self.lines.append(f"derived {number.source} {operands[0]} {operands[-1]}\n")
            self._known[number.text] = f"${self._derived}"
            self._derived += 1
        return self._known[number.text]


def _hash(data: bytes) -> int:
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return value
