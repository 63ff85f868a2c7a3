"""The language: operators, formulas, specifications and their text."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.language.ids import RequirementId
    from rtamt.language.publications import Publication
    from rtamt.language.subscriptions import SubscribedField, Subscription
    from rtamt.language.template import SpecificationTemplate

__all__ = [
    "Publication",
    "RequirementId",
    "SpecificationTemplate",
    "SubscribedField",
    "Subscription",
]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "Publication": "rtamt.language.publications.Publication",
            "RequirementId": "rtamt.language.ids.RequirementId",
            "SpecificationTemplate": "rtamt.language.template.SpecificationTemplate",
            "SubscribedField": "rtamt.language.subscriptions.SubscribedField",
            "Subscription": "rtamt.language.subscriptions.Subscription",
        },
    )
