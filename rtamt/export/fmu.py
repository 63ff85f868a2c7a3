"""`export_fmu`: a monitor as a functional mock-up unit (FMU), for FMI 2.0 and 3.0.

The file ``modelDescription.xml`` has these variables:

=================  ================================================================  =============
value reference    variable                                                          type
=================  ================================================================  =============
0                  ``time``, the independent variable (only FMI 3.0)                 Float64
1, 2, 3            ``robustness``, ``lower``, ``upper``                              Real, Float64
4                  ``verdict``: -1 violated, 0 undecided, 1 satisfied                Integer, Int32
5                  ``stop_on_violation``                                             Boolean
8 and up           the inputs, the parameters, the fixed constants, the named        Real, Float64
                   formulas: in this order, without gaps
=================  ================================================================  =============

`rtamt.export.program_file` describes their meaning at each step.

Parameters may be set until initialization ends. Then the values of the program's constants are
computed from them by functions of `rtamt.program.algebra`; a result that is not a number ends
initialization with an error. A parameter of -0.0 is 0.0, as in a text.

Source: Functional Mock-up Interface 2.0.4 and 3.0.2, Modelica Association.

To add a variable, add its name and value reference here, and the value for the reference in
``rtamt/native/fmu``.

To add a version of FMI, add the texts here, a file next to ``rtamt/native/fmu/fmi3.cpp`` that calls
``Unit``, and a pattern in ``exported.map``. ``tests/support/fmu_calls.py`` calls the exported
functions.

To add a platform, add a row to `_PLATFORMS`.
"""

from __future__ import annotations

import hashlib
import math
import os
import platform
import sys
import uuid
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import Final, Literal, NamedTuple
from xml.etree.ElementTree import Element, SubElement

from rtamt.errors import Argument, InputError, InputTypeError, SpecificationError, brief
from rtamt.export.program_file import Programs, dense_programs, sampled_programs
from rtamt.language.parser import as_specification, traced
from rtamt.monitors.options import Options, SampleOptions, Spec
from rtamt.program.interface import Names, SemanticsName
from rtamt.program.timing import Align, Period

Fmi = Literal[2, 3]
"""The version of FMI: 2.0 or 3.0."""

COMPRESSION = zipfile.ZIP_DEFLATED

MODEL: Final = "rtamt_monitor"
"""The name of the library without its suffix: the model identifier of every unit."""

RESERVED: Final = ("time", "robustness", "lower", "upper", "verdict", "stop_on_violation")
"""The names of a monitor's own variables, in the order of their value references."""

FIRST: Final = 8
"""The value reference of the first input."""

VariableType = Literal["real", "integer", "boolean"]
Causality = Literal["input", "output", "parameter", "local"]

_TYPES: Final[Mapping[Fmi, Mapping[VariableType, str]]] = {
    2: {"real": "Real", "integer": "Integer", "boolean": "Boolean"},
    3: {"real": "Float64", "integer": "Int32", "boolean": "Boolean"},
}


_CATEGORIES: Final = {
    "logStatusError": "why a call was refused; always logged",
    "logEvents": "a verdict that became certain",
}
"""The log categories of ``rtamt/native/fmu/unit.hpp``."""


class UnitVariable(NamedTuple):
    """A variable of a unit."""

    name: str
    reference: int  # its value reference
    kind: VariableType  # its type; the name depends on the version of FMI
    causality: Causality  # its role in FMI; a local variable is a constant that cannot be set
    start: float | None  # its start value; None if it is calculated
    meaning: str  # its description in the model description
    range: tuple[float, float] | None = None  # its declared minimum and maximum, or None


def variables_of(programs: Programs, *, stop: bool) -> list[UnitVariable]:
    """Return the variables of a unit, without ``time``, in the order of their value references.

    Raises:
        SpecificationError: If the specification uses a name of `RESERVED`.
    """
    variables = [*_of_text(programs)]
    for variable in variables:
        if variable.name in RESERVED:
            msg = (
                f"'{variable.name}' is a variable of every exported monitor; "
                f"rename the '{variable.name}' of the specification"
            )
            raise SpecificationError(msg)
    return [*_own(programs, stop=stop), *variables]


