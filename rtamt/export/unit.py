"""The archive of a unit: its description, its library and its program."""

from __future__ import annotations

import hashlib
import uuid
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from io import BytesIO

from rtamt.export import Fmi
from rtamt.export.description import Description, description_text
from rtamt.export.library import library
from rtamt.export.program_file import program_text
from rtamt.export.programs import Programs
from rtamt.export.variables import variables_of

__all__ = ["COMPRESSION", "unit"]

COMPRESSION = zipfile.ZIP_DEFLATED
"""How the files of a unit are compressed."""

_UNNAMED = "-"
"""The token of a unit whose content is not known yet."""


def unit(programs: Programs, fmi: Fmi, *, stop: bool) -> bytes:
    """The bytes of the unit.

    Raises:
        SpecificationError: If the specification has a name that the monitor has itself.
        InputError: If there is no library for this platform, or it was not built.
    """
    spec = programs.program.specification
    file = programs.file(token=_UNNAMED, stop=stop)
    meanings = {
        name: f"{spec.formulas[name]}{said and f', {said}'}" for name, said in programs.said.items()
    }
    described = Description(
        name=spec.title or "monitor",
        text=str(spec.formula),
        token=_UNNAMED,
        step=programs.step,
        variables=variables_of(file, meanings, spec.declared_ranges),
    )
    # What the unit holds names it: a tool that kept another unit's files finds that they differ.
    content = description_text(described, fmi) + program_text(file).encode()
    token = str(uuid.UUID(bytes=hashlib.sha256(content).digest()[:16]))
    built = library()
    return _zipped(
        {
            "modelDescription.xml": description_text(replace(described, token=token), fmi),
            built.paths[fmi]: built.data,
            "resources/program.rtamt": program_text(replace(file, token=token)).encode(),
        }
    )


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """An archive without times, users or anything else that differs from one export to another."""
    data = BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name)
            entry.create_system = 3  # Unix, wherever it is written
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content, COMPRESSION)
    return data.getvalue()
