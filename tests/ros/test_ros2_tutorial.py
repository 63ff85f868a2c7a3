"""The tutorial on ROS 2."""

import math

import pytest
from ros_tutorial import NEAR, LiveTutorial, Played, play_tutorial


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return play_tutorial(2, tmp_path_factory.mktemp("tutorial"))


class TestRos2Tutorial(LiveTutorial):
    def test_the_program_of_the_page_shows_the_topic(self, played: Played) -> None:
        shown = [float(line) for line in played.watched.splitlines()]
        assert len(shown) > 50
        known = set(played.heard[NEAR])
        assert {each for each in shown if not math.isnan(each)} <= known
        assert min(shown) < -0.5
