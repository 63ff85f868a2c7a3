"""The classes of the released library, for programs that were written for it.

They are names over `rtamt.Monitor`, `rtamt.EpisodeMonitor`, `rtamt.evaluate`, `rtamt.DenseMonitor`
and `rtamt.evaluate_dense`, and have their values; docs/differences.md says where those are not what
the released library gave. ``rtamt.StlDiscreteTimeSpecification`` and all the others are attributes
of `rtamt`, loaded when first asked for.
"""

from functools import partial

from rtamt.compat.discrete import (
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeSpecification,
)
from rtamt.compat.options import Language, Semantics, StlIOType, TimeInterpretation
from rtamt.errors import RtamtError

__all__ = [
    "Language",
    "RTAMTException",
    "Semantics",
    "StlDiscreteTimeOfflineSpecification",
    "StlDiscreteTimeOnlineSpecification",
    "StlDiscreteTimeOnlineSpecificationCpp",
    "StlDiscreteTimeSpecification",
    "StlIOType",
    "TimeInterpretation",
]

RTAMTException = RtamtError
StlDiscreteTimeOnlineSpecificationCpp = partial(
    StlDiscreteTimeOnlineSpecification, language=Language.CPP
)
