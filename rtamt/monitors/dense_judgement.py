"""The verdict on a whole trace in dense time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Unpack

from rtamt.inputs.events import EventsLike, Until
from rtamt.machines.backend import BACKENDS
from rtamt.machines.dense.outlook import DenseOutlook
from rtamt.machines.dense.rows import dense_of, rows_of, unknown_of
from rtamt.machines.protocols import End
from rtamt.machines.readout import verdict_of
from rtamt.monitors.asked import Evidence
from rtamt.monitors.dense_asked import DenseAsked, DenseQuestion, dense_evidence
from rtamt.monitors.dense_untested import found_untested_dense
from rtamt.monitors.judgement import Judgement
from rtamt.monitors.monitor import Verdict
from rtamt.monitors.options import (
    EventOptions,
    Spec,
    checked_end,
    compiled_dense,
    event_reader,
    listed_in_signature,
)
from rtamt.monitors.untested import Untested
from rtamt.program.dense_regions import compile_regions
from rtamt.program.timing import Period

__all__ = ["judge_dense"]


@listed_in_signature(EventOptions)
def judge_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    end: End = "cut",
    *,
    until: Until | None = None,
    resolution: Period = "1ns",
    **options: Unpack[EventOptions],
) -> Judgement:
    """The verdict on a whole trace in dense time, by what its end means.

    It is about the first time at which all variables are known, and exact at that instant: values
    at single instants count, those inside nested formulas too, which `evaluate_dense` leaves out.
    The trace ends at the earliest of the variables' last events, an instant that is known. If other
    variables have later events, the text of the result names the variable that ends the trace, and
    ``until`` holds its last value. Invariants are written ``always(...)``. The attributes
    `untested`, `decided_at`, `asked` and `vacuous` of the result cost extra, when they are first
    asked for.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `evaluate_dense`; a value may also be a `Between`.
        end: As for `judge`: ``"complete"``, ``"cut"`` or ``"open"``.
        until: A time up to which the last value of each variable holds, as if an event at that time
            repeated it; ``"latest"`` for the time of the last event of all variables of the
            formula. Beyond ``max_gap`` the value is unknown. None: the trace ends with the earliest
            of the last events.
        resolution: As for `DenseMonitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`; ``nan``
            and ``max_gap``, as for `DenseEpisodeMonitor`.

    Returns:
        The judgement. Its ``decided_at`` is a time of the kind of the events' times,
        `numpy.datetime64` too; ``untested`` is in seconds, for dates since 1970.

    Raises:
        SpecificationError: As for `evaluate_dense`.
        InputError: As for `evaluate_dense`; on another reading of the end; on a time ``until``
            before the last event of every variable; and on a trace that with the bounds of the
            formula lasts 2^62 ticks or more.
        InputTypeError: As for `evaluate_dense`.

    Example:
        >>> trace = {"req": [(0, 0), (1, 4), (1.5, 0), (6, 0)], "gnt": [(0, 0), (2.25, 5), (6, 5)]}
        >>> judge_dense("always(req >= 3 implies eventually[0:2](gnt >= 3))", trace).verdict.name
        'SATISFIED'
        >>> print(judge_dense("always[0:8](gnt < 9)", trace))
        UNDECIDED: always[0:8](gnt < 9)
        robustness 4, bounds -inf to 4 under end="cut"
        always[0:8](gnt < 9): not recorded: 6 s to 8 s
        if the trace is all there is, end="complete" says SATISFIED
        >>> print(judge_dense("always(req >= 3 implies eventually[0:2](gnt >= 3))", trace).asked[0])
        asked 1x, first at time 1

        A value that is written once holds to the end of the others:

        >>> flight = {"z": [(0, -10), (6, -500), (9, -10)], "home": [(0, 0)]}
        >>> print(judge_dense("always(z - home > -100)", flight))
        SATISFIED: always(z - home > -100)
        robustness 90, bounds 90 to 90 under end="cut"
        the trace ends at time 0 with the last event of 'home' and leaves out 2 later
            events; until="latest" holds its value
        >>> judge_dense("always(z - home > -100)", flight, until="latest").verdict.name
        'VIOLATED'

    Source: see `DenseMonitor`.
    """
    reading = checked_end(end)
    specification, interface, backend, whole = compiled_dense(
        judge_dense, spec, resolution, options, online=False, bounds=True
    )
    regions = compile_regions(specification, whole.resolution, interface=interface)
    make = BACKENDS[backend].dense_episode_machine
    reader = event_reader(dense_of(regions), options)
    given = reader.whole(signals)
    if until is not None:
        given = reader.held(given, until)
    machine = make(regions, reader)
    machine.run(given)
    decided = verdict_of(machine.lower, machine.upper) != 0
    complete = machine.complete()
    terms = BACKENDS[backend].term_columns, BACKENDS[backend].term_ranges
    machine.finish(reading)
    lower, upper, span = machine.lower, machine.upper, machine.span

    def untested() -> tuple[Untested, ...]:
        if reading == "complete" or verdict_of(lower, upper) != 0:
            return ()
        begin, last, rows = rows_of(regions, given, reader, terms)
        outlook = DenseOutlook(regions.program, rows, last, cut=reading == "cut")
        return found_untested_dense(outlook, begin, whole.resolution, cut=reading == "cut")

    def decided_at() -> float | None:
        if not decided:
            return None
        again = make(regions, reader)
        again.run(given, decided=True)
        return again.decided_at

    def evidence(verdict: Verdict) -> Evidence[DenseAsked]:
        its = specification, interface, reading, regions, given, span, reader, backend
        question = DenseQuestion(*its)
        return dense_evidence(question, satisfied=verdict is Verdict.SATISFIED)

    return Judgement.of(
        (machine.robustness, lower, upper),
        reading,
        str(specification.formula),
        Verdict(verdict_of(*complete)),
        untested,
        decided_at,
        evidence,
        unknown_of(given, reader),
        lambda: reader.early_end(given),
    )
