"""`falsify`: search for an input with which a system violates a requirement."""

from __future__ import annotations

import json
import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Literal, Unpack

import numpy as np

from rtamt import InputError, Verdict
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_count, check_whole
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case, Waveform
from rtamt_gym.inputs.space import Parameter, Signal, Space, SpaceLike
from rtamt_gym.options.evaluation import (
    EvaluationKeywords,
    EvaluationOptions,
    checked_options,
    documents_options,
)
from rtamt_gym.play.campaign import ParallelRunner, Recipe, check_workers
from rtamt_gym.play.folder import Folder
from rtamt_gym.play.history import Stop
from rtamt_gym.play.record import Record, check_columns, written_space
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.recorded.progress import progress as shown_progress
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.falsification.optimizers import OptimizerLike, find_optimizer
from rtamt_gym.search.falsification.points import Effects, Optimizer, coverage_of
from rtamt_gym.search.falsification.scales import checked_scales
from rtamt_gym.search.falsification.search import Search, SearchFolder, SearchOver
from rtamt_gym.search.sweeps.sweep import space_of, tell_failures
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.system import Policy
from rtamt_gym.tables import counted

if TYPE_CHECKING:  # joblib is optional
    from rtamt_gym.play.campaign import ClusterBackend


_REDUCTIONS: Final = 200
"""The maximum number of simulations of a reduction."""

_DIGITS: Final = (1, 2, 3, 4)
"""The numbers of digits that values are rounded to."""


class IrreproducibleWarning(UserWarning):
    """A simulation that violated a requirement did not do so again."""


