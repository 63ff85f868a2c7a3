"""The advice of the library's errors, where it names arguments that the released classes lack."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from rtamt.errors import InputError, ParseError

__all__ = ["own_advice"]

_ADVICE = (
    (
        r"take samples (\S+) s apart, or let align= round it$",
        r"or take samples \1 s apart and say so with set_sampling_period()",
    ),
    (
        r"give resolution=('.*'), of which it is one$",
        r"write whole nanoseconds, or use rtamt.DenseMonitor with resolution=\1",
    ),
    (
        r"; resolution=('.*') would do$",
        r"; rtamt.DenseMonitor takes it with resolution=\1",
    ),
)


@contextmanager
def own_advice() -> Iterator[None]:
    """Raise errors of the library again, with the way out that the released classes have."""
    try:
        yield
    except ParseError as error:
        hint = _replaced(error.hint)
        raise ParseError(error.reason, error.text, error.line, error.column, hint) from None
    except InputError as error:
        raise InputError(_replaced(str(error))) from None


def _replaced(text: str) -> str:
    for advice, own in _ADVICE:
        text = re.sub(advice, own, text)
    return text
