"""`Run`: one run of a simulation under specifications; its JSON and its Parquet file."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import Explanation, InputError, Specification, Verdict, parse
from rtamt.monitors import TriggerCount
from rtamt.renamed import OldName
from rtamt.typing import Align, SemanticsName
from rtamt_gym import markup
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.monitors import chosen, robustness_text, titled
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.options.evaluation import View
from rtamt_gym.results.codec import VERSION, fraction_of, number_of, plain
from rtamt_gym.results.outcome import Outcome, triggers_of, verdict_text
from rtamt_gym.results.trial import STOPPED, RunEnd, Trial
from rtamt_gym.tables import sample_text

if TYPE_CHECKING:  # it is optional
    import pandas as pd

Floats = NDArray[np.float64]

CURVES = ("robustness", "lower", "upper")
"""The arrays of a history."""

_OF_OUTCOME: Final = ("decided_at", "ended_at", "triggers", "vacuous", "progress")
"""The fields of a history that are written as in its outcome."""

_KEYS: Final = {"histories": "courses"}
"""The keys in files of attributes with another name."""

_KEY = b"rtamt.run"
"""The key of the file's metadata, which stores as JSON everything except the arrays."""

Stop = Literal["violation", "decided", "known", "verdicts", "end"]
"""When to stop a run: at the first certain violation; also once every verdict is certain; also once
every robustness is known; only once every verdict is certain; or at its end."""


class _ComparesArrays:
    """A base of dataclasses with a comparison that handles arrays."""

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(getattr(self, item.name), getattr(other, item.name))
            for item in fields(self)  # type: ignore[arg-type]  # the subclasses are dataclasses
            if item.compare
        )

    __hash__ = None  # type: ignore[assignment]  # arrays have no hash


def _same(left: object, right: object) -> bool:
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return np.array_equal(left, right, equal_nan=True)
    if isinstance(left, Mapping) and isinstance(right, Mapping):
        return list(left) == list(right) and all(_same(left[key], right[key]) for key in left)
    return left == right


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class History(_ComparesArrays):
    """The history of one specification over a run: robustness and bounds at every sample.

    Attributes:
        formula: Its text.
        robustness: The robustness at every sample, if the run ended there.
        lower: The lower bound of the final robustness, at every sample.
        upper: The upper bound of the final robustness, at every sample.
        final: The robustness at the end.
        verdict: The verdict at the end.
        decided_at: The sample that decided the verdict, counted from the start of the episode;
            None if it is open, or if only the end decided it.
        unit: The unit of bounds in the formula without a unit.
        semantics: As for `rtamt.Monitor`.
        inputs: Variables that the system reads.
        outputs: Variables that the system sets.
        triggers: Its triggers, as in `Outcome.triggers`.
        vacuous: Whether it was vacuously satisfied.
        progress: Its progress through stages at the end, as in `Outcome.progress`.
        ended_at: The last sample, counted in the same way, if only the end decided the verdict;
            otherwise None.
    """

    formula: str
    robustness: Floats
    lower: Floats
    upper: Floats
    final: float
    verdict: Verdict
    decided_at: int | None
    unit: str = "s"
    semantics: SemanticsName = "standard"
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    triggers: tuple[TriggerCount | rtamt.dense.TriggerCount, ...] | None = None
    vacuous: bool = False
    progress: float | None = None
    ended_at: int | None = None

    asked = OldName("triggers")

    @property
    def verdicts(self) -> NDArray[np.int8]:
        """The verdict at every sample: -1 violated, 1 satisfied, 0 undecided."""
        return np.subtract(~np.signbit(self.lower), np.signbit(self.upper), dtype=np.int8)

    def final_text(self, form: str) -> str:
        """Format the robustness at the end; a 0 without a verdict states whether it holds."""
        text = robustness_text(self.final, self.semantics, self.verdict, form)
        return text if self.verdict == Verdict.UNDECIDED else text.partition(", ")[0]

    @property
    def specification(self) -> Specification:
        """The formula, parsed again."""
        return parse(self.formula, unit=self.unit)

    @property
    def interface(self) -> dict[str, Any]:
        """The semantics, the inputs and the outputs, as arguments of `rtamt.evaluate`."""
        return {"semantics": self.semantics, "inputs": self.inputs, "outputs": self.outputs}

    def outcome(self, period: Fraction | None) -> Outcome:
        """Return the outcome of the specification, without its history."""
        bounds = self.final, float(self.lower[-1]), float(self.upper[-1])
        result = Outcome.at(bounds, self.verdict, self.decided_at, period, ended=self.ended_at)
        return replace(result, triggers=self.triggers, vacuous=self.vacuous, progress=self.progress)

    def decided_text(self, period: Fraction | None) -> str:
        """Return when the verdict was decided: a time, a sample or "the end"; empty while open."""
        if self.decided_at is not None:
            return sample_text(self.decided_at, period)
        return "" if self.verdict is Verdict.UNDECIDED else "the end"

    def __repr__(self) -> str:
        decided = self.decided_text(None)
        when = f" at {decided}" if decided else ""
        verdict = verdict_text(self.verdict, self.final)
        return f"<History of {self.formula}: {verdict}{when}, robustness {self.final_text('.3g')}>"


