"""The module of the released library's classes for dense time."""

from rtamt.compat import (
    Language,
    Semantics,
    StlDenseTimeOfflineSpecification,
    StlDenseTimeOnlineSpecification,
    StlDenseTimeSpecification,
    TimeInterpretation,
)
