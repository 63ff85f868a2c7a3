"""Monitors over dense time, whose inputs are events at any times; no period is needed.

Each name corresponds to the same name in `rtamt`, which is for samples.
"""

from rtamt.inputs.events import Events
from rtamt.monitors.dense_monitor import DenseEpisodeMonitor as EpisodeMonitor
from rtamt.monitors.dense_monitor import DenseMonitor as Monitor
from rtamt.monitors.evaluation import evaluate_dense as evaluate
from rtamt.monitors.evidence import DenseTriggerCount as TriggerCount
from rtamt.monitors.explainer import explain_dense as explain
from rtamt.monitors.explanation import DenseExplanation as Explanation
from rtamt.monitors.judgement import DenseImplications as Implications
from rtamt.monitors.judgement import judge_dense as judge
from rtamt.monitors.occurrences import occurrences_dense as occurrences

__all__ = [
    "EpisodeMonitor",
    "Events",
    "Explanation",
    "Implications",
    "Monitor",
    "TriggerCount",
    "evaluate",
    "explain",
    "judge",
    "occurrences",
]
