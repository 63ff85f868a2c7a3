"""Signal temporal logic for simulations: Gymnasium environments under `rtamt` monitors.

Names are imported when first used: the command line monitors recorded traces without Gymnasium.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtamt_gym.mujoco import StepMonitor
    from rtamt_gym.rewards import StlReward
    from rtamt_gym.rollouts import evaluate_rollouts
    from rtamt_gym.signals import Step
    from rtamt_gym.simulation.fmi import Fmus
    from rtamt_gym.simulation.run import Run
    from rtamt_gym.simulation.simulate import simulate
    from rtamt_gym.snapshots import Snapshot
    from rtamt_gym.vector import VectorStlMonitor
    from rtamt_gym.vector_rewards import VectorStlReward
    from rtamt_gym.wrappers import StlMonitor

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
    "Snapshot": "rtamt_gym.snapshots",
    "Step": "rtamt_gym.signals",
    "StepMonitor": "rtamt_gym.mujoco",
    "StlMonitor": "rtamt_gym.wrappers",
    "StlReward": "rtamt_gym.rewards",
    "VectorStlMonitor": "rtamt_gym.vector",
    "VectorStlReward": "rtamt_gym.vector_rewards",
    "evaluate_rollouts": "rtamt_gym.rollouts",
    "simulate": "rtamt_gym.simulation.simulate",
}


def __getattr__(name: str) -> Any:  # noqa: ANN401 - any of the names above
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return [*globals(), *_MODULES]
