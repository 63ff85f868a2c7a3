"""The objects that users call: monitors, evaluations of traces, explanations."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.monitors.evidence import Evidence, TriggerCount, Unrecorded
    from rtamt.monitors.explanation import Contribution
    from rtamt.monitors.judgement import Implications
    from rtamt.monitors.judgements import Judgements, TriggerColumns
    from rtamt.monitors.occurrences import (
        BodyOccurrences,
        Occurrence,
        Occurrences,
        Response,
        RunTable,
        UnknownRun,
    )

__all__ = [
    "BodyOccurrences",
    "Contribution",
    "Evidence",
    "Implications",
    "Judgements",
    "Occurrence",
    "Occurrences",
    "Response",
    "RunTable",
    "TriggerColumns",
    "TriggerCount",
    "UnknownRun",
    "Unrecorded",
]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Unrecorded": "rtamt.monitors.evidence.Unrecorded",
            "Contribution": "rtamt.monitors.explanation.Contribution",
            "Evidence": "rtamt.monitors.evidence.Evidence",
            "Implications": "rtamt.monitors.judgement.Implications",
            "Judgements": "rtamt.monitors.judgements.Judgements",
            "TriggerColumns": "rtamt.monitors.judgements.TriggerColumns",
            **{
                name: f"rtamt.monitors.occurrences.{name}"
                for name in (
                    "BodyOccurrences",
                    "Occurrence",
                    "Occurrences",
                    "Response",
                    "RunTable",
                    "UnknownRun",
                )
            },
            "TriggerCount": "rtamt.monitors.evidence.TriggerCount",
        },
    )
