"""Signal temporal logic for simulations: Gymnasium environments under `rtamt` monitors.

Names are imported at their first use: the command line monitors recorded traces without Gymnasium.
Without an optional package, ``from rtamt_gym import *`` imports the names that do not need it, and
the import of any other name is an error with the extra that installs the package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rtamt.renamed import NAMES, old_name
from rtamt_gym.checks.extras import missing, naming_extra

if TYPE_CHECKING:
    from rtamt_gym import live as live
    from rtamt_gym import mujoco as mujoco
    from rtamt_gym import results as results
    from rtamt_gym import wrappers as wrappers
    from rtamt_gym.commands.recordings import judge_recordings
    from rtamt_gym.datasets.relabel import relabel
    from rtamt_gym.evaluation.comparison import compare
    from rtamt_gym.evaluation.evaluate import evaluate_policy
    from rtamt_gym.evaluation.methods import compare_methods
    from rtamt_gym.inputs.case import Case, Waveform
    from rtamt_gym.inputs.space import Parameter, Signal, Space
    from rtamt_gym.mujoco.step_monitor import StepMonitor
    from rtamt_gym.options.evaluation import EvaluationOptions
    from rtamt_gym.play.runner import Runner
    from rtamt_gym.play.simulate import simulate
    from rtamt_gym.reports.write import write_report
    from rtamt_gym.search.falsification.falsify import falsify
    from rtamt_gym.search.mining.mining import mine
    from rtamt_gym.search.sweeps.sweep import sweep
    from rtamt_gym.signals.signals import Step
    from rtamt_gym.systems.fmi import Fmus
    from rtamt_gym.wrappers.monitor import CostEnv, StlMonitor
    from rtamt_gym.wrappers.overlay import RobustnessOverlay
    from rtamt_gym.wrappers.parallel import ParallelStlMonitor, ParallelStlReward
    from rtamt_gym.wrappers.recording import RecordViolations
    from rtamt_gym.wrappers.reward import StlReward, VectorStlReward
    from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor

    __all__ = [
        "Case",
        "CostEnv",
        "EvaluationOptions",
        "Fmus",
        "ParallelStlMonitor",
        "ParallelStlReward",
        "Parameter",
        "RecordViolations",
        "RobustnessOverlay",
        "Runner",
        "Signal",
        "Space",
        "Step",
        "StepMonitor",
        "StlMonitor",
        "StlReward",
        "VectorStlMonitor",
        "VectorStlReward",
        "Waveform",
        "compare",
        "compare_methods",
        "evaluate_policy",
        "falsify",
        "judge_recordings",
        "mine",
        "relabel",
        "simulate",
        "sweep",
        "write_report",
    ]

if TYPE_CHECKING:  # Old names, which `rtamt.renamed` lists; the next version removes them.
    from rtamt_gym.mujoco import evaluate_rollouts as evaluate_rollouts
    from rtamt_gym.results import Comparison as Comparison
    from rtamt_gym.results import Evaluation as Evaluation
    from rtamt_gym.results import Falsification as Falsification
    from rtamt_gym.results import MethodComparison as MethodComparison
    from rtamt_gym.results import Mined as Mined
    from rtamt_gym.results import Record as Record
    from rtamt_gym.results import RequirementResult as RequirementResult
    from rtamt_gym.results import Run as Run
    from rtamt_gym.results import SavedCase as SavedCase
    from rtamt_gym.results import Snapshot as Snapshot
    from rtamt_gym.results import Sweep as Sweep
    from rtamt_gym.wrappers import SharedBuffers as SharedBuffers
    from rtamt_gym.wrappers import as_vector_env as as_vector_env
    from rtamt_gym.wrappers import batched as batched

    Reading = EvaluationOptions


_MODULES = {
    "Case": "rtamt_gym.inputs.case",
    "CostEnv": "rtamt_gym.wrappers.monitor",
    "Fmus": "rtamt_gym.systems.fmi",
    "ParallelStlMonitor": "rtamt_gym.wrappers.parallel",
    "ParallelStlReward": "rtamt_gym.wrappers.parallel",
    "Parameter": "rtamt_gym.inputs.space",
    "EvaluationOptions": "rtamt_gym.options.evaluation",
    "RecordViolations": "rtamt_gym.wrappers.recording",
    "RobustnessOverlay": "rtamt_gym.wrappers.overlay",
    "Runner": "rtamt_gym.play.runner",
    "Signal": "rtamt_gym.inputs.space",
    "Space": "rtamt_gym.inputs.space",
    "Step": "rtamt_gym.signals.signals",
    "StepMonitor": "rtamt_gym.mujoco.step_monitor",
    "StlMonitor": "rtamt_gym.wrappers.monitor",
    "StlReward": "rtamt_gym.wrappers.reward",
    "VectorStlMonitor": "rtamt_gym.wrappers.vector_monitor",
    "VectorStlReward": "rtamt_gym.wrappers.reward",
    "Waveform": "rtamt_gym.inputs.case",
    "compare": "rtamt_gym.evaluation.comparison",
    "compare_methods": "rtamt_gym.evaluation.methods",
    "evaluate_policy": "rtamt_gym.evaluation.evaluate",
    "falsify": "rtamt_gym.search.falsification.falsify",
    "judge_recordings": "rtamt_gym.commands.recordings",
    "mine": "rtamt_gym.search.mining.mining",
    "relabel": "rtamt_gym.datasets.relabel",
    "simulate": "rtamt_gym.play.simulate",
    "sweep": "rtamt_gym.search.sweeps.sweep",
    "write_report": "rtamt_gym.reports.write",
}

_ROOMS = ("live", "mujoco", "results", "wrappers")


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any of the names above
    if name == "__all__":
        return [export for export in _MODULES if _is_there(export)]
    if name in NAMES[__name__]:
        return old_name(__name__, name)
    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module(_MODULES[name]), name)
    except ModuleNotFoundError as error:
        raise naming_extra(error, f"{__name__}.{name}") from error


def _is_there(name: str) -> bool:
    """Return whether the packages that a name needs are installed."""
    try:
        __getattr__(name)
    except ModuleNotFoundError as error:
        if missing(error) is None:
            raise
        return False
    return True


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
