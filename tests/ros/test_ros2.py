"""The live scenario on ROS 2."""

import pytest
from ros_live import LiveScenario
from ros_scenario import Run, play


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return play(2, tmp_path_factory.mktemp("live"))


class TestRos2(LiveScenario):
    pass
