"""The live scenario on ROS 2."""

import pytest

pytest.register_assert_rewrite("ros_live")

from ros_live import LiveScenario  # noqa: E402 - pytest rewrites its assertions first
from ros_scenario import Run, play  # noqa: E402


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return play(2, tmp_path_factory.mktemp("live"))


class TestRos2(LiveScenario):
    pass
