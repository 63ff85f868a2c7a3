"""`Run`: one run of a simulation under specifications."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rtamt
from rtamt import Explanation, InputError
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.monitors import chosen, titled
from rtamt_gym.judging.specs import SpecsLike, load_specs
from rtamt_gym.play.run_record import Floats, RunRecord

if TYPE_CHECKING:  # it is optional
    import pandas as pd


class Run(RunRecord):
    """One run of a simulation under specifications; `simulate` makes it.

    Two runs are equal if they differ only in wall time.

    Attributes:
        system: Name of the system that ran.
        signals: The values of every variable and of every further recorded signal, from sample 0
            on.
        histories: The course of every specification, by its name.
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
        {'dry': <Course of always(level < 3): VIOLATED at sample 2, robustness -1>}
        >>> run.replay()
        {'dry': array([-1., -1., -1.])}
    """

    __slots__ = ()

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
            interfaces = {name: course.interface for name, course in self.histories.items()}
            specs = {name: course.specification for name, course in self.histories.items()}
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
            sample: The sample at which the formula is explained, counted from 0. None: the whole
                run, that is sample 0, and with ``view="step"`` the worst of all samples
                (``always`` of the formula).

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
        courses = self.histories
        final = {key: course.final for key, course in courses.items()}
        name = chosen(name, final, self.violated_by)
        spec = courses[name].specification
        explanation = rtamt.explain(
            spec.always() if self.view == "step" and sample is None else spec,
            self.signals,
            self.period,
            sample=0 if sample is None else sample,
            n=self.steps + 1,
            align=self.align,
            **courses[name].interface,
        )
        return titled(explanation, name, spec.formula)

    def to_frame(self) -> pd.DataFrame:
        """Return the run as a data frame of pandas: a row for each sample, the columns of `save`.

        They are ``time``, the signals, and ``robustness(NAME)``, ``lower(NAME)``, ``upper(NAME)``
        of every specification. The index is the number of the sample, so
        ``frame.loc[run.violated_at]`` is the row of the violation. ``frame.attrs["view"]`` is the
        view: with ``"step"`` the robustness is that of the newest instant, and the bounds hold for
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

    def _check_whole(self, way_out: str) -> None:
        """Raise InputError if a run lacks the start of its episode."""
        if self.first_sample:
            raise InputError(
                f"expected the samples of a whole episode, got those from sample "
                f"{self.first_sample} on; {way_out} takes sample {self.first_sample} for the "
                "start of an episode"
            )

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
        from rtamt_gym.play.run_files import save_run

        save_run(self, Path(path))

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Run:
        """Read a file written by `save`; the run is equal to the saved one.

        Raises:
            InputError: If the file does not hold a run.
        """
        from rtamt_gym.play.run_files import load_run

        return Run(**load_run(Path(path)))
