"""The advice of the library's errors, where it names arguments that the released classes lack."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from rtamt.errors import InputError, ParseError, SpecificationError

__all__ = ["of_a_sample", "own_advice"]

_HOLD = "; pass nan='hold' to keep the last value instead$"
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
    (
        r"or use (EpisodeMonitor or evaluate|evaluate_dense)\(\)$",
        "or call evaluate() with all of it",
    ),
    (r"use evaluate\(\) with n=, or", "use StlDiscreteTimeSpecification, or"),
    (r"or use Monitor with a period$", "or use StlDiscreteTimeSpecification"),
    (r" and n=(\d+)$", r" and time: \1"),
    (_HOLD, "; rtamt.evaluate with nan='hold' keeps the last value instead"),
)


@contextmanager
def own_advice() -> Iterator[None]:
    """Raise errors of the library again, with the way out that the released classes have."""
    try:
        yield
    except ParseError as error:
        hint = _replaced(error.hint)
        raise ParseError(error.reason, error.text, error.line, error.column, hint) from None
    except SpecificationError as error:
        raise SpecificationError(_replaced(str(error))) from None
    except InputError as error:
        raise InputError(_replaced(str(error))) from None


def of_a_sample(error: InputError) -> InputError:
    """An error about a sample, with the way out that ``update`` has."""
    kept = "; leave it out of the sample, and it keeps its last value"
    return InputError(re.sub(_HOLD, kept, str(error)))


def _replaced(text: str) -> str:
    for advice, own in _ADVICE:
        text = re.sub(advice, own, text)
    return text
