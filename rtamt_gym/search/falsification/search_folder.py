"""`SearchFolder`: the finished simulations of a search in a folder, from which it can resume.

A resumed search starts the optimizer again with the same seed and returns the stored values for
points that have run. The optimizer then continues as if it had never been interrupted.
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

__all__ = ["SearchFolder", "ValuedTrial"]

_SECONDS: Final = 1.0
"""The time between writes; a killed process loses the simulations of this time."""

_SEARCH: Final = "search"
"""The key of the fields that are stored next to the rows."""


class ValuedTrial(NamedTuple):
    """A simulation of a search, with its value for the optimizer.

    Attributes:
        row: The simulation.
        least: The requirement with the smallest robustness, in units of the scales.
        value: This robustness, or a bound of it; the optimizer gets this number.
        violated: The requirement that it violates; None if it violates none.
    """

    row: Trial
    least: str
    value: float
    violated: str | None


class SearchFolder:
    """The folder of a search.

    Attributes:
        scales: The stored scales; None if they are not known yet.
        reused: The numbers of the stored simulations that were used.

    Args:
        folder: The folder; `close` closes it.
        optimizer: The name of the optimizer.
    """

    def __init__(self, folder: Folder, optimizer: str) -> None:
        self._folder = folder
        self._optimizer = optimizer
        self._known: dict[int, ValuedTrial] = {}
        self._waiting: dict[int, ValuedTrial] = {}
        self._since = time.monotonic()
        self.scales: Mapping[str, float] | None = None
        self.reused: set[int] = set()
        for numbers, rows, extra in folder.parts():
            fields = extra[_SEARCH]
            values = zip(fields["least"], fields["values"], fields["violated"], strict=True)
            for number, row, value in zip(numbers, rows, values, strict=True):
                self._known[number] = ValuedTrial(row, *value)
            self.scales = fields["scales"] if self.scales is None else self.scales
        self._stored = frozenset(self._known)

    def forget(self) -> None:
        """Discard simulations from before the scales were known, unless one ended the search."""
        if all(valued.violated is None for valued in self._known.values()):
            self._known.clear()

    def known(self, number: int, case: Case) -> ValuedTrial | None:
        """Return the stored simulation of a number, or None.

        Raises:
            InputError: If it has another case: the optimizer requests other points than before.
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

    def add(self, trials: Mapping[int, ValuedTrial]) -> None:
        """Store finished simulations by their numbers; write them after a second at most."""
        self._waiting |= {i: trial for i, trial in trials.items() if i not in self._known}
        if self._waiting and time.monotonic() - self._since > _SECONDS:
            self.write()

    def write(self) -> None:
        """Write pending simulations."""
        if self._waiting:
            trials = sorted(self._waiting.items())
            rows = [(number, trial.row) for number, trial in trials]
            self._folder.add(rows, self._fields([trial for _, trial in trials]))
            self._known |= self._waiting
            self._waiting.clear()
        self._since = time.monotonic()

    def finish(self, record: Record, trials: list[ValuedTrial]) -> None:
        """Replace the parts by one file with all simulations of a finished search.

        If the folder holds more simulations, as after a call with a smaller budget, it stays as it
        is.
        """
        self.write()
        more = any(number >= len(trials) for number in self._known)
        if not more or trials[-1].violated is not None:
            self._folder.finish(record, self._fields(trials))

    def close(self) -> None:
        """Write pending simulations, and release the folder."""
        try:
            self.write()
        finally:
            self._folder.close()

    def _fields(self, trials: list[ValuedTrial]) -> dict[str, Any]:
        return {
            _SEARCH: {
                "least": [trial.least for trial in trials],
                "values": [trial.value for trial in trials],
                "violated": [trial.violated for trial in trials],
                "scales": None if self.scales is None else dict(self.scales),
            }
        }
