"""Pairs of recordings of two releases that have the same name below their folders."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import PurePath
from typing import NamedTuple

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.recorded.parts import split_name
from rtamt_gym.tables import shorten

_NAMED = 3
"""The recordings of a side that an error names."""

_TRIED = 32
"""The maximum number of folders without all recordings of their side that are tried."""

_Paths = Mapping[str, tuple[str, ...]]
"""The folders, the file and the group of each recording, by name."""


class RecordingPairs(NamedTuple):
    """Recordings of A and B with the same name."""

    folders: tuple[str, str]
    pairs: Mapping[str, tuple[str, str]]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]


def pair_recordings(
    names_a: Sequence[str], names_b: Sequence[str], folders: Sequence[str] | None = None
) -> RecordingPairs:
    """Pair the recordings with equal groups and equal paths below a folder of A and a folder of B.

    A file with all recordings of its side counts as a folder. Without ``folders``, every folder
    with all recordings of its side is tried. If recordings are left over, smaller folders must not
    have more pairs, or as many if a recording is paired with itself.
    """
    sides = []
    for side, names in (("A", names_a), ("B", names_b)):
        name, count = max(Counter(names).items(), key=lambda item: item[1])
        if count > 1:
            raise InputError(f"{side} has the recording {shown(name)} {count} times")
        sides.append({name: _parts(name) for name in names})
    if folders is not None:
        steps = [_steps_of(paths, folder) for paths, folder in zip(sides, folders, strict=True)]
        return _checked(_paired(sides, steps), sides)
    deepest = [_common(paths.values()) for paths in sides]
    # Moving both folders up by one step keeps the pairs, or has none.
    choices = [(deepest[0], deepest[1][:depth]) for depth in range(len(deepest[1]), -1, -1)]
    choices += [(deepest[0][:depth], deepest[1]) for depth in range(len(deepest[0]) - 1, -1, -1)]
    results = dict[frozenset[tuple[str, str]], RecordingPairs]()
    for choice in choices:
        paired = _paired(sides, choice)
        if paired.pairs:
            results.setdefault(frozenset(paired.pairs.values()), paired)
    several = [*results.values()]
    if len(several) < 2:
        several.extend(_rivals(sides, several[0] if several else None))
    if len(several) > 1:
        first, second = (_option(r) for r in several[:2])
        raise InputError(
            "recordings of A and B have equal names below several folders: set "
            f"{first}, or {second}"
        )
    if several and not results:
        return _checked(_paired(sides, deepest), sides, several[0])
    return _checked(several[0] if several else _paired(sides, deepest), sides)


def _option(paired: RecordingPairs) -> str:
    return f"--folders {' '.join(map(shown, paired.folders))}"


def _rivals(sides: Sequence[_Paths], paired: RecordingPairs | None) -> list[RecordingPairs]:
    """Return the best pairs below folders that lack some recordings, if they are as plausible."""
    own = frozenset(paired.pairs.values()) if paired else frozenset()
    if paired and not (paired.only_a or paired.only_b):
        return []
    minimum = len(own) + (not any(one == two for one, two in own))
    best: list[RecordingPairs] = []
    for folders in product(*(_folders_of(paths, minimum) for paths in sides)):
        result = _paired(sides, folders)
        if len(result.pairs) >= minimum and frozenset(result.pairs.values()) != own:
            best, minimum = [result], len(result.pairs) + 1
    return best


def _folders_of(paths: _Paths, minimum: int) -> list[tuple[str, ...]]:
    """Return the largest folders with a minimum of recordings; a file with groups is a folder."""
    counts = Counter(
        parts[:depth] for parts in paths.values() for depth in range(len(parts) - (not parts[-1]))
    )
    return [folder for folder, count in counts.most_common(_TRIED) if count >= minimum]


def _parts(name: str) -> tuple[str, ...]:
    file, group = split_name(name)
    return (*PurePath(file).parts, group)


def _common(paths: Iterable[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the deepest folder that contains all paths; the only file counts as a folder."""
    files = [path[:-1] for path in paths]
    depth = next(
        (depth for depth, steps in enumerate(zip(*files, strict=False)) if len({*steps}) > 1),
        min(map(len, files)),
    )
    return files[0][:depth]


def _steps_of(paths: _Paths, folder: str) -> tuple[str, ...]:
    steps = PurePath(folder).parts
    if not any(parts[:-1][: len(steps)] == steps for parts in paths.values()):
        name = next(iter(paths))
        raise InputError(
            f"--folders: no recording is in the folder {shown(folder)}; one of its release is "
            f"{shown(name)}"
        )
    return steps


def _paired(sides: Sequence[_Paths], folders: Sequence[tuple[str, ...]]) -> RecordingPairs:
    inside, outside = list[dict[str, str]](), list[list[str]]()
    for paths, steps in zip(sides, folders, strict=True):
        depth = len(steps)
        names = [name for name, parts in paths.items() if parts[:-1][:depth] == steps]
        inside.append({_joined(paths[name][depth:]): name for name in names})
        within = {*names}
        outside.append([name for name in paths if name not in within])
    a, b = inside
    folder_a, folder_b = (str(PurePath(*steps)) for steps in folders)
    return RecordingPairs(
        (folder_a, folder_b),
        {short: (name, b[short]) for short, name in a.items() if short in b},
        (*(short for short in a if short not in b), *outside[0]),
        (*(short for short in b if short not in a), *outside[1]),
    )


def _joined(parts: tuple[str, ...]) -> str:
    return str(PurePath(*parts[:-1])) * (len(parts) > 1) + parts[-1]


def _checked(
    paired: RecordingPairs, sides: Sequence[_Paths], other: RecordingPairs | None = None
) -> RecordingPairs:
    """Return a result with pairs; otherwise raise InputError with a hint at folders."""
    if paired.pairs:
        return paired
    texts = []
    for paths in sides:
        more = f" and {len(paths) - _NAMED} more" if len(paths) > _NAMED else ""
        texts.append(", ".join(shown(shorten(name, 60)) for name in [*paths][:_NAMED]) + more)
    raise InputError(
        f"no recording has the same name in A and B: A has {texts[0]}, B has {texts[1]}. Judge "
        "files with equal names, or name the folders that differ: "
        f"{_option(other) if other else '--folders FOLDER_A FOLDER_B'}"
    )
