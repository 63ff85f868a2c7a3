"""The released library's interface-aware monitors of dense time."""

from rtamt.compat import (
    Semantics,
    StlDenseTimeOfflineSpecification,
    StlDenseTimeOnlineSpecification,
)
from rtamt.compat.specification import interface_aware

globals().update(
    interface_aware(
        "DenseTime",
        Offline=StlDenseTimeOfflineSpecification,
        Online=StlDenseTimeOnlineSpecification,
    )
)
