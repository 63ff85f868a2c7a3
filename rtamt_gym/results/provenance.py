"""`Provenance`: ids of requirements, versions and hashes of files that results were made with.

To add a field of the provenance, such as a version or a hash: the field of `Provenance`, and its
line in `plain_provenance` and `provenance_of`. All results and all file formats then carry it.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Self

from rtamt import Specification
from rtamt.errors import shown
from rtamt.language import RequirementId
from rtamt_gym.results.fingerprint import Fingerprint, Reuse

_OF_VERSIONS: Final = ("rtamt", "numpy", "gymnasium", "mujoco", "fmpy", "numba")


@dataclass(frozen=True, slots=True)
class Provenance:
    """The inputs and versions that produced results.

    Attributes:
        ids: The ids of requirements with an id, by name.
        versions: The versions of Python and of the packages that were in use.
        files: The SHA-256 of each file that was read, in hexadecimal digits, by its path as it was
            given, `rtamt.errors.shown`: traces, specifications, models.
        fingerprint: Hashes and versions of the simulated model; None without a model.
        reuse: How many results a folder held before; None without a folder.
    """

    ids: Mapping[str, RequirementId] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    fingerprint: Fingerprint | None = None
    reuse: Reuse | None = None

    @classmethod
    def of(
        cls,
        specs: Mapping[str, Specification],
        fingerprint: Fingerprint | None = None,
        reuse: Reuse | None = None,
    ) -> Self:
        """Return the provenance of results that are made here, without files."""
        ids = {name: spec.id for name, spec in specs.items() if spec.id is not None}
        return cls(ids, versions_in_use(), fingerprint=fingerprint, reuse=reuse)

    def called(self, name: str) -> str:
        """Return the name of a requirement with its id, if it has one: ``slow (SYS-REQ-7)``."""
        return f"{name} ({self.ids[name].id})" if name in self.ids else name

    def with_files(self, paths: Iterable[str | os.PathLike[str]]) -> Self:
        """Return the provenance with the hashes of files; other paths are left out."""
        known = ((shown(os.fspath(path)), file_hash(path)) for path in paths)
        return replace(self, files={**self.files, **{path: sha for path, sha in known if sha}})


def file_hash(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file in hexadecimal digits; empty if it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):  # a formula may not be a valid path
        return ""


def versions_in_use() -> dict[str, str]:
    """Return the versions of Python and of the packages that are in use."""
    used = {name: sys.modules[name] for name in _OF_VERSIONS if name in sys.modules}
    return {"python": platform.python_version()} | {
        name: str(getattr(module, "__version__", "")) for name, module in used.items()
    }


def ids_lines(found: Provenance) -> list[str]:
    """Return lines with the ids of requirements, at most 80 columns; empty without ids.

    Example:
        >>> ids_lines(Provenance({"slow": RequirementId("SYS-REQ-7")}))
        ['ids: slow SYS-REQ-7']
    """
    parts = ", ".join(f"{name} {value.id}" for name, value in found.ids.items())
    if not parts:
        return []
    return textwrap.wrap(f"ids: {parts}", 80, subsequent_indent="    ", break_on_hyphens=False)


def reuse_lines(found: Provenance, trial: str) -> list[str]:
    """Return how many results came from a folder, and whether their model differs.

    Args:
        found: The provenance of the results.
        trial: The word for a trial, such as ``simulation``.

    Example:
        >>> reuse_lines(Provenance(reuse=Reuse("runs", 40, 100)), "simulation")
        ['reused 40 of 100 simulations from runs']
    """
    if found.reuse is None:
        return []
    return [
        line
        for text in found.reuse.lines(trial)
        for line in textwrap.wrap(text, 80, subsequent_indent="  ", break_on_hyphens=False)
    ]


def plain_provenance(found: Provenance) -> dict[str, Any]:
    """Return the provenance as a JSON object, without empty fields."""
    ids = {
        name: {"id": value.id, "link": value.link} if value.link else {"id": value.id}
        for name, value in found.ids.items()
    }
    stored = {
        "ids": ids,
        "versions": dict(found.versions),
        "files": dict(found.files),
        "fingerprint": found.fingerprint and found.fingerprint.plain(),
        "reuse": found.reuse and found.reuse.plain(),
    }
    return {name: value for name, value in stored.items() if value}


def provenance_of(kept: Mapping[str, Any]) -> Provenance:
    """Read the output of `plain_provenance`."""
    ids = {name: RequirementId(**value) for name, value in kept.get("ids", {}).items()}
    fingerprint, reuse = Fingerprint.read(kept.get("fingerprint")), Reuse.read(kept.get("reuse"))
    return Provenance(ids, kept.get("versions", {}), kept.get("files", {}), fingerprint, reuse)
