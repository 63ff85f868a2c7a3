"""Signal temporal logic for simulations: Gymnasium environments under `rtamt` monitors.

Names are imported when first used: the command line monitors recorded traces without Gymnasium.
Without an optional package, ``from rtamt_gym import *`` gives the names that do not need it, and to
import one that does is an error that says which extra installs the package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rtamt_gym.checks import released  # noqa: F401 - first, as it says what else could not
from rtamt_gym.checks.extras import missing, naming_extra

if TYPE_CHECKING:
    from rtamt_gym.datasets.relabel import relabel
    from rtamt_gym.evaluation.comparison import Comparison, compare
    from rtamt_gym.evaluation.evaluate import evaluate_policy
    from rtamt_gym.evaluation.evaluation import Evaluation
    from rtamt_gym.evaluation.methods import MethodComparison, compare_methods
    from rtamt_gym.inputs.case import Case
    from rtamt_gym.inputs.ranges import Parameter, Signal
    from rtamt_gym.inputs.space import Space
    from rtamt_gym.inputs.waveform import Waveform
    from rtamt_gym.mujoco.rollouts import evaluate_rollouts
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor
    from rtamt_gym.options.evaluation import Reading
    from rtamt_gym.play.record import Record
    from rtamt_gym.play.run import Run
    from rtamt_gym.play.runner import Runner
    from rtamt_gym.play.saved_case import SavedCase
    from rtamt_gym.play.simulate import simulate
    from rtamt_gym.reports.write import write_report
    from rtamt_gym.results.statistics import RequirementResult
    from rtamt_gym.search.falsification.falsification import Falsification
    from rtamt_gym.search.falsification.falsify import falsify
    from rtamt_gym.search.mining.mining import Mined, mine
    from rtamt_gym.search.sweeps.sweep import Sweep, sweep
    from rtamt_gym.signals.signals import Step, batched
    from rtamt_gym.systems.fmi import Fmus
    from rtamt_gym.wrappers.monitor import CostEnv, StlMonitor
    from rtamt_gym.wrappers.overlay import RobustnessOverlay
    from rtamt_gym.wrappers.parallel import ParallelStlMonitor, ParallelStlReward
    from rtamt_gym.wrappers.recording import RecordViolations
    from rtamt_gym.wrappers.reward import StlReward
    from rtamt_gym.wrappers.vector_forms import SharedBuffers, as_vector_env
    from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor
    from rtamt_gym.wrappers.vector_reward import VectorStlReward

    __all__ = [
        "Case",
        "Comparison",
        "CostEnv",
        "Evaluation",
        "Falsification",
        "Fmus",
        "MethodComparison",
        "Mined",
        "ParallelStlMonitor",
        "ParallelStlReward",
        "Parameter",
        "Reading",
        "Record",
        "RecordViolations",
        "RequirementResult",
        "RobustnessOverlay",
        "Run",
        "Runner",
        "SavedCase",
        "SharedBuffers",
        "Signal",
        "Snapshot",
        "Space",
        "Step",
        "StepMonitor",
        "StlMonitor",
        "StlReward",
        "Sweep",
        "VectorStlMonitor",
        "VectorStlReward",
        "Waveform",
        "as_vector_env",
        "batched",
        "compare",
        "compare_methods",
        "evaluate_policy",
        "evaluate_rollouts",
        "falsify",
        "mine",
        "relabel",
        "simulate",
        "sweep",
        "write_report",
    ]

_MODULES = {
    "Case": "rtamt_gym.inputs.case",
    "Comparison": "rtamt_gym.evaluation.comparison",
    "CostEnv": "rtamt_gym.wrappers.monitor",
    "Evaluation": "rtamt_gym.evaluation.evaluation",
    "Falsification": "rtamt_gym.search.falsification.falsification",
    "Fmus": "rtamt_gym.systems.fmi",
    "MethodComparison": "rtamt_gym.evaluation.methods",
    "Mined": "rtamt_gym.search.mining.mining",
    "ParallelStlMonitor": "rtamt_gym.wrappers.parallel",
    "ParallelStlReward": "rtamt_gym.wrappers.parallel",
    "Parameter": "rtamt_gym.inputs.ranges",
    "Reading": "rtamt_gym.options.evaluation",
    "Record": "rtamt_gym.play.record",
    "RecordViolations": "rtamt_gym.wrappers.recording",
    "RobustnessOverlay": "rtamt_gym.wrappers.overlay",
    "RequirementResult": "rtamt_gym.results.statistics",
    "Run": "rtamt_gym.play.run",
    "Runner": "rtamt_gym.play.runner",
    "SavedCase": "rtamt_gym.play.saved_case",
    "SharedBuffers": "rtamt_gym.wrappers.vector_forms",
    "Signal": "rtamt_gym.inputs.ranges",
    "Snapshot": "rtamt_gym.mujoco.snapshots",
    "Space": "rtamt_gym.inputs.space",
    "Step": "rtamt_gym.signals.signals",
    "StepMonitor": "rtamt_gym.mujoco.step_monitor",
    "StlMonitor": "rtamt_gym.wrappers.monitor",
    "StlReward": "rtamt_gym.wrappers.reward",
    "Sweep": "rtamt_gym.search.sweeps.sweep",
    "VectorStlMonitor": "rtamt_gym.wrappers.vector_monitor",
    "VectorStlReward": "rtamt_gym.wrappers.vector_reward",
    "Waveform": "rtamt_gym.inputs.waveform",
    "as_vector_env": "rtamt_gym.wrappers.vector_forms",
    "batched": "rtamt_gym.signals.signals",
    "compare": "rtamt_gym.evaluation.comparison",
    "compare_methods": "rtamt_gym.evaluation.methods",
    "evaluate_policy": "rtamt_gym.evaluation.evaluate",
    "evaluate_rollouts": "rtamt_gym.mujoco.rollouts",
    "falsify": "rtamt_gym.search.falsification.falsify",
    "mine": "rtamt_gym.search.mining.mining",
    "relabel": "rtamt_gym.datasets.relabel",
    "simulate": "rtamt_gym.play.simulate",
    "sweep": "rtamt_gym.search.sweeps.sweep",
    "write_report": "rtamt_gym.reports.write",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any of the names above
    if name == "__all__":
        return [each for each in _MODULES if _is_there(each)]
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module(_MODULES[name]), name)
    except ModuleNotFoundError as error:
        raise naming_extra(error, f"{__name__}.{name}") from error


def _is_there(name: str) -> bool:
    """Whether the packages that a name needs are installed."""
    try:
        __getattr__(name)
    except ModuleNotFoundError as error:
        if missing(error) is None:
            raise
        return False
    return True


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
