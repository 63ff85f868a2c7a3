"""A monitor, a robot with blocked wheels, and the screen of its requirement."""

from __future__ import annotations

import re
from pathlib import Path

from paths import ROOT
from ros_processes import patiently, ros

ON_TERMINAL = """
import os, pty, sys
os.environ["TERM"], os.environ["NO_COLOR"] = "xterm", "1"
pty.spawn([sys.executable, "-m", "rtamt_ros.screen", "--ros", sys.argv[1], "--topic", "rtamt/all"])
"""


def screen_of_robot(generation: int, folder: Path) -> str:
    """Return the text on the terminal without control sequences, until the violation."""

    def text() -> str:
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.output)

    which = ["--ros", str(generation)]
    with ros(generation, folder) as own:
        screen = own.start("-c", ON_TERMINAL, str(generation), name="screen")
        spec = str(ROOT / "examples" / "follows.stl")
        combined = ["--combined", "rtamt/all"]
        own.start("-m", "rtamt_ros", *which, "--stl", spec, *combined, name="monitor")
        own.start("-m", "rtamt_ros.simulator", *which, "--stuck", "1:20", name="robot")
        patiently(lambda: re.search(r"follows +VIOLATED", text()) is not None)
        return text()
