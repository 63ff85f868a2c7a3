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
from rtamt_gym.play.run import Run, draw
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
from rtamt_gym.search.falsification.points import Coverage, Effects
from rtamt_gym.tables import counted, number

_WIDTH = 79
_CURVE_POINTS = 100
"""The points of a waveform in a notebook."""


@dataclass(frozen=True, eq=False, repr=False)
class Falsification:
    """The result of a search for an input that violates a requirement; `falsify` returns it.

    ``print`` shows the full result.

    Attributes:
        falsified: Whether a simulation violates a requirement.
        requirement: The name of the violated requirement; without a violation, the name of the
            requirement that came closest.
        row: The violating simulation with the reduced input; without a violation, the closest.
        unreduced: The violating case before its reduction; without a violation, the closest.
        record: All simulations of the search in order, without simulations for the reduction and
            for `effects`.
        space: The space of the search.
        scales: The scale of each predicate, by its text; empty without scales.
        coverage: How much of the space the evaluated simulations cover.
        reductions: The number of simulations of the reduction.
        effects: The inputs without an effect on the robustness, and the number of simulations that
            showed this: each moves one input to the other end of its range, from `unreduced` and
            from a second simulation of the search.
        optimizer: The name of the optimizer.
        budget: The maximum number of simulations of the search.
        seed: The seed of the search.
        interrupted: Whether an error or Ctrl-C ended the search early.
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
        """The violating case, reduced; without a violation, the closest."""
        return self.row.case

    @property
    def simulations(self) -> int:
        """The number of simulations up to and including the violation."""
        return len(self.record)

    @property
    def failed(self) -> int:
        """The number of simulations that an error ended; they have no verdict."""
        return len(self.record.failed())

    @property
    def judged(self) -> int:
        """The number of simulations that did not fail."""
        return self.simulations - self.failed

    @property
    def simulated_time(self) -> float:
        """The simulated seconds of all simulations (steps without a period)."""
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
        """Run `input` again, alone, and record every sample.

        Raises:
            RtamtError: As `rtamt_gym.simulate` does.
        """
        return self._runner.simulate(self.input, self.row.seed)

    def explain(self) -> Explanation:
        """Return which sub-formulas and samples decide the robustness of `requirement`."""
        return self.replay().explain(self.requirement)

    def plot(self, path: str | os.PathLike[str]) -> None:
        """Draw `input` and its run into a file: .png, .svg or .pdf. Needs the extra ``plot``.

        Waveforms are above the signals of the run; numbers are in the title.

        Raises:
            InputError: If the file does not have the extension of a picture.
        """
        try:
            from rtamt_gym import drawing
        except ModuleNotFoundError as error:
            raise naming_extra(error, "Falsification.plot") from error
        drawing.check_format(Path(path))
        drawing.save(draw([with_inputs(self.replay(), self.input)]), Path(path))

    def save(
        self, path: str | os.PathLike[str], *, system: str | None = None, policy: str | None = None
    ) -> None:
        """Write a file with which ``rtamt replay`` and `SavedCase.load` run `input` again.

        It is strict JSON with the name and arguments of the system, the text of the requirement,
        the input, the seed, the verdict and the robustness. Scenarios and registered environments
        are named by their ids, FMUs by their paths, functions by their modules.

        Args:
            path: The name of the file; it ends in ``.json``.
            system: A name ``module:name`` for a system without a name: an object, or a function
                without arguments that returns it.
            policy: A name for a policy without a name, as for ``rtamt run --policy``.

        Raises:
            InputError: If the system, the policy or a signal has no name for a file.
        """
        from rtamt_gym.play.saved_case import SavedCase
        from rtamt_gym.results.codec import check_name

        check_name(path)
        searched = self.record.provenance.fingerprint
        if searched is not None:
            current = replace(searched, contents=self._runner.fingerprint().contents)
            if changes := searched.changes(current):
                raise InputError(
                    f"cannot save the case: {listed(changes)} since the search; search again"
                )
        # The search may have stopped this run early, because it could not become the closest.
        complete = self.row.ended != "known"
        row = self.row if complete else self.replay().trial(self.input)
        names = {"system": system, "policy": policy}
        SavedCase.of(self._runner, self.requirement, row, Path(path).parent, **names).save(path)

    def to_json(self) -> str:
        """Return the search as JSON of the kind ``"search"``; ``rtamt report`` shows it."""
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
                text = number(low) if low == high else f"{number(low)} to {number(high)}"
                times = np.linspace(entry.times[0], entry.times[-1], _CURVE_POINTS)
                curve = markup.curve(entry.at(times), f"{name} over time")
            else:
                text, curve = number(entry), markup.plain("")
            rows.append([markup.plain(name), markup.plain(text), curve])
        heading = "input" if self.falsified else "input of the closest"
        formula = markup.code(self.record.requirements[self.requirement])
        inputs = markup.table([heading, "", "over time"], rows)
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
            why = "no sample of any simulation counts; windows may lie beyond its end"
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
            change = f"reduced from {before} numbers to {after}"
            if before == after:
                change = "no simpler one found" if self.input == self.unreduced else "rounded"
            lines += _wrapped(f"{change} by {runs}", "")
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
    """Return how many numbers describe a case."""
    return len(case.columns())


def with_inputs(run: Run, case: Case) -> Any:  # noqa: ANN401 - a run that is only drawn
    """Return a run with the waveforms of its case as signals, and the numbers as its label."""
    times = np.arange(run.steps + 1) * float(run.period or 1)
    waves = {
        name: entry.at(times)
        for name, entry in case.items()
        if isinstance(entry, Waveform) and name not in run.signals
    }
    numbers = [f"{name}={entry:g}" for name, entry in case.items() if isinstance(entry, float)]
    return replace(run, signals={**waves, **run.signals}, label=", ".join(numbers[:3]))
