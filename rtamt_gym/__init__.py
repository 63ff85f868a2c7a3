"""Signal temporal logic for simulations: Gymnasium environments under `rtamt` monitors.

Names are imported when first used: the command line monitors recorded traces without Gymnasium.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtamt_gym.mujoco.rollouts import evaluate_rollouts
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.mujoco.step_monitor import StepMonitor
    from rtamt_gym.signals.signals import Step
    from rtamt_gym.simulation.fmi import Fmus
    from rtamt_gym.simulation.run import Run
    from rtamt_gym.simulation.simulate import simulate
    from rtamt_gym.wrappers.monitor import StlMonitor
    from rtamt_gym.wrappers.reward import StlReward
    from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor
    from rtamt_gym.wrappers.vector_reward import VectorStlReward

__all__ = [
    "Fmus",
    "Run",
    "Snapshot",
    "Step",
    "StepMonitor",
    "StlMonitor",
    "StlReward",
    "VectorStlMonitor",
    "VectorStlReward",
    "evaluate_rollouts",
    "simulate",
]

_MODULES = {
    "Fmus": "rtamt_gym.simulation.fmi",
    "Run": "rtamt_gym.simulation.run",
    "Snapshot": "rtamt_gym.mujoco.snapshots",
    "Step": "rtamt_gym.signals.signals",
    "StepMonitor": "rtamt_gym.mujoco.step_monitor",
    "StlMonitor": "rtamt_gym.wrappers.monitor",
    "StlReward": "rtamt_gym.wrappers.reward",
    "VectorStlMonitor": "rtamt_gym.wrappers.vector_monitor",
    "VectorStlReward": "rtamt_gym.wrappers.vector_reward",
    "evaluate_rollouts": "rtamt_gym.mujoco.rollouts",
    "simulate": "rtamt_gym.simulation.simulate",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any of the names above
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
