"""`evaluate_policy`: play episodes of a policy and count how many satisfy each requirement."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack, get_args

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv

from rtamt import InputError, InputTypeError, Verdict
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_choice, check_count, check_whole
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.replays import (
    Filming,
    Frame,
    refuse_unrepeated,
    repeats,
    replay_difference,
    tell_unrepeated,
    warn_of_difference,
)
from rtamt_gym.evaluation.sequential import MARGIN, Stopping, stopping_of
from rtamt_gym.judging.end_warnings import warn_of_open_end
from rtamt_gym.options.evaluation import (
    EvaluationKeywords,
    checked_options,
    documents_options,
    seconds_of,
)
from rtamt_gym.play.campaign import run_campaign
from rtamt_gym.play.episodes import Episodes, VectorEpisodes
from rtamt_gym.play.history import Stop
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.results.intervals import IntervalKind
from rtamt_gym.results.statistics import rank
from rtamt_gym.results.trial import Trial
from rtamt_gym.search.sweeps.sweep import tell_failures
from rtamt_gym.signals.signals import ParsedSignal, SignalLike, own_signals
from rtamt_gym.signals.sources import SOURCES
from rtamt_gym.systems.policies import check_name_of_policy
from rtamt_gym.systems.registry import make
from rtamt_gym.systems.system import no_exit

if TYPE_CHECKING:  # joblib is optional
    from rtamt_gym.play.campaign import ClusterBackend


@documents_options("episodes")
def evaluate_policy(
    policy: Any,  # noqa: ANN401 - a model of a package that is optional
    env: Any,  # noqa: ANN401
    specs: Requirements | None = None,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    episodes: int = 100,
    seed: int = 0,
    n_envs: int = 1,
    n_jobs: int | None = None,
    backend: ClusterBackend | None = None,
    timeout: float | None = None,
    folder: str | os.PathLike[str] | None = None,
    accept_changed: bool = False,
    duration: float | None = None,
    stop: Stop = "end",
    deterministic: bool = True,
    until_width: float | None = None,
    target: float | None = None,
    alpha: float = 0.05,
    margin: float = MARGIN,
    interval: IntervalKind = "exact",
    keep: int = 1,
    name: str | None = None,
    progress: bool = False,
    **reading: Unpack[EvaluationKeywords],
) -> Evaluation:
    """Play episodes of a policy and count how many satisfy each requirement.

    Episode i has the seed ``seed + i``, for its reset and for a random policy. The result does not
    depend on the number of processes. docs/evaluation.md describes intervals, tests and traps.

    Args:
        policy: A model of Stable-Baselines3 (or any object with its ``predict``), a function from
            observation to action, a class of such functions (created for each episode, with
            ``seed=`` if it takes one), ``"random"``, ``"zero"``, ``"baseline"``,
            ``"sb3:FILE.zip"`` or ``"module:name"``.
        env: The id of an environment, a function that makes one, an environment, or a vector
            environment with a seed for each of its environments.
        specs: As for `simulate`. Default: the specifications of the environment or its monitor.
        signals: As for `simulate`.
        episodes: The number of episodes; with ``until_width`` or ``target``, the maximum.
        seed: The seed of the first episode.
        n_envs: The number of episodes side by side in a process. A network may round differently
            in a batch, which can change single verdicts of a chaotic simulation.
        n_jobs: The number of processes; -1: one for each core. Default: this process.
        backend: ``"dask"`` or ``"ray"`` for a cluster. Default: this machine.
        timeout: The maximum time of an episode in seconds; a longer one fails. Default: no limit.
        folder: A folder for finished episodes; the same call resumes from it. Default: none.
        accept_changed: As for `rtamt_gym.sweep`.
        duration: The maximum simulated time of an episode, as for `simulate`.
        stop: When to stop an episode, as for `simulate`. ``"violation"`` leaves other requirements
            undecided, so that their rates are too low; ``"verdicts"`` changes no rate. Robustness,
            returns and lengths end at the stop.
        deterministic: Whether a model returns its best action or draws one.
        until_width: The width of the rates' intervals at which to stop. Default: no such stop.
        target: A rate to test: stop when every requirement meets it or falls short of it.
        alpha: The maximum probability of a wrong answer to ``target``.
        margin: How far below the target a rate must be rejected.
        interval: ``"exact"`` (Clopper and Pearson) or ``"wilson"``, which is narrower.
        keep: The number of worst episodes of each requirement to play again for `worst_runs`.
        name: The name of the policy in tables, files and reports.
        progress: Whether to show a bar on a terminal if tqdm is installed.
        **reading: Evaluation options.

    Returns:
        Rates with intervals, robustness and returns. A failed episode counts as not satisfied.

    Raises:
        KeyboardInterrupt: On Ctrl-C, with the `Evaluation` so far as its attribute ``evaluation``.
        SpecificationError: If a specification is wrong.
        InputError: If an argument is wrong, the policy does not fit, ``folder`` belongs to another
            campaign or a changed model, or all episodes failed.
        InputTypeError: If the policy is not a policy, or cannot be sent to a process.

    Example:
        >>> from rtamt_gym import evaluate_policy
        >>> signals, options = {"x": "obs[0]"}, {"episodes": 5, "at_termination": "failure"}
        >>> result = evaluate_policy("zero", "CartPole-v1", "always(x < 1)", signals, **options)
        >>> result.requirements["spec"]
        <spec: 0 of 5 episodes satisfy it, 5 violated>
    """
    options = checked_options(reading, evaluate_policy, "episodes")
    check_count(Argument("episodes"), episodes)
    check_count(Argument("n_envs"), n_envs)
    check_choice("interval", interval, get_args(IntervalKind))
    check_name_of_policy(name)
    check_whole(Argument("keep"), keep)
    check_whole(Argument("seed"), seed)
    env, instance = _environment(env, n_envs)
    kind = VectorEpisodes if isinstance(instance, VectorEnv) else partial(Episodes, n_envs=n_envs)
    runner: Episodes | VectorEpisodes = kind(
        env,
        specs,
        first=instance,
        policy=policy,
        signals=signals,
        deterministic=deterministic,
        duration=duration,
        stop=stop,
        **options.options(),
    )
    stopping = stopping_of(runner.requirements, until_width, target, alpha, margin, interval)
    rules: dict[str, Any] = {"until_width": until_width, "target": target}
    rules |= {"alpha": alpha, "margin": margin} if target is not None else {}
    rules |= {"interval": interval} if until_width is not None else {}

    def evaluation_of(
        record: Record, keep: int, planned: int | None = None, *, repeated: bool | None = None
    ) -> Evaluation:
        period = seconds_of(runner.period)
        worst = _worst_runs(runner, period, record, keep)
        return Evaluation(
            record,
            runner.name,
            name or runner.evaluated.name,
            period,
            runner.duration,
            int(seed),
            None if stopping is None else dict(stopping.decisions),
            worst.runs,
            worst.frames,
            written_options(runner),
            interval,
            False if worst.differing else repeated,
            planned,
            worst.differing,
            runner,
        )

    campaign = partial(
        run_campaign,
        runner,
        [({}, number) for number in range(seed, seed + episodes)],
        n_jobs=n_jobs,
        backend=backend,
        timeout=timeout,
        folder=folder,
        accept_changed=accept_changed,
        about={"policy": runner.evaluated.identity, "rules": rules},
        what=f"evaluation of {name or runner.evaluated.name}",
        progress=progress,
        enough=None if stopping is None else partial(_add, stopping),
    )
    try:
        record = campaign()
    except KeyboardInterrupt as error:
        interrupt: Any = error
        if len(getattr(error, "record", ())):
            interrupt.evaluation = evaluation_of(interrupt.record, 0, episodes)
        raise
    tell_failures(record)
    try:
        if runner.unasked:
            _tell_open_end(runner, record)
        repeated = _repeats(runner, record)
        return evaluation_of(record, 0 if repeated is False else keep, repeated=repeated)
    except KeyboardInterrupt as error:  # all episodes are over; only replays are missing
        interrupted: Any = error
        interrupted.evaluation = evaluation_of(record, 0)
        raise


def _environment(env: Any, n_envs: int) -> tuple[Any, Any]:  # noqa: ANN401
    """Return the environment or the function that makes it, and an environment."""
    if isinstance(env, str):
        env = make(env)
    instance = env
    if callable(env) and not isinstance(env, gym.Env | VectorEnv):
        with no_exit("the function that makes the environment"):
            instance = env()
    if isinstance(instance, VectorEnv) and n_envs not in (1, instance.num_envs):
        raise InputError(
            Argument("n_envs"),
            f" comes from the vector environment, which has {instance.num_envs}, got {n_envs}",
        )
    if not isinstance(instance, gym.Env | VectorEnv):
        raise InputTypeError(
            "expected the id of an environment, a function that makes one, an environment or a "
            f"vector environment, got {instance!r}"
        )
    return env, instance


def check_repeats(env: Any, seed: Any) -> None:  # noqa: ANN401 - as `evaluate_policy` takes them
    """Raise InputError if two resets of the environment with one seed differ.

    If ``env`` is an id or a function, the environment is closed again.
    """
    _, instance = _environment(env, 1 if not isinstance(env, VectorEnv) else env.num_envs)
    try:
        is_integer = isinstance(seed, int | np.integer)  # otherwise, `evaluate_policy` refuses it
        if is_integer and repeats(instance, int(seed)) is False:
            spec = instance.spec
            refuse_unrepeated(spec.id if spec else type(instance.unwrapped).__name__)
    finally:
        if instance is not env:
            instance.close()


def _repeats(runner: Episodes | VectorEpisodes, record: Record) -> bool | None:
    """Return whether the seed of an episode that did not fail repeats its start; warn otherwise.

    The check runs after all episodes, because an environment that hangs or crashes with a seed has
    failed with it by then.
    """
    seeds = [row.seed for row in record if not row.error and row.seed is not None]
    repeated = repeats(runner.system, seeds[0])
    if repeated is False:
        tell_unrepeated(runner.name, seeds[0])
    return repeated


def _tell_open_end(runner: Runner, record: Record) -> None:
    """Warn once if an end with the default end mode satisfied an open requirement."""
    for name in record.requirements:
        for row in record:
            outcome = row.outcomes.get(name)
            if outcome is None or row.ended != "terminated":
                continue
            # One episode shows whether the last sample or the end decided it.
            last = outcome.decided is None or outcome.decided_at == row.simulated
            if outcome.verdict is Verdict.SATISFIED and last:
                again = partial(runner.simulate, {}, row.seed, stop="end")
                try:
                    failing = again(at_termination="failure")
                    if failing.histories[name].verdict is not Verdict.VIOLATED:
                        break
                    cut = again(at_termination="cut")
                except Exception:  # noqa: BLE001 - an episode that does not repeat shows nothing
                    return
                window = cut.histories[name].verdict is Verdict.UNDECIDED
                warn_of_open_end(name, window=window)
                return


def _add(stopping: Stopping, row: Trial) -> bool:
    """Count an episode; return whether the episodes are enough."""
    satisfied = {
        name: not row.error
        and name in row.outcomes
        and row.outcomes[name].verdict is Verdict.SATISFIED
        for name in stopping.decisions
    }
    stopping.add(satisfied)
    return stopping.done


class _WorstRuns(NamedTuple):
    """The worst episodes of each requirement, played again."""

    runs: dict[str, tuple[Run, ...]]
    frames: dict[int, tuple[Frame, ...]]
    differing: tuple[int, ...]


def _worst_runs(
    runner: Episodes | VectorEpisodes, period: Fraction | None, record: Record, keep: int
) -> _WorstRuns:
    """Play the worst episodes of each requirement again in full.

    Replays that differ from the record are left out, with one warning.
    """
    filming = Filming(runner, period)
    runs: dict[int, Run] = {}
    differing: dict[int, str] = {}
    failed: dict[int, Exception] = {}
    frames = {}
    result = {}
    for name in record.requirements:
        ranked = sorted(
            (row for row in record if name in row.outcomes and not row.error),
            key=lambda row: rank(row.outcomes[name], row.seed),
        )
        for row in ranked[:keep]:
            number = row.seed or 0
            if number in runs or number in failed or number in differing:
                continue
            try:
                run, pictures = filming.play(row)
                differs = replay_difference(runner, row, run)
            except Exception as error:  # noqa: BLE001 - the evaluation is complete without it
                failed[number] = error
                continue
            if differs:
                differing[number] = differs
                continue
            runs[number] = run
            if pictures:
                frames[number] = pictures
        numbers = [row.seed or 0 for row in ranked[:keep]]
        result[name] = tuple(runs[number] for number in numbers if number in runs)
    filming.tell()
    for number, why in failed.items():
        warnings.warn(
            f"the episode with seed {number} is missing among the worst ones, since it could not "
            f"be played again: {type(why).__name__}: {why}",
            RuntimeWarning,
            stacklevel=caller_level(),
        )
    for number, differs in list(differing.items())[:1]:
        warn_of_difference(record.system, number, differs)
    return _WorstRuns(result, frames, tuple(differing))


def written_options(runner: Episodes | VectorEpisodes) -> dict[str, Any]:
    """Return the evaluation options of a runner for JSON.

    ``"signals"`` has the source of each variable of the requirements; None for a function.
    """
    result = runner.evaluation_options.written()
    monitor = runner.monitor
    signals = {
        **own_signals(runner.system),
        **((monitor.judging.signals or {}) if monitor is not None else {}),
        **(runner.signals or {}),
    }
    variables = {name for spec in runner.requirements.values() for name in spec.variables}
    result["signals"] = {
        name: _signal_text(ParsedSignal.parse(name, signals[name], SOURCES))
        for name in sorted(variables)
        if name in signals
    }
    return result


def _signal_text(signal: ParsedSignal) -> str | None:
    """Return the source of a signal, and its value at reset if it has one."""
    if signal.source is None:
        return None
    if signal.default is None:
        return str(signal)
    value = "unknown" if math.isnan(signal.default) else repr(signal.default)
    return f"{signal}, {value} at reset"
