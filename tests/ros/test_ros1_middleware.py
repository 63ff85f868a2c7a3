"""The middleware of ROS 1 owes what that of ROS 2 owes, and these things of its own."""

import xmlrpc.client
from collections.abc import Iterator

import pytest
from ros_contract import MiddlewareContract, World
from ros_processes import ros


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    folder, simulated = (tmp_path_factory.mktemp(name) for name in ("ros", "simulated"))
    with ros(1, folder) as wall, ros(1, simulated) as simulation:
        with xmlrpc.client.ServerProxy(simulation.environment["ROS_MASTER_URI"]) as master:
            master.setParam("/tests", "/use_sim_time", 1)
        with World(wall, simulation) as found:
            yield found


class TestRos1Middleware(MiddlewareContract):
    pass
