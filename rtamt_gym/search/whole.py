"""`Whole`: runs cases to their end and judges them then, where monitors would take longer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rtamt import Formula, Specification, Verdict, conjunction, predicates
from rtamt.language.node import Node
from rtamt_gym.search.rows import Outcome, Row
from rtamt_gym.search.runner import CaseLike, Runner
from rtamt_gym.search.scales import alone
from rtamt_gym.search.trace import Trace
from rtamt_gym.simulation.record import Stop

__all__ = ["MakeRunner", "Whole", "judged_whole"]

MakeRunner = Callable[[Mapping[str, Specification], Stop], Runner]


def judged_whole(specs: Mapping[str, Specification], runner: Runner) -> bool:
    """Whether runs are better judged once they are over.

    They are where a window is over a combination of windows, as in ``always[0:30](p implies
    eventually[0:5] q)``. What a monitor says of it after every sample takes ten times what a
    simulation of a scenario takes, and the robustness of the whole trace a tenth. Unless it is
    violated, such a requirement is hardly ever certain long before the end.
    """
    standard = {"view": "episode", "semantics": "standard"}
    return (
        runner.duration is not None
        and all(runner.options.get(name, value) == value for name, value in standard.items())
        and all(spec.unit == "s" and spec.horizon <= runner.duration for spec in specs.values())
        and any(_nests(spec.formula) for spec in specs.values())
    )


class Whole:
    """Runs cases to the end, and judges them by their samples.

    Rows are those of `Runner`, except that a run without a violation is never stopped, and that its
    end is the time at which its verdicts were certain. A run that violates, that fails, or that
    ends before every verdict is certain, is run again under monitors, which stop it.

    Args:
        make: Makes a runner of requirements.
        specs: The requirements.
    """

    def __init__(self, make: MakeRunner, specs: Mapping[str, Specification]) -> None:
        # Monitors of next to no cost, which read the same variables.
        self._samples = make({name: _reading(spec) for name, spec in specs.items()}, "end")
        self._monitored = make(specs, "known")
        self._names = list(specs)
        self._horizon = max(spec.horizon for spec in specs.values())

    @property
    def takes_seeds(self) -> bool:
        """As `Runner.takes_seeds`."""
        return self._samples.takes_seeds

    def close(self) -> None:
        """Closes what has been made."""
        self._samples.close()
        self._monitored.close()

    def judge(self, name: str, trace: Trace) -> float:
        """The robustness of a requirement on samples that were kept."""
        return self._monitored.judge(name, trace)

    def run(
        self,
        cases: Iterable[CaseLike],
        seeds: Sequence[int] | None = None,
        *,
        above: Mapping[str, float] | None = None,
    ) -> Iterator[tuple[int, Row]]:
        """Runs cases, as `Runner.run` does."""
        listed = list(cases)
        heights: dict[int, dict[str, float]] = {}

        def keep(index: int, trace: Trace) -> None:
            heights[index] = {name: self.judge(name, trace) for name in self._names}

        for index, row in self._samples.run(listed, seeds, keep=keep):
            found = heights.pop(index, {})
            known = not row.error and row.simulated >= self._horizon
            if known and not np.signbit(list(found.values())).any():
                yield index, _satisfied(row, found)
                continue
            own = None if seeds is None else [seeds[index]]
            for _, again in self._monitored.run([listed[index]], own, above=above):
                yield index, again


def _satisfied(row: Row, heights: Mapping[str, float]) -> Row:
    """The row of a run that satisfies all requirements, by their robustness."""
    outcomes = {
        name: Outcome(height, height, height, Verdict.SATISFIED, row.simulated)
        for name, height in heights.items()
    }
    return replace(row, outcomes=outcomes)


def _reading(spec: Specification) -> Specification:
    return alone(spec, conjunction(predicates(spec.formula)).always())


def _nests(formula: Formula) -> bool:
    """Whether a window is over a combination of windows."""
    return any(_timed(node) and any(map(_combines, node.args)) for node in formula.nodes())


def _combines(node: Node) -> bool:
    """Whether a node combines formulas, one of which has a window."""
    if len(node.args) > 1 and any(_timed(each) for arg in node.args for each in arg.nodes()):
        return True
    return any(map(_combines, node.args))


def _timed(node: Node) -> bool:
    return node.op is not None and node.op.timed
