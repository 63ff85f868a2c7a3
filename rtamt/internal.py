"""Names that only the packages of this project use; any version may change them."""

from rtamt.inputs.groups import TraceRows, groups_of, may_separate
from rtamt.inputs.stamps import StampOrder
from rtamt.machines.clocks import ClockEvent, ClockKind, OperatorClock
from rtamt.monitors.clocks import OperatorClocks
from rtamt.monitors.explainer import explain_dense_verdict, explain_verdict
from rtamt.monitors.judgements import judgements_of
from rtamt.monitors.monitor_sets import JointFeed, JointRead, VerdictLog, joint_feed

__all__ = [
    "ClockEvent",
    "ClockKind",
    "JointFeed",
    "JointRead",
    "OperatorClock",
    "OperatorClocks",
    "StampOrder",
    "TraceRows",
    "VerdictLog",
    "explain_dense_verdict",
    "explain_verdict",
    "groups_of",
    "joint_feed",
    "judgements_of",
    "may_separate",
]
