"""The objects that users call: monitors, evaluations of traces, explanations."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.monitors.implications import Implications
    from rtamt.monitors.triggers import Asked as TriggerCount
    from rtamt.monitors.triggers import Evidence

__all__ = ["Evidence", "Implications", "TriggerCount"]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Evidence": "rtamt.monitors.triggers.Evidence",
            "Implications": "rtamt.monitors.implications.Implications",
            "TriggerCount": "rtamt.monitors.triggers.Asked",
        },
    )
