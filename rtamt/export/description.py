"""The file ``modelDescription.xml`` of a unit, for FMI 2.0 and 3.0.

Source: Functional Mock-up Interface 2.0.4 and 3.0.2, Modelica Association.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree.ElementTree import Element, SubElement

from rtamt.export import Fmi
from rtamt.export.library import MODEL
from rtamt.export.variables import UnitVariable, VariableType

__all__ = ["Description", "description_text"]

_TYPES: Final[Mapping[Fmi, Mapping[VariableType, str]]] = {
    2: {"real": "Real", "integer": "Integer", "boolean": "Boolean"},
    3: {"real": "Float64", "integer": "Int32", "boolean": "Boolean"},
}


_CATEGORIES: Final = {
    "logStatusError": "why a call was refused; always logged",
    "logEvents": "a verdict that became certain",
}
"""What ``rtamt/native/fmu/unit.hpp`` logs."""


@dataclass(frozen=True, slots=True)
class Description:
    """The content of a model description.

    Attributes:
        name: The name of the model.
        text: What it monitors.
        token: The guid or instantiation token.
        step: The period in seconds; None over dense time.
        variables: The variables, without ``time``.
    """

    name: str
    text: str
    token: str
    step: float | None
    variables: Sequence[UnitVariable]


def description_text(description: Description, fmi: Fmi) -> bytes:
    """The file, in UTF-8."""
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": description.name,
            "guid" if fmi == 2 else "instantiationToken": description.token,
            "description": description.text,
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
    if description.step is not None:
        experiment.set("stepSize", repr(description.step))
    if fmi == 2:
        _variables_2(root, description)
    else:
        _variables_3(root, description)
    ET.indent(root)
    data: bytes = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    return data + b"\n"


def _variables_2(root: Element, description: Description) -> None:
    parent = SubElement(root, "ModelVariables")
    for each in description.variables:
        scalar = SubElement(parent, "ScalarVariable", _attributes(each))
        SubElement(scalar, _TYPES[2][each.kind], {**_limits(each), **_start(each)})
    structure = SubElement(root, "ModelStructure")
    places = {str(i): each for i, each in enumerate(description.variables, 1)}
    for name, dependencies in _dependencies(places).items():
        parent = SubElement(structure, f"{name}s")
        for place, each in places.items():
            if each.causality == "output":
                SubElement(parent, "Unknown", index=place, dependencies=dependencies)


def _variables_3(root: Element, description: Description) -> None:
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
    for each in description.variables:
        attributes = {**_attributes(each), **_limits(each), **_start(each)}
        SubElement(parent, _TYPES[3][each.kind], attributes)
    structure = SubElement(root, "ModelStructure")
    places = {str(each.reference): each for each in description.variables}
    for name, dependencies in _dependencies(places).items():
        for place, each in places.items():
            if each.causality == "output":
                SubElement(structure, name, valueReference=place, dependencies=dependencies)


def _dependencies(places: Mapping[str, UnitVariable]) -> dict[str, str]:
    """On which variables, by their places, each output depends: in the run, and before it.

    An output at the end of a step follows from inputs at its begin: from none at that time. Before
    the first step it follows from the constants of the text. That lets an importer close a loop
    through the monitor, and initialize it.
    """
    constants = [
        place
        for place, each in places.items()
        if each.causality == "parameter" and each.kind == "real"
    ]
    return {"Output": "", "InitialUnknown": " ".join(constants)}


def _attributes(variable: UnitVariable) -> dict[str, str]:
    # Inputs hold their values between samples or events. An importer may interpolate continuous
    # inputs, which adds values that nobody recorded, and may step over their events.
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
    """The range of a variable; a limit that is infinite is none."""
    named = zip(("min", "max"), variable.range or (), strict=False)
    return {name: repr(limit) for name, limit in named if math.isfinite(limit)}


def _start(variable: UnitVariable) -> dict[str, str]:
    if variable.start is None:
        return {}
    text = str(bool(variable.start)).lower() if variable.kind == "boolean" else repr(variable.start)
    return {"start": text}
