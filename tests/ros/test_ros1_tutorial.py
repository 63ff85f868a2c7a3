"""The tutorial on ROS 1."""

import json

import pytest
from ros_tutorial import NEAR, LiveTutorial, Played, play_tutorial, words

from rtamt_gym.__main__ import main


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return play_tutorial(1, tmp_path_factory.mktemp("tutorial"))


class TestRos1Tutorial(LiveTutorial):
    def test_the_bag_of_the_page_is_checked(
        self, played: Played, capsys: pytest.CaptureFixture[str]
    ) -> None:
        command = words("rtamt monitor examples/follows.stl run.bag")
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(played.folder)
            assert main([*command, "--json"]) == 1
        (trial,) = json.loads(capsys.readouterr().out)["trials"]
        robustness = trial["outcomes"]["follows"]["robustness"]
        assert robustness == pytest.approx(min(played.heard[NEAR]), abs=0.05)