class HistoriesOnDemand(Mapping[str, History]):
    """Histories that are computed when the first of them is read."""

    def __init__(self, names: tuple[str, ...], compute: Callable[[], dict[str, History]]) -> None:
        self._names = names
        self._compute: Callable[[], dict[str, History]] | None = compute
        self._histories: dict[str, History] = {}

    def __getitem__(self, name: str) -> History:
        return self._read()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return repr(self._read())

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (self._read(),)

    def _read(self) -> dict[str, History]:
        if self._compute is not None:
            self._histories, self._compute = self._compute(), None
        return self._histories


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTrace:
    """The samples of one simulation.

    Attributes:
        signals: The values of every variable, by name.
        period: Seconds between samples, or None.
    """

    signals: Mapping[str, Floats]
    period: Fraction | None

    @property
    def samples(self) -> int | None:
        """The number of samples; None without variables."""
        return next((len(values) for values in self.signals.values()), None)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Run(_ComparesArrays):
    """One run of a simulation under specifications; `simulate` makes it.

    Two runs are equal if they differ only in wall time.

    Attributes:
        system: Name of the system that ran.
        signals: The values of every variable and of every further recorded signal, from sample 0
            on.
        histories: The history of every specification, by its name.
        ended: Why the run is over: ``"violation"``, ``"decided"``, ``"known"``, ``"terminated"``,
            ``"truncated"`` or ``"duration"``; ``"error"`` of a run that an error carries.
        violated_by: The specification that was violated first, or None.
        period: Seconds between samples, or None.
        view: ``"episode"`` if formulas are about the run from sample 0 on, ``"step"`` if they are
            about every instant.
        stop: The option ``stop`` of `simulate`.
        limit: The maximum number of steps that it could have made, or None.
        seed: The seed, or None.
        label: The label, which names who acted; may be empty.
        wall_time: Seconds that it took, monitors included.
        align: How bounds that are not multiples of the period became samples, or None.
        first_sample: The number of the first recorded sample in its episode: 0, unless the run
            continues a `StepMonitor`. Then robustness, bounds and verdicts judge the whole episode,
            and the run has its samples from this one on.
        case: The `Case`, or None.
        reward: The sum of the rewards of an environment; None for another system.

    Example:
        >>> from rtamt_gym import simulate
        >>> levels = [{"level": x} for x in (1.0, 2.0, 4.0, 8.0)]
        >>> run = simulate(levels, {"dry": "always(level < 3)"}, period=0.5)
        >>> run
        <Run of samples: violation of dry at 1 s, 3 samples>
        >>> run.times, run.signals["level"]
        (array([0. , 0.5, 1. ]), array([1., 2., 4.]))
        >>> run.histories["dry"].robustness, run.histories["dry"].verdicts
        (array([ 2.,  1., -1.]), array([ 0,  0, -1], dtype=int8))
        >>> run.violated_by, run.violated_at
        ('dry', 2)
        >>> run.histories
        {'dry': <History of always(level < 3): VIOLATED at sample 2, robustness -1>}
        >>> run.replay()
        {'dry': array([-1., -1., -1.])}
    """

    system: str
    signals: Mapping[str, Floats]
    histories: Mapping[str, History]
    ended: RunEnd
    violated_by: str | None
    period: Fraction | None
    view: View
    stop: Stop
    limit: int | None
    seed: int | None
    label: str
    wall_time: float = field(compare=False)
    align: Align | None = None
    first_sample: int = 0
    case: Case | None = None
    reward: float | None = None

    courses = OldName("histories")

    def columns(self) -> dict[str, Floats]:
        """Return a table: ``time``, the signals, and three columns for every specification.

        These are ``robustness(NAME)``, ``lower(NAME)`` and ``upper(NAME)``. A signal named ``time``
        takes the place of the times, which follow from the period.
        """
        columns = {"time": self.times, **self.signals}
        for name, history in self.histories.items():
            columns |= {f"{curve}({name})": getattr(history, curve) for curve in CURVES}
        return columns

    @property
    def steps(self) -> int:
        """The number of steps: one less than the number of samples."""
        samples = next(iter(self.signals.values()), None)
        if samples is None:  # the specifications read nothing
            samples = next(iter(self.histories.values())).robustness
        return len(samples) - 1

    @property
    def last_sample(self) -> int:
        """The number of the last sample in its episode."""
        return self.first_sample + self.steps

    @property
    def duration(self) -> float:
        """Simulated time in seconds; without a period, the number of steps."""
        return float(self.steps * (self.period or 1))

    @property
    def times(self) -> Floats:
        """The time of every sample in seconds; without a period, its number."""
        period = self.period or Fraction(1)
        times: Floats = np.arange(self.first_sample, self.last_sample + 1, dtype=np.float64)
        return times * period.numerator / period.denominator

    @property
    def verdict(self) -> Verdict:
        """The verdict on all specifications together, their worst verdict."""
        return min(history.verdict for history in self.histories.values())

    @property
    def outcomes(self) -> dict[str, Outcome]:
        """The outcome of each specification, by name."""
        return {name: history.outcome(self.period) for name, history in self.histories.items()}

    def trial(self, case: Case | None = None, error: str = "") -> Trial:
        """Return the case and the outcomes, without the samples.

        Args:
            case: The inputs of the simulation. Default: the case of the run.
            error: The error that ended it, as text.
        """
        case = (self.case or Case({})) if case is None else case
        ended, wall = self.ended, self.wall_time
        return Trial(case, self.seed, self.outcomes, ended, self.duration, wall, error, self.reward)

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation, or None.

        It is the last sample if only the end decided it.
        """
        if self.violated_by is None:
            return None
        history = self.histories[self.violated_by]
        return history.ended_at if history.decided_at is None else history.decided_at

    @property
    def saved(self) -> int | None:
        """Steps from the stop to the limit; None if it was not stopped or has no limit."""
        if self.ended not in STOPPED or self.limit is None:
            return None
        return self.limit - self.steps

    def replay(self, specs: SpecsLike | None = None) -> dict[str, Floats]:
        """Evaluate specifications offline on the recorded signals, with `rtamt.evaluate`.

        For the run's own specifications, the first value equals the last monitored one. With
        ``view="step"`` the monitor has the same values, later by its latency; but the formulas
        ``always p`` and ``eventually p`` look back online and forward here, see `rtamt.Monitor`.

        Args:
            specs: Specifications that read the signals of the run, under the standard semantics;
                their bounds are rounded as the run's were. None: the run's own, under theirs.

        Returns:
            The robustness at every sample, by name of the specification.

        Raises:
            SpecificationError: As `rtamt.evaluate` does.
            InputError: If a specification reads a signal that the run does not have; if ``specs``
                is None and the run has not recorded its episode from sample 0 on.
        """
        interfaces: dict[str, dict[str, Any]] = {}
        if specs is None:
            self._check_whole("replay(specs)")
            interfaces = {name: history.interface for name, history in self.histories.items()}
            specs = {name: history.specification for name, history in self.histories.items()}
        loaded = load_specs(specs)
        for name, spec in loaded.items():
            for variable in spec.variables:
                if variable not in self.signals:
                    raise InputError(
                        f"specification {name!r} reads {variable!r}, which was not recorded; the "
                        f"signals of the run are {listing(self.signals)}"
                    )
        return {
            name: rtamt.evaluate(
                spec,
                self.signals,
                self.period,
                n=self.steps + 1,
                align=self.align,
                **interfaces.get(name, {}),
            )
            for name, spec in loaded.items()
        }

    def explain(self, name: str | None = None, *, sample: int | None = None) -> Explanation:
        """Return the sub-formulas and samples that decided the robustness of a specification.

        It is `rtamt.explain` of the recorded signals with the semantics, the period and the
        rounding of the run; ``print`` shows the path from the specification to the sample.

        Args:
            name: The specification. Default: the first violated specification; without a violation,
                the specification with the smallest robustness at the end.
            sample: The number of the sample to explain, from 0. Default: the whole run, that is
                sample 0, and with ``view="step"`` the worst of all samples (``always`` of the
                formula).

        Raises:
            InputError: If the run has no such specification or no such sample, or has not recorded
                its episode from sample 0 on.

        Example:
            >>> from rtamt_gym import simulate
            >>> levels = [{"level": x} for x in (1.0, 2.0, 4.0, 8.0)]
            >>> specs = {"dry": "always(level < 3)", "fills": "eventually(level > 1)"}
            >>> print(simulate(levels, specs, period=0.5).explain())
            robustness -1 at 0 s, decided by level < 3 at 1 s
            <BLANKLINE>
             at  value  formula
            0 s     -1  dry = always(level < 3)
            1 s     -1  level < 3
            1 s      4  level
        """
        self._check_whole("rtamt.explain(formula, run.signals, run.period)")
        histories = self.histories
        final = {key: history.final for key, history in histories.items()}
        name = chosen(name, final, self.violated_by)
        spec = histories[name].specification
        explanation = rtamt.explain(
            spec.always() if self.view == "step" and sample is None else spec,
            self.signals,
            self.period,
            sample=0 if sample is None else sample,
            n=self.steps + 1,
            align=self.align,
            **histories[name].interface,
        )
        return titled(explanation, name, spec.formula)

    def to_frame(self) -> pd.DataFrame:
        """Return the run as a data frame of pandas: a row for each sample, the columns of `save`.

        They are ``time``, the signals, and ``robustness(NAME)``, ``lower(NAME)``, ``upper(NAME)``
        of every specification. The index is the number of the sample, so
        ``frame.loc[run.violated_at]`` is the row of the violation. ``frame.attrs["view"]`` is the
        view: with ``"step"`` it is the robustness of the newest instant, and the bounds hold for
        all instants. ``frame.attrs["by_end"]``, if present, lists the specifications that only the
        end violates. Needs the extra ``pandas``.

        Example:
            >>> from rtamt_gym import simulate
            >>> levels = [{"level": x} for x in (1.0, 2.0, 4.0)]
            >>> frame = simulate(levels, {"dry": "always(level < 3)"}, period=0.5).to_frame()
            >>> frame[["time", "level", "robustness(dry)"]]
                    time  level  robustness(dry)
            sample
            0        0.0    1.0              2.0
            1        0.5    2.0              1.0
            2        1.0    4.0             -1.0
        """
        try:
            import pandas as pd
        except ModuleNotFoundError as error:
            raise naming_extra(error, "Run.to_frame") from error
        samples = pd.RangeIndex(self.first_sample, self.last_sample + 1, name="sample")
        frame = pd.DataFrame(self.columns(), index=samples)
        frame.attrs["view"] = self.view
        by_end = [name for name, outcome in self.outcomes.items() if outcome.by_end]
        if by_end:
            frame.attrs["by_end"] = by_end
        return frame

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draw signals, robustness, bounds and verdicts into a file: .png, .svg, .pdf.

        Raises:
            InputError: If the extension does not belong to a picture.
        """
        from rtamt_gym.drawing import check_format, save
        from rtamt_gym.play.plot import draw

        check_format(Path(path))
        save(draw([self]), Path(path))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a Parquet file: a row for each sample, with ``time`` and the signals first.

        Every reader of Parquet can read it, ``rtamt monitor`` too. Needs the extra ``files``.

        Raises:
            InputError: If the name does not end in ``.parquet``.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        path = Path(path)
        if path.suffix.lower() != ".parquet":
            raise InputError(
                f"cannot write {path}: expected a name that ends in .parquet, the format that "
                "holds all of a run; run.to_frame() has the columns for other formats"
            )
        metadata = {"version": VERSION, **plain_run(self, arrays=False)}
        text = json.dumps(metadata, allow_nan=False)
        table = pa.table({name: np.asarray(values) for name, values in self.columns().items()})
        pq.write_table(table.replace_schema_metadata({_KEY: text}), path)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Run:
        """Read a file written by `save`; the run is equal to the saved one.

        Raises:
            InputError: If the file does not hold a run.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        path = Path(path)
        try:
            table = pq.read_table(path)
        except pa.ArrowInvalid as error:
            raise InputError(f"cannot read {path}: it is not a Parquet file") from error
        metadata = table.schema.metadata or {}
        if _KEY not in metadata:
            raise InputError(f"{path} is not a run: expected a file of Run.save")

        def column(name: str) -> Floats:
            array: Floats = table.column(name).to_numpy()
            return array

        return Run(**run_fields(json.loads(metadata[_KEY]), column))

    def _check_whole(self, way_out: str) -> None:
        """Raise InputError if a run lacks the start of its episode."""
        if self.first_sample:
            raise InputError(
                f"expected the samples of a whole episode, got the samples from "
                f"{self.first_sample} on; {way_out} takes sample {self.first_sample} for the "
                "start of an episode"
            )

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: verdict, robustness and curve of each specification."""
        rows = [
            [
                markup.plain(name),
                markup.verdict(history.verdict, verdict_text(history.verdict, history.final)),
                markup.plain(history.final_text(".6g")),
                markup.plain(history.decided_text(self.period)),
                markup.curve(history.robustness, f"robustness of {name}"),
                markup.code(history.formula),
            ]
            for name, history in self.histories.items()
        ]
        head = ["", "verdict", "robustness", "certain at", "over time", "formula"]
        return f"{markup.plain(repr(self)[1:-1])}{markup.table(head, rows)}"

    def __repr__(self) -> str:
        phrase = f" of {self.violated_by}" if self.ended == "violation" else ""
        when = sample_text(self.last_sample, self.period)
        samples = f"{self.steps + 1} samples" if self.steps else "1 sample"
        return f"<Run of {self.system}: {self.ended}{phrase} at {when}, {samples}>"


