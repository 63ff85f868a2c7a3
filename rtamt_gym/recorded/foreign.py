"""Errors of the libraries that read files of others: a file that they stumble on is refused."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rtamt import InputError, RtamtError
from rtamt.errors import shown
from rtamt_gym.tables import shorten

__all__ = ["refusing"]


@contextmanager
def refusing(path: str, what: str) -> Iterator[None]:
    """Turns whatever a library raises while it reads a file into the refusal of the file.

    Args:
        path: The file.
        what: What was expected, as in ``a whole MATLAB file``.

    Raises:
        InputError: If the library raises anything; a lack of memory too, for a damaged file may
            claim more numbers than there are.
        OSError: If a file cannot be opened.
        ModuleNotFoundError: If the library is not installed.
    """
    try:
        yield
    except (RtamtError, ModuleNotFoundError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise
        said = shorten(" ".join(str(error).split()), 120)
        kind = type(error).__name__.lstrip("_")
        raise InputError(
            f"{shown(path)}: expected {what}, got an error: {kind}{': ' * bool(said)}{said}"
        ) from None
