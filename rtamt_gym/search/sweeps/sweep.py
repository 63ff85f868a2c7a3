"""`sweep`: simulations of a system on many points of a space, with their outcomes."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_whole
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.space import Space, SpaceLike
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.play.campaign import run_campaign
from rtamt_gym.play.history import Stop
from rtamt_gym.play.record import Record, check_columns, read_space, written_space
from rtamt_gym.play.run import Run
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.play.summaries import failures, record_table
from rtamt_gym.results.provenance import reuse_lines
from rtamt_gym.results.trial import Trial
from rtamt_gym.results.warnings import evidence_lines
from rtamt_gym.search.sweeps.effects import Indices, RobustnessMap, indices, map_of
from rtamt_gym.search.sweeps.samplers import SampleCount, Sampler, sample
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.system import Policy
from rtamt_gym.tables import counted

if TYPE_CHECKING:  # joblib is optional
    from rtamt_gym.play.campaign import ClusterBackend


class FailedSimulationWarning(UserWarning):
    """Some simulations of a sweep ended with an error."""


@dataclass(frozen=True, eq=False, repr=False)
class Sweep:
    """Many simulations of one system, each on a point of a space; `sweep` returns it.

    ``print`` shows the robustness and the verdicts of every requirement, and the maps of a grid of
    two columns, except maps with a constant value.

    Attributes:
        record: The simulations, a row for each.
        space: The varied signals and parameters.
        sampler: How the points were chosen.
        seed: The seed that chose them, and the seed of the first simulation.
    """

    record: Record
    space: Space
    sampler: Sampler
    seed: int
    _runner: Runner | None = field(default=None, compare=False)

    @property
    def requirements(self) -> Mapping[str, str]:
        """The text of each requirement, by name."""
        return self.record.requirements

    @property
    def playable(self) -> bool:
        """Whether the sweep has its system, so that `replay` can run it."""
        return self._runner is not None

    def worst(self, requirement: str | None = None) -> Trial:
        """Return the simulation with the smallest robustness; ``sweep.replay`` runs it again.

        Raises:
            InputError: As `Record.worst`.
        """
        return self.record.worst(requirement)

    def replay(self, row: Trial) -> Run:
        """Run a simulation of the sweep again, alone, and keep every sample.

        Raises:
            InputError: If the sweep comes from a file or a pickle, which do not hold the system.
            InputTypeError: If the argument is not a row.
        """
        if not isinstance(row, Trial):
            raise InputTypeError(
                f"expected a row of the record, such as sweep.worst() or sweep.record[0], got "
                f"{row!r}"
            )
        if self._runner is None:
            raise InputError(
                "a sweep from a file or a pickle has no system to run; write simulate(system, "
                "specs, case=row.case, seed=row.seed)"
            )
        return self._runner.simulate(row.case, row.seed)

    def under(self, requirements: Requirements) -> Runner:
        """Return a runner of the system under other requirements, with runs to their end.

        Raises:
            InputError: If the sweep was read from a file, which does not hold the system.
        """
        if self._runner is None:
            raise InputError(
                "a sweep from a file has no system to run; repeat it with sweep(system, ...)"
            )
        options: Any = {**self._runner.options, "stop": "end"}
        return Runner(self._runner.system, requirements, **options)

    def indices(self, requirement: str | None = None) -> Indices:
        """Return how much each column changes the robustness of a requirement.

        The indices are Morris's for ``sampler="morris"`` and Sobol's for ``sampler="saltelli"``.

        Raises:
            InputError: If the sweep has another sampler, a simulation failed or was stopped, or the
                robustness is infinite somewhere or the same everywhere.
        """
        return indices(self.record, self.space, self.sampler, self.seed, requirement)

    def map(
        self, x: str | None = None, y: str | None = None, requirement: str | None = None
    ) -> RobustnessMap:
        """Return the robustness of a requirement over two columns; its `cells` are an array.

        Args:
            x: The column that runs to the right. Default: the second of only two.
            y: The column that runs upwards. Default: the first of only two.
            requirement: The requirement. Default: the only one.

        Raises:
            InputError: If a column or requirement is unknown or must be named.
        """
        return map_of(self.record, self.space, x, y, requirement)

    def heat_map(
        self,
        path: str | os.PathLike[str],
        x: str | None = None,
        y: str | None = None,
        requirement: str | None = None,
    ) -> None:
        """Draw `map` into a file: a grid as cells with their numbers, other points as dots.

        If a grid has more columns, a cell is the minimum over these. Needs the extra ``plot``.

        Raises:
            InputError: As `map`, and if the file does not have the extension of a picture.
        """
        drawing, pictures = _pictures("Sweep.heat_map")
        drawing.check_format(Path(path))
        heights = self.map(x, y, requirement)
        formula = self.requirements[heights.requirement]
        drawing.save(pictures.draw_map(heights, self.space, formula), Path(path))

    def scatter(self, path: str | os.PathLike[str]) -> None:
        """Draw the robustness of each requirement over each column into a file.

        Needs the extra ``plot``.

        Raises:
            InputError: If the file does not have the extension of a picture.
        """
        drawing, pictures = _pictures("Sweep.scatter")
        drawing.check_format(Path(path))
        drawing.save(pictures.draw_scatter(self.record, self.space), Path(path))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the record and the space into a Parquet file. Needs the extra ``files``.

        Raises:
            InputError: If the name does not end in ``.parquet``.
        """
        self.record.write(path, "Sweep.save", _sweep_fields(self.space, self.sampler, self.seed))

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Sweep:
        """Read a file that `save` has written.

        Raises:
            InputError: If the file does not hold a sweep.
        """
        record, also = Record.read(path, "Sweep.load")
        if "space" not in also:
            raise InputError(f"{path} is a record, not a sweep; read it with Record.load")
        space = read_space(also["space"])
        return Sweep(record, space, also["sampler"], also["seed"])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the system, as `save` does: not every system can be pickled."""
        return Sweep, (self.record, self.space, self.sampler, self.seed)

    def __repr__(self) -> str:
        return f"<Sweep {repr(self.record).removeprefix('<Record ')}"

    def __str__(self) -> str:
        return "\n".join([*self.lines(), *evidence_lines(self.record, "simulation")])

    def lines(self) -> list[str]:
        """Return the record as a table, and the map of a grid of two columns, as lines of text."""
        lines = record_table(self.record)
        if self.sampler == "grid" and len(self.space.columns) == 2:
            for name in self.requirements:
                heights = self.record.robustness_values(name)
                if np.unique(heights[~np.isnan(heights)]).size > 1:
                    lines += ["", *self.map(requirement=name).lines()]
        if reused := reuse_lines(self.record.provenance, "simulation"):
            lines += ["", *reused]
        return lines


@documents_options("episodes")
def sweep(
    system: Any,  # noqa: ANN401 - MuJoCo is not typed
    requirements: Requirements | None = None,
    space: SpaceLike | None = None,
    *,
    fixed: Mapping[str, float] | None = None,
    samples: SampleCount,
    sampler: Sampler = "sobol",
    seed: int = 0,
    signals: Mapping[str, SignalLike] | None = None,
    policy: Policy | None = None,
    duration: float | None = None,
    stop: Stop = "end",
    batch: int = 100,
    n_jobs: int | None = None,
    backend: ClusterBackend | None = None,
    timeout: float | None = None,
    folder: str | os.PathLike[str] | None = None,
    accept_changed: bool = False,
    progress: bool = True,
    **reading: Unpack[EvaluationKeywords],
) -> Sweep:
    r"""Simulate a system on many points of a space and record the outcome of every requirement.

    Many cases run side by side in a scenario, with the same numbers. docs/sweeps.md describes the
    record, samplers, sensitivity indices, campaigns in folders and clusters.

    Args:
        system: The id of an environment, or a system of `simulate` that can be restarted.
        requirements: Names of the scenario's own requirements (``"AT6a"``), or specifications as
            for `simulate`: one, a sequence, or a mapping by name. Default: all of the scenario.
        space: The signals and parameters to vary. Default: the inputs of the scenario.
        fixed: Parameters with one value in all simulations, by name. Default: no fixed values.
        samples: The number of points, as the sampler counts them.
        sampler: ``"sobol"``, ``"lhs"`` (Latin hypercube), ``"random"`` or ``"grid"``; ``"morris"``
            and ``"saltelli"`` are for `Sweep.indices`.
        seed: The seed of the points and of the first simulation; simulation i has ``seed + i``.
        signals: As for `simulate`.
        policy: As for `simulate`.
        duration: The simulated time of a run in seconds. Default: until the system ends.
        stop: When to stop a run, as for `simulate`; ``"end"``, the default, compares whole runs.
        batch: The maximum number of simulations side by side; 1 turns this off.
        n_jobs: The number of processes; -1: one for each core. Default: this process. A simulation
            that crashes its process runs again, and then has a ``ChildProcessError`` in its row.
        backend: ``"dask"`` or ``"ray"`` for a cluster. Default: this machine.
        timeout: The maximum time of a simulation in seconds, in a process of its own; a longer one
            is killed and has a ``TimeoutError`` in its row. Default: no limit.
        folder: A folder for finished simulations; the same call resumes from it. Default: none.
        accept_changed: Whether to use simulations in the folder although the model, its policy,
            rtamt or the simulator has changed; ``record.provenance.reuse`` then counts them.
        progress: Whether to show a bar on a terminal if tqdm is installed.
        **reading: Evaluation options.

    Returns:
        The record and the space. A failed simulation keeps its error in its row.

    Raises:
        SpecificationError: If a requirement is wrong.
        InputError: If a name or an option is wrong, the space does not fit, all simulations failed,
            or ``folder`` belongs to another campaign or a changed model.
        InputTypeError: If an argument has a wrong type, or the system cannot be sent to a process.

    Warns:
        FailedSimulationWarning: If some simulations failed.

    Example:
        >>> from rtamt_gym import Parameter, sweep
        >>> def tank(inflow):
        ...     for second in range(10):
        ...         yield {"level": 1 + inflow * second}
        >>> space = [Parameter("inflow", 0, 0.2)]
        >>> done = sweep(tank, "always(level < 2)", space, samples=3, sampler="grid", period=1)
        >>> done
        <Sweep of tank: 3 simulations, 1 violates>
        >>> done.replay(done.worst())
        <Run of tank: terminated at 9 s, 10 samples>
    """
    seed = check_whole(Argument("seed"), seed)
    runner = Runner(
        system,
        requirements,
        signals=signals,
        policy=policy,
        duration=duration,
        stop=stop,
        batch=batch,
        **checked_options(reading, sweep, "episodes").options(),
    )
    varied = space_of(runner, space, "sweep")
    constants = Case(fixed or {})
    for name in constants:
        if name in varied.entries:
            raise InputError(f"expected {name!r} varied or fixed, got both")
    check_columns([*varied.columns, *constants.columns()], runner.requirements)
    points = sample(varied, samples, sampler, seed)
    cases = [{**varied.case(point), **constants} for point in points]
    seeds = range(seed, seed + len(cases)) if runner.takes_seeds else None
    record = run_campaign(
        runner,
        zip(cases, seeds or repeat(None), strict=False),
        n_jobs=n_jobs,
        backend=backend,
        timeout=timeout,
        folder=folder,
        accept_changed=accept_changed,
        about=None if folder is None else _sweep_fields(varied, sampler, seed),
        what=f"sweep of {runner.name}",
        progress=progress,
    )
    tell_failures(record)
    return Sweep(record, varied, sampler, seed, runner)


def _sweep_fields(space: Space, sampler: Sampler, seed: int) -> dict[str, Any]:
    """The parts of a saved sweep next to its record."""
    return {"space": written_space(space), "sampler": sampler, "seed": seed}


def space_of(runner: Runner, space: SpaceLike | None, caller: str) -> Space:
    """Return the space of the sweep, with the duration of a run for its signals."""
    if space is None and not runner.inputs:
        raise InputError(
            f"{runner.name} does not declare a space of parameters; ",
            Argument(
                "space",
                words=f"give a space, as in {caller}(system, requirements, "
                '[Parameter("mass", 1, 2)], ...)',
            ),
        )
    if isinstance(space, Space):
        return Space(list(space), duration=space.duration or runner.duration)
    return Space(runner.inputs if space is None else space, duration=runner.duration)


def tell_failures(record: Record) -> None:
    """Warn if some simulations failed; raise InputError if all failed."""
    failed = record.failed()
    if not len(failed):
        return
    if len(failed) == len(record):
        phrase = "simulation" if record.has_cases else "episode"
        raise InputError(
            f"all {counted(len(record), phrase)} failed, the first with {failed[0].error}"
        )
    text = " ".join(line.strip() for line in failures(record))
    warnings.warn(text, FailedSimulationWarning, stacklevel=caller_level())


def _pictures(what: str) -> tuple[Any, Any]:
    try:
        from rtamt_gym import drawing
        from rtamt_gym.search.sweeps import pictures
    except ModuleNotFoundError as error:
        raise naming_extra(error, what) from error
    return drawing, pictures
