"""Hypothesis draws the same examples everywhere, others with ``--hypothesis-profile=nightly``."""

from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, Phase, settings

import rtamt

# Tests and fixtures that two files have in common.
pytest.register_assert_rewrite(
    "array_contract", "ros_contract", "ros_live", "ros_tutorial", "ros2_client"
)

# Every run repeats the same few examples; those of a night are many, and others each time. A
# property whose examples are slow has a number of its own, in both.
settings.register_profile(
    "repeatable",
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=50,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "nightly",
    settings.get_profile("repeatable"),
    derandomize=False,
    max_examples=1000,
    print_blob=True,
)
# Sanitizers look at memory: a tenth of the time, and each path of the machines still comes.
settings.register_profile("sanitized", settings.get_profile("repeatable"), max_examples=15)
# A mutant is killed by the first example that fails, however long the example is; hundreds of
# mutants are tried.
settings.register_profile(
    "mutation",
    settings.get_profile("repeatable"),
    max_examples=20,
    phases=[Phase.explicit, Phase.generate],
)
settings.load_profile("repeatable")

# Without a compiler there is one back-end to test; CI requires both.
BACKENDS = ("python", "native") if rtamt.BACKEND == "native" else ("python",)


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """The whole suite runs on every core; tests that were chosen start no workers."""
    return None if config.args_source is pytest.Config.ArgsSource.TESTPATHS else 0


@pytest.hookimpl(tryfirst=True)
def pytest_make_collect_report(collector: pytest.Collector) -> pytest.CollectReport | None:
    """Where ROS is missing, each file of its tests fails with how to install it."""
    if collector.path.name.startswith(("test_ros1", "test_ros2")):
        from ros_processes import missing

        if install := missing(int(collector.path.name[8])):
            if type(collector) is not pytest.Module:  # the collector of doctests
                return pytest.CollectReport(collector.nodeid, "passed", None, [])
            return pytest.CollectReport(collector.nodeid, "failed", install, [])
    return None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--backend", choices=BACKENDS, help="leave out the tests that run another back-end alone"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    only = config.getoption("--backend")
    if only is None:
        return
    run = {item: _backend_of(item) in {None, only} for item in items}
    config.hook.pytest_deselected(items=[item for item in items if not run[item]])
    items[:] = [item for item in items if run[item]]


def _backend_of(item: pytest.Item) -> str | None:
    """The back-end that a test is parametrized with; None: it is not, or compares them."""
    params = (
        item.callspec.params
        if isinstance(item, pytest.Function) and hasattr(item, "callspec")
        else {}
    )
    backend: object = params.get("backend")
    return None if backend is None else str(backend)


@pytest.fixture(scope="session", params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    """Every back-end that is built."""
    return str(request.param)


@pytest.fixture(scope="module")
def doubles() -> Iterator[None]:
    """JAX with float64, which it has on demand; it is installed for its own tests alone."""
    import jax

    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - its only form
    yield
    jax.config.update("jax_enable_x64", before)
