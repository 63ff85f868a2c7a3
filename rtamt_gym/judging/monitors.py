"""The monitors of a specification: for the episode, or for every instant with ``view="step"``."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

import rtamt
from rtamt import (
    EpisodeMonitor,
    Explanation,
    Formula,
    InputError,
    Monitor,
    RtamtError,
    Specification,
    VectorEpisodeMonitor,
    VectorMonitor,
    Verdict,
)
from rtamt.errors import Argument, nearest
from rtamt.typing import SemanticsName
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.formulas import require_whole_episode
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.shaping import Numeric

if TYPE_CHECKING:  # a recorded trace is judged without Gymnasium
    from rtamt_gym.judging.infos import Entrywise
    from rtamt_gym.signals.columns import Entries, Floats

_M = TypeVar("_M")

EXACT: tuple[SemanticsName, ...] = ("standard", "boolean")
"""The semantics in which every predicate counts, so that the sign of a robustness decides."""


class Owed(NamedTuple):
    """The clock of an operator, from 0 to 1, and the robustness of its operands; or arrays."""

    clock: Any
    margins: tuple[Any, ...]


class MonitorValues(NamedTuple, Generic[Numeric]):
    """The values of monitors after a sample: a float or a batch array per specification.

    Attributes:
        robustness: The robustness, of the newest instant with ``view="step"``.
        judged: The robustness of the episode.
        lower: The lower bounds of ``judged``.
        upper: The upper bounds of ``judged``.
        verdicts: The verdicts on the episode: 1 satisfied, -1 violated, 0 undecided.
        samples: Samples since the reset.
        owed: The pending obligations per specification; None if nothing tracks them.
    """

    robustness: list[Numeric]
    judged: list[Numeric]
    lower: list[Numeric]
    upper: list[Numeric]
    verdicts: list[Numeric]
    samples: Entrywise
    owed: list[list[Owed]] | None = None


class InstantMonitor:
    """The robustness of a formula at every instant, and a judge of ``always(formula)``.

    Before the first instant with a complete horizon, it is the robustness of the samples so far.
    """

    def __init__(self, spec: Specification, *, history: bool = False, **options: Any) -> None:  # noqa: ANN401 - of `EpisodeMonitor`
        self._instant = Monitor(spec, **options)
        self._sofar = EpisodeMonitor(spec, **options)
        self.judge = EpisodeMonitor(spec.always(), history=history, **options)
        self.robustness = math.nan

    def update(self, *values: float) -> float:
        """Take one sample; return the robustness."""
        robustness = self._instant.update(*values)
        self.judge.update(*values)
        if math.isnan(robustness):
            robustness = self._sofar.update(*values)
        self.robustness = robustness
        return robustness

    def reset(self) -> None:
        for monitor in self._parts():
            monitor.reset()

    def state(self) -> tuple[Any, ...]:
        return [machine_state(monitor) for monitor in self._parts()], self.robustness

    def restore(self, state: tuple[Any, ...]) -> None:
        states, self.robustness = state
        for monitor, part in zip(self._parts(), states, strict=True):
            monitor.__setstate__(part)

    def _parts(self) -> list[Monitor | EpisodeMonitor]:
        return [self._instant, self._sofar, self.judge]


class VectorInstantMonitor:
    """`InstantMonitor` for a batch, with an element per environment in each array."""

    def __init__(self, spec: Specification, num: int, **options: Any) -> None:  # noqa: ANN401
        self._instant = VectorMonitor(spec, num, **options)
        self._sofar = VectorEpisodeMonitor(spec, num, **options)
        self.judge = VectorEpisodeMonitor(spec.always(), num, **options)
        self.robustness = np.full(num, np.nan)

    def update(self, values: Floats, mask: Entries | None = None) -> Floats:
        """Take one sample of the environments in the mask; return the robustness."""
        robustness = self._instant.update(values, mask)
        self.judge.update(values, mask)
        early = np.isnan(robustness)
        if early.any():
            fed = early if mask is None else early & mask
            robustness = np.where(early, self._sofar.update(values, fed), robustness)
        self.robustness = robustness
        return robustness

    def reset(self, mask: Entries | None = None) -> None:
        for monitor in (self._instant, self._sofar, self.judge):
            monitor.reset(mask)


def make_monitors(
    specs: Mapping[str, Specification],
    reading: EvaluationOptions,
    of_episode: Callable[..., Any],
    of_instants: Callable[..., Any],
) -> dict[str, tuple[Any, Any]]:
    """Return the monitors of each specification: ``(robustness source, judge)``.

    The source takes the samples and has the robustness. The judge has bounds and verdict of the
    episode; it is the source itself, or the source updates it. ``of_episode`` and ``of_instants``
    make the source for the two views.

    Raises:
        SpecificationError: If a bound is not a multiple of the period; if the formula, or an
            operand of it, is about the first sample only and ``view`` is ``"episode"``; or if it
            has an unbounded future and ``view`` is ``"step"``.
        InputError: If inputs and outputs do not fit; a note names one of several specifications.
    """
    monitors: dict[str, tuple[Any, Any]] = {}
    view = reading.view
    if view == "step":
        require_known(reading, Argument("view", "step"))
    for name, options in reading.from_monitors(specs).items():
        spec = specs[name]
        if view == "episode":  # the first sample judges no episode
            require_whole_episode(f"specification {name!r}", spec, Argument("view", "step"))
        make = of_instants if view == "step" else of_episode
        try:
            source = make(spec, **options)
        except RtamtError as error:
            if len(specs) > 1:
                error.add_note(f"in specification {name!r}")
            raise
        monitors[name] = source, source.judge if view == "step" else source
    return monitors


def monitors_of_parts(
    specs: Mapping[str, Specification],
    parts: Sequence[Specification],
    reading: EvaluationOptions,
    make: Callable[..., _M],
) -> list[_M]:
    """Return monitors of parts of specifications, which use their inputs and outputs."""
    numbered = {str(number): part for number, part in enumerate(parts)}
    both = {f"specification {name}": spec for name, spec in specs.items()} | numbered
    options = reading.from_monitors(both)
    return [make(part, **options[number]) for number, part in numbered.items()]


def bare(spec: Specification, formula: Formula) -> Specification:
    """Return a part of a specification, without named formulas that its monitor would keep."""
    return replace(spec, formulas={}, uses={}).with_result(formula)


def require_known(reading: EvaluationOptions, argument: Argument) -> None:
    """Raise InputError if samples may be unknown, because an argument needs every robustness."""
    if reading.nan == "unknown":
        raise InputError(
            Argument("nan", "unknown"),
            " leaves the robustness between two bounds, and ",
            argument,
            " needs its value at every instant; expected ",
            Argument("nan", "raise"),
            " or ",
            Argument("nan", "hold"),
            " with it",
        )


def machine_state(monitor: Monitor | EpisodeMonitor) -> Any:  # noqa: ANN401 - opaque
    """Return the state of a monitor, for ``__setstate__`` with the same specification."""
    return monitor.__reduce__()[2]


def picked(
    indices: Sequence[int],
) -> tuple[int, Callable[[Sequence[float]], tuple[float, ...]] | None]:
    """Return the only index; for several, -1 and a function that selects these elements."""
    if len(indices) == 1:
        return indices[0], None
    return -1, itemgetter(*indices) if indices else lambda _: ()


def update_of(
    monitor: Monitor | EpisodeMonitor, names: Sequence[str]
) -> Callable[[Sequence[float]], float]:
    """Return the update function for samples with values in the order of these names."""
    index, several = picked([names.index(name) for name in monitor.variables])
    update = monitor.update
    if several is None:
        return lambda values: update(values[index])
    return lambda values: update(*several(values))


def columns_of(
    monitor: VectorMonitor | VectorEpisodeMonitor, names: Sequence[str]
) -> slice | list[int]:
    """Return the index of a monitor's columns in tables: a slice, without a copy, if adjacent."""
    columns = [names.index(name) for name in monitor.variables]
    if columns and columns == list(range(columns[0], columns[-1] + 1)):
        return slice(columns[0], columns[-1] + 1)
    return columns


