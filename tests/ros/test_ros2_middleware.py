"""ROS 2 satisfies the contract of every middleware, and these properties of its own."""

from collections.abc import Iterator

import pytest
from ros_contract import MiddlewareContract
from ros_processes import ros
from ros_world import World


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with (
        ros(2, tmp_path_factory.mktemp("ros")) as domain,
        World(domain, domain, ["-p", "use_sim_time:=true"]) as found,
    ):
        yield found


class TestRos2Middleware(MiddlewareContract):
    pass
