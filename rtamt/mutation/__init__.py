"""Mutants of requirements: one change each, which a good suite of traces kills."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names

if TYPE_CHECKING:
    from rtamt.mutation.mutants import Mutant, killed
    from rtamt.mutation.mutations import MUTATIONS, Mutation

__all__ = [
    "MUTATIONS",
    "Mutant",
    "Mutation",
    "killed",
]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__,
        {
            "MUTATIONS": "rtamt.mutation.mutations.MUTATIONS",
            "Mutant": "rtamt.mutation.mutants.Mutant",
            "Mutation": "rtamt.mutation.mutations.Mutation",
            "killed": "rtamt.mutation.mutants.killed",
        },
    )
