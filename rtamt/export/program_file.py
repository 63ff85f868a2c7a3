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

To add a kind of record, change this table, `Programs` and the reader in
``rtamt/native/fmu/program.cpp``. ``tests/bench/fmu.py`` measures a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

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

LineFields = tuple[str | float | None, ...]
"""The fields of a line."""


@dataclass(frozen=True)
class Programs:
    """The programs of a unit, as records of its file."""

    program: Program  # the program with all registers
    step: float | None  # seconds between samples; None over dense time
    clock: LineFields  # the record of the period or the ticks
    notes: Mapping[str, str]  # a note on the value of each named formula
    # the episode of each named formula in the file; None: the next observed register
    episodes: Sequence[int | None]
    records: Sequence[LineFields]  # the records of the programs

    @cached_property
    def inputs(self) -> Mapping[str, float]:
        """The variables with their start values, in the order of the programs."""
        spec = self.program.specification
        return {name: _start(spec, name) for name in self.program.variables}

    @cached_property
    def parameters(self) -> Mapping[str, float]:
        """The constants that may be set: numbers of the program depend on them."""
        numbers = [i.value for i in self.program.instructions if isinstance(i, Const)]
        traced = [number for number in numbers if isinstance(number, Traced)]
        used = frozenset[str]().union(*(number.constants for number in traced))
        spec = self.program.specification
        return {n: v for n, v in spec.constants.items() if n in used - spec.bounding}

    @cached_property
    def fixed(self) -> Mapping[str, float]:
        """The constants in bounds of intervals."""
        spec = self.program.specification
        return {name: v for name, v in spec.constants.items() if name in spec.bounding}

    def text(self, *, token: str, stop: bool) -> str:
        """Return the text of the file, for UTF-8 and Unix line ends."""
        writer = _Writer(self.parameters)
        writer.add("rtamt-program", 3)
        writer.add("token", token)
        writer.add(*self.clock)
        for name, start in self.inputs.items():
            writer.add("input", name, float(start))
        for name, episode in zip(self.notes, self.episodes, strict=True):
            writer.add("formula", name, episode)
        for name, start in self.parameters.items():
            writer.add("parameter", name, float(start))
        for name, value in self.fixed.items():
            writer.add("fixed", name, float(value))
        writer.add("stop", int(stop))
        for record in self.records:
            writer.add(*record)
        text = "".join(writer.lines)
        return f"{text}end {_hash(text.encode()):016x}\n"


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
    registers, numbers = _episodes(program, late)
    readings = variants_of(program)
    records: list[LineFields] = [("episodes", len(readings))]
    for episode in (*readings, *(variants_of(replace(program, result=r))[-1] for r in registers)):
        limit_episode(episode)
        encoded = encoded_episode(episode)
        records += [("episode",), *_rows("sample-row", encoded.terms)]
        records += _rows("formula-row", encoded.formulas)
        records += [("initial", *encoded.initial), ("streams", *encoded.streams)]
    monitor = _monitor(running)
    if monitor is not None:
        limit_discrete(monitor)
        records += [
            ("monitor", monitor.terms),
            *_rows("sample-row", encoded_discrete(monitor).rows),
        ]
        observed = monitor.outputs.items()
        records += [("observed", register, late[name] or 0) for name, register in observed]
    # The file counts the episodes of the specification, of which there may be two.
    numbers = [None if n is None else n + len(readings) - 1 for n in numbers]
    clock = ("samples", *step.as_integer_ratio())
    return Programs(program, float(step), clock, _notes(late, step), numbers, records)


def dense_programs(
    caller: Callable[..., object], spec: Specification, resolution: Period, options: Options
) -> Programs:
    """Return the programs of a unit over dense time; ``spec`` has traced constants."""
    _, interface, _, dense = compiled_dense(caller, spec, resolution, options, online=False)
    program = dense.program
    running = program.running(*program.specification.formulas.values())
    late = {name: running.latencies[register] for name, register in running.outputs.items()}
    regions = compile_regions(
        program.specification, dense.resolution, interface=interface, named=True
    )
    registers, numbers = _episodes(regions.program, late)
    readings = variants_of(regions.program)
    results = [(regions.reach, reading) for reading in readings]
    others = map(regions.of, registers)
    results += [(other.reach, variants_of(other.program)[-1]) for other in others]
    records: list[LineFields] = [("episodes", len(readings))]
    for reach, result in results:
        placed = place(result)
        encoded = encoded_regions(placed)
        records += [("regions", reach), *_rows("sample-row", encoded_terms(placed.program))]
        records += _rows("region-row", encoded.rows)
        records += [("initial", *encoded.initial), ("streams", *encoded.streams)]
        records += [("unknowns", *encoded.unknowns)]
    monitor = _monitor(running)
    if monitor is not None:
        rows = encoded_dense(DenseProgram(monitor, dense.resolution)).rows
        records += [("dense", monitor.terms), *_rows("dense-row", rows)]
        records += [("observed", register) for register in monitor.outputs.values()]
    # The simulator's time is in seconds, whatever the unit of the specification is.
    clock = ("ticks", *clock_of(dense.resolution))
    return Programs(program, None, clock, _notes(late, dense.resolution), numbers, records)


def _rows(kind: str, rows: Iterable[LineFields]) -> list[LineFields]:
    return [(kind, *row) for row in rows]


def _episodes(
    program: Program, late: Mapping[str, int | None]
) -> tuple[list[int], list[int | None]]:
    """Return the registers that need an episode, and the number of it for each named formula.

    Episode 0 is of the specification. A formula with a latency needs none.
    """
    episodes = {program.result: 0}
    numbers: list[int | None] = []
    for name, latency in late.items():
        number = None
        if latency is None:
            number = episodes.setdefault(program.outputs[name], len(episodes))
        numbers.append(number)
    return list(episodes)[1:], numbers


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


def _notes(late: Mapping[str, int | None], step: Fraction) -> dict[str, str]:
    """Return a note on each named formula, with latencies in steps of this length."""
    return {
        name: "as if the run ended now"
        if latency is None
        else f"late by {float(latency * step):g} s" * bool(latency * step)
        for name, latency in late.items()
    }


class _Writer:
    """The lines of a file, and its derived numbers."""

    def __init__(self, parameters: Iterable[str]) -> None:
        self.lines: list[str] = []
        self._known = {name: f"%{i}" for i, name in enumerate(parameters)}
        self._derived = 0

    def add(self, *fields: str | float | None) -> None:
        line = " ".join([self._field(field) for field in fields])
        self.lines.append(f"{line}\n")

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
