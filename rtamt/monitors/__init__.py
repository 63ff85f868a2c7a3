"""The objects that users call: monitors, evaluations of traces, explanations."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.monitors.explanation import Contribution
    from rtamt.monitors.implications import Implications
    from rtamt.monitors.judgements import Judgements, TriggerColumns
    from rtamt.monitors.triggers import Evidence, TriggerCount
    from rtamt.monitors.unrecorded import Unrecorded

__all__ = [
    "Contribution",
    "Evidence",
    "Implications",
    "Judgements",
    "TriggerColumns",
    "TriggerCount",
    "Unrecorded",
]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Unrecorded": "rtamt.monitors.unrecorded.Unrecorded",
            "Contribution": "rtamt.monitors.explanation.Contribution",
            "Evidence": "rtamt.monitors.triggers.Evidence",
            "Implications": "rtamt.monitors.implications.Implications",
            "Judgements": "rtamt.monitors.judgements.Judgements",
            "TriggerColumns": "rtamt.monitors.judgements.TriggerColumns",
            "TriggerCount": "rtamt.monitors.triggers.TriggerCount",
        },
    )
