"""Mutants of requirements: one change each, which a good suite of traces kills."""

from typing import TYPE_CHECKING

from rtamt.lazy import lazy_names
from rtamt.mutation.mutations import MUTATIONS, Mutation

if TYPE_CHECKING:
    from rtamt.mutation.mutants import Mutant as Mutant
    from rtamt.mutation.mutants import killed as killed
else:
    _NAMES = ("Mutant", "killed")  # they need the monitors, and the names of mutations do not
    __getattr__ = lazy_names(__name__, {name: f"{__name__}.mutants.{name}" for name in _NAMES})

__all__ = ["MUTATIONS", "Mutant", "Mutation", "killed"]
