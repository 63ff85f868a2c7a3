"""The number of examples of a property, under the profile in use."""

import math

from hypothesis import settings


def examples(count: int) -> int:
    """Return `count`, or a share of it under a profile with fewer examples than `repeatable`.

    A profile with more examples does not raise `count`: these examples are slow.
    """
    share = settings().max_examples / settings.get_profile("repeatable").max_examples
    return math.ceil(count * min(share, 1.0))
