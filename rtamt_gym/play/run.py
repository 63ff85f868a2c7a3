"""`Run`: one run of a simulation under specifications; its JSON and its Parquet file."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import Explanation, InputError, Verdict
from rtamt.renamed import OldName
from rtamt.typing import Align
from rtamt_gym import markup
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.inputs.case import Case
from rtamt_gym.judging.monitors import chosen, titled
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.options.evaluation import View
from rtamt_gym.play.history import CURVES, ComparesArrays, Floats, History, Stop
from rtamt_gym.results.codec import VERSION, fraction_of, number_of, plain
from rtamt_gym.results.outcome import Outcome, triggers_of, verdict_text
from rtamt_gym.results.trial import STOPPED, RunEnd, Trial
from rtamt_gym.tables import sample_text

if TYPE_CHECKING:  # they are optional
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OF_OUTCOME: Final = ("decided_at", "ended_at", "triggers", "vacuous", "progress")
"""The fields of a history that are written as in its outcome."""

_KEYS: Final = {"histories": "courses"}
"""The keys in files of attributes with another name."""

_KEY = b"rtamt.run"
"""The key of the file's metadata, which stores as JSON everything except the arrays."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Run(ComparesArrays):
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


# Pictures: signals, robustness between its bounds, and when the verdict was certain.

_CURVE_TEXTS: Final[Mapping[View, str]] = {
    "episode": "robustness if it ended now",
    "step": "robustness of the newest instant",
}
"""The meaning of the curve of robustness, by view."""

_AFTER = 0.2
"""Room for the shading after a verdict at the last sample, as a fraction of the run's length."""


def draw(runs: Sequence[Run]) -> Figure:
    """Draw runs side by side: the signals, and below them a panel for every specification.

    A panel shows the robustness of the samples so far, between its lower and upper bound; infinite
    bounds end at the frame. A line marks the sample that decided the verdict; the rest is shaded.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from rtamt_gym import drawing

    heights = [1.0] * len(runs[0].signals) + [1.6] * len(runs[0].histories)
    size = (5.2 * len(runs) + 0.4, 1.25 * sum(heights) + 1.1)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(
        len(heights), len(runs), sharex="col", squeeze=False, height_ratios=heights
    )
    for column, run in zip(axes.T, runs, strict=True):
        _draw_run(column, run)
    verdicts = {c.verdict for run in runs for c in run.histories.values()}
    figure.legend(
        handles=[
            Line2D([], [], color=drawing.ROBUSTNESS, label=_CURVE_TEXTS[runs[0].view]),
            Patch(color=drawing.BOUNDS, alpha=0.5, label="what it can still become"),
            *(
                Patch(color=c, alpha=0.4, label=v.name)
                for v, c in drawing.VERDICT_COLOURS.items()
                if v in verdicts
            ),
        ],
        loc="outside lower center",
        ncols=2 if len(runs) == 1 else 4,
        frameon=False,
        fontsize=9,
    )
    return figure


def _draw_run(axes: NDArray[np.object_], run: Run) -> None:
    from rtamt_gym import drawing

    times = run.times
    last = any(c.decided_at == run.last_sample for c in run.histories.values())
    begin, end = float(times[0]), float(times[-1])
    end += (end - begin) * _AFTER * last or float(end == begin)
    signal_axes, history_axes = np.split(axes, [len(run.signals)])
    ax: Axes
    for ax, (name, values) in zip(signal_axes, run.signals.items(), strict=True):
        drawing.tidy(ax, name)
        ax.plot(times, values, color=drawing.SIGNAL, linewidth=1.6)
        ax.margins(y=0.15)
    for ax, (name, history) in zip(history_axes, run.histories.items(), strict=True):
        _draw_history(ax, name, history, run, end)
        text = f"{verdict_text(history.verdict, history.final)}, {history.final_text('+.3g')}"
        if decided := history.decided_text(run.period):
            text += f", at {decided}"
        drawing.show_verdict(ax, history.verdict, text)
    axes[-1].set_xlim(begin, end)
    axes[-1].annotate(
        "time in s" if run.period else "samples",
        (0.0, 0.0),
        (0.0, -26.0),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=9,
        color=drawing.OPEN,
    )
    driver = run.label or ("" if run.seed is None else f"seed {run.seed}")
    axes[0].set_title(
        f"{run.system}, {driver}" if driver else run.system, fontsize=12, fontweight="bold", pad=10
    )


def _draw_history(ax: Axes, name: str, history: History, run: Run, end: float) -> None:
    from rtamt_gym import drawing

    times = run.times
    curves = (history.robustness, history.lower, history.upper)
    robustness, lower, upper = drawing.robustness_panel(ax, name, history.formula, 64, curves)
    ax.fill_between(times, lower, upper, color=drawing.BOUNDS, alpha=0.5, linewidth=0)
    if history.decided_at is not None:
        colour = drawing.VERDICT_COLOURS[history.verdict]
        time = float(times[max(history.decided_at - run.first_sample, 0)])
        ax.axvspan(time, end, color=colour, alpha=0.18, linewidth=0)
        ax.axvline(time, color=colour, linewidth=1.6)
    ax.plot(times, robustness, color=drawing.ROBUSTNESS, linewidth=1.6)
