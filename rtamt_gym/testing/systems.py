"""The contract of a system."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import get_args

from rtamt import RtamtError
from rtamt_gym.checks.numbers import exact
from rtamt_gym.systems.system import System, SystemEnd
from rtamt_gym.testing.claims import claim

__all__ = ["check_system"]


def check_system(
    make: Callable[[], System],
    variables: Sequence[str],
    *,
    period: Fraction | None = None,
    steps: int = 10,
) -> None:
    """Checks that `simulate` and the searches can run a system.

    Its samples are numbers, in the order of the variables; a run that begins again gives the same,
    whole or after one that was left early; what it does not have is refused by name before a run
    begins; `close` may be called at any time.

    Args:
        make: Makes the system, ready to be bound.
        variables: Names that it has; two, if it has so many.
        period: The time between samples where the system needs to be told.
        steps: How many steps to make.

    Raises:
        AssertionError: If the contract is not kept.

    Example:
        >>> from rtamt_gym.systems.samples import SampleSource
        >>> check_system(lambda: SampleSource([{"x": 0.0, "y": 2}, {"x": 1.0, "y": 3}]), ["x", "y"])
    """
    system = make()
    claim(isinstance(system, System), f"expected a System, got {type(system).__name__}")
    claim(bool(system.name), "expected a name, got an empty one")
    known = system.period
    claim(known is None or 0 < known < math.inf, f"expected a period above 0, got {known}")
    claim(
        not system.needs_period or known is None,
        f"expected a period or the need of one, got both: {known} and {system.needs_period!r}",
    )
    names = list(variables)
    rows = _run(system, names, period, steps)
    claim(_run(make(), names, period, steps) == rows, "expected the same samples of every one")
    _run(system, names, period, 0)
    claim(
        _run(system, names, period, steps) == rows,
        "expected the same samples of a run that begins again after one that was left early",
    )
    backwards = _run(make(), names[::-1], period, steps)
    claim(
        [row[::-1] for row in backwards] == rows,
        f"expected values in the order of the variables {names[::-1]}, got {backwards[0]}",
    )
    _check_unknown(make(), names, period)


def _run(
    system: System, names: list[str], period: Fraction | None, steps: int
) -> list[list[float]]:
    """The samples of a run of at most so many steps."""
    system.bind(names, None, _period(system, period))
    try:
        rows = [[float(value) for value in system.start()]]
        claim(system.ended == "", f"expected a run that has begun, got {system.ended!r}")
        while len(rows) <= steps and (values := system.advance()) is not None:
            rows.append([float(value) for value in values])
            claim(system.ended in get_args(SystemEnd), f"got ended={system.ended!r}")
        if len(rows) <= steps:
            claim(system.ended != "", "expected `ended` to say how the system ended, got ''")
            claim(system.limit is None or len(rows) <= system.limit + 1, "got steps past the limit")
    finally:
        system.close()
    for row in rows:
        claim(len(row) == len(names), f"expected {len(names)} values, got {row}")
    return rows


def _period(system: System, given: Fraction | None) -> Fraction | None:
    """The time between samples as `simulate` gives it: the system's own, or the one it is told."""
    return given if system.period is None else exact(system.period)


def _check_unknown(system: System, names: list[str], period: Fraction | None) -> None:
    unknown = f"{names[0]}_that_is_not_there"
    try:
        system.bind([unknown], None, _period(system, period))
        system.start()
    except RtamtError as error:
        claim(unknown in str(error), f"expected an error that names {unknown!r}, got {error}")
    else:
        claim(holds=False, what=f"expected an error about {unknown!r}, got a sample")
    finally:
        system.close()
