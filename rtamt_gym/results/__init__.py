"""Results of runs and traces: their types, one file format, and tables."""

from typing import TYPE_CHECKING

from rtamt_gym.checks.extras import lazy_names

if TYPE_CHECKING:
    from rtamt_gym.evaluation.comparison import Comparison
    from rtamt_gym.evaluation.evaluation import Evaluation
    from rtamt_gym.evaluation.methods import MethodComparison
    from rtamt_gym.mujoco.snapshots import Snapshot
    from rtamt_gym.play.history import History
    from rtamt_gym.play.record import Record
    from rtamt_gym.play.run import Run
    from rtamt_gym.play.saved_case import SavedCase
    from rtamt_gym.results.outcome import Outcome
    from rtamt_gym.results.statistics import RequirementResult
    from rtamt_gym.search.falsification.falsification import Falsification
    from rtamt_gym.search.mining.mining import Mined
    from rtamt_gym.search.sweeps.sweep import Sweep

__all__ = [
    "Comparison",
    "Evaluation",
    "Falsification",
    "History",
    "MethodComparison",
    "Mined",
    "Outcome",
    "Record",
    "RequirementResult",
    "Run",
    "SavedCase",
    "Snapshot",
    "Sweep",
]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Outcome": "rtamt_gym.results.outcome.Outcome",
            "History": "rtamt_gym.play.history.History",
            "Comparison": "rtamt_gym.evaluation.comparison.Comparison",
            "Evaluation": "rtamt_gym.evaluation.evaluation.Evaluation",
            "Falsification": "rtamt_gym.search.falsification.falsification.Falsification",
            "MethodComparison": "rtamt_gym.evaluation.methods.MethodComparison",
            "Mined": "rtamt_gym.search.mining.mining.Mined",
            "Record": "rtamt_gym.play.record.Record",
            "RequirementResult": "rtamt_gym.results.statistics.RequirementResult",
            "Run": "rtamt_gym.play.run.Run",
            "SavedCase": "rtamt_gym.play.saved_case.SavedCase",
            "Snapshot": "rtamt_gym.mujoco.snapshots.Snapshot",
            "Sweep": "rtamt_gym.search.sweeps.sweep.Sweep",
        },
    )
