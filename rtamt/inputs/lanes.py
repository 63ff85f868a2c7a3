"""From what a caller hands to monitors in lockstep to an array of samples, a row for each lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError, StateError
from rtamt.inputs.samples import NanPolicy, SampleReader, array_of_numbers
from rtamt.program.program import Program

__all__ = ["Floats", "LaneReader", "Lanes"]

Floats = NDArray[np.float64]
Lanes = NDArray[np.bool_]
"""Which lanes are meant."""


class LaneReader:
    """Reads samples of many lanes, and which lanes take one.

    Both back-ends use it, the native one for what is rare and for every message.

    Args:
        program: Says which variables there are and which terms can fail.
        num: How many lanes.
        nan: ``"raise"`` refuses a nan; ``"hold"`` keeps the variable's last value in that lane.
    """

    __slots__ = ("_nan", "_num", "_program")

    def __init__(self, program: Program, num: int, nan: NanPolicy) -> None:
        SampleReader(program, nan)  # which checks the policy
        self._program = program
        self._num = num
        self._nan = nan

    def lane(self, lane: int) -> SampleReader:
        """The reader of one lane: its messages name the lane."""
        return SampleReader(self._program, self._nan, lane)

    def values(self, values: ArrayLike) -> Floats:
        """An array of shape (lanes, variables), row behind row; the caller's own if it is one."""
        table = array_of_numbers(values, "the lanes")
        names = self._program.variables
        if table.shape != (self._num, len(names)):
            columns = f"a column for each of {', '.join(names)}" if names else "no column"
            msg = (
                f"expected an array of shape ({self._num}, {len(names)}), a row for each lane and "
                f"{columns}, got shape {table.shape}; lanes that a mask leaves out have rows too"
            )
            raise InputError(msg)
        return np.ascontiguousarray(table)

    def mask(self, mask: ArrayLike | None) -> Lanes | None:
        """One boolean for each lane, one behind the other; None: all lanes."""
        if mask is None:
            return None
        chosen = np.asarray(mask)
        if chosen.dtype != np.bool_:
            msg = (
                f"expected a mask of {self._num} booleans, got dtype {chosen.dtype}; "
                f"np.isin(range({self._num}), [0, 2]) makes one of numbers of lanes"
            )
            raise InputTypeError(msg)
        if chosen.shape != (self._num,):
            msg = (
                f"expected a mask of {self._num} booleans, one for each lane, "
                f"got shape {chosen.shape}; without a mask all lanes are meant"
            )
            raise InputError(msg)
        return np.ascontiguousarray(chosen)

    def without_nan(
        self, table: Floats, chosen: Lanes | None, samples: NDArray[np.int64], inputs: Floats
    ) -> Floats:
        """The samples as the nan policy has them; lanes that are not chosen may keep their nan.

        Args:
            table: A row for each lane.
            chosen: The lanes that take their sample; None: all.
            samples: How many each lane has taken.
            inputs: The last sample of every lane that has taken any.

        Raises:
            InputError: Naming the variable, the lane and its sample.
        """
        missing = np.isnan(table)
        if chosen is not None:
            missing &= chosen[:, None]
        if not missing.any():
            return table
        refused = missing
        if self._nan == "hold":
            refused = missing & (samples == 0)[:, None]
        if refused.any():
            lane, variable = np.argwhere(refused)[0].tolist()
            reader = self.lane(lane)
            reader.refuse_nan(reader.variables[variable], int(samples[lane]))
        return np.where(missing, inputs, table)

    def refuse(self, values: Sequence[float], sample: int, lane: int) -> NoReturn:
        """Raise the error of the first term that is nan in a lane's sample.

        Raises:
            InputError: Naming the term, the lane, its sample and the values.
        """
        self.lane(lane).refuse(values, sample)

    def refuse_update(self, lane: int) -> NoReturn:
        """Raise the error of an update of an episode that is finished.

        Raises:
            StateError: Always.
        """
        msg = (
            f"the episode of lane {lane} is finished; "
            "reset it before its next update, or leave it out with a mask"
        )
        raise StateError(msg)

    def refuse_finish(self, lane: int) -> NoReturn:
        """Raise the error of finishing an episode without a sample.

        Raises:
            StateError: Always.
        """
        msg = (
            f"finish() needs at least one sample, lane {lane} has got none since its reset; "
            "leave it out with a mask"
        )
        raise StateError(msg)
