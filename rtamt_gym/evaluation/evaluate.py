"""`evaluate_policy`: plays episodes of a policy and counts how many satisfy each requirement."""

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
from rtamt_gym.checks.arguments import check_choice, check_count
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.frames import Filming, Frame, replay_difference
from rtamt_gym.evaluation.repeating import (
    refuse_unrepeated,
    repeats,
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
from rtamt_gym.play.episodes import Episodes
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import Stop
from rtamt_gym.play.runner import Requirements, Runner
from rtamt_gym.play.vector import VectorEpisodes
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
    from rtamt_gym.play.workers import ClusterBackend


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
    r"""Plays episodes of a policy and counts how many satisfy each requirement.

    Episode i has the seed ``seed + i``, for its reset and for whatever is random in the policy.
    The result depends on nothing else: not on how many episodes run side by side, in which process,
    or which is over first; but see ``n_envs`` for networks.

    | policy | who acts |
    |---|---|
    | a model of Stable-Baselines3 | its ``predict``; the memory of a recurrent one starts anew |
    | a function | the action for an observation; it is taken to have no memory |
    | a class of such | an object for each episode: ``Class()``, or ``Class(seed=...)`` |
    | ``"random"``, ``"zero"`` | actions drawn from their space; the action nearest to zero |
    | ``"baseline"`` | the environment's own policy, as scenarios have one |
    | ``"sb3:FILE.zip"`` | a model that Stable-Baselines3 has saved, which is trusted code |
    | ``"module:function"``, ``"module:Class"`` | a function, or a class of such, of a module |

    A model is anything with ``predict(observation, state, episode_start, deterministic=...)`` for
    one observation or a batch. It sees observations normalised where it has its ``VecNormalize``
    from the training; the file of a model does not hold it.

    An environment may have an `StlMonitor` or `StlReward`, with wrappers around it. Then the policy
    sees what they append, specifications, signals, period and readings are the monitor's unless
    specifications are given, and returns are sums of the rewards that the monitor reads. It ends no
    episode here.

    With ``until_width`` or ``target`` no more episodes are played than the answer needs, and
    ``episodes`` is the most: the episodes are looked at in their order until every requirement has
    its answer, and those beyond are left out. `Evaluation.decision` says the answers.

    ``stop="violation"`` saves the rest of every episode that violates a requirement. The rate at
    which all requirements are satisfied at once stays as without it, and so does the rate of a
    single requirement. The other requirements may be undecided at the stop, so that their rates are
    too low. Robustness, returns and lengths end at the stop. ``"decided"`` and ``"known"`` stop
    at the first violation too. ``"verdicts"`` stops once all verdicts are certain and leaves all
    rates as they are; robustness, returns and lengths end at the stop.

    Args:
        policy: Who acts, see above.
        env: The id of an environment, a function that makes one, an environment, or a vector
            environment that takes a seed for each of its own. One that resets by itself plays one
            episode in each of its environments, and begins anew once all are over.
        specs: The specifications, as for `simulate`, or names of requirements that the environment
            has. None: what its monitor monitors, or all that it has of its own.
        signals: What their variables read, as for `simulate`.
        episodes: How many episodes are played.
        seed: The seed of the first episode; each further one has one more.
        n_envs: How many episodes run side by side in a process: a model that gives the action that
            it holds for best acts in all of them at once. A network may round otherwise for a batch
            than for one observation; in a chaotic simulation that can change single verdicts.
        n_jobs: How many processes play episodes; -1: as many as there are cores. None: this one.
        backend: Where the processes run: None: on this machine; ``"dask"``, ``"ray"``.
        timeout: Seconds that an episode may take, in a process of its own; one that takes longer is
            ended and counts as failed.
        folder: A folder for finished episodes: the same call goes on there after an interruption.
            Another call is refused, and so is one whose policy, environment or simulator has
            changed: the folder stores hashes of their files and of the values that functions hold,
            and versions.
        accept_changed: As for `rtamt_gym.sweep`, of the episodes in the folder.
        duration: The longest simulated time of an episode, as for `simulate`.
        stop: When to stop an episode, see above and `simulate`.
        deterministic: Whether a model gives the action that it holds for best, or draws one.
        until_width: Stops once the interval of every rate is at most so wide.
        target: Stops once it is clear of every rate whether it meets this target.
        alpha: The greatest chance that the answer to ``target`` is wrong.
        margin: How far below the target a rate is to be told from it.
        interval: The kind of the 95 % intervals of rates: ``"exact"``, of Clopper and Pearson,
            holds the true rate in at least 95 of 100 evaluations; ``"wilson"``, which is narrower,
            in about 95, at rates near 0 and 1 in far fewer.
        keep: How many of the worst episodes of each requirement are played again in full at the
            end, for `Evaluation.worst_runs`; with pictures if the environment was made with
            ``render_mode="rgb_array"``, but not of a vector environment.
        name: What the policy is called in tables, files and reports, to tell it from others. None:
            as it says itself, a model by its class if it has no ``name``.
        progress: Whether to show a bar on a terminal, after a second, if tqdm is installed.
        **reading: How samples are judged, the options of `rtamt_gym.EvaluationOptions`: ``period``,
            ``view``, ``nan``, ``align``, ``semantics``, ``inputs``, ``outputs``, ``at_termination``
            and ``at_truncation``.

    Returns:
        Rates with intervals, robustness, returns and more of every requirement. An episode that an
        error ended counts as not satisfied, and has the error in its row.

    Raises:
        KeyboardInterrupt: On Ctrl-C, with the `Evaluation` of the episodes so far as its attribute
            ``evaluation`` if there are any: those up to the first that is not over.
        SpecificationError: If a specification is wrong.
        InputError: If an argument is wrong, the policy does not fit the environment, ``folder``
            holds another campaign or episodes of a model that has changed, or all episodes failed.
        InputTypeError: If the policy is none, or cannot be sent to another process.

    Warns:
        OpenEndWarning: Once, if the environment has ended an episode while a requirement was open
            that counts as satisfied then, and ``at_termination`` does not say so.
        FailedSimulationWarning: If some episodes failed.
        UnrepeatedSeedWarning: If two resets with one seed begin differently. To know it the
            environment is reset twice more, after the episodes. Also if one of the worst episodes
            has another robustness when it is played again, as with a policy that draws numbers
            which the seed does not choose.
        RuntimeWarning: Once, if the environment could not be rendered.

    Example:
        >>> from rtamt_gym import evaluate_policy
        >>> result = evaluate_policy(
        ...     lambda obs: int(obs[2] + obs[3] > 0),
        ...     "CartPole-v1",
        ...     {"upright": "always(abs(angle) < 0.05)", "near": "always(abs(x) < 0.2)"},
        ...     {"angle": "obs[2]", "x": "obs[0]"},
        ...     episodes=50,
        ...     at_termination="failure",
        ... )
        >>> result.requirements["near"]
        <near: 13 of 50 episodes satisfy it, 37 violated>
        >>> rate, (low, high) = result.success.rate, result.success.interval
        >>> print(f"{rate:.2f}, in truth between {low:.2f} and {high:.2f}")
        0.26, in truth between 0.15 and 0.40
        >>> seed, robustness = result.requirements["near"].worst[0]
        >>> result.replay(seed)
        <Run of CartPole-v1: terminated at 6.68 s, 335 samples>
    """
    judged = checked_options(reading, evaluate_policy, "episodes")
    check_count(Argument("episodes"), episodes)
    check_count(Argument("n_envs"), n_envs)
    check_choice("interval", interval, get_args(IntervalKind))
    check_name_of_policy(name)
    given: dict[str, object] = {"keep": keep, "seed": seed}
    for each, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
            raise InputError(
                "expected ", Argument(each), f" as a whole number, 0 or more, got {value!r}"
            )
    env, made = _made(env, n_envs)
    kind = VectorEpisodes if isinstance(made, VectorEnv) else partial(Episodes, n_envs=n_envs)
    runner: Episodes | VectorEpisodes = kind(
        env,
        specs,
        made=made,
        policy=policy,
        signals=signals,
        deterministic=deterministic,
        duration=duration,
        stop=stop,
        **judged.options(),
    )
    stopping = stopping_of(runner.requirements, until_width, target, alpha, margin, interval)
    rules: dict[str, Any] = {"until_width": until_width, "target": target}
    rules |= {"alpha": alpha, "margin": margin} if target is not None else {}
    rules |= {"interval": interval} if until_width is not None else {}

    def made_of(
        record: Record, keep: int, planned: int | None = None, *, begun: bool | None = None
    ) -> Evaluation:
        period = seconds_of(runner.period)
        shown = _worst_runs(runner, period, record, keep)
        return Evaluation(
            record,
            runner.name,
            name or runner.evaluated.name,
            period,
            runner.duration,
            int(seed),
            None if stopping is None else dict(stopping.decisions),
            shown.runs,
            shown.frames,
            reading_of(runner),
            interval,
            False if shown.differing else begun,
            planned,
            shown.differing,
            runner,
        )

    campaign = partial(
        run_campaign,
        runner,
        [({}, each) for each in range(seed, seed + episodes)],
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
    except KeyboardInterrupt as pressed:
        so_far: Any = pressed
        if len(getattr(pressed, "record", ())):
            so_far.evaluation = made_of(so_far.record, 0, episodes)
        raise
    tell_failures(record)
    try:
        if runner.unasked:
            _tell_open_end(runner, record)
        begun = _repeats(runner, record)
        return made_of(record, 0 if begun is False else keep, begun=begun)
    except KeyboardInterrupt as pressed:  # all episodes are over: only what was played again is not
        whole: Any = pressed
        whole.evaluation = made_of(record, 0)
        raise


def _made(env: Any, n_envs: int) -> tuple[Any, Any]:  # noqa: ANN401
    """The environment, or the function that makes it, and what it has made."""
    if isinstance(env, str):
        env = make(env)
    made = env
    if callable(env) and not isinstance(env, gym.Env | VectorEnv):
        with no_exit("the function that makes the environment"):
            made = env()
    if isinstance(made, VectorEnv) and n_envs not in (1, made.num_envs):
        raise InputError(
            Argument("n_envs"),
            f" comes from the vector environment, which has {made.num_envs}, got {n_envs}",
        )
    if not isinstance(made, gym.Env | VectorEnv):
        raise InputTypeError(
            "expected the id of an environment, a function that makes one, an environment or a "
            f"vector environment, got {made!r}"
        )
    return env, made


def check_repeats(env: Any, seed: Any) -> None:  # noqa: ANN401 - as `evaluate_policy` takes them
    """Refuses an environment in which two resets with one seed begin differently.

    It makes the environment, if that is an id or a function, resets it twice and closes it.

    Raises:
        InputError: If they do; or as `evaluate_policy` does.
    """
    _, made = _made(env, 1 if not isinstance(env, VectorEnv) else env.num_envs)
    try:
        whole = isinstance(seed, int | np.integer)  # else `evaluate_policy` refuses it
        if whole and repeats(made, int(seed)) is False:
            refuse_unrepeated(made.spec.id if made.spec else type(made.unwrapped).__name__)
    finally:
        if made is not env:
            made.close()


def _repeats(runner: Episodes | VectorEpisodes, record: Record) -> bool | None:
    """Whether the seed of an episode that went well begins alike twice; tells if not.

    It is asked at the end, in this process, where the worst episodes are played again too: an
    environment that hangs or crashes with a seed has failed with it by then.
    """
    seeds = [row.seed for row in record if not row.error and row.seed is not None]
    begun = repeats(runner.system, seeds[0])
    if begun is False:
        tell_unrepeated(runner.name, seeds[0])
    return begun


def _tell_open_end(runner: Runner, record: Record) -> None:
    """Warns once if an end that nobody has said the meaning of has satisfied what was open."""
    for name in record.requirements:
        for row in record:
            outcome = row.outcomes.get(name)
            if outcome is None or row.ended != "terminated":
                continue
            # What the last sample has decided, or the end: one episode shows it.
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
    """Adds an episode to those that are counted; whether they are enough."""
    satisfied = {
        name: not row.error
        and name in row.outcomes
        and row.outcomes[name].verdict is Verdict.SATISFIED
        for name in stopping.decisions
    }
    stopping.add(satisfied)
    return stopping.done


class _WorstRuns(NamedTuple):
    """The worst episodes of each requirement, played again.

    Attributes:
        runs: The runs by requirement, the worst first.
        frames: Pictures by seed.
        differing: The seeds of episodes whose replay differs from the record.
    """

    runs: dict[str, tuple[Run, ...]]
    frames: dict[int, tuple[Frame, ...]]
    differing: tuple[int, ...]


def _worst_runs(
    runner: Episodes | VectorEpisodes, period: Fraction | None, record: Record, keep: int
) -> _WorstRuns:
    """Play the worst episodes of each requirement again in full.

    Warns once if the replay of an episode differs from the record, and leaves out all that do.
    """
    filming = Filming(runner, period)
    runs: dict[int, Run] = {}
    differing: dict[int, str] = {}
    failed: dict[int, Exception] = {}
    frames = {}
    found = {}
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
            except Exception as error:  # noqa: BLE001 - what was found without it stays
                failed[number] = error
                continue
            if differs:
                differing[number] = differs
                continue
            runs[number] = run
            if pictures:
                frames[number] = pictures
        numbers = [row.seed or 0 for row in ranked[:keep]]
        found[name] = tuple(runs[number] for number in numbers if number in runs)
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
    return _WorstRuns(found, frames, tuple(differing))


def reading_of(runner: Episodes | VectorEpisodes) -> dict[str, Any]:
    """How a runner reads and judges episodes, as JSON can write it.

    It has a signal for each variable of the requirements, wherever it comes from; None stands for a
    function, of which nobody knows what it reads.
    """
    found = runner.evaluation_options.written()
    monitor = runner.monitor
    signals = {
        **own_signals(runner.system),
        **((monitor.judging.signals or {}) if monitor is not None else {}),
        **(runner.signals or {}),
    }
    variables = {name for spec in runner.requirements.values() for name in spec.variables}
    found["signals"] = {
        name: _signal_text(ParsedSignal.parse(name, signals[name], SOURCES))
        for name in sorted(variables)
        if name in signals
    }
    return found


def _signal_text(signal: ParsedSignal) -> str | None:
    """What a signal reads, and its value at reset if it was given one."""
    if signal.source is None:
        return None
    if signal.default is None:
        return str(signal)
    value = "unknown" if math.isnan(signal.default) else repr(signal.default)
    return f"{signal}, {value} at reset"
