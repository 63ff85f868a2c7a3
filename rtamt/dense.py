"""Monitors over dense time, whose inputs are events at any times; no period is needed.

The names mean what the same names of `rtamt` mean for samples.
"""

from rtamt.inputs.events import Events
from rtamt.monitors.dense import DenseMonitor as Monitor
from rtamt.monitors.dense import evaluate_dense as evaluate
from rtamt.monitors.dense_episode import DenseEpisodeMonitor as EpisodeMonitor
from rtamt.monitors.explainer import explain_dense as explain
from rtamt.monitors.explanation import DenseExplanation as Explanation
from rtamt.monitors.implications import DenseImplications as Implications
from rtamt.monitors.judgement import judge_dense as judge
from rtamt.monitors.triggers import DenseAsked as TriggerCount

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
