"""Monitors over dense time, whose inputs are events at any times; no period is needed.

The names mean what the same names of `rtamt` mean for samples.
"""

from rtamt.inputs.events import Events
from rtamt.monitors.dense import DenseMonitor as Monitor
from rtamt.monitors.dense import evaluate_dense as evaluate
from rtamt.monitors.dense_asked import DenseAsked as TriggerCount
from rtamt.monitors.dense_episode import DenseEpisodeMonitor as EpisodeMonitor
from rtamt.monitors.dense_explanation import DenseExplanation as Explanation
from rtamt.monitors.dense_explanation import explain_dense as explain
from rtamt.monitors.dense_judgement import judge_dense as judge
from rtamt.monitors.evidence import DenseImplications as Implications

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
]