@documents_options("episodes")
def falsify(
    system: Any,  # noqa: ANN401 - MuJoCo is not typed
    requirements: Requirements | None = None,
    space: SpaceLike | None = None,
    *,
    fixed: Mapping[str, float | Waveform] | None = None,
    budget: int = 300,
    seed: int = 0,
    optimizer: OptimizerLike = "portfolio",
    signals: Mapping[str, SignalLike] | None = None,
    policy: Policy | None = None,
    duration: float | None = None,
    batch: int = 100,
    scales: Mapping[str, float] | Literal["plain"] | None = None,
    reduce: bool = True,
    n_jobs: int | None = None,
    backend: ClusterBackend | None = None,
    timeout: float | None = None,
    folder: str | os.PathLike[str] | None = None,
    accept_changed: bool = False,
    progress: bool = False,
    **reading: Unpack[EvaluationKeywords],
) -> Falsification:
    """Search for an input with which a system violates a requirement.

    The search ends at the first violation, or when the budget is spent. A violating input is then
    reduced, and one more simulation for each input shows whether it has an effect. Many cases run
    side by side in a scenario, with the same result. docs/falsification.md describes the search.

    Args:
        system: The id of an environment, or a system of `simulate` that can be restarted.
        requirements: Names of the scenario's own requirements (``"AT6a"``), or specifications as
            for `simulate`: one, a sequence, or a mapping by name. Default: all of the scenario.
        space: The signals and parameters to choose. Default: the inputs of the scenario.
        fixed: Values by name that are the same in every simulation. Default: no fixed values.
        budget: The maximum number of simulations of the search.
        seed: The seed of the search and of the first simulation; simulation i has ``seed + i``.
        optimizer: ``"portfolio"``, another name (docs/falsification.md#optimizers lists them), or a
            function ``optimizer(evaluate, dimension, rng)``: ``evaluate`` takes points of the unit
            cube, shape (k, dimension), and returns k numbers to minimize.
        signals: As for `simulate`.
        policy: As for `simulate`.
        duration: The simulated time of a run in seconds. Default: until the system ends.
        batch: The maximum number of simulations side by side; 1 turns this off.
        scales: The scale of predicates by their text, ``{"rpm < 3000": 1000}``, or ``"plain"`` for
            no scales. Default: the spread in the first eight simulations, if predicates read
            different variables. Verdicts and reported robustness are never scaled.
        reduce: Whether to simplify a violating input in up to 200 further simulations.
        n_jobs: The number of processes for points that the optimizer passes together; -1: one for
            each core. Default: this process. The result is the same.
        backend: As for `sweep`.
        timeout: As for `sweep`, for simulations in other processes.
        folder: A folder for finished simulations; the same call resumes from it, also with another
            ``budget``. Default: no folder.
        accept_changed: As for `sweep`.
        progress: Whether to show a bar on a terminal if tqdm is installed.
        **reading: Evaluation options.

    Returns:
        The violation, or the closest simulation if none violates. A failed simulation keeps its
        error in its row and counts neither for the coverage nor as the closest.

    Raises:
        SpecificationError: If a requirement is wrong.
        InputError: If a name or an option is wrong, the space does not fit, the optimizer evaluates
            no point or a point outside the unit cube, all simulations failed, or ``folder`` belongs
            to another search or a changed model. An error of the optimizer and Ctrl-C keep their
            type and get the result so far as their attribute ``falsification``.
        InputTypeError: If an argument has a wrong type.

    Warns:
        FailedSimulationWarning: If some simulations failed.
        IrreproducibleWarning: If the violating input does not violate again.

    Example:
        >>> from rtamt_gym import Parameter, falsify
        >>> def tank(inflow):
        ...     for second in range(10):
        ...         yield {"level": 1 + inflow * second}
        >>> falsify(tank, "always(level < 2)", [Parameter("inflow", 0.1, 0.3)], period=1)
        <Falsification: spec of tank falsified, 2 simulations, robustness -0.2>
    """
    chosen = find_optimizer(optimizer)
    own_name = getattr(optimizer, "__name__", type(optimizer).__name__)
    name = optimizer if isinstance(optimizer, str) else str(own_name)
    budget, seed = check_count(Argument("budget"), budget), check_whole(Argument("seed"), seed)
    options = checked_options(reading, falsify, "episodes")

    def make(
        specs: Requirements | None,
        stop: Stop,
        signals: Mapping[str, SignalLike] | None = signals,
        options: EvaluationOptions = options,
    ) -> Runner:
        return Runner(
            system,
            specs,
            signals=signals,
            policy=policy,
            duration=duration,
            stop=stop,
            batch=batch,
            **options.options(),
        )

    timeout = check_workers(n_jobs, backend, timeout)
    here = n_jobs is None and backend is None and timeout is None
    parallel = partial(ParallelRunner, n_jobs=n_jobs, backend=backend, timeout=timeout)
    runner = make(requirements, "violation")
    specs = runner.requirements
    varied = space_of(runner, space, "falsify")
    constants = Case(fixed or {})
    if both := next((key for key in constants if key in varied.entries), None):
        raise InputError(f"expected {both!r} varied or fixed, got both")
    check_columns([*varied.columns, *constants.columns()], specs)
    optimizer_seed, search_seed = np.random.SeedSequence(seed).spawn(2)
    rng = np.random.default_rng(search_seed)
    # If the system has a monitor, its signals and options belong to its specifications.
    again = partial(make, signals=runner.signals, options=runner.evaluation_options)
    texts = {key: str(spec.standalone()) for key, spec in specs.items()}
    scaling = checked_scales(scales, specs)
    fingerprint = runner.fingerprint()
    stored = None
    if folder is not None:
        identity: dict[str, Any] = {
            **Recipe(runner).identity(texts),
            "space": written_space(varied),
            "fixed": json.loads(constants.to_json()),
            "optimizer": name,
            "seed": seed,
            "scales": scaling,
        }
        opened = Folder(
            *(folder, identity, {}, texts, runner.name, fingerprint), accept_changed=accept_changed
        )
        stored = SearchFolder(opened, name)
    search = Search(
        *(again, runner, varied, constants, budget, seed, rng, scaling),
        parallel=None if here else parallel,
        folder=stored,
    )

    effects = Effects()

    def record() -> Record:
        reuse = None if stored is None else stored.reuse(len(search.trials))
        return Record(search.rows, texts, runner.name, Provenance.of(specs, fingerprint, reuse))

    def result(
        simplest: Trial | None = None, reductions: int = 0, *, interrupted: bool = False
    ) -> Falsification:
        best = search.trials[search.best].row
        return Falsification(
            falsified=search.violated is not None,
            requirement=search.closest,
            row=simplest or best,
            unreduced=best.case,
            record=record(),
            space=varied,
            scales=search.scales or {},
            coverage=coverage_of(search.judged_points),
            reductions=reductions,
            effects=effects,
            optimizer=name,
            budget=budget,
            seed=seed,
            _runner=runner,
            interrupted=interrupted,
        )

    try:
        phrase = f"falsification of {runner.name}"
        with shown_progress(phrase, budget if progress else 0, "run") as search.advance:
            try:
                with suppress(SearchOver):
                    _optimize(chosen, name, search, np.random.default_rng(optimizer_seed))
                if stored is not None and search.trials:
                    stored.finish(record(), search.trials)
                effects = search.effects()
            finally:
                search.close()
        _check_rows(search, runner, name)
        if search.violated is None:
            return result()
        return result(*_reproduced(search, runner, varied, _REDUCTIONS if reduce else 0))
    except BaseException as error:
        if search.trials:
            _carry(error, result(interrupted=True))
        raise


def _optimize(optimizer: Optimizer, name: str, search: Search, rng: np.random.Generator) -> None:
    try:
        optimizer(search, search.dimension, rng)
    except ModuleNotFoundError as error:
        raise naming_extra(error, f"optimizer={name!r}", "search") from error


def _check_rows(search: Search, runner: Runner, optimizer: str) -> None:
    """Warn if some simulations failed; raise InputError if all failed, or there are none."""
    if not search.trials:
        raise InputError(
            f"the optimizer {optimizer} evaluated no point; it is called with evaluate, the "
            "dimension and a generator, and calls evaluate(points) until that ends it"
        )
    tell_failures(Record(search.rows, {}, runner.name))