def _own(programs: Programs, *, stop: bool) -> Iterator[UnitVariable]:
    robustness = "of the episode if it ended now"
    if programs.step is None:
        robustness = "at the last time for which it is settled"
    meanings: Mapping[str, tuple[VariableType, str]] = {
        "robustness": ("real", f"the robustness {robustness}"),
        "lower": ("real", "the minimum robustness over all continuations and ends"),
        "upper": ("real", "the maximum robustness over all continuations and ends"),
        "verdict": ("integer", "-1 violated, 0 undecided, 1 satisfied"),
    }
    for name, (kind, meaning) in meanings.items():
        yield UnitVariable(name, RESERVED.index(name), kind, "output", None, meaning)
    name = "stop_on_violation"
    meaning = "whether the simulation ends when a violation is certain"
    yield UnitVariable(name, RESERVED.index(name), "boolean", "parameter", stop, meaning)


def _of_text(programs: Programs) -> Iterator[UnitVariable]:
    spec = programs.program.specification
    reference = count(FIRST)
    for name, start in programs.inputs.items():
        column = spec.columns.get(name)
        meaning = "a variable of the specification" + (f"; column {column}" if column else "")
        limits = spec.declared_ranges.get(name)
        yield UnitVariable(name, next(reference), "real", "input", start, meaning, limits)
    meaning = "a constant of the specification"
    for name, start in programs.parameters.items():
        yield UnitVariable(name, next(reference), "real", "parameter", start, meaning)
    meaning = "a constant in a bound of an interval, which cannot be set"
    for name, start in programs.fixed.items():
        yield UnitVariable(name, next(reference), "real", "local", start, meaning)
    for name, note in programs.notes.items():
        meaning = f"{spec.formulas[name]}{note and f', {note}'}"
        yield UnitVariable(name, next(reference), "real", "output", None, meaning)


def description_text(
    programs: Programs, variables: Sequence[UnitVariable], token: str, fmi: Fmi
) -> bytes:
    """Return the file ``modelDescription.xml``, in UTF-8."""
    spec = programs.program.specification
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": spec.title or "monitor",
            "guid" if fmi == 2 else "instantiationToken": token,
            "description": str(spec.formula),
            "generationTool": "rtamt",
            "variableNamingConvention": "structured",
        },
    )
    state = "state" if fmi == 2 else "State"
    SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": MODEL,
            "canHandleVariableCommunicationStepSize": "true",
            f"canGetAndSetFMU{state}": "true",
            f"canSerializeFMU{state}": "true",
        },
    )
    if fmi == 3:
        units = SubElement(SubElement(root, "UnitDefinitions"), "Unit", name="s")
        SubElement(units, "BaseUnit", s="1")
    categories = SubElement(root, "LogCategories")
    for name, meaning in _CATEGORIES.items():
        SubElement(categories, "Category", name=name, description=meaning)
    experiment = SubElement(root, "DefaultExperiment", startTime="0.0")
    if programs.step is not None:
        experiment.set("stepSize", repr(programs.step))
    (_variables_2 if fmi == 2 else _variables_3)(root, variables)
    ET.indent(root)
    data: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return data + b"\n"


def _variables_2(root: Element, variables: Sequence[UnitVariable]) -> None:
    parent = SubElement(root, "ModelVariables")
    for variable in variables:
        scalar = SubElement(parent, "ScalarVariable", _attributes(variable))
        SubElement(scalar, _TYPES[2][variable.kind], {**_limits(variable), **_start(variable)})
    structure = SubElement(root, "ModelStructure")
    places = {str(i): variable for i, variable in enumerate(variables, 1)}
    for name, dependencies in _dependencies(places).items():
        parent = SubElement(structure, f"{name}s")
        for position, variable in places.items():
            if variable.causality == "output":
                SubElement(parent, "Unknown", index=position, dependencies=dependencies)


