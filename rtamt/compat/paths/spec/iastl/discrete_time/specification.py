"""The released library's interface-aware monitors of samples."""

from functools import partial

from rtamt.compat import (
    Language,
    Semantics,
    StlDiscreteTimeOfflineSpecification,
    StlDiscreteTimeOnlineSpecification,
    StlDiscreteTimeSpecification,
    TimeInterpretation,
)

IASTLDiscreteTimeSpecification = StlDiscreteTimeSpecification

IAStlOutputRobustnessDiscreteTimeOfflineSpecification = partial(
    StlDiscreteTimeOfflineSpecification, Semantics.OUTPUT_ROBUSTNESS
)
IAStlOutputRobustnessDiscreteTimeOnlineSpecification = partial(
    StlDiscreteTimeOnlineSpecification, Semantics.OUTPUT_ROBUSTNESS
)
IAStlInputRobustnessDiscreteTimeOfflineSpecification = partial(
    StlDiscreteTimeOfflineSpecification, Semantics.INPUT_ROBUSTNESS
)
IAStlInputRobustnessDiscreteTimeOnlineSpecification = partial(
    StlDiscreteTimeOnlineSpecification, Semantics.INPUT_ROBUSTNESS
)
IAStlInputVacuityDiscreteTimeOfflineSpecification = partial(
    StlDiscreteTimeOfflineSpecification, Semantics.INPUT_VACUITY
)
IAStlInputVacuityDiscreteTimeOnlineSpecification = partial(
    StlDiscreteTimeOnlineSpecification, Semantics.INPUT_VACUITY
)
IAStlOutputVacuityDiscreteTimeOfflineSpecification = partial(
    StlDiscreteTimeOfflineSpecification, Semantics.OUTPUT_VACUITY
)
IAStlOutputVacuityDiscreteTimeOnlineSpecification = partial(
    StlDiscreteTimeOnlineSpecification, Semantics.OUTPUT_VACUITY
)

__all__ = [
    "IASTLDiscreteTimeSpecification",
    "IAStlInputRobustnessDiscreteTimeOfflineSpecification",
    "IAStlInputRobustnessDiscreteTimeOnlineSpecification",
    "IAStlInputVacuityDiscreteTimeOfflineSpecification",
    "IAStlInputVacuityDiscreteTimeOnlineSpecification",
    "IAStlOutputRobustnessDiscreteTimeOfflineSpecification",
    "IAStlOutputRobustnessDiscreteTimeOnlineSpecification",
    "IAStlOutputVacuityDiscreteTimeOfflineSpecification",
    "IAStlOutputVacuityDiscreteTimeOnlineSpecification",
    "Language",
    "Semantics",
    "TimeInterpretation",
]
