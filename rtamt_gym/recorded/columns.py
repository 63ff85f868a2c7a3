"""Which columns of a recording are read, and how: names, times, separators, empty cells."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final, Literal, get_args

from rtamt import InputError
from rtamt.columns import NANOSECONDS
from rtamt.errors import nearest
from rtamt_gym.checks.numbers import read_floats

Missing = Literal["raise", "hold", "drop", "unknown"]
"""The treatment of empty cells: an error, the value before, no row, or an unknown value."""

Start = Literal["unknown", "known"]
"""How the time counts in which some variables of a requirement have no value yet."""

SameTime = Literal["first", "last"]
"""Which of several different records at one instant counts."""

DateOrder = Literal["dmy", "mdy"]
"""Whether 03/04/2024 is in April or in March."""

UNITS = NANOSECONDS
"""The units of a column of times, in nanoseconds."""

NEAR = 0.05
"""The default part of the period by which a sample may lie off the grid."""

_ROUNDED: Final = 1e-10
"""The part of ``max_gap`` by which a distance of rounded times may differ from it."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Options for reading the columns of a recording; the defaults suit a plain file.

    Attributes:
        signals: The column of each variable that has another name in the recording.
        time: The column of times. None: the column with a known name, such as ``time``,
            ``timestamp`` or ``Time [s]``.
        time_unit: The unit of the times, a name of `UNITS`. None: the unit in the name or the type
            of the column; otherwise, seconds.
        separator: The character between the cells of a text. None: the separator of its first line.
        decimal: The decimal mark of a text, ``.`` or ``,``. None: the mark that the cells of the
            file show.
        missing: The treatment of empty cells.
        jitter: The largest distance of a sample from the grid, as a part of the period, at which it
            counts as on the grid. A trace with samples farther off is resampled, and each value
            holds until the next. None: 0.05, and such a trace is an error.
        stale: The longest time in seconds for which a topic of a bag may be without a message.
            None: any time, and a note reports a long one.
        same_time: Which of several different records of one variable at one instant counts,
            ``"first"`` or ``"last"``. None: such records are an error; in bags and ULog files the
            last one counts.
        max_gap: The longest time in seconds for which a value holds until the next record of its
            variable; values are unknown in longer gaps. A number or text, such as ``"500ms"``.
            None: any time.
        starts: The values of variables before their first record, or without one, such as the
            defaults that a specification declares.
        defaults: The variables that have their default even if a column has nearly their name.
        no_defaults: Whether the defaults of all other variables are an error.
        skip: The number of lines of a text before the line of names, or before lines that are
            recognised as comments.
        start: The treatment of the time before all variables of a requirement have a value, in
            dense time and in bags. ``"unknown"``: the requirement is judged without this time, and
            with unknown values in it, and the worse verdict is reported. ``"known"``: this time is
            omitted.
        where: The required text of some columns; other rows are not read.
        by: The key columns of a table with several traces.
        long: The columns of names and of values, for a table with one event in each row. None: the
            columns ``variable`` and ``value``, if there are such columns.
        wide: The column of objects, which become columns such as ``speed.Ego``. None: a row holds
            the values of one object only.
        one_trace: Whether rows are one trace although they look like several objects or episodes.
        sorted: Whether the rows of each trace of a table follow each other, so that a Parquet file
            is read in parts.
        date_order: Whether dates such as 03/04/2024 have the day first (``"dmy"``) or the month
            (``"mdy"``). None: a date with an uncertain order is an error.

    Raises:
        InputError: If an attribute has an invalid value.
    """

    signals: Mapping[str, str] = field(default_factory=dict)
    time: str | None = None
    time_unit: str | None = None
    separator: str | None = None
    decimal: str | None = None
    missing: Missing = "raise"
    jitter: float | None = None
    stale: float | None = None
    same_time: SameTime | None = None
    max_gap: Fraction | None = None
    starts: Mapping[str, float] = field(default_factory=dict)
    defaults: Collection[str] = ()
    no_defaults: bool = False
    skip: int = 0
    start: Start = "unknown"
    where: Mapping[str, str] = field(default_factory=dict)
    by: Sequence[str] = ()
    long: tuple[str, str] | None = None
    wide: str | None = None
    one_trace: bool = False
    sorted: bool = False
    date_order: DateOrder | None = None

    def __post_init__(self) -> None:
        if self.max_gap is not None:
            object.__setattr__(self, "max_gap", read_seconds("--max-gap", str(self.max_gap)))
        for name, choices in _CHOICES.items():
            option, value = f"--{name.replace('_', '-')}", getattr(self, name)
            if value is not None and value not in choices:
                raise InputError(
                    f"{option}: expected {', '.join(choices)}, got {value!r}"
                    f"{nearest(value, choices)}"
                )
        if self.separator is not None and (len(self.separator) != 1 or self.separator in '"\r\n'):
            raise InputError(f"--separator: expected one character or tab, got {self.separator!r}")
        if self.separator is not None and self.separator == self.decimal:
            raise InputError(
                f"expected a --separator other than the --decimal mark, got {self.separator!r} as "
                "both"
            )
        if self.jitter is not None and not 0 <= self.jitter < 0.5:
            raise InputError(
                f"--jitter: expected less than half of the period, such as 5% or 0.05, "
                f"got {self.jitter:g}"
            )
        if self.stale is not None and not self.stale > 0:
            raise InputError(f"--stale: expected seconds, such as 0.5, got {self.stale:g}")

    @property
    def most(self) -> float:
        """The longest time in seconds for which a value holds: infinite without ``max_gap``.

        A distance of rounded times, such as 1.1 - 0.4, is not longer than the time that it shows.
        """
        return math.inf if self.max_gap is None else float(self.max_gap) * (1 + _ROUNDED)

    def column(self, variable: str) -> str:
        """Return the column of a variable."""
        return self.signals.get(variable, variable)


_CHOICES: Final[Mapping[str, Collection[str]]] = {
    "time_unit": UNITS,
    "decimal": (".", ","),
    "same_time": get_args(SameTime),
    "missing": get_args(Missing),
    "start": get_args(Start),
    "date_order": get_args(DateOrder),
}
"""The values of attributes of `Columns`."""


def read_columns(
    *,
    signals: Sequence[str] = (),
    separator: str | None = None,
    jitter: str | None = None,
    max_gap: str | None = None,
    where: Sequence[str] = (),
    by: Sequence[str] = (),
    long: str | None = None,
    wide: Sequence[str] = (),
    **others: Any,  # noqa: ANN401 - attributes of `Columns`
) -> Columns:
    r"""Read the arguments of a command: ``speed=Vehicle Speed [km/h]``, ``tab``, ``5%``."""
    named: dict[str, str] = {}
    for argument in signals:
        variable, _, column = (part.strip() for part in argument.partition("="))
        if not (variable and column):
            raise InputError(
                "--signal: expected VARIABLE=COLUMN, such as 'speed=Vehicle Speed [km/h]', "
                f"got {argument!r}"
            )
        if variable in named:
            raise InputError(f"--signal: expected one column for {variable!r}, got two")
        named[variable] = column
    rows: dict[str, str] = {}
    for argument in where:
        column, equals, value = (part.strip() for part in argument.partition("="))
        if not (column and equals):
            raise InputError(
                f"--where: expected COLUMN=VALUE, such as vehicle_id=3, got {argument!r}"
            )
        if rows.setdefault(column, value) != value:
            raise InputError(
                f"--where: expected one value of {column!r}, got {rows[column]!r} and {value!r}"
            )
    if len({*wide}) > 1:
        raise InputError(
            f"--wide: expected one column of objects, got {' and '.join(dict.fromkeys(wide))}"
        )
    return Columns(
        signals=named,
        separator="\t" if separator in ("tab", r"\t") else separator,
        jitter=_share(jitter),
        max_gap=None if max_gap is None else read_seconds("--max-gap", max_gap),
        where=rows,
        by=tuple(dict.fromkeys(by)),
        long=None if long is None else _pair(long),
        wide=wide[0] if wide else None,
        **others,
    )


def _pair(text: str) -> tuple[str, str]:
    """Read ``PID=VALUE``, the columns of names and of values."""
    names, _, values = (part.strip() for part in text.partition("="))
    if not (names and values) or names == values:
        raise InputError(f"--long: expected NAMES=VALUES, such as PID=VALUE, got {text!r}")
    return names, values


def read_seconds(option: str, text: str) -> Fraction:
    """Read a length of time: a number of seconds, or a number with a unit.

    Example:
        >>> read_seconds("--max-gap", "500ms"), read_seconds("--max-gap", "1.5 h")
        (Fraction(1, 2), Fraction(5400, 1))
    """
    match = _LENGTH.fullmatch(text.strip())
    unit = UNITS.get((match and match["unit"]) or "s")
    if match is None or unit is None or not Fraction(match["number"]) > 0:
        raise InputError(
            f"{option}: expected a time above 0, such as 10s, 500ms or 2h, got {text!r}; units are "
            f"{', '.join(UNITS)}"
        )
    return Fraction(match["number"]) * unit / UNITS["s"]


_LENGTH = re.compile(
    r"(?P<number>\d+/[1-9]\d*|(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,2})?)\s*(?P<unit>[a-z]*)",
    re.ASCII,
)


def _share(text: str | None) -> float | None:
    """Read ``5%`` or ``0.05``."""
    if text is None:
        return None
    read = read_floats([text.removesuffix("%")])
    if read is None:
        raise InputError(f"--jitter: expected a part of the period, such as 5%, got {text!r}")
    return read[0] / 100 if text.endswith("%") else read[0]


FieldPath = tuple[str | int, ...]
"""The fields and elements that lead to a value in a message."""

_STEP = re.compile(r"\.([A-Za-z]\w*)|\[(\d+)\]", re.ASCII)


def path_text(path: FieldPath) -> str:
    """Return the text of a path.

    Example:
        >>> path_text(("ranges", 0))
        'ranges[0]'
    """
    steps = (f".{step}" if isinstance(step, str) else f"[{step}]" for step in path)
    return "".join(steps).removeprefix(".")


class FieldError(InputError):
    """A path that does not lead to a number in the messages of a topic.

    Attributes:
        depth: The index of the wrong step of the path.
        reason: The reason, without a hint.
        hint: How to correct the path, or an empty string.
    """

    def __init__(self, depth: int, reason: str, hint: str = "") -> None:
        super().__init__(f"{reason}; {hint}" if hint else reason)
        self.depth, self.reason, self.hint = depth, reason, hint


def read_source(text: str) -> tuple[str, FieldPath]:
    """Return the topic, whose name has no dots, and the path after it, which may be empty.

    Example:
        >>> read_source("/robot0/scan.ranges[0]"), read_source("/speed")
        (('/robot0/scan', ('ranges', 0)), ('/speed', ()))
    """
    topic, dot, remainder = text.partition(".")
    if not dot:
        return topic, ()
    steps = _STEP.findall(f".{remainder}")
    path = tuple(int(element) if element else field for field, element in steps)
    if not (topic.strip("/") and path) or path_text(path) != remainder:
        raise InputError(
            "--signal: expected TOPIC.FIELD, such as /robot0/odom.twist.twist.linear.x, "
            f"got {text!r}"
        )
    return topic, path
