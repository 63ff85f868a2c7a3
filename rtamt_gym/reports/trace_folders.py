"""Where the page of results reads recorded traces: regular files below some folders, no others.

A result names its traces, and whoever wrote the file could name any path: a secret, a device, a
pipe that nobody writes to.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rtamt_gym.reports.rows import DIGITS
from rtamt_gym.results.provenance import file_hash

__all__ = ["NotShownError", "TraceFolders"]


class NotShownError(Exception):
    """Why a trace is not shown, in words that repeat nothing of a file."""


@dataclass(frozen=True, slots=True)
class TraceFolders:
    """The folders below which traces are read.

    Attributes:
        own: The folders from which paths are read: the present one and that of the result.
        traces: Further ones, in which a trace may have the end of its path alone.
    """

    own: tuple[Path, ...]
    traces: tuple[Path, ...] = ()

    def found(self, name: str, sha256: str) -> Path:
        """The file of a trace.

        Args:
            name: The path of the trace, as it was judged.
            sha256: The hash of the trace when it was judged; empty if it is not known.

        Raises:
            NotShownError: If no regular file of this name lies below the folders, or none is as it
                was.
        """
        folders = list(dict.fromkeys([*self.own, *self.traces]))
        roots = [folder.resolve() for folder in folders]
        files = [path for path in self._places(name) if _is_below(path, roots)]
        if not files:
            below = " or ".join(map(str, folders))
            raise NotShownError(
                f"no regular file of this name lies below {below}; rtamt report --traces DIR reads "
                "below another folder"
            )
        for path in files:
            if not sha256 or file_hash(path) in {sha256, ""}:
                return path
        raise NotShownError(
            f"{files[0]} is not the file that was judged, whose SHA-256 begins with "
            f"{sha256[:DIGITS]}, but {file_hash(files[0])[:DIGITS]}; judge it again"
        )

    def _places(self, name: str) -> Iterator[Path]:
        yield from (folder / name for folder in self.own)
        steps = Path(name).parts
        for folder in self.traces:
            yield from (folder.joinpath(*steps[i:]) for i in range(len(steps)))


def _is_below(path: Path, roots: list[Path]) -> bool:
    """Whether a path is a regular file below a folder, links followed, or a folder of such."""
    try:
        whole = path.resolve(strict=True)
        if not any(whole.is_relative_to(root) for root in roots):
            return False
        mode = whole.stat().st_mode
        if stat.S_ISREG(mode):
            return True
        return stat.S_ISDIR(mode) and _holds_regular_files(whole)
    except (OSError, ValueError):  # ValueError: a path with a null character
        return False


def _holds_regular_files(folder: Path) -> bool:
    """Whether a folder holds regular files alone, as a bag does; a link in it may lead anywhere."""
    with os.scandir(folder) as entries:
        return all(entry.is_file(follow_symlinks=False) for entry in entries)