def _variables_3(root: Element, variables: Sequence[UnitVariable]) -> None:
    parent = SubElement(root, "ModelVariables")
    SubElement(
        parent,
        "Float64",
        name="time",
        valueReference="0",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    for variable in variables:
        attributes = {**_attributes(variable), **_limits(variable), **_start(variable)}
        SubElement(parent, _TYPES[3][variable.kind], attributes)
    structure = SubElement(root, "ModelStructure")
    places = {str(variable.reference): variable for variable in variables}
    for name, dependencies in _dependencies(places).items():
        for position, variable in places.items():
            if variable.causality == "output":
                SubElement(structure, name, valueReference=position, dependencies=dependencies)


def _dependencies(places: Mapping[str, UnitVariable]) -> dict[str, str]:
    """Return the variables that each output depends on, during the run and before it.

    An output at the end of a step depends on inputs at the start of the step, not on inputs at that
    time. Before the first step it depends on the constants of the text. This lets importers close a
    loop through the monitor, and initialize it.
    """
    constants = [
        position
        for position, variable in places.items()
        if variable.causality == "parameter" and variable.kind == "real"
    ]
    return {"Output": "", "InitialUnknown": " ".join(constants)}


def _attributes(variable: UnitVariable) -> dict[str, str]:
    # Discrete inputs hold their values. Importers may interpolate continuous ones, and may step
    # over their events.
    variability, initial = {
        "input": ("discrete", None),
        "output": ("discrete", "calculated"),
        "parameter": ("fixed", "exact"),
        "local": ("constant", "exact"),
    }[variable.causality]
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "description": variable.meaning,
        "causality": variable.causality,
        "variability": variability,
    }
    return attributes if initial is None else {**attributes, "initial": initial}


def _limits(variable: UnitVariable) -> dict[str, str]:
    """Return the finite limits of a variable."""
    named = zip(("min", "max"), variable.range or (), strict=False)
    return {name: repr(limit) for name, limit in named if math.isfinite(limit)}


def _start(variable: UnitVariable) -> dict[str, str]:
    if variable.start is None:
        return {}
    text = str(bool(variable.start)).lower() if variable.kind == "boolean" else repr(variable.start)
    return {"start": text}


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
    """Write a functional mock-up unit (FMU), as `Specification.export_fmu`.

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

    Example:
        >>> import pathlib, tempfile, zipfile
        >>> path = pathlib.Path(tempfile.mkdtemp(), "monitor.fmu")
        >>> export_fmu("const float limit = 5; always(speed < limit)", path, period="100ms")
        >>> zipfile.ZipFile(path).namelist()  # doctest: +NORMALIZE_WHITESPACE
        ['modelDescription.xml', 'binaries/linux64/rtamt_monitor.so', 'resources/program.rtamt']
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
    """Return the bytes of a unit."""
    variables = variables_of(programs, stop=stop)
    # The token is a hash of the content, so that tools do not reuse the files of another unit.
    content = description_text(programs, variables, _UNNAMED, fmi)
    content += programs.text(token=_UNNAMED, stop=stop).encode()
    token = str(uuid.UUID(bytes=hashlib.sha256(content).digest()[:16]))
    path, binary = library(fmi)
    return _zipped(
        {
            "modelDescription.xml": description_text(programs, variables, token, fmi),
            path: binary,
            "resources/program.rtamt": programs.text(token=token, stop=stop).encode(),
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


def library(fmi: Fmi) -> tuple[str, bytes]:
    """Return the path of the library for this platform in a unit, and its bytes.

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
        return f"binaries/{folders[fmi - 2]}/{path.name}", path.read_bytes()
    except FileNotFoundError:
        msg = f"the FMU library {path.name} was not built; reinstall rtamt with a C++20 compiler"
        raise InputError(msg) from None
