"""`export_fmu`: a monitor as a functional mock-up unit (FMU).

To add a platform, add a row to `_PLATFORMS`.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import uuid
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

from rtamt.errors import Argument, InputError, InputTypeError, brief
from rtamt.export import Fmi
from rtamt.export.description import MODEL, Description, description_text, variables_of
from rtamt.export.program_file import (
    DenseFile,
    Named,
    ProgramFile,
    RegionFile,
    SampledFile,
    program_text,
)
from rtamt.language.interval import Traced
from rtamt.language.parser import as_specification, traced
from rtamt.language.specification import Specification
from rtamt.monitors.options import Options, SampleOptions, Spec, compiled, compiled_dense
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
from rtamt.program.interface import Names, SemanticsName
from rtamt.program.lowering import refuse_rates
from rtamt.program.memory import limit_discrete, limit_episode
from rtamt.program.placement import place, variants_of
from rtamt.program.program import Program
from rtamt.program.timing import Align, Period


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


COMPRESSION = zipfile.ZIP_DEFLATED

_UNNAMED: Final = "-"
"""The token of a unit without its hash."""

_PLATFORMS: Final[Mapping[tuple[str, str], tuple[str, str, str]]] = {
    ("linux", "x86_64"): ("linux64", "x86_64-linux", ".so"),
}
"""Operating system and processor: the folder in FMI 2.0 and 3.0, and the suffix of libraries."""


def export_fmu(
    spec: Spec,
    path: str | os.PathLike[str],
    *,
    period: Period | None = None,
    dense: bool = False,
    fmi: Fmi = 2,
    stop_on_violation: bool = False,
    semantics: SemanticsName = "standard",
    inputs: Names | None = None,
    outputs: Names | None = None,
    align: Align | None = None,
    resolution: Period = "1ns",
) -> None:
    """Write a functional mock-up unit (FMU) that monitors a specification in another tool.

    The unit is for co-simulation and needs no Python: it contains the C++ machines. Its inputs are
    the variables of the specification, its parameters the constants. After each step the outputs
    are

    * ``robustness``, ``lower``, ``upper`` and ``verdict`` (-1 violated, 0 undecided, 1 satisfied),
      equal to the bit to `EpisodeMonitor` after the same samples;
    * every named formula, also the result, equal to the bit to `Monitor` of this formula, late by
      its latency. A formula with an unbounded future, which no monitor can wait for, has the value
      of `EpisodeMonitor`: its robustness if the run ended now.

    A sample is taken at each multiple of the period, the first at the start: a step from t to
    t + period reads the inputs at t. Longer steps hold them. Before the first step robustness and
    named formulas are nan. Inputs are discrete, so that importers do not interpolate them. A
    constant in a bound of an interval can be read, not set, and unused constants are left out.

    Over dense time (``dense``) steps may have any size, and each step starts with an event of every
    variable. The outputs equal `rtamt.dense.EpisodeMonitor` after these events; a named formula is
    the last value that `rtamt.dense.Monitor` has settled, or the value of
    `rtamt.dense.EpisodeMonitor` if `rtamt.dense.Monitor` cannot wait.

    The unit has the library for the platform of the export, Linux on x86-64. The same arguments
    give the same bytes.

    Args:
        spec: Text, a formula, or a parsed specification; its result is monitored.
        path: The file to write; its name ends in ``.fmu``.
        period: Seconds between samples, as a number or as text (``"100ms"``).
        dense: Whether to monitor over dense time, without a period.
        fmi: The version of FMI, 2 or 3.
        stop_on_violation: The start value of the parameter of this name, which makes the monitor
            end the simulation after the step that turns the verdict to -1.
        semantics: As for `Monitor`.
        inputs: As for `Monitor`.
        outputs: As for `Monitor`.
        align: As for `Monitor`; not over dense time.
        resolution: As for `rtamt.dense.Monitor`.

    Raises:
        SpecificationError: As for `EpisodeMonitor` and `rtamt.dense.EpisodeMonitor`, or for a name
            that the monitor itself uses, such as ``lower``.
        InputError: If an argument has a wrong value, the path does not end in ``.fmu``, both
            ``period`` and ``dense`` are missing, or this platform has no library.
        OSError: If the file cannot be written.

    Example:
        >>> import pathlib, tempfile, zipfile
        >>> path = pathlib.Path(tempfile.mkdtemp(), "monitor.fmu")
        >>> export_fmu("const float limit = 5; always(speed < limit)", path, period="100ms")
        >>> zipfile.ZipFile(path).namelist()  # doctest: +NORMALIZE_WHITESPACE
        ['modelDescription.xml', 'binaries/linux64/rtamt_monitor.so', 'resources/program.rtamt']

    Source: Functional Mock-up Interface 2.0.4 and 3.0.2, Modelica Association.
    """
    if fmi not in {2, 3}:
        raise InputError(f"expected fmi=2 or fmi=3, got {brief(fmi)}")
    if not isinstance(path, str | os.PathLike):
        raise InputTypeError(f"expected the path of a file as text or a Path, got {brief(path)}")
    if not os.fspath(path).lower().endswith(".fmu"):  # tools require it
        raise InputError(f"cannot write {os.fspath(path)}: expected a name that ends in .fmu")
    known = traced(as_specification(spec))
    if dense:
        if period is not None:
            raise InputError("expected period= or dense=True, which takes events at any time")
        if align is not None:
            raise InputError(
                Argument("align"), " rounds bounds to samples, which dense time does not have"
            )
        options: Options = {"semantics": semantics, "inputs": inputs, "outputs": outputs}
        programs = dense_programs(export_fmu, known, resolution, options)
    else:
        if period is None:
            raise InputError(
                "expected the time between samples, period= in seconds or as text such as '100ms', "
                "or dense=True"
            )
        sampled: SampleOptions = {
            "semantics": semantics,
            "inputs": inputs,
            "outputs": outputs,
            "align": align,
        }
        programs = sampled_programs(export_fmu, known, period, sampled)
    data = unit(programs, fmi, stop=bool(stop_on_violation))
    Path(path).write_bytes(data)


def unit(programs: Programs, fmi: Fmi, *, stop: bool) -> bytes:
    """Return the bytes of a unit.

    Raises:
        SpecificationError: If the specification has a name that the monitor itself uses.
        InputError: If this platform has no library, or it was not built.
    """
    spec = programs.program.specification
    file = programs.file(token=_UNNAMED, stop=stop)
    meanings = {
        name: f"{spec.formulas[name]}{note and f', {note}'}"
        for name, note in programs.notes.items()
    }
    description = Description(
        name=spec.title or "monitor",
        text=str(spec.formula),
        token=_UNNAMED,
        step=programs.step,
        variables=variables_of(file, meanings, spec.declared_ranges, spec.columns),
    )
    # The token is a hash of the content, so that tools do not reuse the files of another unit.
    content = description_text(description, fmi) + program_text(file).encode()
    token = str(uuid.UUID(bytes=hashlib.sha256(content).digest()[:16]))
    built = library()
    return _zipped(
        {
            "modelDescription.xml": description_text(replace(description, token=token), fmi),
            built.paths[fmi]: built.data,
            "resources/program.rtamt": program_text(replace(file, token=token)).encode(),
        }
    )


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """Return an archive without times and users, so that equal exports are equal bytes."""
    data = BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)
            entry.create_system = 3  # Unix, on every platform
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, COMPRESSION)
    return data.getvalue()


class Library(NamedTuple):
    """The shared library, and its path in a unit by the version of FMI."""

    data: bytes
    paths: Mapping[int, str]


def library() -> Library:
    """Return the library for this platform.

    Raises:
        InputError: If this platform has no library, or it was not built.
    """
    here = (sys.platform, platform.machine())
    if here not in _PLATFORMS:
        known = ", ".join(" ".join(names) for names in _PLATFORMS)
        msg = f"there is no FMU library for this platform, {' '.join(here)}; export on {known}"
        raise InputError(msg)
    *folders, ending = _PLATFORMS[here]
    built = find_spec("rtamt._native")  # an editable install has it in another folder
    folder = Path(__file__).parents[1] if built is None else Path(built.origin or "").parent
    path = folder / f"{MODEL}{ending}"
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        msg = f"the FMU library {path.name} was not built; reinstall rtamt with a C++20 compiler"
        raise InputError(msg) from None
    return Library(data, {v: f"binaries/{f}/{path.name}" for v, f in enumerate(folders, start=2)})
