"""The tutorial on ROS 1."""

import pytest
from ros_tutorial import LiveTutorial, Played, play_tutorial


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return play_tutorial(1, tmp_path_factory.mktemp("tutorial"))


class TestRos1Tutorial(LiveTutorial):
    pass
