"""`Falsification`: the result of a search for a violation."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from rtamt import Explanation, InputError, Verdict
from rtamt.renamed import OldName
from rtamt_gym import markup
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.inputs.space import Space
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.play.runner import Runner
from rtamt_gym.play.summaries import case_lines, failures
from rtamt_gym.results.codec import document, plain_results
from rtamt_gym.results.outcome import BY_END, violated_by_end
from rtamt_gym.results.provenance import listed, reuse_lines
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import (
    evidence_lines,
    triggered_in,
    undecided_in,
    undecided_warnings,
)
from rtamt_gym.search.falsification.coverage import Coverage
from rtamt_gym.search.falsification.effects import Effects
from rtamt_gym.tables import counted, number

__all__ = ["Falsification", "with_inputs"]

_WIDTH = 79
_DRAWN = 100
"""How many points of a waveform a notebook shows."""


@dataclass(frozen=True, eq=False, repr=False)
class Falsification:
    """The result of a search for an input that violates a requirement; `falsify` returns it.

    ``print`` shows the full result.

    Attributes:
        falsified: Whether a simulation violates a requirement.
        requirement: The name of the violated requirement; without a violation, the name of the
            requirement that came closest.
        row: The simulation that violates, with the reduced input; if none does, the closest.
        unreduced: The case that violates as it was found, before it was reduced; if none does, the
            closest.
        record: All simulations of the search, in their order, without those for the reduction and
            for `effects`.
        space: The space of the search.
        scales: The scale of each predicate, by its text; empty where the search used none.
        coverage: How much of the space the simulations have seen that were judged.
        reductions: The simulations that the reduction took.
        effects: The inputs without an effect on the robustness, and the simulations for this: each
            moves one input to the other end of its range, from `unreduced` and from a second
            simulation of the search.
        optimizer: The name of the optimizer.
        budget: The most simulations that the search could make.
        seed: The seed of the search.
        interrupted: Whether an error, or Ctrl-C, has ended the search before it was over.
    """

    falsified: bool
    requirement: str
    row: Trial
    unreduced: Case
    record: Record
    space: Space
    scales: Mapping[str, float]
    coverage: Coverage
    reductions: int
    effects: Effects
    optimizer: str
    budget: int
    seed: int
    _runner: Runner = field(compare=False)
    interrupted: bool = False

    found = OldName("unreduced")

    @property
    def input(self) -> Case:
        """The case that violates, reduced; if none does, the closest."""
        return self.row.case

    @property
    def simulations(self) -> int:
        """The number of simulations up to and including the violation."""
        return len(self.record)

    @property
    def failed(self) -> int:
        """How many of these an error has ended: nothing is known of their verdicts."""
        return len(self.record.failed())

    @property
    def judged(self) -> int:
        """How many of these were judged: all that did not fail."""
        return self.simulations - self.failed

    @property
    def simulated_time(self) -> float:
        """The simulated seconds of these (steps without a period)."""
        return math.fsum(row.simulated for row in self.record)

    @property
    def robustness(self) -> float:
        """The robustness of `requirement` in `row`, in its own units; nan if it is missing."""
        outcome = self.row.outcomes.get(self.requirement)
        return math.nan if outcome is None else outcome.robustness

    @property
    def not_violated(self) -> str:
        """The coverage of a search without a violation, from judged simulations only."""
        triggers = triggered_in(self.record, self.requirement)
        but = ", and never triggered" * (triggers is not None and not triggers[0])
        undecided, judged = undecided_in(self.record, self.requirement)
        if 0 < judged == undecided:
            but += f", and is undecided in {undecided} of {counted(judged, 'simulation')}"
        if not self.failed:
            return f"not violated{but}"
        total = counted(self.judged, "evaluated simulation")
        return f"not violated in {total}{but}; {self.failed} failed"

    def replay(self) -> Run:
        """Run `input` again, alone, and keep every sample.

        Raises:
            RtamtError: As `rtamt_gym.simulate` does.
        """
        return self._runner.simulate(self.input, self.row.seed)

    def explain(self) -> Explanation:
        """Which sub-formulas and samples decide the robustness of `requirement` on `input`."""
        return self.replay().explain(self.requirement)

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draw `input` and the run that it makes into a file: .png, .svg, .pdf.

        Waveforms stand above the signals of the run; numbers are in the title. Needs the extra
        ``plot``.

        Raises:
            InputError: If the file does not have the extension of a picture.
        """
        try:
            from rtamt_gym import drawing
            from rtamt_gym.play.plot import draw
        except ModuleNotFoundError as error:
            raise naming_extra(error, "Falsification.plot") from error
        drawing.check_format(Path(path))
        drawing.save(draw([with_inputs(self.replay(), self.input)]), Path(path))

    def save(
        self, path: str | os.PathLike[str], *, system: str | None = None, policy: str | None = None
    ) -> None:
        """Write a file with which ``rtamt replay`` and `SavedCase.load` run `input` again.

        It is strict JSON, and holds the system's name and arguments, the requirement's text, the
        input, the seed, and the verdict and robustness that come of it. Scenarios and registered
        environments are named by their ids, FMUs by their paths, functions by their modules.

        Args:
            path: The name of the file, which ends in ``.json``.
            system: A name ``module:name`` for a system without a name: an object, or a function
                without arguments that makes it.
            policy: A name for a policy without a name, as for ``rtamt run --policy``.

        Raises:
            InputError: If the system, the policy or a signal has no name for a file.
        """
        from rtamt_gym.play.saved_case import SavedCase
        from rtamt_gym.results.codec import check_name

        check_name(path)
        then = self.record.provenance.fingerprint
        if then is not None:
            now = replace(then, contents=self._runner.fingerprint().contents)
            if changes := then.changes(now):
                raise InputError(
                    f"cannot save the case: {listed(changes)} since the search; search again"
                )
        # The search stops a run that cannot become the closest, once enough of it is known.
        complete = self.row.ended != "known"
        row = self.row if complete else self.replay().trial(self.input)
        names = {"system": system, "policy": policy}
        SavedCase.of(self._runner, self.requirement, row, Path(path).parent, **names).save(path)

    def to_json(self) -> str:
        """The search as a result of the kind ``"search"``, which ``rtamt report`` shows."""
        return document(
            "search",
            {
                "requirement": self.requirement,
                "formula": self.record.requirements[self.requirement],
                "falsified": self.falsified,
                "robustness": self.robustness,
                **({"by_end": True} if self._by_end else {}),
                "input": self.input,
                "found": self.unreduced,
                "simulation_seed": self.row.seed,
                "simulations": self.simulations,
                "interrupted": self.interrupted,
                "judged": self.judged,
                "failed": self.failed,
                "simulated_time": self.simulated_time,
                "reductions": self.reductions,
                "without_effect": list(self.effects.without),
                "effect_simulations": self.effects.simulations,
                "budget": self.budget,
                "seed": self.seed,
                "optimizer": self.optimizer,
                "scales": self.scales,
                "gap": self.coverage.gap,
                "distance": self.coverage.distance,
                **plain_results(self.record, rates=False),
            },
        )

    def __repr__(self) -> str:
        phrase = f"falsified{self._how}" if self.falsified else "not falsified"
        return (
            f"<Falsification: {self.requirement} of {self.record.system} {phrase}, "
            f"{counted(self.simulations, 'simulation')}"
            f"{f', {self.failed} failed' if self.failed else ''}, "
            f"robustness {number(self.robustness)}>"
        )

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the result, and the input with a curve for each waveform."""
        rows = []
        for name, entry in self.input.items():
            if isinstance(entry, Waveform):
                low, high = min(entry.values), max(entry.values)
                said = number(low) if low == high else f"{number(low)} to {number(high)}"
                times = np.linspace(entry.times[0], entry.times[-1], _DRAWN)
                drawn = markup.curve(entry.at(times), f"{name} over time")
            else:
                said, drawn = number(entry), markup.plain("")
            rows.append([markup.plain(name), markup.plain(said), drawn])
        of = "input" if self.falsified else "input of the closest"
        formula = markup.code(self.record.requirements[self.requirement])
        inputs = markup.table([of, "", "over time"], rows)
        return f"{markup.plain(repr(self)[1:-1])}<br>{formula}{inputs}"

    def __str__(self) -> str:
        undecided = []
        if not self.falsified:
            undecided = undecided_warnings(self.record, "simulation", fails=False)
        return "\n".join([*self.lines(), *evidence_lines(self.record, "simulation", undecided)])

    @property
    def _by_end(self) -> bool:
        return self.falsified and violated_by_end(Verdict.VIOLATED, self.robustness)

    @property
    def _how(self) -> str:
        return f" {BY_END}" * self._by_end

    def lines(self) -> list[str]:
        """Return the result as lines of text."""
        name, system = self.requirement, self.record.system
        end = f"is violated{self._how}" if self.falsified else f"was {self.not_violated}"
        # `wrap` does not break lines at no-break spaces.
        head = f"{name} of {system} {end}: robustness\xa0{number(self.robustness)}"
        lines = [line.replace("\xa0", " ") for line in _wrapped(head, "")]
        if self.interrupted:
            runs = counted(self.simulations, "simulation")
            lines = [f"interrupted after {runs} of {self.budget}", "", *lines]
        lines += _wrapped(self.record.requirements[name])
        if self.robustness == math.inf:
            why = "no sample of any simulation counts, as where windows lie beyond the end"
            lines += _wrapped(why, "")
        unit = "steps" if self._runner.period is None else "simulated seconds"
        took = f"{self.simulated_time:.6g} {unit}, optimizer {self.optimizer}"
        took += f", seed {self.seed}"
        if self.falsified:
            lines += ["", *_wrapped(f"simulation {self.simulations} of {self.budget}; {took}", "")]
            lines.append("input:")
        else:
            runs = counted(self.simulations, "simulation")
            if self.simulations < self.budget:  # the optimizer has ended by itself
                runs += f" of {self.budget}"
            lines += ["", *_wrapped(f"{runs}; {took}", ""), "input of the closest:"]
        lines += case_lines(self.input)
        if self.reductions:
            before, after = _size(self.unreduced), _size(self.input)
            runs = counted(self.reductions, "more simulation")
            made = f"reduced from {before} numbers to {after}"
            if before == after:
                made = "no simpler one found" if self.input == self.unreduced else "rounded"
            lines += _wrapped(f"{made} by {runs}", "")
        if self.scales:
            scales = ", ".join(f"{text}: {number(it)}" for text, it in self.scales.items())
            lines += _wrapped(f"scales of the search: {scales}", "")
        lines += _wrapped(f"coverage (not a proof): {self.coverage}", "")
        if self.effects.without:
            lines += _wrapped(f"note: {self.effects}", "")
        if self.failed:
            lines += ["", *failures(self.record)]
        reused = reuse_lines(self.record.provenance, "simulation")
        return [*lines, "", *reused] if reused else lines


def _wrapped(text: str, indent: str = "  ") -> list[str]:
    return wrap(text, _WIDTH, initial_indent=indent, subsequent_indent="  ")


def _size(case: Case) -> int:
    """How many numbers describe a case."""
    return len(case.columns())


def with_inputs(run: Run, case: Case) -> Any:  # noqa: ANN401 - what is drawn as a run
    """A run with the waveforms of its case among its signals, and the numbers as its label."""
    times = np.arange(run.steps + 1) * float(run.period or 1)
    waves = {
        name: entry.at(times)
        for name, entry in case.items()
        if isinstance(entry, Waveform) and name not in run.signals
    }
    numbers = [f"{name}={entry:g}" for name, entry in case.items() if isinstance(entry, float)]
    return replace(run, signals={**waves, **run.signals}, label=", ".join(numbers[:3]))
