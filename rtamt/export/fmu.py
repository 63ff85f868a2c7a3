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
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Final, NamedTuple

from rtamt.errors import Argument, InputError, InputTypeError, brief
from rtamt.export import Fmi
from rtamt.export.description import MODEL, Description, description_text, variables_of
from rtamt.export.program_file import program_text
from rtamt.export.programs import Programs, dense_programs, sampled_programs
from rtamt.language.parser import as_specification, traced
from rtamt.monitors.options import Options, SampleOptions, Spec
from rtamt.program.interface import Names, SemanticsName
from rtamt.program.timing import Align, Period

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

    Over dense time (``dense``) steps may have any size, and each gives every variable an event at
    its start. The outputs are those of `rtamt.dense.EpisodeMonitor` after these events; a named
    formula is the last value that `rtamt.dense.Monitor` has settled, or the value of
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
        InputError: If an argument has a wrong value, the path does not end in ``.fmu``, there is
            neither a period nor ``dense``, or there is no library for this platform.
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
                Argument("align"), " rounds bounds to samples; expected none with dense time"
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
        InputError: If there is no library for this platform, or it was not built.
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
    """Return an archive without times, users or anything else that differs between exports."""
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
        InputError: If there is no library for this platform, or it was not built.
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