def robustness_text(
    value: float, semantics: SemanticsName, verdict: Verdict, form: str = ".6g"
) -> str:
    """Return a robustness as text; for 0, with the meaning of its sign if it is known.

    Example:
        >>> undecided = rtamt.Verdict.UNDECIDED
        >>> [robustness_text(value, "standard", undecided) for value in (0.5, 0.0, -0.0)]
        ['0.5', '0, holds', '0, violated']
        >>> robustness_text(0.0, "input-vacuity", undecided)
        '0'
    """
    if value != 0.0:
        return format(value, form)
    if verdict == 0 and semantics not in EXACT:
        return "0"
    return "0, holds" if rtamt.holds(value) else "0, violated"


def described(spec: Specification, judge: EpisodeMonitor) -> str:
    """Return the formula of a judge, with its semantics if it is not the standard one."""
    interface = judge.interface
    if interface.semantics == "standard":
        return str(spec.formula)
    words = [str(interface.semantics)]
    words += [f"input {name}" for name in interface.inputs]
    words += [f"output {name}" for name in interface.outputs]
    return f"{spec.formula} under {', '.join(words)}"


def chosen(name: str | None, robustness: Mapping[str, float], violated_by: str | None) -> str:
    """Return the name of the specification to explain; raise InputError for an unknown one.

    Without a name it is the specification that was violated first; otherwise, the first with the
    minimum robustness.

    Example:
        >>> chosen(None, {"near": 0.5, "slow": 0.0, "upright": -0.0}, None)
        'upright'
    """
    if name is None:
        if violated_by is not None:
            return violated_by
        return min(robustness, key=lambda n: (robustness[n], math.copysign(1.0, robustness[n])))
    if name not in list(robustness):  # a list also compares unhashable values
        raise InputError(
            f"expected the name of a specification, got {name!r}; the specifications are "
            f"{listing(robustness)}{nearest(name, robustness)}"
        )
    return name


def titled(explanation: Explanation, name: str, formula: object) -> Explanation:
    """Return the explanation with a name for a formula that has none."""
    steps: Iterable[Any] = (
        replace(step, name=name) if step.formula is formula and step.name is None else step
        for step in explanation.steps
    )
    return replace(explanation, steps=tuple(steps))
