"""Mutants of requirements: one change each, which a good suite of traces kills."""

from rtamt.mutation.mutants import Mutant, killed
from rtamt.mutation.mutations import MUTATIONS, Mutation

__all__ = ["MUTATIONS", "Mutant", "Mutation", "killed"]
