"""Values of arguments of several commands: environments, signals, output files."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.checks.numbers import read_floats

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView
    from rtamt_gym.signals.signals import SignalLike


def read_options(arguments: Sequence[str]) -> dict[str, Any]:
    """Read ``--env-kwarg``: values are JSON, a constant of Python, or text."""
    options: dict[str, Any] = {}
    for argument in arguments:
        key, _, value = (part.strip() for part in argument.partition("="))
        if not (key.isidentifier() and value):
            raise InputError(
                f"--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got {argument!r}"
            )
        if key in options:
            raise InputError(f"--env-kwarg: expected one {key!r}, got two")
        options[key] = _read_value(value)
    return options


_PYTHON = {"True": True, "False": False, "None": None}
"""Python constants, which would otherwise be non-empty texts and so count as true."""


def _read_value(text: str) -> Any:  # noqa: ANN401 - what JSON holds
    if text in _PYTHON:
        return _PYTHON[text]
    try:
        return json.loads(text)
    except ValueError as error:
        if text[0] in "[{":
            raise InputError(
                f"--env-kwarg: expected JSON, such as '{{\"duration\": 20}}', got {text!r}: {error}"
            ) from error
        return text


def read_signals(arguments: Sequence[str]) -> dict[str, SignalLike]:
    """Read ``--signal NAME=SELECTOR``, with the value at reset after a comma."""
    signals: dict[str, SignalLike] = {}
    for argument in arguments:
        name, _, selector = (part.strip() for part in argument.partition("="))
        if not (name and selector):
            raise InputError(
                f"--signal: expected NAME=SELECTOR, such as angle=obs[2], got {argument!r}"
            )
        if name in signals:
            raise InputError(f"--signal: expected one signal {name!r}, got two")
        signals[name] = selector
        value, comma, reset = selector.rpartition(",")
        if comma and "]" not in reset:  # a comma before a bracket belongs to a key
            at_reset = [None] if reset.strip() == "unknown" else read_floats([reset])
            if at_reset is None:
                raise InputError(
                    "--signal: expected a number after the comma, the value at reset, or unknown, "
                    f"got {argument!r}"
                )
            signals[name] = (value, *at_reset)
    return signals


def check_outputs(*files: Path | None, picture: Path | None, inputs: Sequence[str] = ()) -> None:
    """Check the files that a command will write, before it starts."""
    read = {Path(name).resolve() for name in inputs}
    written: set[Path] = set()
    for path in filter(None, (*files, picture)):
        resolved = path.resolve()
        if resolved in read:
            raise InputError(f"cannot write {shown(str(path))}: it is an input of the command")
        if resolved in written:
            raise InputError(f"cannot write {shown(str(path))}: two options write it")
        written.add(resolved)
        if path.is_dir():
            raise InputError(f"cannot write {shown(str(path))}: it is a folder")
        if not path.parent.is_dir():
            raise InputError(
                f"cannot write {shown(str(path))}: the folder {path.parent} does not exist"
            )
    if picture:
        from rtamt_gym.drawing import check_format

        check_format(picture)


def open_view(
    path: str | bool | None,  # noqa: FBT001 - the value of the option
    *,
    pictures: int | None = None,
) -> RerunView | None:
    """Open the view for ``--rerun``.

    Args:
        path: The value of the option: False without the option, None without a file.
        pictures: As for `RerunView`.
    """
    if isinstance(path, bool):
        return None
    if path is not None and not path.endswith(".rrd"):
        raise InputError(
            f"--rerun writes a .rrd file, got {path!r}. For a view without a file, put --rerun "
            "after all arguments."
        )
    from rtamt_gym.live.view import RerunView

    return RerunView(path, pictures=pictures)


def hold(view: RerunView) -> None:
    """Keep a view with a viewer open until Ctrl-C."""
    if view.address is None:
        return
    print(f"ended; the view stays until Ctrl-C: {view.address}", file=sys.stderr)
    with suppress(KeyboardInterrupt):
        threading.Event().wait()
