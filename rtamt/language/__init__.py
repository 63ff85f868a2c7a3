"""The language: operators, formulas, specifications and their text."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.language.declarations import RequirementId
    from rtamt.language.parser import SpecificationTemplate
    from rtamt.language.topics import Publication, SubscribedField, Subscription

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
            "Publication": "rtamt.language.topics.Publication",
            "RequirementId": "rtamt.language.declarations.RequirementId",
            "SpecificationTemplate": "rtamt.language.parser.SpecificationTemplate",
            "SubscribedField": "rtamt.language.topics.SubscribedField",
            "Subscription": "rtamt.language.topics.Subscription",
        },
    )
