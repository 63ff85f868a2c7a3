"""What the verdicts on many traces of one specification stand on, without judging them again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

from rtamt.errors import InputTypeError, brief
from rtamt.inputs.events import EventsLike
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.machines.backend import BACKENDS
from rtamt.machines.dense.rows import dense_of
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.asked import (
    Asked,
    Evidence,
    SampledQuestion,
    evidence_of,
    texts_of,
)
from rtamt.monitors.dense_asked import DenseAsked, DenseQuestion, dense_evidence
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.monitor import Verdict
from rtamt.monitors.options import (
    EventOptions,
    SampleOptions,
    Spec,
    checked_end,
    compiled,
    compiled_dense,
    event_reader,
    listed_in_signature,
)
from rtamt.program.dense_regions import compile_regions
from rtamt.program.timing import Period

__all__ = ["DenseImplications", "Implications"]


class Implications:
    """The implications of a specification; counts how often a trace puts them to the test.

    It is checked and compiled once, for many traces whose verdict is known: from `EpisodeMonitor`,
    from a lane of `VectorEpisodeMonitor`, or from `judge`, whose judgements have the same rows.
    Nothing is kept from one trace to the next.

    Attributes:
        texts: The implications that count, in positive position, as `Asked.text` has them; none: a
            verdict on the specification needs no answer.
        variables: The variables of the specification, in the order of columns.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `judge`.

    Raises:
        SpecificationError: As for `judge`.

    Example:
        >>> response = Implications("always(req >= 3 implies eventually[0:2](gnt >= 3))")
        >>> response.texts
        ('req >= 3 implies eventually[0:2](gnt >= 3)',)
        >>> found = response.evidence({"req": [0, 4, 0, 4], "gnt": [0, 0, 5, 5]})
        >>> print(found.asked[0], found.vacuous, found.never_asked)
        asked 2x, first at sample 1 False False
        >>> bool(Implications("always(gnt >= 3)"))
        False
    """

    __slots__ = ("_compiled", "_options", "_period", "_spec", "texts", "variables")

    @listed_in_signature(SampleOptions)
    def __init__(
        self, spec: Spec, period: Period | None = None, **options: Unpack[SampleOptions]
    ) -> None:
        self._compiled = compiled(Implications, spec, period, options, online=False)
        self._spec, *_, program = self._compiled
        self._period, self._options = period, options
        self.texts = texts_of(self._spec.formula)
        self.variables = program.inputs

    def __bool__(self) -> bool:
        return bool(self.texts)

    def __repr__(self) -> str:
        return f"<Implications of {self._spec.formula}: {len(self.texts)}>"

    def evidence(
        self,
        signals: TraceColumns,
        end: End = "complete",
        verdict: Verdict | None = None,
        *,
        n: int | None = None,
    ) -> Evidence[Asked]:
        """How often a trace puts the implications to the test; `judge` says the same of it.

        Args:
            signals: As for `judge`. It is not read where there is no implication.
            end: What lies behind the last sample, as for `judge`: the reading with which the
                monitor was finished.
            verdict: The verdict on the trace; it says whether an answer could be missing. None:
                the one that `judge` gives.
            n: The length, for a formula without variables.

        Raises:
            InputError: As `judge` does.
            InputTypeError: As `judge` does, and if ``verdict`` is none.
        """
        reading = checked_end(end)
        _check_verdict(verdict)
        if not self.texts:
            return _NOTHING
        specification, interface, backend, nan, seconds, program = self._compiled
        reader = SampleReader(program, nan, bounds=True)
        least, greatest, length = trace_between(reader, signals, n, self._period)
        columns = dict(zip(program.variables, zip(least, greatest, strict=True), strict=True))
        its = (specification, seconds, self._options.get("align"), interface, reading, length)
        question = SampledQuestion(*its, None, columns, nan, backend)
        satisfied = question.satisfied() if verdict is None else verdict is Verdict.SATISFIED
        return evidence_of(question, satisfied=satisfied)


class DenseImplications:
    """The implications of a specification; counts how often a trace in dense time asks them.

    It is the twin of `Implications`, over events.

    Attributes:
        texts: As for `Implications`.
        variables: The variables of the specification.

    Args:
        spec: Text, a formula, or a parsed specification.
        resolution: As for `DenseMonitor`.
        **options: As for `judge_dense`.

    Raises:
        SpecificationError: As for `judge_dense`.

    Example:
        >>> response = DenseImplications("always(req >= 3 implies eventually[0:2](gnt >= 3))")
        >>> trace = {"req": [(0, 0), (1, 4), (1.5, 0), (6, 0)], "gnt": [(0, 5), (6, 5)]}
        >>> print(response.evidence(trace).asked[0])
        asked 1x, first at time 1
    """

    __slots__ = ("_options", "_resolution", "_spec", "texts", "variables")

    @listed_in_signature(EventOptions)
    def __init__(
        self, spec: Spec, *, resolution: Period = "1ns", **options: Unpack[EventOptions]
    ) -> None:
        self._spec, *_, dense = compiled_dense(
            DenseImplications, spec, resolution, options, online=False, bounds=True
        )
        self._resolution, self._options = resolution, options
        self.texts = texts_of(self._spec.formula)
        self.variables = dense.program.variables

    def __bool__(self) -> bool:
        return bool(self.texts)

    def __repr__(self) -> str:
        return f"<DenseImplications of {self._spec.formula}: {len(self.texts)}>"

    def evidence(
        self,
        signals: Mapping[str, EventsLike],
        end: End = "complete",
        verdict: Verdict | None = None,
    ) -> Evidence[DenseAsked]:
        """How often a trace puts the implications to the test; `judge_dense` says the same of it.

        Args:
            signals: As for `judge_dense`. It is not read where there is no implication.
            end: As for `Implications.evidence`.
            verdict: As for `Implications.evidence`.

        Raises:
            InputError: As `judge_dense` does.
            InputTypeError: As `judge_dense` does, and if ``verdict`` is none.
        """
        reading = checked_end(end)
        _check_verdict(verdict)
        if not self.texts:
            return _NOTHING
        specification, interface, backend, whole = compiled_dense(
            DenseImplications,
            self._spec,
            self._resolution,
            self._options,
            online=False,
            bounds=True,
        )
        regions = compile_regions(specification, whole.resolution, interface=interface)
        reader = event_reader(dense_of(regions), self._options)
        given = reader.whole(signals)
        machine = BACKENDS[backend].dense_episode_machine(regions, reader)
        machine.run(given)  # refuses what judge_dense refuses
        machine.finish(reading)
        satisfied = verdict_of(machine.lower, machine.upper) if verdict is None else verdict
        its = specification, interface, reading, regions, given, machine.span, reader, backend
        question = DenseQuestion(*its)
        return dense_evidence(question, satisfied=satisfied > 0)


_NOTHING: Evidence[Any] = Evidence((), vacuous=False, never_asked=False)


def _check_verdict(verdict: object) -> None:
    if verdict is not None and not isinstance(verdict, Verdict):
        raise InputTypeError(f"expected an rtamt.Verdict, got {brief(verdict)}")
