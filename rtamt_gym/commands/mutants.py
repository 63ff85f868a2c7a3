"""The mutants of requirements, and the traces that kill them, for `rtamt monitor --mutants`."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import rtamt
from rtamt import InputError, RtamtError, Verdict
from rtamt.mutation import MUTATIONS
from rtamt_gym.options.command_line import Option, add_options, positive
from rtamt_gym.recorded.progress import progress
from rtamt_gym.results.warnings import VerdictWarning
from rtamt_gym.tables import shorten

if TYPE_CHECKING:
    from rtamt.mutation import Mutant
    from rtamt_gym.commands.judged import Judged
    from rtamt_gym.commands.traces import TracesAsked
    from rtamt_gym.results.matrix import Matrix
    from rtamt_gym.results.mutation import JudgedMutant, MutationScore
    from rtamt_gym.results.trial import Trial

_MOST: Final = 50
_SECONDS: Final = 2.0
"""The time limit of a solver for a trace that distinguishes a mutant from its requirement."""

_DECIDED: Final = {Verdict.SATISFIED, Verdict.VIOLATED}


def add_arguments(group: argparse._ArgumentGroup) -> None:
    """Add ``--mutants`` and its options."""
    add_options(
        group,
        Option(
            "--mutants",
            "change each requirement in one place, and report the mutants that the traces kill; "
            "verdicts then do not change the exit code",
        ),
        Option(
            "--max-mutants N",
            f"maximum number of mutants of each requirement (default: {_MOST})",
            read=positive,
        ),
        Option(
            "--mutation KIND",
            f"make only mutants of this kind: {', '.join(MUTATIONS)}",
            choices=tuple(MUTATIONS),
            repeat=True,
        ),
        Option(
            "--min-killed SHARE",
            "exit 3 if less than this share of a requirement's mutants is killed, such as 80%",
            read=_share,
        ),
        Option(
            "--write-killing-traces FOLDER",
            "write a CSV trace that would kill each surviving mutant; needs the extra check",
            read=Path,
        ),
    )


def _share(text: str) -> float:
    match = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*(%?)", text.strip(), re.ASCII)
    share = float(match[1]) / (100 if match[2] else 1) if match else math.nan
    if not 0 <= share <= 1:
        msg = f"expected a share from 0 to 1 or from 0% to 100%, such as 80%, got {text!r}"
        raise argparse.ArgumentTypeError(msg)
    return share


def check_arguments(options: argparse.Namespace, request: TracesAsked) -> None:
    """Refuse options that need ``--mutants`` without it, and options that exclude it."""
    if not options.mutants:
        for option in ("--max-mutants", "--mutation", "--min-killed", "--write-killing-traces"):
            if getattr(options, option.strip("-").replace("-", "_")) not in (None, []):
                raise InputError(f"{option} needs mutants; give --mutants with it")
        return
    for option in ("--junit", "--markdown"):
        if getattr(options, option.strip("-")) is not None:
            raise InputError(
                f"expected --mutants, which evaluates the traces as tests, or {option}, which "
                "writes their verdicts; run the command twice"
            )
    if options.write_killing_traces is not None and request.reading.dense:
        raise InputError(
            "expected --write-killing-traces or --dense: a solver finds traces of samples alone"
        )


class MutantWatch:
    """Judges the mutants of requirements on traces while these are read.

    If time bounds change by the period, the first trace sets the period. If other traces have
    another period, the mutants are made again, and all traces are read a second time. A mutant is
    not judged again after a trace has killed it.
    """

    def __init__(self, options: argparse.Namespace, request: TracesAsked) -> None:
        self._request = request
        self._most: int = options.max_mutants or _MOST
        self._kinds: Sequence[str] | None = options.mutation or None
        self._period: Fraction | None = None
        self._made: dict[str, list[Mutant]] = {}
        self._left_out: dict[str, int] = {}
        self._noticed: dict[str, dict[int, str]] = {}
        self._seen: dict[str, set[int]] = {}
        if request.reading.period is not None or request.reading.dense or not _timed(request):
            self._make(_period(request, ()))

    @property
    def ready(self) -> bool:
        """Whether the mutants are made."""
        return bool(self._made)

    def see(self, judged: Judged, row: Trial) -> dict[str, list[int]]:
        """Return the numbers of the mutants that a trace is the first to kill."""
        from rtamt_gym.recorded.judge import noticed

        if not self.ready and row.extent is not None:
            self._make(_period(self._request, [row]))
        if not self.ready or judged.trace is None:
            return {}
        killed: dict[str, list[int]] = {}
        for name, outcome in row.outcomes.items():
            left = [i for i in range(len(self._made[name])) if i not in self._seen[name]]
            if outcome.verdict not in _DECIDED or not left:
                continue
            mutants = [self._made[name][i] for i in left]
            kills = noticed(mutants, judged.trace, judged.period, self._request.reading)
            killed[name] = [i for i, kill in zip(left, kills, strict=True) if kill]
            self._seen[name].update(killed[name])
        return killed

    def take(self, row: Trial, killed: Mapping[str, Sequence[int]]) -> None:
        """Record the mutants that a trace kills."""
        for name, numbers in killed.items():
            for number in numbers:
                self._noticed[name].setdefault(number, row.name)

    def scores(self, matrix: Matrix) -> dict[str, MutationScore]:
        """Return the scores after all traces."""
        from rtamt_gym.results.mutation import MutationScore

        period = _period(self._request, matrix.rows)
        if not self.ready or period != self._period:
            self._again(matrix, period)
        total = sum(map(len, self._made.values()))
        total -= sum(map(len, self._noticed.values()))
        scores = {}
        with progress("comparing", total, " mutants") as advance:
            for name, mutants in self._made.items():
                judged = []
                for number, mutant in enumerate(mutants):
                    trace = self._noticed[name].get(number, "")
                    judged.append(_judged(self._request, mutant, period, trace))
                    advance(0 if trace else 1)
                left_out = self._left_out[name]
                capped = len(mutants) + left_out >= self._most
                scores[name] = MutationScore(tuple(judged), capped, left_out)
        return scores

    def _make(self, period: Fraction | None) -> None:
        """Make the mutants, and forget which mutants are killed."""
        self._period = period
        for name, spec in self._request.specs.items():
            mutants = rtamt.mutants(spec, period, kinds=self._kinds, limit=self._most)
            ahead = [
                mutant
                for mutant in mutants
                if mutant.specification.looks_ahead or self._request.reading.view == "step"
            ]
            self._made[name], self._left_out[name] = ahead, len(mutants) - len(ahead)
            self._noticed[name], self._seen[name] = {}, set()

    def _again(self, matrix: Matrix, period: Fraction | None) -> None:
        """Judge the mutants if no trace has a period."""
        from rtamt_gym.commands.judging import read_file

        self._make(period)
        with progress("judging mutants", len(matrix.rows), " traces") as advance:
            for row in matrix.rows:
                self.take(row, self.see(read_file(self._request, row.name), row))
                advance(1)


def _timed(request: TracesAsked) -> bool:
    return any(spec.timed for spec in request.specs.values())


def _period(request: TracesAsked, rows: Sequence[Trial]) -> Fraction | None:
    """Return the change of time bounds: a common multiple of the periods of the traces."""
    if request.reading.period is not None or request.reading.dense:
        return request.reading.seconds
    periods = [row.extent.period for row in rows if row.extent and row.extent.period]
    return reduce(_multiple, periods) if periods and _timed(request) else None


def _multiple(one: Fraction, other: Fraction) -> Fraction:
    """Return the least common multiple."""
    numerator = math.lcm(one.numerator * other.denominator, other.numerator * one.denominator)
    return Fraction(numerator, one.denominator * other.denominator)


def _judged(
    request: TracesAsked, mutant: Mutant, period: Fraction | None, trace: str
) -> JudgedMutant:
    """Return the fate of a mutant."""
    from rtamt_gym.results.mutation import JudgedMutant

    where = (mutant.kind, mutant.line, mutant.column, mutant.before, mutant.after)
    formula = str(mutant.specification.standalone())
    if trace:
        return JudgedMutant(*where, formula, "noticed", trace)
    answer, why = _compared(request, mutant, period)
    if answer is None:
        return JudgedMutant(*where, formula, "unknown", why=why)
    if answer.answer == "yes" and answer.samples:
        why = f"no trace of up to {answer.samples} samples tells them apart; longer ones may"
        return JudgedMutant(*where, formula, "unknown", samples=answer.samples, why=why)
    if answer.answer == "yes":
        return JudgedMutant(*where, formula, "same")
    if answer.trace is None:
        return JudgedMutant(*where, formula, "unknown", why=answer.why)
    satisfies: dict[str, Literal["", "requirement", "mutant"]] = {
        "one": "requirement",
        "other": "mutant",
    }
    columns: Mapping[str, tuple[float, ...]]
    columns = {name: (*answer.trace.unrolled(name),) for name in answer.trace.columns}
    twice = {name: (*values, *values) for name, values in columns.items() if len(values) == 1}
    if twice and _differ(request, mutant, period, twice):
        columns = twice  # a file of one sample has no period
    text = satisfies.get(answer.satisfied, "")
    return JudgedMutant(*where, formula, "missed", apart=columns, satisfies=text)


def _compared(
    request: TracesAsked, mutant: Mutant, period: Fraction | None
) -> tuple[rtamt.checking.Equivalence | None, str]:
    """Return whether a mutant is equivalent; None and the reason if that is not known."""
    reading = request.reading
    if reading.dense:
        return None, "a solver compares samples, not dense time"
    if reading.semantics != "standard" or reading.align is not None:
        option = "--align" if reading.align is not None else "--semantics"
        return None, f"a solver does not know {option}"
    try:
        return rtamt.equivalent(
            *_both(request, mutant), period, end=reading.end, timeout=_SECONDS
        ), ""
    except ModuleNotFoundError as error:
        return None, str(error)
    except RtamtError as error:
        return None, str(error).partition("\n")[0]


def _differ(
    request: TracesAsked,
    mutant: Mutant,
    period: Fraction | None,
    columns: Mapping[str, Sequence[float]],
) -> bool:
    """Return whether requirement and mutant have different verdicts on a trace."""
    verdicts = [
        rtamt.judge(spec, columns, period, request.reading.end).verdict
        for spec in _both(request, mutant)
    ]
    return {*verdicts} == _DECIDED


def _both(request: TracesAsked, mutant: Mutant) -> tuple[rtamt.Specification, rtamt.Specification]:
    """Return the requirement and the mutant in the form that is evaluated on traces."""
    one, other = mutant.requirement, mutant.specification
    return (one.always(), other.always()) if request.reading.view == "step" else (one, other)


def score_warnings(
    options: argparse.Namespace, scores: Mapping[str, MutationScore]
) -> Iterator[VerdictWarning]:
    """Yield the warning on surviving mutants, which fails below ``--min-killed``."""
    from rtamt_gym.results.mutation import percent, score_text

    least = options.min_killed
    for name, score in scores.items():
        if score.share is not None and score.share < 1:
            fails = least is not None and score.share < least
            below = f", which is {percent(score.share)}" if fails else ""
            yield VerdictWarning(f"{score_text(name, score)}{below}", fails=fails)
    reasons = {m.why for score in scores.values() for m in score.mutants if m.says == "unknown"}
    for why in sorted(reasons):
        yield VerdictWarning(f"not known whether mutants differ: {shorten(why, 200)}")


def write_apart(
    scores: Mapping[str, MutationScore], request: TracesAsked, matrix: Matrix, folder: Path
) -> str:
    """Write traces that kill the survivors; return a line about them.

    They have the columns of their requirement, and a column of times if the traces have one.
    """
    from rtamt_gym.commands.example_traces import write_samples

    period = None if request.reading.period is not None else _period(request, matrix.rows)
    written = 0
    for name, score in scores.items():
        for number, mutant in enumerate(score.mutants, 1):
            if not mutant.apart:
                continue
            columns = {
                request.columns.signals.get(v, v): value for v, value in mutant.apart.items()
            }
            if period is not None:
                count = len(next(iter(columns.values())))
                columns = {"time": tuple(float(i * period) for i in range(count)), **columns}
            write_samples(folder, f"{name}-{number}", columns)
            written += 1
    return f"traces that kill surviving mutants: {written} in {folder}\n"
