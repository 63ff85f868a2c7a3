"""`simulate`: runs one simulation under specifications."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Unpack

from rtamt import InputError
from rtamt_gym.inputs.case import Waveform
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.mujoco.values import MonitorSetValues
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.play.run import Run
from rtamt_gym.play.run_record import Stop
from rtamt_gym.play.simulation import Simulator
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.systems.environment import with_own_monitor
from rtamt_gym.systems.system import Policy, no_exit
from rtamt_gym.wrappers.monitor import monitor_of

if TYPE_CHECKING:
    from rtamt_gym.live.view import RerunView
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
    live: RerunView | None = None,
    **reading: Unpack[EvaluationKeywords],
) -> Run:
    """Run a simulation under specifications until a violation is certain; record every sample.

    Sample 0 is the state before the first step. An environment with an `StlMonitor` or `StlReward`
    uses its specifications, signals, period and options unless ``specs`` is given; the monitor
    ends no episode here. docs/simulations.md describes systems, cases, ends and branches.

    Args:
        system: A Gymnasium environment, ``(model, data)`` of MuJoCo, a `StepMonitor` (from its
            current state on), `Fmus`, a function from time to sample, or an iterable of samples. A
            sample is a mapping from names to numbers.
        specs: A specification (text, path of a ``.stl`` file, formula, `rtamt.Specification` or the
            name of an environment's own requirement), or several by name. Default: the
            specifications of the environment or its monitor.
        signals: The sources of the variables, and further signals to record: selectors, variables
            of FMUs or keys of samples. Default: the system's own signals, and keys by name.
        case: Numbers and waveforms by name, such as a `Case`; attributes, model and data are
            restored afterwards.
        start: The snapshot where the branch of a `StepMonitor` starts. Default: its current state.
        policy: A function of the observation, or of model and data. Default: the ``baseline`` of
            the environment, if it has one.
        seed: The seed of an environment's reset.
        duration: The maximum simulated time in seconds, at least a step; the period must be known.
            ``math.inf``: no limit. Default: until the system ends by itself.
        stop: ``"violation"``: at the first certain violation; ``"decided"``: also once every
            verdict is certain; ``"known"``: also once every robustness is known, checked every
            tenth sample; ``"verdicts"``: only once all verdicts are certain; ``"end"``: never.
        above: Numbers by specification, for ``stop="known"``: a robustness that certainly stays
            above its number counts as known.
        label: A name for tables and pictures.
        live: A view that shows each sample, such as ``rtamt_gym.live.RerunView()``; further runs
            with it are further episodes. Default: no view.
        **reading: Evaluation options.

    Returns:
        The signals, the robustness, bounds and verdicts at every sample, and the reason for the
        end. Verdicts stay UNDECIDED after a stop, and when a `StepMonitor` only pauses.

    Raises:
        SpecificationError: If a specification is wrong or needs a period.
        InputError: If a variable cannot be read, an argument is missing or wrong, or a signal is
            nan. An error after sample 0 and Ctrl-C keep their type and get the samples so far as
            their attribute ``run``, a `Run` with ``ended="error"``.
        InputTypeError: If the system has another type, or specifications are missing.
        StateError: If the simulation is unstable, or a `StepMonitor` has finished.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import simulate
        >>> env = gym.make("CartPole-v1")
        >>> specs = {"upright": "always(abs(angle) < 0.1)", "near": "always(abs(x) < 1)"}
        >>> signals = {"angle": "obs[2]", "x": "obs[0]"}
        >>> run = simulate(env, specs, signals, policy=lambda obs: int(obs[3] > 0), seed=1)
        >>> run
        <Run of CartPole-v1: violation of near at 2.36 s, 119 samples>
    """
    options = checked_options(reading, simulate, "runs")
    specs, signals, options = with_own_monitor(monitor_of(system), specs, signals, options)
    monitor = system if isinstance(system, MonitorSetValues) else monitor_of(system)
    if live is not None and monitor is not None and monitor.shown_live:
        raise InputError(
            f"expected live= of simulate or of the {type(monitor).__name__}, got both; leave one "
            "out"
        )
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
        simulation = simulator.begin(seed=seed, stop=stop, above=above, label=label, live=live)
        simulation.play()
    assert simulation.run is not None  # noqa: S101 - for mypy
    return simulation.run
