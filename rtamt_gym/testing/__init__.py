"""The contracts of trace formats, optimizers and systems of other packages.

The tests of such a package call these functions; an `AssertionError` states the broken claim.
"""

from rtamt_gym.testing.contracts import check_optimizer, check_system, check_trace_format

__all__ = ["check_optimizer", "check_system", "check_trace_format"]
