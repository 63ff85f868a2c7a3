"""The released library's interface-aware monitors of dense time."""

from functools import partial

from rtamt.compat import (
    Semantics,
    StlDenseTimeOfflineSpecification,
    StlDenseTimeOnlineSpecification,
)

IAStlOutputRobustnessDenseTimeOfflineSpecification = partial(
    StlDenseTimeOfflineSpecification, Semantics.OUTPUT_ROBUSTNESS
)
IAStlOutputRobustnessDenseTimeOnlineSpecification = partial(
    StlDenseTimeOnlineSpecification, Semantics.OUTPUT_ROBUSTNESS
)
IAStlInputRobustnessDenseTimeOfflineSpecification = partial(
    StlDenseTimeOfflineSpecification, Semantics.INPUT_ROBUSTNESS
)
IAStlInputRobustnessDenseTimeOnlineSpecification = partial(
    StlDenseTimeOnlineSpecification, Semantics.INPUT_ROBUSTNESS
)
IAStlInputVacuityDenseTimeOfflineSpecification = partial(
    StlDenseTimeOfflineSpecification, Semantics.INPUT_VACUITY
)
IAStlInputVacuityDenseTimeOnlineSpecification = partial(
    StlDenseTimeOnlineSpecification, Semantics.INPUT_VACUITY
)
IAStlOutputVacuityDenseTimeOfflineSpecification = partial(
    StlDenseTimeOfflineSpecification, Semantics.OUTPUT_VACUITY
)
IAStlOutputVacuityDenseTimeOnlineSpecification = partial(
    StlDenseTimeOnlineSpecification, Semantics.OUTPUT_VACUITY
)

__all__ = [
    "IAStlInputRobustnessDenseTimeOfflineSpecification",
    "IAStlInputRobustnessDenseTimeOnlineSpecification",
    "IAStlInputVacuityDenseTimeOfflineSpecification",
    "IAStlInputVacuityDenseTimeOnlineSpecification",
    "IAStlOutputRobustnessDenseTimeOfflineSpecification",
    "IAStlOutputRobustnessDenseTimeOnlineSpecification",
    "IAStlOutputVacuityDenseTimeOfflineSpecification",
    "IAStlOutputVacuityDenseTimeOnlineSpecification",
]