def _again(search: Search, runner: Runner, case: Case) -> Trial | None:
    """Run a case with the seed of the violation; return its row, or None if it does not violate."""
    seed = search.trials[-1].row.seed
    ((_, row),) = runner.run([case], None if seed is None else [seed])
    violates = not row.error and row.outcomes[search.closest].verdict is Verdict.VIOLATED
    return row if violates else None


def _reproduced(search: Search, runner: Runner, space: Space, most: int) -> tuple[Trial, int]:
    """Run the violating simulation again and reduce it; return its row and the simulations."""
    row = _again(search, runner, search.trials[-1].row.case)
    if row is not None:
        return reduced(row, space, partial(_again, search, runner), most)
    warnings.warn(
        f"the input that violated {search.violated} did not do so a second time: {runner.name} "
        "is not the same in every simulation of one input",
        IrreproducibleWarning,
        stacklevel=caller_level(),
    )
    return search.trials[-1].row, 0


def _carry(error: BaseException, result: Falsification) -> None:
    """Attach the result so far to an error as ``falsification``, with a note."""
    with suppress(AttributeError):  # an error class may refuse attributes
        untyped: Any = error
        untyped.falsification = result
        runs = counted(result.simulations, "simulation")
        error.add_note(f"error.falsification holds {runs}")


def reduced(
    row: Trial, space: Space, again: Callable[[Case], Trial | None], most: int
) -> tuple[Trial, int]:
    """Make a violating case simpler, in steps that keep the violation.

    First parameters get their defaults, which removes faults. Then signals become constant or lose
    control points, and numbers are rounded. ``again`` runs a case, at most ``most`` times, and
    returns None if it does not violate. Returns the simplest simulation, and how many cases ran.
    """
    budget = _Budget(row, again, most)
    for entry in space:
        if isinstance(entry, Parameter) and entry.default is not None:
            budget.attempt(entry.name, entry.default)
    for entry in space:
        if isinstance(entry, Signal):
            _fewer_points(entry, budget)
    for entry in space:
        _fewer_digits(entry, budget)
    return budget.row, budget.count


class _Budget:
    """The simplest violating case so far, and the number of cases that ran."""

    def __init__(self, row: Trial, again: Callable[[Case], Trial | None], most: int) -> None:
        self.row = row
        self.count = 0
        self._again = again
        self._most = most

    @property
    def case(self) -> Case:
        return self.row.case

    def attempt(self, name: str, entry: float | Waveform) -> bool:
        """Replace the entry of a name if the case then still violates."""
        if entry == self.case[name] or self.count >= self._most:
            return False
        self.count += 1
        row = self._again(Case({**self.case, name: entry}))
        self.row = row or self.row
        return row is not None


def _fewer_points(signal: Signal, budget: _Budget) -> None:
    """Make a signal constant, or remove control points one by one."""
    wave = budget.case[signal.name]
    assert isinstance(wave, Waveform)  # noqa: S101 - the space has made it
    mean = math.fsum(wave.values) / len(wave.values)
    for value in dict.fromkeys([mean, *wave.values]):
        if len(wave.values) > 1 and budget.attempt(signal.name, Waveform([0.0], [value])):
            return
    index = len(wave.values) - 1
    while index >= 0:
        wave = budget.case[signal.name]
        assert isinstance(wave, Waveform)  # noqa: S101
        fewer = _without(wave, index)
        if fewer is not None:
            budget.attempt(signal.name, fewer)
        index -= 1


def _without(wave: Waveform, at: int) -> Waveform | None:
    """Return the waveform without a control point; None if it would have too few."""
    if len(wave.values) <= (1 if wave.interpolation == "hold" else 2):
        return None
    times, values = list(wave.times), list(wave.values)
    # The first time stays, because a waveform keeps its first value before that time.
    del times[max(at, 1)], values[at]
    return Waveform(times, values, wave.interpolation)


def _fewer_digits(entry: Signal | Parameter, budget: _Budget) -> None:
    """Round each number of an entry to as few digits as still violate."""
    current = budget.case[entry.name]
    if not isinstance(current, Waveform):
        if isinstance(entry, Parameter) and entry.values is not None:
            return
        for value in _rounded(current, entry):
            if budget.attempt(entry.name, value):
                return
        return
    for index in range(len(current.values)):
        wave = budget.case[entry.name]
        assert isinstance(wave, Waveform)  # noqa: S101
        for value in _rounded(wave.values[index], entry):
            values = [*wave.values[:index], value, *wave.values[index + 1 :]]
            if budget.attempt(entry.name, Waveform(wave.times, values, wave.interpolation)):
                break


def _rounded(value: float, entry: Signal | Parameter) -> Iterator[float]:
    """Yield a number rounded to more and more digits, if the result is inside the range."""
    if not math.isfinite(value):
        return
    # The range sets the first digit: 0.0031 in a range up to 100 is 0.
    size = max(abs(entry.low), abs(entry.high))
    position = math.floor(math.log10(size)) if size else 0
    for digits in _DIGITS:
        number = round(value, digits - 1 - position) + 0.0
        if number == value:
            return
        if entry.low <= number <= entry.high:
            yield number
