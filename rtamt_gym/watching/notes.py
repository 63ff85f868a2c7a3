"""Notes on how the rows of a stream were read, with the same texts as for files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rtamt.errors import shown
from rtamt_gym.tables import counted, number


class StreamNotes:
    """The notes on all traces of a stream.

    Attributes:
        held: The number of empty cells of each variable that hold the value before.
        no_events: The number of empty cells of each variable that do not count as events.
        dropped: The number of rows with an empty cell that were left out.
    """

    def __init__(self) -> None:
        self.held, self.no_events = Counter[str](), Counter[str]()
        self._defaults: dict[str, None] = {}
        self.dropped = 0
        self._unknown = Counter[str]()
        self._first: dict[str, str] = {}
        self._unit = self._period = ""
        self._periods = 0

    def add_unknown(
        self, names: Sequence[str], empty: NDArray[np.bool_], lines: Sequence[int]
    ) -> None:
        """Count empty cells that are unknown.

        Args:
            names: The variables.
            empty: Whether each cell is empty, shape (rows, variables).
            lines: The lines of the rows.
        """
        for place in np.nonzero(empty.any(axis=0))[0].tolist():
            name, cells = names[place], empty[:, place]
            self._unknown[name] += int(cells.sum())
            self._first.setdefault(name, f"line {lines[int(cells.argmax())]}")

    def add_unknown_event(self, name: str, time: float) -> None:
        """Count an event without a number."""
        self._unknown[name] += 1
        self._first.setdefault(name, f"{number(time)} s")

    def add_default(self, text: str) -> None:
        """Add the note on a variable with its default value; equal notes are printed once."""
        self._defaults[text] = None

    def add_unit(self, text: str) -> None:
        """Add the note on the unit of a trace; only the first is printed."""
        self._unit = self._unit or text

    def add_period(self, text: str, group: str | None) -> None:
        """Add the note on times that a stated period ignores; only the first is printed."""
        if text:
            self._periods += 1
            place = "" if group is None else f"group {shown(group)!r}: "
            self._period = self._period or f"{place}{text}"

    def texts(self, *, dense: bool) -> list[str]:
        """Return the notes in sentences.

        Args:
            dense: Whether rows are events.
        """
        texts = []
        if any(self.held.values()):
            counts = ", ".join(f"{name}: {count}" for name, count in self.held.items() if count)
            texts.append(f"empty cells hold the value before ({counts})")
        if self.no_events:
            counts = ", ".join(f"{name}: {count}" for name, count in self.no_events.items())
            texts.append(f"empty cells are not events: the value before holds ({counts})")
        texts += self._defaults
        if self.dropped:
            rows = f"{self.dropped} row{'s' * (self.dropped > 1)}"
            texts.append(f"{rows} with an empty cell left out")
        if self._unknown:
            place = "at" if dense else "in"
            counts = ("; " if dense else ", ").join(
                f"{name}: {count}, the first {place} {self._first[name]}"
                for name, count in self._unknown.items()
            )
            cells = "events without a number are unknown" if dense else "empty cells are unknown"
            texts.append(f"{cells}{'' if dense else ' samples'} ({counts})")
        period = self._period
        if self._periods > 1:
            period += f" (and {counted(self._periods - 1, 'more group')} with other times)"
        return [*texts, *filter(None, [self._unit, period])]
