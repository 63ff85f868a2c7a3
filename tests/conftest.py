"""The same examples in every run and on every machine; ``--hypothesis-profile=search`` looks on."""

import pytest
from hypothesis import HealthCheck, settings

import rtamt

settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=100,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("search", deadline=None, max_examples=2000)
settings.load_profile("repeatable")

# Where no compiler was at hand there is one machine to test; CI requires both.
BACKENDS = ("python", "native") if rtamt.BACKEND == "native" else ("python",)


@pytest.fixture(scope="session", params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    """Every back-end that is built."""
    return str(request.param)
