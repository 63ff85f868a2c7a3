"""`falsify`: searches for an input with which a system violates a requirement."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np

from rtamt import InputError, Specification, Verdict
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.inputs.case import Case
from rtamt_gym.inputs.space import Space, SpaceLike
from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.options.evaluation import (
    EvaluationKeywords,
    EvaluationOptions,
    checked_options,
    documents_options,
)
from rtamt_gym.play.folder import Folder
from rtamt_gym.play.record import Record, check_columns
from rtamt_gym.play.record_files import written_space
from rtamt_gym.play.run_record import Stop
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.play.workers import Elsewhere, Recipe, check_workers
from rtamt_gym.recorded.progress import progress as shown_progress
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.falsification.coverage import coverage_of
from rtamt_gym.search.falsification.effects import Effects
from rtamt_gym.search.falsification.falsification import Falsification
from rtamt_gym.search.falsification.kept import KeptSearch
from rtamt_gym.search.falsification.optimizers import OptimizerLike, find_optimizer
from rtamt_gym.search.falsification.protocol import Optimizer
from rtamt_gym.search.falsification.reduction import reduced
from rtamt_gym.search.falsification.scales import given_scales, needs_scales
from rtamt_gym.search.falsification.search import Search, SearchOver
from rtamt_gym.search.sweeps.sweep import space_of, tell_failures
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.system import Policy
from rtamt_gym.tables import counted

if TYPE_CHECKING:  # joblib is optional
    from rtamt_gym.play.workers import ClusterBackend

__all__ = ["IrreproducibleWarning", "falsify"]

_REDUCTIONS = 200
"""The most simulations of a reduction."""


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
    """Searches for an input with which a system violates a requirement.

    Simulations are run until one violates, or the budget is spent. Each is stopped at its certain
    violation. An environment whose native vector environment has ``rollout``, as every scenario
    has, runs many side by side; all else runs one by one, by `simulate`. The result does not depend
    on that: it is what points that run one after the other give.

    | optimizer | what it does |
    |---|---|
    | ``"portfolio"`` | corners, then quasi-random points, then CMA-ES with restarts |
    | ``"corners"`` | inputs constant at the ends of their ranges, then all corners of the space |
    | ``"random"`` | uniform points |
    | ``"sobol"`` | a scrambled Sobol sequence |
    | ``"cma"`` | CMA-ES from random starts |
    | ``"dual_annealing"``, ``"differential_evolution"`` | SciPy's, with its defaults |
    | ``"tpe"`` | the Parzen estimator of Optuna |
    | a function | one's own: it calls ``evaluate`` until that ends it |

    One's own is called with ``evaluate``, the dimension of the space and a
    ``numpy.random.Generator``. ``evaluate(points)`` takes points of the unit cube, shape
    (k, dimension), and returns k numbers to minimize: the least robustness over the requirements.

    In a robustness over several units, the unit with the smallest numbers decides: for speed and
    rpm, the speed. If predicates read different variables, optimizers get the robustness in units
    of scales (`Specification.scaled`). Verdicts and `Falsification.robustness` are not scaled.

    The search ends with a further simulation for each input, in which this input alone is at the
    other end of its range. `Falsification.effects` lists the inputs that did not change the
    robustness.

    Args:
        system: The id of an environment (``"rtamt/ChasingCars-v0"``), or what `simulate` takes; not
            a `StepMonitor` or an iterator, which are not the same a second time.
        requirements: The name of one of the scenario's own requirements (``"AT6a"``), a
            specification as for `simulate`, or several: a sequence of names and texts, or a mapping
            from names to specifications. None: all of the scenario's own. The search ends at the
            first that is violated.
        space: The signals and parameters to choose. None: the inputs of the scenario.
        fixed: What every simulation is given beside the space.
        budget: The most simulations of the search.
        seed: The seed of the search, and the seed of the first simulation of an environment; each
            further one has one more.
        optimizer: What chooses the points, as above.
        signals: As for `simulate`.
        policy: As for `simulate`.
        duration: The simulated time of a run, in seconds. None: until the system ends by itself.
        batch: How many simulations run side by side at most; 1: none do.
        scales: The scale of predicates by their text, ``{"rpm < 3000": 1000}``; ``"plain"``: none.
            None: where predicates read different variables, the range of each one's robustness over
            the first eight simulations; an optimizer that begins with fewer points gets
            quasi-random ones before its own.
        reduce: Whether to make a violating input simpler while it still violates, in 200 further
            simulations at most: parameters get their defaults, signals lose control points, numbers
            lose digits.
        n_jobs: How many simulations, or batches of lanes, run at once, each in a process of its
            own, of the points that the optimizer asks for together; -1: as many as there are cores.
            The result is the same. The runs that scales come from, and the reduction, stay in this
            process. None: all do, unless ``backend`` or ``timeout`` is given.
        backend: As for `sweep`.
        timeout: As for `sweep`, of the simulations in other processes.
        folder: A folder for finished simulations. The same call goes on there after an
            interruption, as if there had been none: the optimizer is asked again, and gets what is
            kept for points that have run. ``budget`` may be another one. The first eight
            simulations are kept once the scales that come of them are known; those of the reduction
            are not. `Record.load` reads the folder at any time.
        accept_changed: As for `sweep`.
        progress: Whether to show a bar on a terminal, after a second, if tqdm is installed.
        **reading: How samples are judged, the options of `rtamt_gym.EvaluationOptions`: ``period``,
            ``view``, ``nan``, ``align``, ``semantics``, ``inputs``, ``outputs``, ``at_termination``
            and ``at_truncation``.

    Returns:
        What was found; if no simulation violates, the closest. A simulation that raises an error
        has it in its row, and the search goes on; it counts as failed, and not as one that was
        judged: neither for the coverage nor as the closest.

    Raises:
        SpecificationError: If a requirement is wrong.
        InputError: If there is no such system, requirement or optimizer, the space does not fit, or
            an option is wrong; if an optimizer evaluates no point, or one out of the unit cube; if
            all simulations failed, with the error of the first; if ``folder`` holds another search
            or simulations of a model that has changed, or the optimizer asks for other points than
            before.
        InputTypeError: If an argument is not of the types above.

        An error of the optimizer, and Ctrl-C too, comes with its own type, and with what was found
        so far as its attribute ``falsification``.

    Warns:
        FailedSimulationWarning: If some simulations failed.
        IrreproducibleWarning: If the violating input does not violate a second time.

    Example:
        >>> from rtamt_gym import Parameter, falsify
        >>> def tank(inflow, leak):
        ...     level = 1.0
        ...     for _ in range(20):
        ...         yield {"level": level}
        ...         level += inflow - leak * level
        >>> space = [Parameter("inflow", 0.1, 0.25), Parameter("leak", 0.1, 0.2)]
        >>> found = falsify(tank, {"dry": "always(level < 2)"}, space, period=1)
        >>> found
        <Falsification: dry of tank falsified, 3 simulations, robustness -0.0292841>
        >>> found.input
        Case({'inflow': 0.25, 'leak': 0.1})
        >>> print(found.explain())
        robustness -0.0292841 at 0 s, decided by level < 2 at 11 s
        <BLANKLINE>
          at       value  formula
         0 s  -0.0292841  dry = always(level < 2)
        11 s  -0.0292841  level < 2
        11 s     2.02928  level

        An optimizer of one's own:

        >>> def hill(evaluate, dimension, rng):
        ...     best = rng.random(dimension)
        ...     height = evaluate([best])[0]
        ...     while True:
        ...         points = (best + 0.1 * rng.normal(size=(4, dimension))).clip(0, 1)
        ...         heights = evaluate(points)
        ...         if heights.min() < height:
        ...             best, height = points[heights.argmin()], heights.min()
        >>> found = falsify(tank, "always(level < 2)", space, period=1, optimizer=hill)
        >>> found.falsified, found.optimizer
        (True, 'hill')
    """
    chosen = find_optimizer(optimizer)
    name = optimizer if isinstance(optimizer, str) else _name_of(optimizer)
    budget, seed = check_count(Argument("budget"), budget), _checked_seed(seed)
    judged = checked_options(reading, falsify, "episodes")

    def make(
        specs: Requirements | None,
        stop: Stop,
        signals: Mapping[str, SignalLike] | None = signals,
        judged: EvaluationOptions = judged,
    ) -> Runner:
        return Runner(
            system,
            specs,
            signals=signals,
            policy=policy,
            duration=duration,
            stop=stop,
            batch=batch,
            **judged.options(),
        )

    timeout = check_workers(n_jobs, backend, timeout)
    here = n_jobs is None and backend is None and timeout is None
    elsewhere = partial(Elsewhere, n_jobs=n_jobs, backend=backend, timeout=timeout)
    runner = make(requirements, "violation")
    specs = runner.requirements
    varied = space_of(runner, space, "falsify")
    rest = Case(fixed or {})
    if both := next((each for each in rest if each in varied.entries), None):
        raise InputError(f"expected {both!r} varied or fixed, got both")
    check_columns([*varied.columns, *rest.columns()], specs)
    of_optimizer, of_search = np.random.SeedSequence(seed).spawn(2)
    rng = np.random.default_rng(of_search)
    # A monitor that the system has gives its specifications, and so its signals and reading too.
    again = partial(make, signals=runner.signals, judged=runner.evaluation_options)
    texts = {each: str(spec.standalone()) for each, spec in specs.items()}
    scaling = _scales(scales, specs)
    fingerprint = runner.fingerprint()
    kept = None
    if folder is not None:
        about: dict[str, Any] = {"space": written_space(varied)}
        about |= {"fixed": json.loads(rest.to_json()), "optimizer": name, "seed": seed}
        identity = {
            **Recipe(runner).identity(texts),
            **about,
            "scales": scaling,
        }
        opened = Folder(
            *(folder, identity, {}, texts, runner.name, fingerprint), accept_changed=accept_changed
        )
        kept = KeptSearch(opened, name)
    search = Search(
        *(again, runner, varied, rest, budget, seed, rng, scaling),
        elsewhere=None if here else elsewhere,
        kept=kept,
    )

    effects = Effects()

    def record() -> Record:
        reuse = None if kept is None else kept.reuse(len(search.rows))
        return Record(search.rows, texts, runner.name, Provenance.of(specs, fingerprint, reuse))

    def result(
        simplest: Trial | None = None, reductions: int = 0, *, interrupted: bool = False
    ) -> Falsification:
        best = search.rows[search.best]
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
        what = f"falsification of {runner.name}"
        with shown_progress(what, budget if progress else 0, "run") as search.advance:
            try:
                with suppress(SearchOver):
                    _optimize(chosen, name, search, np.random.default_rng(of_optimizer))
                if kept is not None and search.rows:
                    kept.finish(record(), search.valued)
                effects = search.effects()
            finally:
                search.close()
        _check_rows(search, runner, name)
        if search.violated is None:
            return result()
        return result(*_reproduced(search, runner, varied, _REDUCTIONS if reduce else 0))
    except BaseException as error:
        if search.rows:
            _carry(error, result(interrupted=True))
        raise


def _optimize(optimizer: Optimizer, name: str, search: Search, rng: np.random.Generator) -> None:
    try:
        optimizer(search, search.dimension, rng)
    except ModuleNotFoundError as error:
        raise naming_extra(error, f"optimizer={name!r}", "search") from error


def _check_rows(search: Search, runner: Runner, optimizer: str) -> None:
    """Warns if some simulations failed.

    Raises:
        InputError: If all did, or there are none.
    """
    if not search.rows:
        raise InputError(
            f"the optimizer {optimizer} evaluated no point; it is called with evaluate, the "
            "dimension and a generator, and calls evaluate(points) until that ends it"
        )
    tell_failures(Record(search.rows, {}, runner.name))


def _again(search: Search, runner: Runner, case: Case) -> Trial | None:
    """The row of a case under the seed that violates; None if it does not violate."""
    seed = search.rows[-1].seed
    ((_, row),) = runner.run([case], None if seed is None else [seed])
    violates = not row.error and row.outcomes[search.closest].verdict is Verdict.VIOLATED
    return row if violates else None


def _reproduced(search: Search, runner: Runner, space: Space, most: int) -> tuple[Trial, int]:
    """The violating simulation, run again and reduced; and how many simulations that took."""
    row = _again(search, runner, search.rows[-1].case)
    if row is not None:
        return reduced(row, space, partial(_again, search, runner), most)
    warnings.warn(
        f"the input that violated {search.violated} did not do so a second time: {runner.name} "
        "is not the same in every simulation of one input",
        IrreproducibleWarning,
        stacklevel=caller_level(),
    )
    return search.rows[-1], 0


def _checked_seed(seed: Any) -> int:  # noqa: ANN401 - checked here
    if isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0:
        raise InputError(
            "expected ", Argument("seed"), f" as a whole number, 0 or more, got {seed!r}"
        )
    return int(seed)


def _scales(
    given: Mapping[str, float] | Literal["plain"] | None, specs: Mapping[str, Specification]
) -> Mapping[str, float] | None:
    """The scales that were given; None: they are to be found."""
    if given is None:
        return None if needs_scales(specs.values()) else {}
    if isinstance(given, Mapping):
        return given_scales(given, specs)
    if given != "plain":
        raise InputError(
            f'expected scales= as {{"rpm < 3000": 1000}}, None or "plain", got {given!r}'
        )
    return {}


def _name_of(optimizer: Any) -> str:  # noqa: ANN401 - any function
    return str(getattr(optimizer, "__name__", type(optimizer).__name__))


def _carry(error: BaseException, found: Falsification) -> None:
    """Makes what was found so far the attribute ``falsification`` of an error, and says so."""
    with suppress(AttributeError):  # of an error that takes no attributes
        crashed: Any = error
        crashed.falsification = found
        runs = counted(found.simulations, "simulation")
        error.add_note(f"error.falsification holds {runs}")
