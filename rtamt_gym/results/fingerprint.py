"""`Fingerprint`: hashes and versions of a model that produced results, and their differences.

Stored results are only worth something as long as their model is the same. A fingerprint is stored
next to the results; before they are used again, it is compared with the fingerprint of the model
as it is now.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Self

from rtamt import InputError
from rtamt.errors import Argument
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
        """Return the entries with names that the other one has too."""
        contents = {name: value for name, value in self.contents.items() if name in other.contents}
        values = {name: value for name, value in self.values.items() if name in other.values}
        return replace(self, contents=contents, values=values)

    def plain(self) -> dict[str, Any]:
        """Return the fingerprint as JSON holds it; empty fields are left out."""
        fields: dict[str, Any] = {
            "contents": dict(self.contents),
            "values": dict(self.values),
            "simulators": dict(self.simulators),
            "packages": dict(self.packages),
            "unseen": list(self.unseen),
            "policy": list(self.policy),
        }
        return {name: value for name, value in fields.items() if value}

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


def check_unchanged(what: str, changes: list[str], way_out: str) -> None:
    """Raise InputError if the model of stored results has changed.

    Args:
        what: Where the results are stored.
        changes: The changes, as `Fingerprint.changes` returns them.
        way_out: The alternative to accepting the change, for the error.

    Raises:
        ChangedModelError: If anything has changed, with both ways out.
    """
    if changes:
        raise ChangedModelError(
            f"{what} holds results of another model or version: {listed(changes)}; {way_out}, or "
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
    """Stored results of one model next to later results of another.

    Attributes:
        count: The number of results that were stored before.
        changes: The changes since; () if the results were stored without a fingerprint.
    """

    count: int
    changes: tuple[str, ...]

    def plain(self) -> dict[str, Any]:
        """Return the mixture as JSON holds it."""
        return {"count": self.count, "changes": list(self.changes)}

    @classmethod
    def read(cls, stored: Mapping[str, Any]) -> Self:
        """Return the mixture that `plain` has written."""
        return cls(stored["count"], tuple(stored["changes"]))

    def line(self, trial: str) -> str:
        """Return a sentence on the results, which are simulations or episodes."""
        number = counted(self.count, trial)
        if not self.changes:
            return f"{number} stored without hashes: a change of the model since cannot be seen"
        return f"{number} from before a change: {listed(list(self.changes))}"


@dataclass(frozen=True, slots=True)
class Reuse:
    """Results that came from a folder, and how far their model is known to be the same.

    Attributes:
        folder: The folder.
        reused: The number of results that were stored before this run.
        total: The number of all results.
        mixtures: Results of other models among them.
        notes: Other versions of packages that do not simulate, each a clause.
        unseen: Parts of the model whose changes cannot be detected.
    """

    folder: str
    reused: int
    total: int
    mixtures: tuple[Mixture, ...] = ()
    notes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()

    def lines(self, trial: str) -> list[str]:
        """Return the lines that a summary shows; ``trial`` is the word for one result."""
        lines = []
        if self.reused:
            of = f"{self.reused} of {counted(self.total, trial)}"
            lines.append(f"reused {of} from {self.folder}")
        lines += [mixture.line(trial) for mixture in self.mixtures]
        lines += [f"note: {note}" for note in self.notes]
        return lines + [f"note: a change of {item} cannot be seen" for item in self.unseen]

    def plain(self) -> dict[str, Any]:
        """Return the fields as JSON holds them; empty lists are left out."""
        fields: dict[str, Any] = {
            "folder": self.folder,
            "reused": self.reused,
            "total": self.total,
            "mixtures": [mixture.plain() for mixture in self.mixtures],
            "notes": list(self.notes),
            "unseen": list(self.unseen),
        }
        return {name: value for name, value in fields.items() if value != []}

    @classmethod
    def read(cls, stored: Mapping[str, Any] | None) -> Self | None:
        """Return the object that `plain` has written, or None."""
        if stored is None:
            return None
        mixtures = tuple(map(Mixture.read, stored.get("mixtures", ())))
        notes, unseen = (tuple(stored.get(name, ())) for name in ("notes", "unseen"))
        return cls(stored["folder"], stored["reused"], stored["total"], mixtures, notes, unseen)
