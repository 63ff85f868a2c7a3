"""ROS 2 satisfies the contract of a monitor among robots."""

from collections.abc import Iterator

import pytest
from robot_contract import RobotContract
from ros_processes import ros
from ros_world import World
from verdict_contract import VerdictContract


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with (
        ros(2, tmp_path_factory.mktemp("ros")) as middleware,
        World(middleware, middleware) as found,
    ):
        yield found


class TestRos2Robots(RobotContract):
    pass


class TestRos2Verdicts(VerdictContract):
    pass
