"""The screen shows the requirement of a robot on ROS 1."""

import re
from pathlib import Path

from ros_screen import screen_of_robot


def test_the_screen_shows_a_violation(tmp_path: Path) -> None:
    text = screen_of_robot(1, tmp_path)
    assert re.search(r"/rtamt/all, \d+ messages, at \d\S* s, last message \d\.\d s ago", text)
    assert re.search(r"follows +VIOLATED +-0\.\d+ +-inf \.\. -0\.\d+ +.*X", text)
