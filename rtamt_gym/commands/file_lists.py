"""Lists of files: a million paths do not fit a command line."""

from __future__ import annotations

import sys
from pathlib import Path

from rtamt import InputError


def listed_paths(name: Path) -> list[str]:
    """Return the paths in a list of files, one on each line; ``-`` is standard input."""
    try:
        text = sys.stdin.read() if str(name) == "-" else name.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(f"--files-from: expected UTF-8 text, got {name}") from None
    paths = list(dict.fromkeys(line for line in text.splitlines() if line.strip()))
    if not paths:
        raise InputError(f"--files-from: expected a path on each line, got none in {name}")
    return paths
