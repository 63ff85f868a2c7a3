"""The objects that users call: monitors, evaluations of traces, explanations."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.monitors.asked import Asked as TriggerCount
    from rtamt.monitors.asked import Evidence
    from rtamt.monitors.evidence import Implications

__all__ = [
    "Evidence",
    "Implications",
    "TriggerCount",
]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Evidence": "rtamt.monitors.asked.Evidence",
            "Implications": "rtamt.monitors.evidence.Implications",
            "TriggerCount": "rtamt.monitors.asked.Asked",
        },
    )
