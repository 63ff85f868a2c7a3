"""`--success`: readings of an environment's own flag of success, beside other requirements."""

from __future__ import annotations

import argparse
import copy
import math
from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

import rtamt
from rtamt import InputError, Verdict
from rtamt_gym.checks.names import listing
from rtamt_gym.options.command_line import Option
from rtamt_gym.options.evaluation import seconds_of
from rtamt_gym.results.warnings import VerdictWarning
from rtamt_gym.success import readings
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rtamt_gym.results.table import Results
    from rtamt_gym.signals.signals import SignalLike

_FLAG: Final = "success"
"""The variable that reads the flag; what its readings are called begins with it."""

_KEYS: Final = ("success", "is_success")
"""The keys under which environments have such a flag."""

_HOLD: Final = Fraction(1, 2)
"""Seconds that are held, if nothing is said."""

_NAMED: Final = 5
"""How many episodes are named."""


SUCCESS = (
    Option(
        "--success",
        "also evaluate the environment's own success flag: true at any step, at the last step, "
        "held for a time, and kept for that time until the end",
    ),
    Option(
        "--success-key KEY",
        "the key of the flag in info",
        usual="success or is_success, whichever exists",
    ),
    Option(
        "--hold TIME",
        "the time of held and kept, such as 2s",
        usual="500ms, or the next multiple of a step",
    ),
)


def check_success(options: argparse.Namespace) -> None:
    """Refuse ``--success-key`` and ``--hold`` without ``--success``."""
    for name in ("success_key", "hold"):
        if getattr(options, name) is not None and not options.success:
            raise InputError(f"--{name.replace('_', '-')} needs --success")


def success_requirements(
    options: argparse.Namespace,
    specs: Mapping[str, rtamt.Specification],
    period: rtamt.typing.Period | None,
) -> dict[str, rtamt.Specification]:
    """Return the specifications, and the requirements of the success flag if there is one.

    Args:
        options: The arguments of the command.
        specs: The specifications.
        period: Seconds between samples, of which the time is the next multiple where none is given.
    """
    if not options.success:
        return dict(specs)
    formulas = readings(_FLAG, options.hold or _hold(period))
    requirements = {
        f"{_FLAG}.{name}": rtamt.Specification.of(formula) for name, formula in formulas.items()
    }
    for name in requirements:
        if name in specs:
            raise InputError(f"expected one specification {name!r}, got two; rename one")
    return {**specs, **requirements}


def _hold(period: rtamt.typing.Period | None) -> str:
    """Return the default time as a text with its unit."""
    step = seconds_of(period)
    length = _HOLD if step is None else math.ceil(_HOLD / step) * step
    return f"{float(length * 1000):.12g}ms"


def flag_signal(
    options: argparse.Namespace,
    env: Any,  # noqa: ANN401 - an environment
    signals: Mapping[str, SignalLike],
) -> dict[str, SignalLike]:
    """Return the signals with the success flag, unless a signal has its name.

    Which key of info the flag is, a reset and a step say: the price is one of each.
    """
    if not options.success or _FLAG in signals:
        return dict(signals)
    key = options.success_key
    if key is None:
        _, info = env.reset(seed=0)
        *_, last = env.step(copy.deepcopy(env.action_space).sample())
        keys = {**info, **last}
        there = [each for each in _KEYS if each in keys]
        if len(there) != 1:
            got = "both of them" if there else f"{listing(keys) if keys else 'no key at all'}"
            raise InputError(
                f"--success: expected {' or '.join(_KEYS)} in the info of a step, got {got}; name "
                "another key with --success-key KEY, or read a signal with --signal "
                "success=SELECTOR"
            )
        key = there[0]
    return {**signals, _FLAG: (f"info[{key!r}]", 0.0)}


def not_kept(results: Results) -> list[VerdictWarning]:
    """Return the warnings on episodes that succeed at some step, and lose it."""
    lost = [
        row.seed
        for row in results
        if _satisfies(row, f"{_FLAG}.any") and not _satisfies(row, f"{_FLAG}.kept")
    ]
    if not lost:
        return []
    named = ", ".join(map(str, lost[:_NAMED])) + (", ..." if len(lost) > _NAMED else "")
    seeds = "seed" if len(lost) == 1 else "seeds"
    return [
        VerdictWarning(
            f"success at some step, and not kept: {len(lost)} of "
            f"{counted(len(results), 'episode')}, {seeds} {named}"
        )
    ]


def _satisfies(row: Any, name: str) -> bool:  # noqa: ANN401 - a `Trial`
    judged = row.judged(name)
    return judged is not None and judged.verdict is Verdict.SATISFIED
