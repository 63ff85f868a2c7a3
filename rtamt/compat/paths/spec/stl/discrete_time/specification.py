"""The module of the released library's classes for samples."""

from rtamt.compat import (
    Language,
    Semantics,
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeOnlineSpecificationCpp,
    StlDiscreteTimeSpecification,
    TimeInterpretation,
)
