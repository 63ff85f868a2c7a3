"""The samples of vectorized monitors, read as an array with a row for each batch entry."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.errors import InputError, InputTypeError, StateError, name_text
from rtamt.inputs.arrays import Floats, array_of_numbers, kind_of
from rtamt.inputs.between import UncertainValue, halves, out_of_order
from rtamt.inputs.frames import named_columns
from rtamt.inputs.samples import NanPolicy, SampleReader, listed, wrong_shape
from rtamt.program.memory import limit_episode
from rtamt.program.program import Program

Entries = NDArray[np.bool_]
"""A mask of batch entries."""


def numbers_of(mask: Entries | None, num: int) -> Sequence[int]:
    """Return the numbers of the batch entries in a mask; None: all."""
    if mask is None:
        return range(num)
    entries: list[int] = np.flatnonzero(mask).tolist()
    return entries


class BatchReader:
    """Reads samples of many batch entries, and masks of the entries that take them.

    Both back-ends use it; the C++ back-end for rare argument forms and for every error.
    """

    __slots__ = ("_bounds", "_nan", "_num", "_program", "intervals_fit")

    def __init__(self, program: Program, num: int, nan: NanPolicy, *, bounds: bool = False) -> None:
        SampleReader(program, nan, bounds=bounds)  # checks the policy
        self._program = program
        self._num = num
        self._nan = nan
        self._bounds = bounds
        self.intervals_fit = True

    def update(self, batch: Any, /, values: ArrayLike = (), *args: Any, **named: Any) -> Floats:  # noqa: ANN401 - a machine, and what it takes
        """Update a batch with a sample by name, or refuse wrong arguments."""
        arguments = ("mask", "upper") if self._bounds else ("mask",)
        others = dict(zip(arguments, args, strict=False))
        if len(args) > len(arguments) or others.keys() & named.keys():
            raise TypeError(f"update() takes values, {' and '.join(arguments)}, each once")
        others |= {name: named.pop(name) for name in arguments if name in named}
        if others.get("upper") is not None:
            raise InputError(
                "expected an array together with upper=; pass an uncertain value by name, as in "
                "update(x=UncertainValue(lower, upper))"
            )
        if not isinstance(values, tuple) or values:
            raise InputError(
                "expected values by position or by keyword, got both: an array and "
                f"{', '.join(named)}{listed(self._program.inputs)}"
            )

        def held(column: int, default: float) -> Floats:
            return self._held(batch, column, default)

        least, greatest = self.named(named, ("values", *arguments), held)
        mask = others.get("mask")
        result: Floats
        result = batch.update(least, mask, greatest) if self._bounds else batch.update(least, mask)
        return result

    def _held(self, batch: Any, column: int, default: float) -> Floats:  # noqa: ANN401 - a machine
        """Return the value of an absent variable with a default: its last one in each entry."""
        begun = batch.samples > 0
        if self._bounds and (unknown := begun & batch.unknown[:, column]).any():
            raise InputError(
                f"expected a value for '{self._program.inputs[column]}': batch entry "
                f"{unknown.argmax()} has no known last value"
            )
        values: Floats = np.where(begun, batch.inputs[:, column], default)
        return values

    def entry(self, entry: int) -> SampleReader:
        """Return the reader of one batch entry, whose errors name it."""
        return SampleReader(self._program, self._nan, entry, bounds=self._bounds)

    def values(self, values: ArrayLike) -> Floats:
        """Return the values as a contiguous array of shape (entries, variables)."""
        names = self._program.inputs
        self._refuse_named(values, names)
        table = array_of_numbers(values, "the batch")
        if table.shape != (self._num, len(names)):
            hint = "; batch entries outside the mask need rows too"
            raise wrong_shape(table, str(self._num), names, "a row for each batch entry and ", hint)
        return np.require(table, requirements=["C", "ALIGNED"])

    def _refuse_named(self, values: object, names: Sequence[str]) -> None:
        """Refuse named columns, which have no order, unless they match the variables."""
        data: Any = named_columns(values)
        if not hasattr(data, "keys"):
            return
        columns = [name_text(name) for name in data.keys()]  # noqa: SIM118 - of a data frame
        if isinstance(data, Mapping) or (columns != [*names] and {*columns} & {*names}):
            raise InputTypeError(
                f"expected an array with a row for each batch entry, got {kind_of(values)} with "
                "named columns; pass the columns by name, as in update(**columns)"
            )

    def named(
        self,
        named: Mapping[str, object],
        arguments: Sequence[str],
        held: Callable[[int, float], Floats],
    ) -> tuple[Floats, Floats | None]:
        """Return the smallest and the largest values, of shape (entries, variables).

        The second array is None if all values are known. ``arguments`` are names that no variable
        may have, and ``held`` returns the values of an absent variable from its column and default.
        """
        names = self._program.inputs
        if taken := next((name for name in names if name in arguments), None):
            raise InputError(
                f"variable '{taken}' has the name of an argument of update; pass an array of shape "
                f"({self._num}, {len(names)}), with columns in the order {', '.join(names)}"
            )
        reader = SampleReader(self._program, self._nan, bounds=self._bounds)
        tables = []
        for half in halves(named) if self._bounds else [named]:
            columns, defaults = reader.lines(half)
            for name, column in columns.items():
                if len(column) != self._num:
                    raise InputError(
                        f"expected {self._num} values of '{name}', one for each batch entry, got "
                        f"{len(column)}; entries outside the mask need values too"
                    )
            columns |= {name: held(names.index(name), value) for name, value in defaults.items()}
            rows = [columns[name] for name in names]
            tables.append(np.column_stack(rows) if rows else np.empty((self._num, 0)))
        return tables[0], tables[1] if len(tables) > 1 else None

    def mask(self, mask: ArrayLike | None) -> Entries | None:
        """Return the mask as a contiguous array of booleans; None: all entries."""
        return None if mask is None else self._booleans(mask)

    def _booleans(self, mask: ArrayLike) -> Entries:
        try:
            chosen = np.asarray(mask)
        except ValueError as ragged:
            raise InputTypeError(
                f"expected a mask of {self._num} booleans, got {kind_of(mask)}"
            ) from ragged
        if chosen.dtype != np.bool_:
            raise InputTypeError(
                f"expected a mask of {self._num} booleans, got dtype {chosen.dtype}; "
                f"np.isin(range({self._num}), [0, 2]) makes a mask from indices"
            )
        if chosen.shape != (self._num,):
            raise InputError(
                f"expected a mask of {self._num} booleans, one for each batch entry, got shape "
                f"{chosen.shape}; without a mask, all entries are updated"
            )
        # numpy miscounts booleans whose bytes are not 0 or 1.
        booleans: Entries = np.ascontiguousarray(chosen).view(np.uint8) != 0
        return booleans

    def without_nan(
        self, table: Floats, chosen: Entries | None, samples: NDArray[np.int64], inputs: Floats
    ) -> Floats:
        """Return the table after the nan policy; entries that are not chosen may keep their nan."""
        missing = np.isnan(table)
        if chosen is not None:
            missing &= self._booleans(chosen)[:, None]
        if not missing.any():
            return table
        refused = missing
        if self._nan == "hold":
            refused = missing & (samples == 0)[:, None]
        if refused.any():
            entry, variable = np.argwhere(refused)[0].tolist()
            reader = self.entry(entry)
            reader.refuse_nan(reader.variables[variable], int(samples[entry]))
        return np.where(missing, inputs, table)

    def ends(
        self,
        table: Floats,
        upper: Floats | None,
        chosen: Entries | None,
        samples: NDArray[np.int64],
        inputs: tuple[Floats, Floats],
    ) -> tuple[Floats, Floats]:
        """Return the smallest and largest values after the nan policy, one array if all are known.

        Without ``upper`` the table has known values. ``inputs`` has both ends of the last samples.
        """
        if upper is not None:
            if not self.intervals_fit:
                limit_episode(self._program, self._num, unknown=True)
            self._require_order(table, upper, chosen, samples)
            return table, upper
        if self._nan == "unknown":
            missing = np.isnan(table)
            return np.where(missing, -np.inf, table), np.where(missing, np.inf, table)
        least, greatest = (self.without_nan(table, chosen, samples, last) for last in inputs)
        return least, greatest

    def _require_order(
        self, lower: Floats, upper: Floats, chosen: Entries | None, samples: NDArray[np.int64]
    ) -> None:
        wrong = out_of_order(lower, upper)
        if chosen is not None:
            wrong &= self._booleans(chosen)[:, None]
        if not wrong.any():
            return
        entry, variable = np.argwhere(wrong)[0].tolist()
        least, greatest = float(lower[entry, variable]), float(upper[entry, variable])
        name = self._program.variables[variable]
        expected = f"numbers as ends of '{name}', and -inf and inf of what is not known"
        if least == least and greatest == greatest:  # noqa: PLR0124 - neither is nan
            expected = f"a lower end of '{name}' that is not above the upper one"
        raise InputError(
            f"expected {expected}, got {least!r} and {greatest!r} at sample {samples[entry]} of "
            f"batch entry {entry}"
        )

    def refuse(self, values: Sequence[float | UncertainValue], sample: int, entry: int) -> NoReturn:
        """Raise the error that names the first term which is nan in an entry's sample."""
        self.entry(entry).refuse(values, sample)

    def refuse_update(self, entry: int) -> NoReturn:
        """Raise the error that refuses a sample of a finished episode."""
        raise StateError(
            f"the episode of batch entry {entry} is finished; reset it before its next update, or "
            "exclude it with a mask"
        )

    def refuse_finish(self, entry: int) -> NoReturn:
        """Raise the error that refuses to finish an episode without a sample."""
        raise StateError(
            f"finish() needs at least one sample, batch entry {entry} got 0 since its reset; "
            "exclude it with a mask"
        )