def plain_run(run: Run, *, arrays: bool = True) -> dict[str, Any]:
    """Return a run for JSON; without arrays, the names of its signals replace them."""
    plain_fields = {
        _KEYS.get(item.name, item.name): getattr(run, item.name) for item in fields(run)
    }
    plain_fields["signals"] = run.signals if arrays else list(run.signals)
    outcomes = run.outcomes
    plain_fields["courses"] = {
        name: {
            item.name: getattr(history, item.name)
            for item in fields(history)
            if item.name not in _OF_OUTCOME and (arrays or item.name not in CURVES)
        }
        | {"decided_at": outcomes[name].decided}
        | ({} if history.ended_at is None else {"ended_at": outcomes[name].ended})
        | dict(outcomes[name].evidence or {})
        | ({} if history.progress is None else {"progress": history.progress})
        | ({"by_end": True} if outcomes[name].by_end else {})
        for name, history in run.histories.items()
    }
    written: dict[str, Any] = plain(plain_fields)
    return written


def run_fields(
    stored: Mapping[str, Any], column: Callable[[str], Floats] | None = None
) -> dict[str, Any]:
    """Return the fields of a run that `plain_run` wrote; ``column`` reads arrays of a table."""
    case = stored.get("case")
    if not isinstance(case, str | None):  # version 1 stores it as text
        case = json.dumps(case)
    signals = stored["signals"]
    converted = ("wall_time", "reward", "period", "case", "signals", "histories")
    known = {item.name for item in fields(Run)} - {*converted}
    own = {name: value for name, value in stored.items() if name in known}
    return own | {
        "wall_time": number_of(stored["wall_time"]),
        "reward": number_of(stored.get("reward")),
        "period": fraction_of(stored["period"]),
        "case": None if case is None else Case.from_json(case),
        "signals": {name: column(name) if column else _array(signals[name]) for name in signals},
        "histories": {
            name: _history(
                value, {c: column(f"{c}({name})") if column else _array(value[c]) for c in CURVES}
            )
            for name, value in stored["courses"].items()
        },
    }


def _history(stored: Mapping[str, Any], curves: Mapping[str, Floats]) -> History:
    return History(
        formula=stored["formula"],
        **curves,
        final=number_of(stored["final"]),
        verdict=Verdict[stored["verdict"]],
        decided_at=_sample(stored["decided_at"]),
        unit=stored.get("unit", "s"),
        semantics=stored.get("semantics", "standard"),
        inputs=tuple(stored.get("inputs", ())),
        outputs=tuple(stored.get("outputs", ())),
        triggers=triggers_of(stored),
        vacuous=stored.get("vacuous", False),
        progress=number_of(stored.get("progress")),
        ended_at=_sample(stored.get("ended_at")),
    )


def _sample(stored: Mapping[str, int] | int | None) -> int | None:
    return stored["sample"] if isinstance(stored, Mapping) else stored  # a number in version 1


def _array(stored: Sequence[float | str]) -> Floats:
    return np.array([number_of(value) for value in stored], np.float64)
