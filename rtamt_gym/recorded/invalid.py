"""Records that hold no number: samples that a measurement marks as not valid."""

from __future__ import annotations

from rtamt import InputError
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Rows
from rtamt_gym.tables import counted

__all__ = ["check_valid"]


def check_valid(rows: Rows, columns: Columns) -> None:
    """Checks that all records hold numbers, unless somebody has said what others do.

    Args:
        rows: The rows that were read.
        columns: What a record without a number does.

    Raises:
        InputError: If one holds none.
    """
    if columns.missing != "raise":
        return
    for name, invalid in rows.invalid.items():
        if invalid.any():
            at, count = int(invalid.argmax()), int(invalid.sum())
            when = "" if rows.times is None else f", at {float(rows.times[at]):.9g} s"
            raise InputError(
                f"{rows.source}{when}, channel '{name}': expected a number, got a sample that is "
                f"nan or marked as not valid ({counted(count, 'sample')} in all); give --missing "
                "unknown, --missing hold or --missing drop"
            )
