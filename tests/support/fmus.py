"""Compiles and packs FMUs of a water tank, for FMI 2.0 and 3.0."""

from __future__ import annotations

import os
import re
import subprocess
import zipfile
from pathlib import Path

import fmpy  # type: ignore[import-untyped]

SOURCE = Path(__file__).parent / "fmu" / "tank.c"
HEADERS = Path(fmpy.__file__).parent / "c-code"

VARIABLES = (
    # name, value reference, type in FMI 2.0 and 3.0, start value, causality, and other attributes
    ("inflow", 0, "Real", "Float64", "0", "input", ""),
    ("level", 1, "Real", "Float64", "1", "output", 'initial="exact"'),
    ("area", 2, "Real", "Float64", "1", "parameter", 'variability="fixed"'),
    ("drain", 3, "Real", "Float64", "0.5", "parameter", 'variability="fixed"'),
    ("doubled", 4, "Real", "Float64", "", "output", ""),
    ("fails_at", 5, "Real", "Float64", "1e9", "parameter", 'variability="fixed"'),
    ("ends_at", 6, "Real", "Float64", "1e9", "parameter", 'variability="fixed"'),
    ("count", 16, "Integer", "UInt8", "", "output", 'variability="discrete"'),
    ("gear", 17, "Integer", "Int32", "1", "input", 'variability="discrete"'),
    ("full", 32, "Boolean", "Boolean", "", "output", 'variability="discrete"'),
    ("half", 48, "", "Float32", "", "output", ""),
    ("maker", 64, "String", "String", "us", "parameter", 'variability="fixed"'),
)

ARRAYS = (
    # of FMI 3.0: name, value reference, type, sizes (or the variable with the size), and others
    ("row", 80, "Float64", (3,), 'causality="output"'),
    ("valves", 81, "Float64", ("n",), 'causality="input" start="0 0"'),
    (
        "grid",
        82,
        "Float64",
        (2, 3),
        'causality="parameter" variability="fixed" start="7 0 0 0 0 0"',
    ),
    ("shown", 83, "Float64", (2, 3), 'causality="output"'),
    ("turns", 84, "Int32", (3,), 'causality="input" variability="discrete" start="4"'),
    ("open", 85, "Boolean", (2,), 'causality="input" start="false true"'),
)


def describe(version: int, interface: str, step: float | None) -> str:
    """Return the text of modelDescription.xml."""
    variables, outputs = [], []
    for name, reference, *types, start, causality, more in VARIABLES:
        kind = types[version - 2]
        said = f'name="{name}" valueReference="{reference}" causality="{causality}" {more}'
        begin = f'start="{start}"' if start else ""
        if not kind:
            continue
        if version == 2:
            variables.append(f"<ScalarVariable {said}><{kind} {begin}/></ScalarVariable>")
        elif kind == "String":
            variables.append(f'<String {said}><Start value="{start}"/></String>')
        else:
            variables.append(f"<{kind} {said} {begin}/>")
        if causality == "output":
            outputs.append((len(variables), reference))
    if version == 2:
        listed = "".join(f'<Unknown index="{index}"/>' for index, _ in outputs)
        structure, unique = f"<Outputs>{listed}</Outputs>", "guid"
    else:
        variables.append('<Float64 name="time" valueReference="98" causality="independent"/>')
        variables.append(
            '<UInt64 name="n" valueReference="99" causality="structuralParameter" '
            'variability="fixed" start="2"/>'
        )
        for name, reference, kind, sizes, more in ARRAYS:
            inner = "".join(
                '<Dimension valueReference="99"/>'
                if size == "n"
                else f'<Dimension start="{size}"/>'
                for size in sizes
            )
            said = f'name="{name}" valueReference="{reference}" {more}'
            variables.append(f"<{kind} {said}>{inner}</{kind}>")
            if "output" in more:
                outputs.append((len(variables), reference))
        structure = "".join(f'<Output valueReference="{r}"/>' for _, r in outputs)
        unique = "instantiationToken"
    size = "" if step is None else f'stepSize="{step}"'
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        f'<fmiModelDescription fmiVersion="{version}.0" modelName="tank" {unique}="{{tank}}">'
        f"{interface}<DefaultExperiment {size}/>"
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


def library(version: int, folder: Path) -> Path:
    """Return the shared library of the tank, compiled."""
    of_3, _, of_2 = SOURCE.read_text().partition("#else\n\nfmi2Component")
    ours = f" fmi2Component{of_2}" if version == 2 else of_3
    stubs = folder / f"stubs{version}.c"
    # FMPy loads every function of the standard; the tank needs few of them.
    header = (HEADERS / f"fmi{version}Functions.h").read_text()
    names = re.findall(rf" fmi{version}\w+TYPE\s+(fmi{version}\w+);", header)
    defined = [n for n in names if re.search(rf" {n}\(|{n[4:7].upper()}\({n[7:]}[,)]", ours)]
    stubs.write_text("".join(f"int {n}(void) {{ return 3; }}\n" for n in names if n not in defined))
    made = folder / f"tank{version}.so"
    command = [os.environ.get("CC", "cc"), "-shared", "-fPIC", "-O1", "-ffp-contract=off"]
    flags = [f"-I{HEADERS}", f"-DTANK_FMI_{version}", str(SOURCE), str(stubs), "-o", str(made)]
    subprocess.run([*command, *flags], check=True)
    return made


def write_fmu(
    path: Path,
    library: Path | None,
    version: int,
    *,
    step: float | None = 0.1,
    kind: str = "CoSimulation",
    fixed: str = "",
) -> Path:
    """Write an FMU of the tank.

    Args:
        path: The path of the file.
        library: The compiled tank; None for an FMU without one.
        version: The version of FMI, 2 or 3.
        step: The step size of the default experiment.
        kind: The kind of FMU.
        fixed: More attributes of the interface.
    """
    interface = f'<{kind} modelIdentifier="tank" {fixed}/>'
    binaries = fmpy.platform if version == 2 else fmpy.platform_tuple
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", describe(version, interface, step))
        if library is not None:
            archive.write(library, f"binaries/{binaries}/tank{fmpy.sharedLibraryExtension}")
    return path
