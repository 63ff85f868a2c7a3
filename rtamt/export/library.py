"""The shared library that every exported monitor holds, and the platform that it was built for."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

from rtamt.errors import InputError

__all__ = ["MODEL", "Library", "library"]

MODEL: Final = "rtamt_monitor"
"""The name of the library without its ending, which is the model identifier of every unit."""

_PLATFORMS: Final[Mapping[tuple[str, str], tuple[str, str, str]]] = {
    ("linux", "x86_64"): ("linux64", "x86_64-linux", ".so"),
}
"""Operating system and processor: the folder in FMI 2.0 and 3.0, and the ending of libraries."""


class Library(NamedTuple):
    """The library, and where it lies in a unit.

    Attributes:
        data: Its bytes.
        paths: Its path in a unit, by the version of FMI.
    """

    data: bytes
    paths: Mapping[int, str]


def library() -> Library:
    """The library for this platform.

    Raises:
        InputError: If there is none for this platform, or it was not built.
    """
    here = (sys.platform, platform.machine())
    if here not in _PLATFORMS:
        known = ", ".join(" ".join(each) for each in _PLATFORMS)
        msg = f"an FMU holds a library for the platform that it is exported on, {' '.join(here)}"
        raise InputError(f"{msg}, for which there is none; export on {known}")
    *folders, ending = _PLATFORMS[here]
    built = find_spec("rtamt._native")  # installed in place, it lies elsewhere than this file
    folder = Path(__file__).parents[1] if built is None else Path(built.origin or "").parent
    path = folder / f"{MODEL}{ending}"
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        msg = f"the library of FMUs, {path.name}, was not built"
        raise InputError(f"{msg}; reinstall rtamt where a C++20 compiler is found") from None
    return Library(data, {v: f"binaries/{f}/{path.name}" for v, f in enumerate(folders, start=2)})
