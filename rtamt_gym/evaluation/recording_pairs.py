"""Pairs of recordings: the ones of two releases that have the same name below their folders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import NamedTuple

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.parts import split_name
from rtamt_gym.tables import shorten

_NAMED = 3

_Paths = Mapping[str, tuple[str, ...]]
"""The folders and the file of each recording, and then its group, by its name."""


class RecordingPairs(NamedTuple):
    """Recordings of A and B with the same name.

    Attributes:
        folders: The folders of A and B below which the names are the same.
        pairs: The full names in A and B, by the name below the folders, in the order of A.
        only_a: The names that only A has.
        only_b: The names that only B has.
    """

    folders: tuple[str, str]
    pairs: Mapping[str, tuple[str, str]]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]


def pair_recordings(
    names_a: Sequence[str], names_b: Sequence[str], folders: Sequence[str] | None = None
) -> RecordingPairs:
    """Pair the recordings whose paths below a folder of A and of B, and whose groups, are equal.

    A file that holds all recordings of its side counts as a folder. Without folders, every folder
    that contains all recordings of its side is tried.

    Args:
        names_a: The names of the recordings of A, such as ``old/run1.csv[car=7]``.
        names_b: The names of the recordings of B.
        folders: The folders of A and B. Default: the only two folders with equal names below.

    Raises:
        InputError: If a name occurs twice, there are no pairs, different folders have different
            pairs, or a recording is not in the folder.

    Example:
        >>> pair_recordings(["old/city/1.csv", "old/2.csv"], ["new/city/1.csv"]).pairs
        {'city/1.csv': ('old/city/1.csv', 'new/city/1.csv')}
        >>> pair_recordings(["old.csv[car=7]"], ["new.csv[car=7]"]).pairs
        {'[car=7]': ('old.csv[car=7]', 'new.csv[car=7]')}
    """
    sides = []
    for side, names in (("A", names_a), ("B", names_b)):
        name, count = max(Counter(names).items(), key=lambda item: item[1])
        if count > 1:
            raise InputError(f"{side} has the recording {shown(name)} {count} times")
        sides.append({name: _parts(name) for name in names})
    if folders is not None:
        depths = [_depth_of(paths, folder) for paths, folder in zip(sides, folders, strict=True)]
        return _checked(_paired(sides, depths), sides)
    deepest = [_common(paths.values()) for paths in sides]
    # Moving both folders up by one step keeps the pairs, or has none.
    choices = [(deepest[0], depth) for depth in range(deepest[1], -1, -1)]
    choices += [(depth, deepest[1]) for depth in range(deepest[0] - 1, -1, -1)]
    results = dict[frozenset[tuple[str, str]], RecordingPairs]()
    for choice in choices:
        paired = _paired(sides, choice)
        if paired.pairs:
            results.setdefault(frozenset(paired.pairs.values()), paired)
    if len(results) > 1:
        first, second = (" ".join(map(shown, r.folders)) for r in [*results.values()][:2])
        raise InputError(
            "recordings of A and B have equal names below several folders: set --folders "
            f"{first}, or --folders {second}"
        )
    return _checked(next(iter(results.values()), None) or _paired(sides, deepest), sides)


def _parts(name: str) -> tuple[str, ...]:
    file, group = split_name(name)
    return (*PurePath(file).parts, group)


def _common(paths: Iterable[tuple[str, ...]]) -> int:
    """Return the number of folders that all paths start with, the file included."""
    files = [path[:-1] for path in paths]
    return next(
        (depth for depth, steps in enumerate(zip(*files, strict=False)) if len({*steps}) > 1),
        min(map(len, files)),
    )


def _depth_of(paths: _Paths, folder: str) -> int:
    steps = PurePath(folder).parts
    for name, parts in paths.items():
        if parts[:-1][: len(steps)] != steps:
            raise InputError(
                f"--folders: the recording {shown(name)} is not in the folder {shown(folder)}"
            )
    return len(steps)


def _paired(sides: Sequence[_Paths], depths: Sequence[int]) -> RecordingPairs:
    a, b = (
        {_joined(parts[depth:]): name for name, parts in paths.items()}
        for paths, depth in zip(sides, depths, strict=True)
    )
    folder_a, folder_b = (
        str(PurePath(*next(iter(paths.values()))[:depth]))
        for paths, depth in zip(sides, depths, strict=True)
    )
    return RecordingPairs(
        (folder_a, folder_b),
        {short: (name, b[short]) for short, name in a.items() if short in b},
        tuple(short for short in a if short not in b),
        tuple(short for short in b if short not in a),
    )


def _joined(parts: tuple[str, ...]) -> str:
    return str(PurePath(*parts[:-1])) * (len(parts) > 1) + parts[-1]


def _checked(paired: RecordingPairs, sides: Sequence[_Paths]) -> RecordingPairs:
    """Refuse a result without pairs."""
    if paired.pairs:
        return paired
    texts = []
    for paths in sides:
        more = f" and {len(paths) - _NAMED} more" if len(paths) > _NAMED else ""
        texts.append(", ".join(shown(shorten(name, 60)) for name in [*paths][:_NAMED]) + more)
    raise InputError(
        f"no recording has the same name in A and B: A has {texts[0]}, B has {texts[1]}. Judge "
        "files with equal names, or name the folders that differ: --folders FOLDER_A FOLDER_B"
    )
