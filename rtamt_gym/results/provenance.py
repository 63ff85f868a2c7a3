"""`Provenance`: requirement ids, versions, file hashes and the `Fingerprint` of the model.

Stored results are valid only for the model that produced them. Before they are used again, their
fingerprint is compared with the fingerprint of the current model.

To add a field of the provenance, such as a version or a hash: the field of `Provenance`. All
results and all file formats then have it.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import textwrap
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Final, Self

from rtamt import InputError, Specification
from rtamt.errors import Argument, shown
from rtamt.language import RequirementId
from rtamt_gym.tables import counted

_SHOWN: Final = 4
"""The number of changes that an error lists."""


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """Hashes and versions of the code and files that simulations run.

    Attributes:
        contents: The SHA-256 of each file (source, FMU, model, mesh, policy), by its path below the
            folder that Python imports it from, so that a project may move.
        values: Functions, classes and the values in them, by name, as text; hashes of compiled
            models and weights.
        simulators: The versions of rtamt and of the packages that simulate, by name.
        packages: The versions of Python and of other packages, by name.
        unseen: Parts of the model whose changes this fingerprint cannot detect, as noun phrases.
        policy: The names in `contents` and `values` that belong to the policy alone.
    """

    contents: Mapping[str, str] = field(default_factory=dict)
    values: Mapping[str, str] = field(default_factory=dict)
    simulators: Mapping[str, str] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)
    unseen: tuple[str, ...] = ()
    policy: tuple[str, ...] = ()

    sparse: ClassVar = True  # JSON leaves out defaults

    def changes(self, now: Fingerprint, *, without: Collection[str] = ()) -> list[str]:
        """Return the changes since this fingerprint, each as a clause.

        Args:
            now: The fingerprint to compare with.
            without: Names in `contents` and `values` that are not compared.

        Example:
            >>> then = Fingerprint({"plant.py": "1f"}, {"gain": "2.0"}, {"mujoco": "3.3.1"})
            >>> then.changes(Fingerprint({"plant.py": "a0"}, {"gain": "3.0"}, {"mujoco": "3.4.0"}))
            ['plant.py has changed', 'gain is 3.0, was 2.0', 'mujoco is 3.4.0, was 3.3.1']
        """
        files = _changes(self.contents, now.contents, without, values=False)
        of_files = tuple(f" of {name.rpartition('/')[2]}" for name in files)
        values = _changes(self.values, now.values, without, values=True)
        for name, text in values.items():
            if not name.endswith(of_files):  # a changed file is listed already
                files[name] = text
        return [*files.values(), *_other_versions(self.simulators, now.simulators)]

    def notes(self, now: Fingerprint) -> list[str]:
        """Return other versions of packages that do not simulate, each as a clause."""
        return _other_versions(
            {**self.simulators, **self.packages},
            {name: value for name, value in now.packages.items() if name not in self.simulators},
        )

    def common(self, other: Fingerprint) -> Fingerprint:
        """Return the entries that the other fingerprint has too."""
        contents = {name: value for name, value in self.contents.items() if name in other.contents}
        values = {name: value for name, value in self.values.items() if name in other.values}
        return replace(self, contents=contents, values=values)

    @classmethod
    def read(cls, stored: object) -> Self | None:
        """Return the fingerprint that `plain` has written, or None.

        Raises:
            InputError: If it is something else.
        """
        if stored is None:
            return None
        if not isinstance(stored, dict) or not all(
            isinstance(value, list if name in {"unseen", "policy"} else dict)
            and all(isinstance(item, str) for item in (*value, *getattr(value, "values", list)()))
            for name, value in stored.items()
        ):
            raise InputError(f'expected "fingerprint" as hashes and versions, got {stored!r}')
        maps = (stored.get(name, {}) for name in ("contents", "values", "simulators", "packages"))
        return cls(*maps, *(tuple(stored.get(name, ())) for name in ("unseen", "policy")))


def _changes(
    then: Mapping[str, str], now: Mapping[str, str], without: Collection[str], *, values: bool
) -> dict[str, str]:
    """Return the differences of two mappings as clauses, with or without the values."""
    texts = {}
    for name in sorted({*then, *now}.difference(without)):
        if name not in then:
            texts[name] = f"{name} is new"
        elif name not in now:
            texts[name] = f"{name} is no longer used"
        elif then[name] != now[name]:
            shown = values and not now[name].startswith("SHA-256")
            changed = f"is {now[name]}, was {then[name]}" if shown else "has changed"
            texts[name] = f"{name} {changed}"
    return texts


def _other_versions(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    return [
        f"{name} is {now[name]}, was {version}"
        for name, version in sorted(then.items())
        if name in now and now[name] != version
    ]


class ChangedModelError(InputError):
    """Stored results are of a model, a policy or a simulator that has changed since."""


def check_unchanged(place: str, changes: list[str], way_out: str) -> None:
    """Raise InputError if the model of stored results has changed."""
    if changes:
        raise ChangedModelError(
            f"{place} holds results of another model or version: {listed(changes)}; {way_out}, or "
            "use them all the same with ",
            Argument("accept_changed", value=True),
        )


def listed(changes: list[str]) -> str:
    """Return the first changes as text, and the number of the others."""
    more = len(changes) - _SHOWN
    shown = changes if more <= 1 else changes[:_SHOWN]
    return ", ".join([*shown, *([] if more <= 1 else [f"{more} more changes"])])


@dataclass(frozen=True, slots=True)
class Mixture:
    """Stored results of one model next to later results of another."""

    count: int
    changes: tuple[str, ...]

    def line(self, trial: str) -> str:
        """Return a sentence on the results, which are simulations or episodes."""
        number = counted(self.count, trial)
        if not self.changes:
            return f"{number} stored without hashes: a change of the model since cannot be seen"
        return f"{number} from before a change: {listed(list(self.changes))}"


@dataclass(frozen=True, slots=True)
class Reuse:
    """Results that came from a folder, and how far their model is known to be the same."""

    folder: str
    reused: int
    total: int
    mixtures: tuple[Mixture, ...] = ()
    notes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()

    sparse: ClassVar = True  # JSON leaves out defaults

    def lines(self, trial: str) -> list[str]:
        """Return the lines that a summary shows; ``trial`` is the word for one result."""
        lines = []
        if self.reused:
            of = f"{self.reused} of {counted(self.total, trial)}"
            lines.append(f"reused {of} from {self.folder}")
        lines += [mixture.line(trial) for mixture in self.mixtures]
        lines += [f"note: {note}" for note in self.notes]
        return lines + [f"note: a change of {item} cannot be seen" for item in self.unseen]


_OF_VERSIONS: Final = ("rtamt", "numpy", "gymnasium", "mujoco", "fmpy", "numba")


@dataclass(frozen=True, slots=True)
class Provenance:
    """The inputs and versions that produced results."""

    ids: Mapping[str, RequirementId] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    fingerprint: Fingerprint | None = None
    reuse: Reuse | None = None

    sparse: ClassVar = True  # JSON leaves out defaults

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


def ids_lines(provenance: Provenance) -> list[str]:
    """Return lines with the ids of requirements, at most 80 columns; empty without ids.

    Example:
        >>> ids_lines(Provenance({"slow": RequirementId("SYS-REQ-7")}))
        ['ids: slow SYS-REQ-7']
    """
    parts = ", ".join(f"{name} {value.id}" for name, value in provenance.ids.items())
    if not parts:
        return []
    return textwrap.wrap(f"ids: {parts}", 80, subsequent_indent="    ", break_on_hyphens=False)


def reuse_lines(provenance: Provenance, trial: str) -> list[str]:
    """Return how many results came from a folder, and whether their model differs.

    Example:
        >>> reuse_lines(Provenance(reuse=Reuse("runs", 40, 100)), "simulation")
        ['reused 40 of 100 simulations from runs']
    """
    if provenance.reuse is None:
        return []
    return [
        line
        for text in provenance.reuse.lines(trial)
        for line in textwrap.wrap(text, 80, subsequent_indent="  ", break_on_hyphens=False)
    ]
