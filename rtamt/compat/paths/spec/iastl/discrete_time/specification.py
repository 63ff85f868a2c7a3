"""The released library's interface-aware monitors of samples."""

from rtamt.compat import (
    Language,
    Semantics,
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeSpecification,
    TimeInterpretation,
)
from rtamt.compat.specification import interface_aware

IASTLDiscreteTimeSpecification = StlDiscreteTimeSpecification
globals().update(
    interface_aware(
        "DiscreteTime",
        Offline=StlDiscreteTimeOfflineSpecification,
        Online=StlDiscreteTimeOnlineSpecification,
    )
)
