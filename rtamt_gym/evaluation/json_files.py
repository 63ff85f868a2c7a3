"""Files of results: strict JSON that says its format, which is checked when it is read."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rtamt import InputError

__all__ = ["read_fields", "write_text"]


def write_text(text: str, path: str | os.PathLike[str]) -> None:
    """Writes the text of a result into a file.

    Raises:
        InputError: If the name does not end in ``.json``.
    """
    path = Path(path)
    if path.suffix.lower() != ".json":
        raise InputError(f"cannot write {path}: expected a name that ends in .json")
    path.write_text(text + "\n", encoding="utf-8")


def read_fields(
    path: Path, kind: str, form: str, fields_of: Callable[[Mapping[str, Any]], dict[str, Any]]
) -> dict[str, Any]:
    """Reads the fields of a result from its file.

    Args:
        path: The file.
        kind: What it holds: ``"evaluation"``; the class has this name, with a capital.
        form: The format that the file says.
        fields_of: Makes the fields of what JSON holds.

    Raises:
        InputError: If the file does not hold such a result.
    """
    writer = f"{kind.capitalize()}.save"
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"cannot read {path}: it is no JSON: {error}") from error
    if not isinstance(kept, dict) or kept.get("format") != form:
        raise InputError(
            f"{path} holds no {kind}: expected the format {form!r}, as {writer} writes it"
        )
    try:
        return fields_of(kept)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"cannot read {path}: it is no {kind} that {writer} has written: "
            f"{type(error).__name__}: {error}"
        ) from error
