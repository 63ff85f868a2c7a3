"""The live scenario on ROS 1."""

import pytest
from ros_live import LiveScenario, inputs_of, judge
from ros_messages import write_bag
from ros_scenario import FOLLOWS, Run, play


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return play(1, tmp_path_factory.mktemp("live"))


class TestRos1(LiveScenario):
    def test_the_stamped_message_is_that_of_the_paper(self, run: Run) -> None:
        found = {(each.kind, each.md5) for each in run.heard[FOLLOWS]}
        assert found == {("rtamt_msgs/FloatStamped", "d053817de0764f9ee90dbc89c4cdd751")}

    def test_a_bag_of_ros_1_gets_the_same_verdicts(
        self, run: Run, capsys: pytest.CaptureFixture[str]
    ) -> None:
        judge(run, write_bag(inputs_of(run), run.folder / "run.bag"), capsys)
