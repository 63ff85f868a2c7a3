"""`simulate`: runs one simulation under specifications."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Unpack

from rtamt_gym.inputs.waveform import Waveform
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import Stop
from rtamt_gym.play.simulation import Simulator
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.environment import monitor_of, with_own_monitor
from rtamt_gym.systems.system import Policy, no_exit

if TYPE_CHECKING:
    from rtamt_gym.mujoco.snapshots import Snapshot


@documents_options("runs")
def simulate(
    system: Any,  # noqa: ANN401 - MuJoCo is not typed
    specs: SpecsLike | None = None,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    case: Mapping[str, float | Waveform] | None = None,
    start: Snapshot | None = None,
    policy: Policy | None = None,
    seed: int | None = None,
    duration: float | None = None,
    stop: Stop = "violation",
    above: Mapping[str, float] | None = None,
    label: str = "",
    **reading: Unpack[EvaluationKeywords],
) -> Run:
    """Run a simulation under specifications until a violation is certain; record every sample.

    | system | ``signals`` | ``policy`` |
    |---|---|---|
    | a Gymnasium environment | selectors, as for `StlMonitor` | the action for an observation |
    | ``(model, data)`` of MuJoCo | selectors, as for `StepMonitor` | sets ``data.ctrl``; optional |
    | a `StepMonitor`, from its present state on | its own | sets ``data.ctrl``; optional |
    | `Fmus`: FMUs connected | names of their variables | |
    | a function from time to sample | keys of the sample | |
    | an iterable of samples, or a generator function | keys of the sample | |

    A sample is a mapping from names to numbers. For the last three systems, a variable that is not
    in ``signals`` reads the value of its own name; environments with ``signals`` of their own, such
    as scenarios, name theirs.

    A ``case`` gives numbers and waveforms by name: actions, parameters and attributes of an
    environment; controls, initial states and constants of a model; inputs and parameters of FMUs;
    keyword arguments of a function. A step gets the value of a waveform at its start with
    ``"hold"``, at its end with ``"linear"`` and ``"pchip"``; a function gets the waveform itself.
    Afterwards attributes, model and data are restored. docs/simulations.md lists the names.

    An environment may have an `StlMonitor` or `StlReward`, with wrappers around it, which sets
    specifications, signals, period and evaluation options unless ``specs`` is given. The policy
    sees the outputs of the wrappers; samples and rewards are those that the monitor reads. The
    monitor ends no episode: ``stop`` sets when the run ends.

    Sample 0 is the state before the first step: an environment's observation at reset, the present
    state of a MuJoCo model's data, an FMU's outputs after its initialization.

    ``at_termination`` sets how open verdicts are decided if the system ends by itself,
    ``at_truncation`` if its time limit or ``duration`` ends the run. They stay UNDECIDED in a run
    that was stopped, and at the ``duration`` of a `StepMonitor` that continues afterwards.

    A `StepMonitor` has its own specifications and options. Its run continues as `StepMonitor.run`
    does: robustness, bounds and verdicts judge the whole episode, and the first recorded sample is
    the monitor's last one. With ``start=snapshot`` the run is a branch from the snapshot, after
    which monitor and simulation are restored exactly. A policy may make such branches.

    An error after sample 0, and Ctrl-C, keeps its type and gets the samples so far as its attribute
    ``run``: a `Run` whose ``ended`` is ``"error"``.

    Args:
        system: The simulation to run.
        specs: A specification (text, path of a ``.stl`` file, formula, or `rtamt.Specification`),
            or several by name; every formula of a text that no other one uses is a specification.
            The name of an environment's own requirement (``"AT1"``) stands for it. None: all of
            these, or those of its monitor; required for a `StepMonitor`.
        signals: What the variables of the specifications read, and further signals to record.
        case: Numbers and waveforms by name, such as a `Case`.
        start: Where a `StepMonitor` branches off. None: it continues from its present state.
        policy: The function that acts; its arguments are the observation, or model and data. For
            more of an environment, use a closure: ``lambda obs: act(env.unwrapped)``. It does not
            drive what a case drives. None: the ``baseline`` of an environment that has one.
        seed: The seed of an environment's reset.
        duration: The maximum simulated time in seconds; the period of the samples must be known.
            None: until the system ends by itself, which a model, an FMU or a function of time never
            does; with ``math.inf`` they run until they are stopped.
        stop: When to stop. ``"violation"``: at the first certain violation; ``"decided"``: also
            once every verdict is certain; ``"known"``: also once every robustness is known, checked
            after every tenth sample; ``"verdicts"``: only once every verdict is certain, not at a
            violation while others are open; ``"end"``: not before the end.
        above: Numbers by specification, for ``stop="known"``: a robustness that is certain to stay
            above its number is known; without a number, one that cannot change any more.
        label: A name for tables and pictures that tells who acted.
        **reading: Evaluation options, those of `rtamt_gym.EvaluationOptions`: ``period``, ``view``,
            ``nan``, ``align``, ``semantics``, ``inputs``, ``outputs``, ``at_termination``,
            ``at_truncation`` and ``substeps``.

    Returns:
        The signals, the robustness with its bounds and verdicts at every sample, and why it ended.

    Raises:
        SpecificationError: If a specification is wrong, reads the first sample only, has a bound
            that is not a multiple of the period without ``align``, or needs a period and has none.
        InputError: If a variable cannot be read, a policy, a period or a duration is missing, the
            duration is shorter than a step, a signal is nan, the semantics is unknown, or a name in
            ``inputs`` or ``outputs`` is no variable; if a `StepMonitor` is given what it has of its
            own.
        InputTypeError: If the system is not one of those above, or specifications are missing.
        StateError: If the simulation is unstable; if a `StepMonitor` has finished.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import simulate
        >>> run = simulate(
        ...     gym.make("CartPole-v1"),
        ...     {"upright": "always(abs(angle) < 0.1)", "near": "always(abs(x) < 1)"},
        ...     {"angle": "obs[2]", "x": "obs[0]"},
        ...     policy=lambda obs: int(obs[3] > 0),
        ...     seed=1,
        ... )
        >>> run
        <Run of CartPole-v1: violation of near at 2.36 s, 119 samples>
        >>> run.histories["near"].verdict.name, run.histories["upright"].verdict.name
        ('VIOLATED', 'UNDECIDED')
    """
    options = checked_options(reading, simulate, "runs")
    specs, signals, options = with_own_monitor(monitor_of(system), specs, signals, options)
    with no_exit("the system"):
        simulator = Simulator(
            system,
            specs,
            signals,
            options,
            case=case,
            start=start,
            policy=policy,
            duration=duration,
        )
        simulation = simulator.begin(seed=seed, stop=stop, above=above, label=label)
        simulation.play()
    assert simulation.run is not None  # noqa: S101 - for mypy
    return simulation.run
