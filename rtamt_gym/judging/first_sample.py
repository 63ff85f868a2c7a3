"""The error about a requirement that only the first sample judges."""

from __future__ import annotations

import rtamt
from rtamt import SpecificationError
from rtamt_gym.tables import shorten

__all__ = ["first_sample_error"]


def first_sample_error(what: str, spec: rtamt.Specification, way: object) -> SpecificationError:
    """Makes the error.

    Args:
        what: Names the specification.
        spec: The specification.
        way: How the caller asks for a requirement on every sample, a text or an `Argument`.
    """
    way_out = f"write always({shorten(str(spec.formula), 60)}) or "
    if spec.requirement is not None and spec.id is not None:
        way_out = f"its id makes it a requirement by itself: remove the id, {way_out}"
    elif spec.requirement is not None:
        way_out = (
            "no other formula uses it, so that it is a requirement by itself: use it in another, "
            + way_out
        )
    return SpecificationError(f"{what} speaks of the first sample only; {way_out}", way)
