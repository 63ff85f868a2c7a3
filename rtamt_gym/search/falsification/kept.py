"""`KeptSearch`: the finished simulations of a search in a folder, so that it can go on later.

The optimizer is asked again, with the same seed, and gets the values that are kept for the points
that have run: so it goes on as if it had never been interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from rtamt import InputError
from rtamt_gym.inputs.case import Case
from rtamt_gym.play.folder import Folder
from rtamt_gym.play.record import Record
from rtamt_gym.results.provenance import Reuse
from rtamt_gym.results.trial import Trial

__all__ = ["KeptSearch", "Valued"]

_SECONDS: Final = 1.0
"""How long simulations wait for others to be written with: a kill loses that much."""

_SEARCH: Final = "search"
"""What is kept beside rows stands under this key."""


class Valued(NamedTuple):
    """A simulation of a search, with its value for the optimizer.

    Attributes:
        row: The simulation.
        least: The requirement with the smallest robustness, in units of the scales.
        value: This robustness, or a bound of it; the number that the optimizer gets.
        violated: The requirement that it violates; None if it violates none.
    """

    row: Trial
    least: str
    value: float
    violated: str | None


class KeptSearch:
    """The folder of a search.

    Attributes:
        scales: The scales that are kept; None: they are not known yet.
        reused: The numbers of the simulations that were stored before and were used.

    Args:
        folder: The folder, which this closes.
        optimizer: The name of the optimizer.
    """

    def __init__(self, folder: Folder, optimizer: str) -> None:
        self._folder = folder
        self._optimizer = optimizer
        self._known: dict[int, Valued] = {}
        self._waiting: dict[int, Valued] = {}
        self._since = time.monotonic()
        self.scales: Mapping[str, float] | None = None
        self.reused: set[int] = set()
        for numbers, rows, also in folder.parts():
            kept = also[_SEARCH]
            worth = zip(kept["least"], kept["values"], kept["violated"], strict=True)
            for number, row, valued in zip(numbers, rows, worth, strict=True):
                self._known[number] = Valued(row, *valued)
            self.scales = kept["scales"] if self.scales is None else self.scales
        self._stored = frozenset(self._known)

    def forget(self) -> None:
        """Discard simulations before the scales were known, unless one ended the search."""
        if all(valued.violated is None for valued in self._known.values()):
            self._known.clear()

    def known(self, number: int, case: Case) -> Valued | None:
        """The simulation of a number, if it is kept.

        Raises:
            InputError: If it had another case: the optimizer asks for other points than before.
        """
        result = self._known.get(number)
        if result is not None and result.row.case != case:
            raise InputError(
                f"{self._folder.path} holds another input as simulation {number + 1}: the "
                f"optimizer {self._optimizer} requests other points with the same seed, so that "
                "the search cannot resume; give another folder"
            )
        if result is not None and number in self._stored:
            self.reused.add(number)
        return result

    def reuse(self, total: int) -> Reuse:
        """Return how many of all simulations were stored before, for the provenance."""
        return self._folder.reuse(sum(number < total for number in self.reused), total)

    def add(self, found: Mapping[int, Valued]) -> None:
        """Keep finished simulations, by their numbers; write them soon."""
        self._waiting |= {i: valued for i, valued in found.items() if i not in self._known}
        if self._waiting and time.monotonic() - self._since > _SECONDS:
            self.write()

    def write(self) -> None:
        """Write the simulations that wait for it."""
        if self._waiting:
            result = sorted(self._waiting.items())
            rows = [(number, valued.row) for number, valued in result]
            self._folder.add(rows, self._also([valued for _, valued in result]))
            self._known |= self._waiting
            self._waiting.clear()
        self._since = time.monotonic()

    def finish(self, record: Record, found: list[Valued]) -> None:
        """Replace the parts by one file of all simulations of a search that is over.

        A search that was over sooner, as with a smaller budget, leaves all as it is.
        """
        self.write()
        more = any(number >= len(found) for number in self._known)
        if not more or found[-1].violated is not None:
            self._folder.finish(record, self._also(found))

    def close(self) -> None:
        """Write pending simulations, and release the folder."""
        try:
            self.write()
        finally:
            self._folder.close()

    def _also(self, found: list[Valued]) -> dict[str, Any]:
        return {
            _SEARCH: {
                "least": [valued.least for valued in found],
                "values": [valued.value for valued in found],
                "violated": [valued.violated for valued in found],
                "scales": None if self.scales is None else dict(self.scales),
            }
        }
