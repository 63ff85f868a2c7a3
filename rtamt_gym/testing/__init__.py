"""The contracts of what other packages add: trace formats, optimizers, systems.

The tests of such a package call these functions, as ours do; an `AssertionError` says what is not
kept, and by which file, points or samples.
"""

from rtamt_gym.testing.formats import check_trace_format
from rtamt_gym.testing.optimizers import check_optimizer
from rtamt_gym.testing.systems import check_system

__all__ = ["check_optimizer", "check_system", "check_trace_format"]
