"""The live view of commands, `--rerun`."""

from __future__ import annotations

import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

from rtamt import InputError

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView


def open_view(
    path: str | bool | None,  # noqa: FBT001 - the value of the option
    *,
    pictures: int | None = None,
) -> RerunView | None:
    """Open the view for ``--rerun``.

    Args:
        path: The value of the option: False without the option, None without a file.
        pictures: As for `RerunView`.

    Returns:
        The view; None without the option.
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
