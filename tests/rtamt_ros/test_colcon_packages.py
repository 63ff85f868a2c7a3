"""The colcon packages match the Python package that they start."""

import configparser
import os
import re
import shutil
import subprocess
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

import pytest
from paths import ROOT

from rtamt_ros.parameters import PARAMETERS

PACKAGES = ROOT / "ros"
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


@pytest.mark.parametrize("package", ["rtamt_ros", "rtamt_msgs"])
def test_package_name_and_version(package: str) -> None:
    manifest = ET.parse(PACKAGES / package / "package.xml").getroot()  # noqa: S314 - our own file
    assert (manifest.findtext("name"), manifest.findtext("version")) == (package, VERSION)


def test_setup_installs_every_file() -> None:
    folder = PACKAGES / "rtamt_ros"
    setup = (folder / "setup.py").read_text()
    assert f'version="{VERSION}"' in setup
    named = set(
        re.findall(
            r'"((?:config|launch|layouts|resource|scripts|systemd)/[^"]+|package\.xml)"', setup
        )
    )
    files = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    of_ros1 = {name for name in files if name.startswith("ros1/")}
    assert named == files - of_ros1 - {"setup.py", "setup.cfg"}


def test_scripts_use_the_active_python() -> None:
    setup = configparser.ConfigParser()
    setup.read(PACKAGES / "rtamt_ros/setup.cfg")
    assert setup["build_scripts"]["executable"] == "/usr/bin/env python3"


def test_the_file_of_parameters_says_their_defaults() -> None:
    text = (PACKAGES / "rtamt_ros/config/stl_monitor.yaml").read_text()
    found = dict(re.findall(r"^    (\w+): (\S+)", text, re.MULTILINE))
    assert found.pop("stale") == "0.5"  # five periods of 100 ms
    assert found == {
        name: str(PARAMETERS[name][0]).lower()
        for name in ("period", "unit", "stamps", "qos", "autostart")
    }


def test_launched_specification_is_the_example() -> None:
    launched = PACKAGES / "rtamt_ros/config/follows.stl"
    assert launched.read_text() == (ROOT / "examples/follows.stl").read_text()


def test_both_stamped_messages_have_equal_fields() -> None:
    for name in ("FloatStamped", "FloatMessage"):
        text = (PACKAGES / f"rtamt_msgs/msg/{name}.msg").read_text()
        fields = [line for line in text.splitlines() if not line.startswith("#")]
        assert fields == ["std_msgs/Header header", "float64 value"]


NEEDED = ("ament_cmake", "rosidl_default_generators", "std_msgs")
STANDS_FOR_ROS = """
function(rosidl_generate_interfaces)
  message(STATUS "made of ${ARGN}")
endfunction()
macro(ament_export_dependencies)
endmacro()
macro(ament_package)
endmacro()
"""


def configured(folder: Path, there: Collection[str]) -> subprocess.CompletedProcess[str]:
    """Return the output of CMake for rtamt_msgs with these packages installed."""
    for name in there:
        (folder / f"{name}Config.cmake").write_text(STANDS_FOR_ROS)
    places = [f"-D{name}_DIR={folder}" for name in there]
    absent = [f"-DCMAKE_DISABLE_FIND_PACKAGE_{name}=ON" for name in {*NEEDED} - {*there}]
    where = ["-S", str(PACKAGES / "rtamt_msgs"), "-B", str(folder / "build"), "-G", "Ninja"]
    return subprocess.run(
        [shutil.which("cmake") or "cmake", *where, *places, *absent],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "AMENT_PREFIX_PATH": ""},
    )


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("absent", NEEDED)
def test_error_without_ros_2_explains_the_build(absent: str, tmp_path: Path) -> None:
    found = configured(tmp_path, [each for each in NEEDED if each != absent])
    assert found.returncode == 1
    said = " ".join(found.stderr.split())
    assert (
        "rtamt_msgs needs ament_cmake, rosidl_default_generators and std_msgs of ROS 2, found no "
        f"{absent}."
    ) in said
    assert "colcon build --base-paths ros --packages-skip rtamt_msgs" in said


def test_with_ros_2_both_messages_are_made(tmp_path: Path) -> None:
    found = configured(tmp_path, NEEDED)
    assert found.returncode == 0, found.stderr
    assert "made of rtamt_msgs;msg/FloatMessage.msg;msg/FloatStamped.msg;" in found.stdout
