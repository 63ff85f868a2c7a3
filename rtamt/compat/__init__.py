"""The classes of the released library, for programs that were written for it.

They call `rtamt.Monitor`, `rtamt.EpisodeMonitor`, `rtamt.evaluate`, `rtamt.dense.Monitor` and
`rtamt.dense.evaluate`, and return their values; docs/differences.md lists the differences to the
released library. ``rtamt.StlDiscreteTimeSpecification`` and the other classes are attributes of
`rtamt`, imported when they are first used.
"""

from functools import partial

from rtamt.compat.dense import (
    StlDenseTimeOfflineSpecification,
    StlDenseTimeOnlineSpecification,
    StlDenseTimeSpecification,
)
from rtamt.compat.discrete import (
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeSpecification,
)
from rtamt.compat.earlier import (
    LTLDiscreteTimeSpecification,
    LTLException,
    LTLNotImplementedException,
    LTLOfflineException,
    LTLParseException,
    LTLPastifyException,
    LTLSpecification,
    LTLSpecificationException,
    STLCTSpecification,
    STLDenseTimeSpecification,
    STLDiscreteTimeSpecification,
    STLException,
    STLIOCTSpecification,
    STLIOSpecification,
    STLNotImplementedException,
    STLOfflineException,
    STLParseException,
    STLSpecification,
    STLSpecificationException,
)
from rtamt.compat.options import Language, Semantics, StlIOType, TimeInterpretation
from rtamt.errors import RtamtError

__all__ = [
    "LTLDiscreteTimeSpecification",
    "LTLException",
    "LTLNotImplementedException",
    "LTLOfflineException",
    "LTLParseException",
    "LTLPastifyException",
    "LTLSpecification",
    "LTLSpecificationException",
    "Language",
    "RTAMTException",
    "STLCTSpecification",
    "STLDenseTimeSpecification",
    "STLDiscreteTimeSpecification",
    "STLException",
    "STLIOCTSpecification",
    "STLIOSpecification",
    "STLNotImplementedException",
    "STLOfflineException",
    "STLParseException",
    "STLSpecification",
    "STLSpecificationException",
    "Semantics",
    "StlDenseTimeOfflineSpecification",
    "StlDenseTimeOnlineSpecification",
    "StlDenseTimeSpecification",
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
